"""Finds meshes that are translated copies of each other, so that the pieces of one serve for all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.meshes import Mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME = 1e-6
"""Of a mesh's size: corners farther apart are not the same. Single precision rounds by some 1e-7."""


def translation_between(mesh: Mesh, other: Mesh) -> Floats | None:
    """Translation (3,) [m] that makes one mesh the other, in whatever order they list corners and triangles; None without one.

    Copies whose corners lie on the border of a rounding step may be missed.
    """
    if mesh.vertices.shape != other.vertices.shape or mesh.faces.shape != other.faces.shape:
        return None
    tolerance = SAME * mesh.size
    corners, triangles = _listed(mesh, tolerance)
    others, other_triangles = _listed(other, tolerance)
    if np.abs(corners - others).max() > tolerance or not np.array_equal(triangles, other_triangles):
        return None
    offset: Floats = other.vertices.min(axis=0) - mesh.vertices.min(axis=0)
    return offset


def _listed(mesh: Mesh, tolerance: float) -> tuple[Floats, Ints]:
    """Corners (n, 3) from the lowest on each axis, and triangles (m, 3), in an order that depends on neither's."""
    corners = mesh.vertices - mesh.vertices.min(axis=0)
    order = np.lexsort(np.rint(corners / (4.0 * tolerance)).T)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    triangles = np.sort(rank[mesh.faces], axis=1)
    listed: Ints = triangles[np.lexsort(triangles.T)]
    return corners[order], listed
