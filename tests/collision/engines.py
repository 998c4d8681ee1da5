"""The pieces of a scene in another engine."""

from __future__ import annotations

import coal
import numpy as np
from numpy.typing import NDArray

from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, SPHERE, Pieces


def coal_shape(pieces: Pieces, k: int) -> coal.CollisionGeometry:
    """Piece k as a shape of coal, in its own frame."""
    a, b, c = map(float, pieces.size[k])
    kind = pieces.kind[k]
    if kind == SPHERE:
        return coal.Sphere(a)
    if kind == CAPSULE:
        return coal.Capsule(a, 2 * b)
    if kind == CYLINDER:
        return coal.Cylinder(a, 2 * b)
    if kind == BOX:
        return coal.Box(2 * a, 2 * b, 2 * c)
    points = coal.StdVec_Vec3s()
    for corner in pieces.vertices[pieces.vertex_start[k] : pieces.vertex_start[k + 1]]:
        points.append(corner)
    return coal.Convex.convexHull(points, True, "Qt")


def coal_place(matrix: NDArray[np.float64]) -> coal.Transform3s:
    """A pose (4, 4) as one of coal's."""
    return coal.Transform3s(np.ascontiguousarray(matrix[:3, :3]), np.ascontiguousarray(matrix[:3, 3]))
