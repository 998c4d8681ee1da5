"""Checks whether a log can be replayed in a scene and reports what a replay will encounter (``geomphys check``).

The check makes all the frames that a replay would, without stepping the scene: gaps, held frames and limits are
what a replay will meet.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from geomphys.config import Config
from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.diagnostics import Diagnostic, as_records
from geomphys.recording.frames import FrameSource
from geomphys.recording.input_plan import JointInput, Plan, make_plan
from geomphys.recording.reader import open_log
from geomphys.recording.recorded_space import RecordedSpace
from geomphys.recording.report import RecordingReport
from geomphys.recording.stamps import WRITABLE_TIMES
from geomphys.scene.findings import Findings
from geomphys.scene.scene_facts import RecordingFacts
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath, as_path


@dataclass(frozen=True)
class PoseMapping:
    """A tree's root and the topic that it follows."""

    tree: str
    topic: str  # `topic` or `topic#child`
    schema: str
    encoding: str
    messages: int


@dataclass(frozen=True)
class JointMapping:
    """A joint of the scene and its recorded joint."""

    tree: str
    joint: str
    topic: str
    recorded: str
    unit: str  # of the recorded values: rad, deg or m


@dataclass(frozen=True)
class SpaceReport:
    """How the scene file describes the space of the recording (`[recording]`)."""

    up: str
    unit: str
    position: tuple[float, ...]  # m, of its origin in the world
    orientation: tuple[float, ...]  # x y z w of its axes in the world, `up` included


@dataclass(frozen=True)
class CheckReport:
    """The result of a check. `errors` prevent a replay, `warnings` do not."""

    log: str
    scene: str
    errors: tuple[str, ...]
    warnings: tuple[str, ...]
    clock: str | None  # topic of the frame clock; None: the log's time span
    poses: tuple[PoseMapping, ...]
    joints: tuple[JointMapping, ...]
    recording: RecordingReport | None  # None if no frame can be made
    zero_pose_overlaps: tuple[tuple[str, str], ...]  # pairs of bodies that are left out for that
    findings: Findings  # about the scene: hidden or non-colliding geometry, renamed bodies, defaults used
    space: SpaceReport | None = None  # None: that of the world, in metres
    keypoint_scale: dict[str, dict[str, float]] = field(default_factory=dict)  # avatar -> finger -> factor of lengths

    def as_dict(self) -> dict[str, Any]:
        """All of it as plain values, as in `CheckRecord`."""
        return {**dataclasses.asdict(self), "diagnostics": as_records(self.errors, self.warnings)}


@dataclass(frozen=True)
class CheckRecord(CheckReport):
    """A `CheckReport` as it is in JSON."""

    diagnostics: tuple[dict[str, str], ...] = ()  # errors and warnings: key, level, text


def check_log(log: AnyPath | str, world: World, config: Config | None = None) -> CheckReport:
    """Check whether `log` can be replayed in `world`.

    Parameters
    ----------
    log : Path or str
        An MCAP file or a ROS 2 bag directory. What is intact of a damaged one is checked; that it is damaged is an
        error unless `config.recover` is set.
    world : World
    config : Config, optional
        As for the replay.

    Raises
    ------
    LogError
        The log cannot be read at all.
    """
    log, config = as_path(log), config or Config()
    errors: list[str] = []
    try:
        reader = open_log(log, recover=config.recover)
    except DamagedLogError as problem:
        errors.append(Diagnostic(str(problem), "damaged"))
        config = dataclasses.replace(config, recover=True)
        reader = open_log(log, recover=True)
    plan = make_plan(reader, world, config)
    errors += [Diagnostic(problem, "input") for problem in plan.problems]
    recording, mapped = None, tuple[JointMapping, ...]()
    if not plan.problems:
        try:
            recording, mapped = _scan_frames(log, world, config)
        except LogError as problem:
            errors.append(Diagnostic(str(problem), "input"))
    if recording is not None and recording.frames == 0:
        errors.append(Diagnostic(f"{log}: gives no frame", "no_frames"))
    return CheckReport(
        log=str(log),
        scene=str(world.path),
        errors=tuple(errors),
        warnings=(
            *(recording.warnings if recording is not None else ()),
            *world.findings.warnings,
            *_rpy_warnings(world),
        ),
        clock=_clock(plan),
        poses=tuple(_poses(plan, world)),
        joints=mapped,
        recording=recording,
        zero_pose_overlaps=world.zero_pose_overlaps,
        space=_space(world.facts.recording),
        findings=world.findings,
        keypoint_scale=world.keypoint_scale,
    )


def _scan_frames(log: AnyPath, world: World, config: Config) -> tuple[RecordingReport, tuple[JointMapping, ...]]:
    """Make all frames; returns their report and the joint mappings."""
    with FrameSource(log, world, config) as source:
        for frame in source:
            if frame.time_ns not in WRITABLE_TIMES:
                raise LogError(
                    f"{log}: frame {frame.index}: the time {frame.time_ns / 1e9} s cannot be written to an output, it must "
                    "lie between 0 (1970) and 2**31 s (2038); shift the log's clock"
                )
        names = {i.topic: source.prescan.names.get(i.topic, set()) for i in source.plan.joints}
        prismatic = source.prismatic
        mapped = [
            JointMapping(
                tree=world.tree_names[i.source.tree],
                joint=world.dof_names[column],
                topic=i.topic,
                recorded=name,
                unit="m" if prismatic[column] else "deg" if i.degrees else "rad",
            )
            for i in source.plan.joints
            for name, column in _recorded_joints(i, names[i.topic])
        ]
        return source.report, tuple(mapped)


def _recorded_joints(source: JointInput, names: set[str]) -> list[tuple[str, int]]:
    """Recorded joints of a topic that feed a tree, in the order of its angles."""
    found = [(n, c) for n, c in source.recorded_names().items() if n in names]
    return sorted(found, key=lambda item: item[1])


def _rpy_warnings(world: World) -> Iterator[str]:
    """Warnings on `rpy` angles that look like radians (multiples of pi / 12)."""
    file = world.file
    tables = [("recording", file.recording.rpy)]
    tables += [(f"object {table.name!r}", table.rpy) for table in file.object]
    tables += [(f"the root of avatar {table.name!r}", table.root.rpy) for table in file.avatar]
    for where, rpy in tables:
        angles = [abs(angle) for angle in rpy or () if angle]
        if angles and all(any(abs(angle - k * math.pi / 12) < 1e-3 for k in range(1, 25)) for angle in angles):
            yield f"{where}: rpy = {list(rpy or ())}: degrees are expected, and these look like radians"


def _space(table: RecordingFacts) -> SpaceReport | None:
    """The space described by `[recording]`; None if it is the world in metres."""
    if RecordedSpace.from_table(table) == RecordedSpace():
        return None
    return SpaceReport(table.up, table.unit, table.position, table.rotation)


def _clock(plan: Plan) -> str | None:
    """Name of the frame clock's topic."""
    if plan.clock is None:
        return None
    if plan.clock.points:
        return plan.clock.topic
    return f"{plan.clock.topic}#{plan.clock.child}" if plan.clock.child else plan.clock.topic


def _poses(plan: Plan, world: World) -> list[PoseMapping]:
    """The topic of each root pose."""
    return [
        PoseMapping(
            tree=world.tree_names[p.source.tree],
            topic=f"{p.topic}#{p.child}" if p.child else p.topic,
            schema=p.channels[0].schema_name,
            encoding=p.channels[0].encoding,
            messages=sum(c.messages for c in p.channels),
        )
        for p in plan.poses
        if not p.is_point
    ]
