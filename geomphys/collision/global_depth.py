"""Global penetration depth of a pair of bodies from the depths of their convex pieces.

PD_g = (Σ pd_i² n_i) / (Σ pd_i)                                                        (1)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Pieces

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class GlobalDepths(NamedTuple):
    """Pairs of bodies that overlap."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    pd: Floats  # (n, 3) m, PD_g: the translation of a that resolves the overlap
    pairs: Ints  # (n,) overlapping pairs of pieces
    largest: Floats  # (n,) m, deepest of them


def make_global_depths(size: int) -> GlobalDepths:
    """A table for `size` pairs of bodies."""
    ints = [np.zeros(size, np.int64) for _ in range(3)]
    return GlobalDepths(ints[0], ints[1], np.zeros((size, 3)), ints[2], np.zeros(size))


@kernel
def global_depths(pieces: Pieces, near: Near, depths: GlobalDepths) -> int:
    """Equation (1) for every pair of bodies with overlapping pieces in `near`, whose pairs are sorted by bodies.

    Returns the number of rows of `depths` that are filled.
    """
    filled, weight = 0, 0.0
    for k in range(near.counts.filled):
        if near.separation[k] >= 0.0:
            continue
        depth = -near.separation[k]
        body_a, body_b = pieces.body[near.a[k]], pieces.body[near.b[k]]
        row = filled - 1
        if row < 0 or depths.body_a[row] != body_a or depths.body_b[row] != body_b:
            if row >= 0:
                for i in range(3):
                    depths.pd[row, i] /= weight
            row += 1
            if row == len(depths.body_a):
                return filled
            filled = row + 1
            depths.body_a[row], depths.body_b[row] = body_a, body_b
            depths.pairs[row], depths.largest[row], weight = 0, 0.0, 0.0
            for i in range(3):
                depths.pd[row, i] = 0.0
        weight += depth
        depths.pairs[row] += 1
        depths.largest[row] = max(depths.largest[row], depth)
        for i in range(3):
            depths.pd[row, i] += depth * depth * near.normal[k, i]
    if filled > 0:
        for i in range(3):
            depths.pd[filled - 1, i] /= weight
    return filled
