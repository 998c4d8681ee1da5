"""Whether a closed mesh is so close to its convex hull that it needs no cutting.

The measure is that of CoACD (Wei et al. 2022): the volume the hull adds, as 0.3 times the radius of a ball that has it,
and the distance of the hull from the solid, both against the concavity a piece may keep. Unlike CoACD, which measures
how deep a hollow is and cuts a narrow one up before it joins the parts again, the distance is taken from the points the
hull adds: a screw hole of less radius than the concavity is filled, as it is by CoACD's own pieces in the end.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.coverage import Surface, divided
from geomphys.scene.meshes import Mesh

Floats = NDArray[np.float64]

VOLUME_SHARE = 0.3
"""Of the radius of the ball whose volume the hull adds, against the distance (CoACD's weight of the two)."""
SLACK = 0.02
"""Of the concavity: how far the distance may be missed."""
FLAT = 1e-6
"""Of the size and the area: a face of the hull is one of the mesh if they differ by less."""
TOUCHING = 1e-4
"""Of the radius: a ball that is free but for this touches only where it stands."""
MOST_LOOKS = 200_000
"""Distances measured a mesh; where they do not do, CoACD decides."""


def is_nearly_convex(mesh: Mesh, concavity: float) -> bool:
    """Whether the hull of a mesh stands for it.

    True if ``0.3 (3 V / 4 pi)^(1/3) <= concavity``, with V the volume between mesh and hull, and no point of the hull
    is farther than `concavity` from the solid, within `SLACK` of it. The distance is bounded over whole triangles of
    the hull, and inside hollows by balls of that radius that touch a triangle of the mesh: one that fits into the hull
    and holds no other part of the mesh is too much.

    Parameters
    ----------
    mesh
        Watertight and wound outwards.
    concavity
        m, > 0.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(mesh.hull_vertices)
    added = max(float(hull.volume) - mesh.signed_volume, 0.0)
    if VOLUME_SHARE * np.cbrt(0.75 * added / np.pi) > concavity:
        return False
    surface, looks = Surface(mesh.vertices, mesh.faces), [MOST_LOOKS]
    lids = hull.points[hull.simplices[~_is_surface(mesh, hull.equations, hull.points[hull.simplices])]]
    if not _lies_within(surface, mesh.vertices, lids, concavity, looks):
        return False
    planes = np.unique(hull.equations, axis=0)
    return not _holds_a_ball(surface, mesh.vertices[mesh.faces], planes, concavity, looks)


def _is_surface(mesh: Mesh, equations: Floats, triangles: Floats) -> NDArray[np.bool_]:
    """Which triangles (n, 3, 3) of the hull lie in a face of it that triangles of the mesh fill altogether."""
    from scipy.spatial import cKDTree

    scale = np.array([1.0, 1.0, 1.0, 1.0 / mesh.size])
    planes, face = np.unique(np.round(equations * scale, 9), axis=0, return_inverse=True)
    corners = mesh.vertices[mesh.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(crossed, axis=1)
    corners, normals, area = corners[area > 0], crossed[area > 0] / area[area > 0, None], area[area > 0]
    offsets = -np.einsum("ij,ij->i", normals, corners[:, 0])
    away, nearest = cKDTree(planes).query(np.column_stack([normals, offsets]) * scale)
    filled = np.bincount(nearest[away < FLAT], area[away < FLAT], len(planes))
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    whole = np.bincount(face.reshape(-1), np.linalg.norm(sides, axis=1), len(planes))
    found: NDArray[np.bool_] = (filled >= (1.0 - FLAT) * whole)[face.reshape(-1)]
    return found


def _lies_within(surface: Surface, corners: Floats, triangles: Floats, limit: float, looks: list[int]) -> bool:
    """Whether triangles (n, 3, 3) on the hull lie within `limit` of the surface, which has these corners."""
    from scipy.spatial import cKDTree

    tree = cKDTree(corners)
    while len(triangles):
        middle, reach = _balls(triangles)
        open_ = tree.query(middle)[0] + reach > limit  # the nearest corner is no nearer than the surface
        triangles, middle, reach = triangles[open_], middle[open_], reach[open_]
        looks[0] -= len(middle)
        if looks[0] < 0:
            return False
        away = surface.distance(middle)
        if np.any(away > limit):
            return False
        triangles = divided(triangles[(away + reach > limit) & (reach > SLACK * limit)])[0]
    return True


def _holds_a_ball(surface: Surface, triangles: Floats, planes: Floats, radius: float, looks: list[int]) -> bool:
    """Whether a ball that touches one of the triangles from outside, within the hull, meets no other part of them."""
    from scipy.spatial import cKDTree

    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    length = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[length > 0], normals[length > 0] / length[length > 0, None]
    facing = planes[cKDTree(planes[:, :3]).query(normals)[1]]
    moved = triangles + radius * normals[:, None]
    out = np.min(np.einsum("tkj,tj->tk", moved, facing[:, :3]) + facing[:, 3:], axis=1) > 0  # nearly all of them
    triangles, normals = triangles[~out], normals[~out]
    while len(triangles):
        inside, out = _against_hull(triangles + radius * normals[:, None], planes)
        triangles, normals, inside = triangles[~out], normals[~out], inside[~out]
        looks[0] -= len(triangles)
        if looks[0] < 0:
            return True
        middle, reach = _balls(triangles)
        free = surface.distance(middle + radius * normals)
        if np.any(inside & (free >= (1.0 - TOUCHING) * radius)):
            return True
        open_ = (free + reach >= (1.0 - TOUCHING) * radius) & (reach > SLACK * radius)
        triangles, whole = divided(triangles[open_])
        normals = normals[open_][whole]
    return False


def _balls(triangles: Floats) -> tuple[Floats, Floats]:
    """Centroids (n, 3) of triangles and how far their corners are from them (n,)."""
    middle = triangles.mean(axis=1)
    reach: Floats = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    return middle, reach


def _against_hull(triangles: Floats, planes: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Of triangles (n, 3, 3): whose centroid lies in the hull n·x + d <= 0, and which lie beyond one of its planes."""
    inside, out = np.empty(len(triangles), dtype=bool), np.empty(len(triangles), dtype=bool)
    rows = max(1, 1_000_000 // len(planes))
    for start in range(0, len(triangles), rows):
        part = slice(start, start + rows)
        height = triangles[part] @ planes[:, :3].T + planes[:, 3]  # (n, corners, planes)
        inside[part] = np.all(height.mean(axis=1) <= 0, axis=1)
        out[part] = np.any(height.min(axis=1) > 0, axis=1)
    return inside, out
