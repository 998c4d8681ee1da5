"""Motion of the driven bodies in the frames of a block: speeds, jerks, and how much rigid ones changed their shape."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.engine.frame_buffer import Block
from geomphys.engine.frame_results import MotionMeasures
from geomphys.jit.kernel import kernel
from geomphys.numerics.motion_rates import MotionMeter
from geomphys.results import Frame
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class BlockMotionMeter:
    """Measures the motion in one block after another.

    Parameters
    ----------
    scene : Scene
    moving : (M,) int
        Bodies that a block has the poses of.
    """

    def __init__(self, scene: Scene, moving: Ints) -> None:
        self._rates = MotionMeter()
        driven = scene.bodies.role[moving] == DRIVEN
        self._driven = _rows_of(driven)
        self._rigid: Ints = np.flatnonzero(driven & (scene.trees.chains[scene.bodies.tree[moving]] == 0))

    def add(self, frames: Sequence[Frame], block: Block) -> MotionMeasures:
        """Motion in the frames that a block begins with, the next ones."""
        count = len(frames)
        recorded, corrected = (poses[:count, self._driven, :3] for poses in (block.recorded, block.corrected))
        times = np.array([frame.time_ns for frame in frames], dtype=np.int64)
        positions = np.empty((count, 2, *recorded.shape[1:]))
        positions[:, 0] = recorded
        np.subtract(corrected, recorded, out=positions[:, 1])
        speeds, jerks = (np.nan_to_num(rates, nan=0.0) for rates in self._rates.add(times, positions))
        chords = np.empty(count)
        largest_chords(block.recorded, block.corrected, self._rigid, chords)
        return MotionMeasures(
            recorded_speed_m_s=speeds[:, 0],
            correction_speed_m_s=speeds[:, 1],
            recorded_jerk_m_s3=jerks[:, 0],
            correction_jerk_m_s3=jerks[:, 1],
            shape_change_rad=4.0 * np.arcsin(np.minimum(1.0, 0.5 * chords)),
        )


@kernel
def largest_chords(recorded: Floats, corrected: Floats, bodies: Ints, chords: Floats) -> None:
    """How far a body's orientation is at most from the recorded one, as points of the unit sphere in 4 dimensions.

    Parameters
    ----------
    recorded, corrected : (N, M, 7)
        Poses.
    bodies : (b,)
        Which of the M count; 0 if none.
    chords : (n,)
        Set to the distance in the first n frames: 2 sin(a / 4) of the angle a. q and -q are one rotation.
    """
    for n in range(len(chords)):
        largest = 0.0
        for body in bodies:
            near = far = 0.0
            for k in range(3, 7):
                a, b = corrected[n, body, k], recorded[n, body, k]
                near += (a - b) * (a - b)
                far += (a + b) * (a + b)
            square = min(near, far)
            if square > largest or square != square:
                largest = square
        chords[n] = math.sqrt(largest)


def _rows_of(mask: NDArray[np.bool_]) -> slice | Ints:
    """Where a mask is set; a slice where that is one stretch, so that nothing has to be copied."""
    rows = np.flatnonzero(mask)
    if len(rows) and rows[-1] - rows[0] == len(rows) - 1:
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows
