"""A log prepared for passes over it: opened and checked, with the inputs of a scene found in it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.channels import kind_of, make_message_reader
from geomphys.recording.clock_agreement import check_clock_agreement, log_times_agree
from geomphys.recording.input_plan import Plan, make_plan
from geomphys.recording.input_problems import input_problems, without_lost_points
from geomphys.recording.message_times import MessageTimes
from geomphys.recording.pose_tuples import PoseTuple
from geomphys.recording.reader import LogReader, open_log
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.stream_prescan import prescan_streams
from geomphys.recording.transform_plan import plan_transforms
from geomphys.scene.arrays import JOINT_PRISMATIC
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath


class PreparedLog:
    """An open log with the plan of its inputs, what a first reading found, and the transforms to the recorded space.

    Parameters and errors are those of `geomphys.recording.frames.FrameSource`.
    """

    def __init__(self, log: AnyPath, world: World, config: Config) -> None:
        self.world, self.config = world, config
        self.reader: LogReader = open_log(log, recover=config.recover)
        self.plan: Plan = make_plan(self.reader, world, config)
        if self.plan.problems:
            more = len(self.plan.problems) - 1
            more_text = f" (and {more} more; `geomphys check` lists them)" if more else ""
            raise LogError(self.plan.problems[0] + more_text)
        self.times = MessageTimes(config.time, self.reader.channels, self.reader.path)
        self.prescan = prescan_streams(self.reader, self.plan, config, self.times)
        if config.time != "log":
            check_clock_agreement(self.reader, self.plan, self.prescan, config)
        problem = next(input_problems(self.reader, self.plan, self.prescan), None)
        if problem is not None:
            raise LogError(problem)
        without_lost_points(self.plan, self.prescan)
        recorded = world.facts.recording
        self.space = RecordedSpace.from_table(recorded)
        self.transforms = plan_transforms(self.reader, self.plan, self.prescan, recorded.frame)
        for key in self.transforms.keys - set(self.prescan.readers):
            channel = self.reader.channels[key]
            if (kind := kind_of(channel)) is not None:
                self.prescan.readers[key] = make_message_reader(channel, kind)
        self.first_space_poses: dict[
            tuple[str, str], PoseTuple
        ] = {}  # of poses in frames that move: the first in the recorded space
        self.file_order = not log_times_agree(self.prescan, round(config.max_delay * 1e9))
        self.prismatic = prismatic_columns(world)

    @property
    def topics(self) -> tuple[str, ...]:
        """Topics that are used, sorted."""
        return tuple(sorted({self.reader.channels[k].topic for k in self.plan.keys | self.transforms.keys}))


@lru_cache(maxsize=1)
def prismatic_columns(world: World) -> NDArray[np.bool_]:
    """(Q,) mask of prismatic degrees of freedom, whose values are lengths."""
    bodies = world.scene.bodies
    prismatic = np.zeros(len(world.scene.dofs.lower), dtype=bool)
    own = (bodies.dof >= 0) & (bodies.multiplier == 1) & (bodies.offset == 0)
    for dof in range(len(prismatic)):
        candidates = np.flatnonzero(own & (bodies.dof == dof))
        if len(candidates) == 0:
            candidates = np.flatnonzero(bodies.dof == dof)
        if len(candidates):
            prismatic[dof] = bodies.joint[candidates[0]] == JOINT_PRISMATIC
    return prismatic
