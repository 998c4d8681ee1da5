"""Spreads motion that the recording missed over time: after a gap, or a jump of a tracker, a driven tree catches up slowly.

Only in scenes with simulated bodies, which it could hit. The tree continues from its pose before; the missed motion is
added at a speed that grows from zero to `MOST` times the larger recorded speed before and after the gap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.quantiles import Quantiles
from geomphys.numerics.transforms import angle_between
from geomphys.results import FLAG_CATCHING_UP, Frame
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene

if TYPE_CHECKING:  # loading it takes as long as a hundred frames, and most recordings miss nothing
    from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

MOST = 1.4  # times the larger recorded speed
GROWTH = 0.1  # s: in which the speed of catching up grows from zero to that
SLOWEST = (0.05, 0.2, 0.2)  # m/s, rad/s, rad/s or m/s of joints: least speed of catching up
JUMP_RATIO = 3.0  # a jump of a tracker: acceleration above this times the 99th percentile of those recorded so far
MIN_JUMP = 100.0  # m/s²: a jump is above this, too
LEARNED = 60  # frames until that percentile is trusted
NOTHING = 1e-9  # m, rad


@dataclass
class _Tree:
    """A driven tree: recorded and assumed pose, and the motion still to catch up with."""

    root: Floats  # (7,) recorded in the frame before
    angles: Floats  # (q,)
    held: bool = False  # it did not move in a held frame
    velocity: Floats = field(default_factory=lambda: np.zeros(3))  # m/s, recorded
    speeds: Floats = field(default_factory=lambda: np.zeros(3))  # of root, rotation, joints in the last good frame
    missed: tuple[Floats, Rotation, Floats] | None = None  # from the recording to where the tree is
    largest: Floats = field(default_factory=lambda: np.zeros(3))  # recorded speeds since the gap and before
    catching: float = 0.0  # s, since the gap
    accelerations: Quantiles = field(default_factory=Quantiles)


class MissedMotion:
    """Follows the recorded frames of a scene's driven trees."""

    def __init__(self, scene: Scene) -> None:
        roles = scene.trees.role
        some = bool((roles == SIMULATED).any())
        self._driven = [int(t) for t in np.flatnonzero(roles == DRIVEN) if some]
        self._columns = {
            t: slice(int(scene.trees.dof_start[t]), int(scene.trees.dof_start[t + 1])) for t in self._driven
        }
        self._trees: dict[int, _Tree] = {}

    def correct(self, frames: Sequence[Frame], roots: Floats, angles: Floats, dts: Floats) -> list[int]:
        """Correct frames (n, T, 7), (n, Q), in place; returns flags of each: `FLAG_CATCHING_UP` or 0."""
        flags, held = [0] * len(frames), np.array([frame.held for frame in frames])
        for tree in self._driven:
            own, k = angles[:, self._columns[tree]], 0
            while k < len(frames):
                k += self._follow_steady(tree, ~held[k:], roots[k:, tree], own[k:], dts[k:])
                if k < len(frames):
                    if self._follow(tree, frames[k].held, roots[k, tree], own[k], float(dts[k])):
                        flags[k] = FLAG_CATCHING_UP
                    k += 1
        return flags

    def _follow_steady(self, tree: int, good: NDArray[np.bool_], roots: Floats, angles: Floats, dts: Floats) -> int:
        """The next frames of a tree, up to the first in which motion may be missing; returns how many."""
        seen = self._trees.get(tree)
        if seen is None or seen.missed is not None or seen.held:
            return 0
        steps = np.where(dts > 0.0, dts, 1.0)
        velocities = np.diff(roots[:, :3], axis=0, prepend=seen.root[None, :3]) / steps[:, None]
        changes = np.linalg.norm(np.diff(velocities, axis=0, prepend=seen.velocity[None]), axis=1) / steps
        steady = good & (dts > 0.0) & (changes < MIN_JUMP)
        count = len(steady) if steady.all() else int(np.argmin(steady))
        if count == 0:
            return 0
        seen.accelerations.add_all(changes[:count])
        last, step = count - 1, float(steps[count - 1])
        before = (roots[last - 1], angles[last - 1]) if last else (seen.root, seen.angles)
        rotation = float(angle_between(roots[last, 3:], before[0][3:]))
        change = float(np.abs(angles[last] - before[1]).max(initial=0.0))
        seen.speeds = np.array([np.linalg.norm(velocities[last]), rotation / step, change / step])
        seen.largest, seen.velocity = seen.speeds, velocities[last]
        seen.root, seen.angles = roots[last].copy(), angles[last].copy()
        return count

    def _follow(self, tree: int, held: bool, root: Floats, angles: Floats, dt: float) -> bool:
        """One frame of a tree: `root` (7,) and `angles` (q,) are corrected; whether they were."""
        seen = self._trees.get(tree)
        if seen is None or dt <= 0.0:
            if seen is None:
                self._trees[tree] = _Tree(root.copy(), angles.copy(), held)
            return False
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_quat(root[3:]) * Rotation.from_quat(seen.root[3:]).inv()
        change = angles - seen.angles
        velocity = (root[:3] - seen.root[:3]) / dt
        speeds = np.array([np.linalg.norm(velocity), rotation.magnitude() / dt, np.abs(change).max(initial=0.0) / dt])
        still = not speeds.any()
        acceleration = float(np.linalg.norm(velocity - seen.velocity)) / dt
        jumped = self._jumps(seen, acceleration) and not held
        if (seen.held and not held) or jumped:
            before = seen.missed or (np.zeros(3), Rotation.identity(), np.zeros(len(angles)))
            at = seen.root[:3] + before[0] - root[:3]
            seen.missed = at, before[1] * rotation.inv(), before[2] - change
            seen.largest, seen.catching, speeds = np.maximum(seen.largest, seen.speeds), 0.0, np.zeros(3)
        elif not held:
            seen.speeds = speeds
            seen.largest = np.maximum(seen.largest, speeds)
            seen.accelerations.add(acceleration)
        seen.held = held and (still or seen.held)
        seen.velocity = np.zeros(3) if held or jumped else velocity
        seen.root, seen.angles = root.copy(), angles.copy()
        if seen.missed is None:
            seen.largest = seen.speeds
            return False
        self._catch_up(seen, speeds, dt)
        if seen.missed is None:
            return False
        root[:3] += seen.missed[0]
        root[3:] = (seen.missed[1] * Rotation.from_quat(root[3:])).as_quat()
        angles += seen.missed[2]
        return True

    @staticmethod
    def _jumps(seen: _Tree, acceleration: float) -> bool:
        if acceleration < MIN_JUMP or seen.accelerations.count < LEARNED:
            return False
        return acceleration > JUMP_RATIO * seen.accelerations.quantile(0.99)

    @staticmethod
    def _catch_up(seen: _Tree, speeds: Floats, dt: float) -> None:
        """Add a part of the missed motion; `speeds` are those of the recording."""
        from scipy.spatial.transform import Rotation

        if seen.missed is None:
            return
        seen.catching += dt
        growth = min(1.0, seen.catching / GROWTH)
        limits = growth * dt * np.maximum(MOST * seen.largest - speeds, np.array(SLOWEST))
        path, rotation, change = seen.missed
        left, angle = float(np.linalg.norm(path)), float(rotation.magnitude())
        path = path * (max(0.0, left - limits[0]) / left if left > NOTHING else 0.0)
        rotation = Rotation.from_rotvec(
            rotation.as_rotvec() * (max(0.0, angle - limits[1]) / angle if angle > NOTHING else 0.0)
        )
        change = np.sign(change) * np.maximum(0.0, np.abs(change) - limits[2])
        done = not path.any() and rotation.magnitude() == 0.0 and not change.any()
        seen.missed = None if done or math.isnan(left) else (path, rotation, change)
