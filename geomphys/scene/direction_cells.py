"""Lookup table of approximate support points of a hull: start vertices of the hill climb, by direction.

Directions are binned on a cube map: face `2 axis + (sign < 0)` of the cube about the origin, each face a grid of
`CELLS_PER_EDGE` squared cells, rows and columns along the next two axes.
"""

from __future__ import annotations

import numpy as np

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec
from geomphys.scene.arrays import Floats, Ints

CELLS_PER_EDGE = 16
"""Cells along an edge of the cube."""
CELLS = 6 * CELLS_PER_EDGE * CELLS_PER_EDGE


@kernel
def cell_of(d: Vec) -> int:
    """Cell index of a direction, 0 to `CELLS` - 1; an arbitrary cell for zeros."""
    x, y, z = abs(d[0]), abs(d[1]), abs(d[2])
    if x >= y and x >= z:
        axis, top, sign, u, v = 0, x, d[0], d[1], d[2]
    elif y >= z:
        axis, top, sign, u, v = 1, y, d[1], d[2], d[0]
    else:
        axis, top, sign, u, v = 2, z, d[2], d[0], d[1]
    if not top > 0.0:
        return 2 * axis * CELLS_PER_EDGE * CELLS_PER_EDGE
    scale = 0.5 * CELLS_PER_EDGE / top
    i = max(0, min(int((u + top) * scale), CELLS_PER_EDGE - 1))
    j = max(0, min(int((v + top) * scale), CELLS_PER_EDGE - 1))
    return ((2 * axis + (1 if sign < 0.0 else 0)) * CELLS_PER_EDGE + i) * CELLS_PER_EDGE + j


def cell_centres() -> Floats:
    """(CELLS, 3) direction through the centre of every cell, not normalised."""
    centre = (2.0 * np.arange(CELLS_PER_EDGE) + 1.0) / CELLS_PER_EDGE - 1.0
    u, v = (grid.reshape(-1) for grid in np.meshgrid(centre, centre, indexing="ij"))
    sides = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            side = np.empty((CELLS_PER_EDGE * CELLS_PER_EDGE, 3))
            side[:, axis], side[:, (axis + 1) % 3], side[:, (axis + 2) % 3] = sign, u, v
            sides.append(side)
    return np.vstack(sides)


def farthest_in_cells(vertices: Floats) -> Ints:
    """(CELLS,) index of the vertex (of (n, 3)) that is the support point in the direction of each cell's centre."""
    found: Ints = np.argmax(cell_centres() @ vertices.T, axis=1).astype(np.int64)
    return found
