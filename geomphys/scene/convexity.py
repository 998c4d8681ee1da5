"""Decides whether a closed mesh may be replaced by its convex hull within an allowed concavity.

The measure is that of CoACD (Wei et al. 2022): 0.3 times the radius of a ball of the volume that the hull adds, and the
distance from the hull to the solid, both relative to the allowed concavity. CoACD measures the depth of a concavity, which
splits narrow holes that its merging step closes again; here the distance is measured from the points that the hull
adds, so a screw hole of a smaller radius than the allowed concavity counts as filled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.coverage import Surface, divided
from geomphys.scene.meshes import Mesh

Floats = NDArray[np.float64]

VOLUME_WEIGHT = 0.3
"""Weight of the radius of the ball of the added volume against the distance (as in CoACD)."""
DISTANCE_TOLERANCE = 0.02
"""Tolerance of the distance, as a share of the concavity."""
FLAT = 1e-6
"""Relative tolerance (of size and area) for a face of the hull to count as a face of the mesh."""
CONTACT_TOLERANCE = 1e-4
"""Share of the radius: a ball with at least (1 - this) of it free touches only the triangle it rests on."""
MAX_QUERIES = 200_000
"""Distance queries per mesh; beyond them CoACD decides."""


@dataclass
class QueryBudget:
    """Distance queries that may still be made."""

    remaining: int

    def spend(self, count: int) -> bool:
        """Subtract `count` queries; False if fewer are left."""
        self.remaining -= count
        return self.remaining >= 0


def is_nearly_convex(mesh: Mesh, concavity: float) -> bool:
    """Whether the convex hull of a mesh may replace it.

    True if ``0.3 (3 V / 4 pi)^(1/3) <= concavity``, with V the volume between mesh and hull, and no point of the hull
    is farther than `concavity` from the solid, up to `DISTANCE_TOLERANCE`. The distance is bounded over entire
    triangles of the hull, and in cavities by balls of that radius that rest on a triangle of the mesh: if one fits into
    the hull without intersecting the rest of the mesh, the mesh is not nearly convex.

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
    if VOLUME_WEIGHT * np.cbrt(0.75 * added / np.pi) > concavity:
        return False
    surface, budget = Surface(mesh.vertices, mesh.faces), QueryBudget(MAX_QUERIES)
    bridging_triangles = hull.points[hull.simplices[~_lies_on_mesh(mesh, hull.equations, hull.points[hull.simplices])]]
    if not _lies_within(surface, mesh.vertices, bridging_triangles, concavity, budget):
        return False
    planes = np.unique(hull.equations, axis=0)
    return not _fits_ball(surface, mesh.vertices[mesh.faces], planes, concavity, budget)


def _lies_on_mesh(mesh: Mesh, equations: Floats, triangles: Floats) -> NDArray[np.bool_]:
    """Which triangles (n, 3, 3) of the hull lie in a face that is completely covered by mesh triangles."""
    from scipy.spatial import cKDTree

    scale = np.array([1.0, 1.0, 1.0, 1.0 / mesh.size])
    planes, face = np.unique(np.round(equations * scale, 9), axis=0, return_inverse=True)
    corners = mesh.vertices[mesh.faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(crossed, axis=1)
    corners, normals, area = corners[area > 0], crossed[area > 0] / area[area > 0, None], area[area > 0]
    offsets = -np.einsum("ij,ij->i", normals, corners[:, 0])
    distance, nearest = cKDTree(planes).query(np.column_stack([normals, offsets]) * scale)
    filled = np.bincount(nearest[distance < FLAT], area[distance < FLAT], len(planes))
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    face_area = np.bincount(face.reshape(-1), np.linalg.norm(sides, axis=1), len(planes))
    found: NDArray[np.bool_] = (filled >= (1.0 - FLAT) * face_area)[face.reshape(-1)]
    return found


def _lies_within(surface: Surface, corners: Floats, triangles: Floats, limit: float, budget: QueryBudget) -> bool:
    """Whether triangles (n, 3, 3) on the hull lie within `limit` of the surface with these vertices."""
    from scipy.spatial import cKDTree

    tree = cKDTree(corners)
    while len(triangles):
        middle, reach = _balls(triangles)
        undecided = tree.query(middle)[0] + reach > limit  # a vertex is no nearer than the surface
        triangles, middle, reach = triangles[undecided], middle[undecided], reach[undecided]
        if not budget.spend(len(middle)):
            return False
        distance = surface.distance(middle)
        if np.any(distance > limit):
            return False
        triangles = divided(triangles[(distance + reach > limit) & (reach > DISTANCE_TOLERANCE * limit)])[0]
    return True


def _fits_ball(surface: Surface, triangles: Floats, planes: Floats, radius: float, budget: QueryBudget) -> bool:
    """Whether a ball that rests on one of the triangles from outside fits into the hull without touching the others."""
    from scipy.spatial import cKDTree

    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    length = np.linalg.norm(normals, axis=1)
    triangles, normals = triangles[length > 0], normals[length > 0] / length[length > 0, None]
    facing = planes[cKDTree(planes[:, :3]).query(normals)[1]]
    offset_triangles = triangles + radius * normals[:, None]
    out = (
        np.min(np.einsum("tkj,tj->tk", offset_triangles, facing[:, :3]) + facing[:, 3:], axis=1) > 0
    )  # nearly all of them
    triangles, normals = triangles[~out], normals[~out]
    while len(triangles):
        inside, out = _against_hull(triangles + radius * normals[:, None], planes)
        triangles, normals, inside = triangles[~out], normals[~out], inside[~out]
        if not budget.spend(len(triangles)):
            return True
        middle, reach = _balls(triangles)
        free = surface.distance(middle + radius * normals)
        if np.any(inside & (free >= (1.0 - CONTACT_TOLERANCE) * radius)):
            return True
        undecided = (free + reach >= (1.0 - CONTACT_TOLERANCE) * radius) & (reach > DISTANCE_TOLERANCE * radius)
        triangles, parent = divided(triangles[undecided])
        normals = normals[undecided][parent]
    return False


def _balls(triangles: Floats) -> tuple[Floats, Floats]:
    """Bounding balls of triangles: centroids (n, 3) and radii (n,)."""
    middle = triangles.mean(axis=1)
    reach: Floats = np.linalg.norm(triangles - middle[:, None], axis=2).max(axis=1)
    return middle, reach


def _against_hull(triangles: Floats, planes: Floats) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Of triangles (n, 3, 3): whose centroid is inside the hull n·x + d <= 0, and which are entirely outside a plane."""
    inside, out = np.empty(len(triangles), dtype=bool), np.empty(len(triangles), dtype=bool)
    rows = max(1, 1_000_000 // len(planes))
    for start in range(0, len(triangles), rows):
        part = slice(start, start + rows)
        height = triangles[part] @ planes[:, :3].T + planes[:, 3]  # (n, corners, planes)
        inside[part] = np.all(height.mean(axis=1) <= 0, axis=1)
        out[part] = np.any(height.min(axis=1) > 0, axis=1)
    return inside, out
