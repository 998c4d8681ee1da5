"""Collects the frames of a log in which a hand touches a surface, and the speeds of its streams."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.authoring.resting_frames import frame_of_touch, means_of_parts
from geomphys.authoring.surface_gaps import GapMeter
from geomphys.config import Config
from geomphys.errors import ConfigError, LogError
from geomphys.numerics.even_samples import EvenSamples
from geomphys.numerics.transforms import angle_between
from geomphys.recording.frames import FrameSource
from geomphys.results import Frame
from geomphys.scene.arrays import FIXED
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

MAX_FRAMES = 8
"""Frames of a stretch that are used, evenly spread, each the mean of its part where the hand rests."""
MAX_SAMPLES = 257
"""Of a stretch fewer frames than this are retained, evenly spread."""
SPEED_TIME = 0.1
"""s over which a speed is taken that is to be slow."""
SLOW_M_S = 0.02
"""m/s; a hand that moves no faster may be resting on something."""
PAUSE = 0.1
"""s; slow frames farther apart are of different rests."""
REST = 0.25
"""s; shortest rest that counts, where nothing is named."""
MAX_RESTS = 100
"""Rests that are used."""
NEAR_M = 0.06
"""m; how near a surface a slow hand has to be to count as touching it, where nothing is named."""


class Stretch(NamedTuple):
    """A stretch of a log in which links touch a surface; s from the first frame."""

    begin: float
    end: float
    link: str = ""  # the only one that touches; "": the lowest ones
    is_touch: bool = False  # whether one link touches rather than the whole hand lies flat


class Contact(NamedTuple):
    """A frame in which links touch a surface."""

    frame: Frame
    surface: int  # tree
    link: int  # of the avatar, -1 for the lowest ones
    is_touch: bool
    stretch: int = 0  # which one


@dataclass
class Recorded:
    """What a calibration needs of a log."""

    contacts: list[Contact] = field(default_factory=list)
    times: list[float] = field(default_factory=list)  # s, of all frames but the first
    linear: list[float] = field(default_factory=list)  # m/s, of the root
    angular: list[float] = field(default_factory=list)  # rad/s
    joints: list[float] = field(default_factory=list)  # rad/s, root mean square of the joint values
    points: list[float] = field(default_factory=list)  # m/s, of the mean of the points that joint values are fitted to


def collect(
    log: AnyPath,
    world: World,
    config: Config,
    tree: int,
    stretches: Sequence[tuple[Stretch, int]],
    movable: Sequence[int],
) -> Recorded:
    """Read a log once.

    Parameters
    ----------
    tree
        The avatar.
    stretches
        With the surface (tree) that is touched. None: slow moments near one of `movable`, else near any fixed object.

    Raises
    ------
    LogError, ConfigError
        A stretch holds no frame, or names a link that the avatar does not have.
    """
    first_body, last_body = world.scene.trees.body_start[tree : tree + 2]
    names = [name.split("/", 1)[1] for name in world.body_names[first_body:last_body]]
    links = [_link_of(s.link, names, world.tree_names[tree]) for s, _ in stretches]
    recorded, buckets = Recorded(), [EvenSamples[Frame](MAX_SAMPLES) for _ in stretches]
    slow: list[Contact] = []
    recent: deque[tuple[int, Floats]] = deque()
    surfaces = list(movable) or [
        t for t in range(world.avatar_count, len(world.tree_names)) if world.scene.trees.role[t] == FIXED
    ]
    meter, start = GapMeter(world), 0
    last: Frame | None = None
    last_points: Floats | None = None
    columns = slice(*world.scene.trees.dof_start[tree : tree + 2])
    with FrameSource(log, world, config) as source:
        for frame in source:
            start = frame.time_ns if last is None else start
            seconds = (frame.time_ns - start) / 1e9
            speed = _add_speeds(recorded, last, frame, tree, columns)
            points = _points_of(source, tree)
            if speed is not None and points is not None and last_points is not None:
                step = (frame.time_ns - last.time_ns) / 1e9 if last is not None else 1.0
                recorded.points.append(float(np.nanmedian(np.linalg.norm(points - last_points, axis=1))) / step)
            last, last_points = frame, points
            if frame.held:
                continue
            for k, (stretch, _) in enumerate(stretches):
                if stretch.begin <= seconds <= stretch.end:
                    buckets[k].offer(frame)
            recent.append((frame.time_ns, frame.roots[tree, :3]))
            while len(recent) > 2 and frame.time_ns - recent[1][0] >= SPEED_TIME * 1e9:
                recent.popleft()
            passed = (frame.time_ns - recent[0][0]) / 1e9
            moved = float(np.linalg.norm(frame.roots[tree, :3] - recent[0][1]))
            if not stretches and surfaces and passed >= 0.5 * SPEED_TIME and moved < SLOW_M_S * passed:
                gaps = [meter.lowest_gap(tree, s, frame.roots, frame.angles) for s in surfaces]
                best = int(np.argmin(np.abs(gaps)))
                if abs(gaps[best]) < NEAR_M:
                    slow.append(Contact(frame, surfaces[best], -1, True))
    for k, (stretch, surface) in enumerate(stretches):
        frames = buckets[k].items
        if not frames:
            raise LogError(f"{log}: has no good frame from {stretch.begin:g} to {stretch.end:g} s after its first")
        if stretch.is_touch:
            touch = frame_of_touch(frames, start + 0.5e9 * (stretch.begin + stretch.end), tree, columns)
            frames = [] if touch is None else [touch]
        else:
            frames = means_of_parts(frames, MAX_FRAMES, tree, columns)
        recorded.contacts += [Contact(frame, surface, links[k], stretch.is_touch, k) for frame in frames]
    recorded.contacts += _rests(slow, tree, columns)
    return recorded


def _rests(slow: Sequence[Contact], tree: int, columns: slice) -> list[Contact]:
    """Slow frames as stretches: a pause of more than `PAUSE` ends one, and what is short is left out."""
    runs: list[list[Contact]] = []
    for contact in slow:
        if not runs or contact.frame.time_ns - runs[-1][-1].frame.time_ns > PAUSE * 1e9:
            runs.append([])
        runs[-1].append(contact)
    long = [run for run in runs if run[-1].frame.time_ns - run[0].frame.time_ns >= REST * 1e9]
    found = []
    for k, run in enumerate(long[-MAX_RESTS:]):
        frames = means_of_parts([contact.frame for contact in run], MAX_FRAMES, tree, columns)
        found += [run[0]._replace(frame=frame, stretch=k) for frame in frames]
    return found


def _link_of(name: str, names: Sequence[str], avatar: str) -> int:
    if not name:
        return -1
    if name not in names:
        raise ConfigError(f"touch: {avatar!r} has no link {name!r}; it has {', '.join(names[:12])}")
    return list(names).index(name)


def _add_speeds(recorded: Recorded, last: Frame | None, frame: Frame, tree: int, columns: slice) -> float | None:
    """Add the speeds since the last frame; returns that of the root [m/s]."""
    if last is None or frame.time_ns <= last.time_ns:
        return None
    step = (frame.time_ns - last.time_ns) / 1e9
    speed = float(np.linalg.norm(frame.roots[tree, :3] - last.roots[tree, :3])) / step
    recorded.times.append(frame.time_ns / 1e9 - step / 2)
    recorded.linear.append(speed)
    recorded.angular.append(float(angle_between(frame.roots[tree, 3:], last.roots[tree, 3:])) / step)
    change = frame.angles[columns] - last.angles[columns]
    recorded.joints.append(float(np.sqrt(np.mean(change**2))) / step if len(change) else 0.0)
    return speed


def _points_of(source: FrameSource, tree: int) -> Floats | None:
    """Points (K, 3) of the last frame that a tree is fitted to, NaN where not seen; None without."""
    for route in source.keypoints:
        if route.tree == tree and route.seen.any():
            return np.where(route.seen[:, None] != 0, route.points, np.nan)
    return None
