"""Signed separations of many pairs in one compiled loop, without a call from Python for each pair."""

from __future__ import annotations

import numpy as np

from geomphys.collision.penetration import Scratch, separation
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Floats, Pieces


@kernel
def measure_pairs(pieces: Pieces, frames: Floats, first: int, last: int, out: Floats, scratch: Scratch) -> None:
    """Measure the pairs `first` to `last`; pair k is of the pieces 2k and 2k + 1, each without knowledge of the others.

    Parameters
    ----------
    pieces, frames
        The pieces and their world frames (2 N, 12).
    first, last
        Pairs to do.
    out
        (N, 4) takes the unit normal out of B into A and the signed separation [m], below 0 for an overlap.
    scratch
        Of `geomphys.collision.penetration.make_scratch`.
    """
    for k in range(first, last):
        s, n, _, _ = separation(pieces, frames, 2 * k, 2 * k + 1, np.inf, (0.0, 0.0, 0.0), scratch)
        out[k, 0], out[k, 1], out[k, 2], out[k, 3] = n[0], n[1], n[2], s
