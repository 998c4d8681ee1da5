"""Directions in cells, and which corner of a hull is about the farthest in each: where a climb over its edges begins.

A cell is a square of a grid on a side of the cube about the origin: side `2 axis + (sign < 0)`, rows and columns along
the next two axes.
"""

from __future__ import annotations

import numpy as np

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec
from geomphys.scene.arrays import Floats, Ints

ALONG = 8
"""Cells along an edge of the cube."""
CELLS = 6 * ALONG * ALONG


@kernel
def cell_of(d: Vec) -> int:
    """The cell of a direction, 0 to `CELLS` - 1; some cell for zeros."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    if x >= y and x >= z:
        axis, top, sign, u, v = 0, x, d[0], d[1], d[2]
    elif y >= z:
        axis, top, sign, u, v = 1, y, d[1], d[2], d[0]
    else:
        axis, top, sign, u, v = 2, z, d[2], d[0], d[1]
    if not top > 0.0:
        return 2 * axis * ALONG * ALONG
    share = 0.5 * ALONG / top
    i = max(0, min(int((u + top) * share), ALONG - 1))
    j = max(0, min(int((v + top) * share), ALONG - 1))
    return ((2 * axis + (1 if sign < 0.0 else 0)) * ALONG + i) * ALONG + j


def cell_centres() -> Floats:
    """(CELLS, 3) a direction in the middle of every cell, not of length 1."""
    at = (2.0 * np.arange(ALONG) + 1.0) / ALONG - 1.0
    u, v = (grid.reshape(-1) for grid in np.meshgrid(at, at, indexing="ij"))
    sides = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.empty((ALONG * ALONG, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, u, v
            sides.append(side)
    return np.vstack(sides)


def farthest_in_cells(vertices: Floats) -> Ints:
    """(CELLS,) which of the corners (n, 3) lies farthest in the direction in the middle of each cell."""
    found: Ints = np.argmax(cell_centres() @ vertices.T, axis=1).astype(np.int64)
    return found
