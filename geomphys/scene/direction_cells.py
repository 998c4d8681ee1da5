"""Tables for support points of a hull by direction: start vertices of the hill climb, and all that can be the farthest.

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
CELLS_AT_ONCE = 256
"""For which rivals are searched together: memory stays small."""
MAX_RIVALS = 8
"""More vertices in a cell are not listed: climbing from the middle is as quick."""
RIVAL_MARGIN = 1e-9
"""Of a hull's size: vertices exceeded by less stay rivals."""


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


def rivals_in_cells(vertices: Floats) -> tuple[Ints, Ints]:
    """Vertices (of (n, 3)) that can be the support point in some direction of each cell, and perhaps some more.

    One that another exceeds in all four corners of a cell, by more than rounding, is exceeded in all of it.

    Returns
    -------
    tuple
        ((CELLS,) number of them, 0 where they are more than `MAX_RIVALS`; their indices, cell by cell in ascending order).
    """
    margin = RIVAL_MARGIN * float(np.ptp(vertices, axis=0).max())
    counts: list[Ints] = []
    rivals: list[Ints] = []
    for corners in np.split(cell_corners(), CELLS // CELLS_AT_ONCE):
        reach = corners @ vertices.T  # (cells, 4, n)
        best = reach.sum(axis=1).argmax(axis=1)  # in the middle of the cell
        cell, vertex = np.nonzero((reach >= _of(reach, best)[:, :, None] - margin).any(axis=1))
        for k in range(4):
            best = reach[:, k].argmax(axis=1)
            stays = (reach[cell, :, vertex] >= _of(reach, best)[cell] - margin).any(axis=1)
            cell, vertex = cell[stays], vertex[stays]
        count = np.bincount(cell, minlength=len(corners))
        few = count[cell] <= MAX_RIVALS
        counts.append(np.where(count <= MAX_RIVALS, count, 0))
        rivals.append(vertex[few])
    return np.concatenate(counts).astype(np.int64), np.concatenate(rivals).astype(np.int64)


def cell_corners() -> Floats:
    """(CELLS, 4, 3) directions through the corners of every cell, which are a little larger than it."""
    centres, half = cell_centres(), 1.0 / CELLS_PER_EDGE + 1e-9
    corners = np.repeat(centres[:, None], 4, axis=1)
    cells = np.arange(CELLS)
    axis = cells // (2 * CELLS_PER_EDGE * CELLS_PER_EDGE)
    for k in range(4):
        corners[cells, k, (axis + 1) % 3] += half if k % 2 else -half
        corners[cells, k, (axis + 2) % 3] += half if k // 2 else -half
    return corners


def _of(reach: Floats, vertex: Ints) -> Floats:
    """(cells, 4) entries of `reach` (cells, 4, n) of one vertex of each cell."""
    picked: Floats = np.take_along_axis(reach, vertex[:, None, None], axis=2)[:, :, 0]
    return picked
