"""Measures any recorded motion in a scene as it is: overlaps, speeds, jerks; nothing of it is corrected in the figures.

The log is read and posed as for a replay, whose measures of the recorded poses these are: the deepest pair of convex pieces of
two bodies, by the exact minimum translation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.results import FrameResult
from geomphys.scene.intersection_volume import intersection_volume
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath, as_path

DEEP_M = 2e-3
"""m; `share_deep` is the share of frames deeper than this."""


@dataclass(frozen=True, kw_only=True)
class PairOverlap:
    """Two bodies that overlapped as recorded."""

    body_a: str
    body_b: str
    frames: int
    largest_m: float
    frame: int
    """Where it is deepest."""
    same_avatar: bool


@dataclass(frozen=True, kw_only=True)
class MotionAudit:
    """Measures of a recorded motion, in SI units."""

    log: str
    scene: str
    frames: int
    duration_s: float
    max_penetration_m: float
    """Deepest pair of convex pieces of a driven body and something fixed, tracked or driven by another tracker."""
    deepest_frame: int | None
    frames_penetrating: int
    share_deep: float
    """Share of frames deeper than `DEEP_M`, 0 to 1."""
    intersection_volume_m3: float | None
    """Volume common to the bodies of the deepest pair in the deepest frame; None if a surface is not closed."""
    max_self_overlap_m: float
    """Deepest overlap of two links of one avatar that are not neighbours; mode ``chains`` only."""
    max_speed_m_s: float
    jerk_p50_m_s3: float
    jerk_p99_m_s3: float
    held_frames: int
    pairs: tuple[PairOverlap, ...]
    """Deepest first."""

    def as_dict(self) -> dict[str, Any]:
        """Everything by name, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)


def audit_motion(
    log: AnyPath | str,
    scene: AnyPath | str | World,
    *,
    config: Config | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> MotionAudit:
    """Measure the motion of a log in a scene.

    Parameters
    ----------
    log : Path or str
        An MCAP file or a ROS 2 bag folder.
    scene : Path, str or World
        The scene file, or the world it was loaded into.
    config : Config, optional
        How the log is read; see `geomphys.replay`.
    progress : callable, optional
        Called with the frames measured and their number, if it is known.

    Raises
    ------
    InputError
        The log or the scene is wrong; LogError if there is no frame.
    """
    config, path = config or Config(), as_path(log)
    world = scene if isinstance(scene, World) else load_world(scene, mode=config.mode, seed=config.seed)
    totals = _Totals(world)
    for result in replay(path, world, config=config, progress=progress):
        totals.add(result)
    if not totals.depths:
        raise LogError(f"{path}: gave no frame in the scene {world.path}; `geomphys check` shows the reason")
    return totals.report(str(path))


class _Totals:
    """Accumulates the measures of frames."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.depths: list[float] = []
        self._speeds: list[float] = []
        self._jerks: list[float] = []
        self._times: list[int] = []
        self._held = 0
        self._pairs: dict[tuple[int, int], tuple[int, float, int]] = {}  # frames, largest, frame of it
        self._deepest: tuple[float, FrameResult, tuple[int, int]] | None = None

    def add(self, result: FrameResult) -> None:
        metrics, rows, frame = result.metrics, result.penetrations, result.frame.index
        self.depths.append(metrics.recorded_penetration_m)
        self._speeds.append(metrics.recorded_speed_m_s)
        self._jerks.append(metrics.recorded_jerk_m_s3)
        self._times.append(result.frame.time_ns)
        self._held += metrics.held
        for a, b, largest in zip(rows.body_a.tolist(), rows.body_b.tolist(), rows.largest.tolist(), strict=True):
            frames, deepest, at = self._pairs.get((a, b), (0, -1.0, frame))
            self._pairs[a, b] = (frames + 1, *((largest, frame) if largest > deepest else (deepest, at)))
            other_trees = not self._same_tree(a, b)
            if other_trees and (self._deepest is None or largest > self._deepest[0]):
                self._deepest = (largest, result, (a, b))

    def report(self, log: str) -> MotionAudit:
        world, depths, jerks = self._world, np.array(self.depths), np.array(self._jerks)
        pairs = [
            PairOverlap(
                body_a=world.body_names[a], body_b=world.body_names[b], frames=frames, largest_m=largest, frame=frame,
                same_avatar=self._same_tree(a, b),
            )
            for (a, b), (frames, largest, frame) in self._pairs.items()
        ]  # fmt: skip
        volume: float | None = 0.0
        if self._deepest is not None:
            _, result, pair = self._deepest
            volume = intersection_volume(world, pair, result.recorded[list(pair)])
        return MotionAudit(
            log=log,
            scene=str(world.path),
            frames=len(depths),
            duration_s=(self._times[-1] - self._times[0]) / 1e9,
            max_penetration_m=float(depths.max()),
            deepest_frame=None if self._deepest is None else self._deepest[1].frame.index,
            frames_penetrating=int((depths > 0.0).sum()),
            share_deep=float((depths > DEEP_M).mean()),
            intersection_volume_m3=volume,
            max_self_overlap_m=max((p.largest_m for p in pairs if p.same_avatar), default=0.0),
            max_speed_m_s=float(max(self._speeds)),
            jerk_p50_m_s3=float(np.percentile(jerks, 50)),
            jerk_p99_m_s3=float(np.percentile(jerks, 99)),
            held_frames=self._held,
            pairs=tuple(sorted(pairs, key=lambda p: (-p.largest_m, p.body_a, p.body_b))),
        )

    def _same_tree(self, a: int, b: int) -> bool:
        tree = self._world.scene.bodies.tree
        return bool(tree[a] == tree[b])
