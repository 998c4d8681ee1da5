"""Signed separations of many pairs in one compiled loop, without a call from Python for each pair."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.penetration import Scratch, separation
from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import set_vec
from geomphys.scene.arrays import Floats, Pieces

SEPARATION = np.dtype(
    [
        ("normal", np.float64, 3),  # unit, out of B into A
        ("distance", np.float64),  # m, below 0 for an overlap
    ]
)
"""Signed separation of a pair."""

Separations = NDArray[Any]
"""(n,) `SEPARATION`."""


@kernel
def measure_pairs(pieces: Pieces, frames: Floats, first: int, last: int, out: Separations, scratch: Scratch) -> None:
    """Measure the pairs `first` to `last`; pair k is of the pieces 2k and 2k + 1, each without knowledge of the others.

    Parameters
    ----------
    pieces, frames
        The pieces and their world frames (2 N, 12).
    first, last
        Pairs to do.
    out
        (N,) SEPARATION, written.
    scratch
        Of `geomphys.collision.penetration.make_scratch`.
    """
    for k in range(first, last):
        s, n, _, _ = separation(pieces, frames, 2 * k, 2 * k + 1, np.inf, (0.0, 0.0, 0.0), scratch)
        out[k].distance = s
        set_vec(out[k].normal, n)
