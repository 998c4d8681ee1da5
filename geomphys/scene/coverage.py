"""Grows convex pieces until they cover a mesh's surface, and measures both one-sided distances between them.

CoACD rounds vertices to about 1e-4 of the mesh's size, so its hulls do not reach the surface everywhere. Each piece is
extended by the surface within that distance of it. What stays uncovered is computed exactly, by clipping every triangle
against the pieces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REACH = 1.5e-4
"""First distance, as a share of the mesh's size, within which a piece takes in surface; doubled while any is uncovered."""
DOUBLINGS = 6
TOLERANCE = 1e-9
"""Share of the mesh's size below which surface outside the pieces counts as covered."""


class Surface:
    """Distance queries to a triangle mesh, vertices (n, 3) m and faces (m, 3)."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        import fcl

        model = fcl.BVHModel()
        model.beginModel(len(vertices), len(faces))
        model.addSubModel(vertices, faces)
        model.endModel()
        self._solid = fcl.CollisionObject(model)

    def distance(self, points: Floats) -> Floats:
        """Unsigned distances (n,) of points (n, 3) to the nearest triangle, m."""
        import fcl

        point = fcl.Sphere(1e-9)
        distances = [fcl.distance(self._solid, fcl.CollisionObject(point, fcl.Transform(p))) for p in points]
        return np.array(distances, dtype=np.float64)


def grow_to_cover(vertices: Floats, faces: Ints, pieces: Sequence[Floats]) -> list[Floats]:
    """Grow convex pieces until their union contains every point of a surface.

    Parameters
    ----------
    vertices, faces
        The surface, (n, 3) m and (m, 3).
    pieces
        Points (k, 3) whose hulls are the pieces.

    Returns
    -------
    list of ndarray
        Vertices (k, 3) of the grown pieces. After `DOUBLINGS` some surface may still be uncovered: see
        `uncovered_distance`.
    """
    size = float(np.ptp(vertices, axis=0).max())
    grown, reach = list(pieces), REACH * size
    for _ in range(DOUBLINGS):
        grown = [_with_surface(vertices, faces, piece, reach) for piece in grown]
        if not _uncovered_polygons(vertices, faces, [_hull(piece)[1] for piece in grown], TOLERANCE * size):
            break
        reach *= 2.0
    return grown


def uncovered_distance(vertices: Floats, faces: Ints, pieces: Sequence[Floats]) -> float:
    """Largest distance of a surface outside the pieces, m, over vertices and centroids of its uncovered polygons."""
    slack = TOLERANCE * float(np.ptp(vertices, axis=0).max())
    planes = [_hull(piece)[1] for piece in pieces]
    polygons = _uncovered_polygons(vertices, faces, planes, slack)
    if not polygons:
        return 0.0
    points = np.concatenate([np.vstack([polygon, polygon.mean(axis=0)]) for polygon in polygons])
    return float(np.max(np.min([_outside(points, p) for p in planes], axis=0), initial=0.0))


def piece_protrusion(vertices: Floats, faces: Ints, pieces: Sequence[Floats], samples: int = 2000) -> float:
    """Largest distance of convex pieces outside a closed surface, m, over sampled points.

    The points are `samples` drawn by area over the pieces with a fixed seed, and as many of their vertices.
    """
    corners = np.concatenate(pieces)
    points = np.concatenate([_surface_points(pieces, samples), corners[:: -(-len(corners) // samples)]])
    distances = Surface(vertices, faces).distance(points)
    far = distances > 1e-6 * float(np.ptp(vertices, axis=0).max())
    outside = np.zeros(len(points), dtype=bool)
    outside[far] = _winding(vertices, faces, points[far]) < 0.5
    return float(np.max(distances[outside], initial=0.0))


def _with_surface(vertices: Floats, faces: Ints, piece: Floats, reach: float) -> Floats:
    """Vertices of a piece extended by the surface within `reach` beyond its planes."""
    planes = _hull(piece)[1]
    height = vertices @ planes[:, :3].T - planes[:, 3]
    out = np.max(height, axis=1)
    planes[:, 3] += reach
    added = [vertices[(out > 0) & (out <= reach)]]
    height -= reach
    corners = height[faces]  # (m, 3, planes)
    crossing = ~np.any(np.min(corners, axis=1) > 0, axis=1) & np.any(out[faces] > reach, axis=1)
    for face in faces[crossing]:
        polygon = vertices[face]
        for plane in planes[np.max(height[face], axis=0) > 0]:
            polygon = _clipped(polygon, plane[3] - polygon @ plane[:3])
            if len(polygon) == 0:
                break
        added.append(polygon)
    return _hull(np.concatenate([piece, *added]))[0]


def _hull(points: Floats) -> tuple[Floats, Floats]:
    """Vertices (k, 3) and planes (f, 4), n·x <= d, of the convex hull of points."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    planes = np.unique(hull.equations, axis=0) * np.array([1.0, 1.0, 1.0, -1.0])
    return points[np.sort(hull.vertices)], planes


def _outside(points: Floats, planes: Floats) -> Floats:
    """Distance of points (n, 3) beyond the farthest plane (n·x <= d); negative inside."""
    found: Floats = np.max(points @ planes[:, :3].T - planes[:, 3], axis=1)
    return found


def _uncovered_polygons(vertices: Floats, faces: Ints, planes: Sequence[Floats], slack: float) -> list[Floats]:
    """Parts of triangles that lie in no piece, as convex polygons (k, 3)."""
    inside = np.stack([_outside(vertices, p) <= slack for p in planes], axis=1)  # (n, pieces)
    covered = np.any(inside[faces].all(axis=1), axis=1)
    uncovered_parts: list[Floats] = []
    for face in faces[~covered]:
        polygons = [vertices[face]]
        order = np.argsort(-inside[face].sum(axis=0), kind="stable")  # pieces that contain most of its vertices first
        for k in order:
            polygons = [remainder for polygon in polygons for remainder in _subtract(polygon, planes[k], slack)]
            if not polygons:
                break
        uncovered_parts += polygons
    return uncovered_parts


def _subtract(polygon: Floats, planes: Floats, slack: float) -> list[Floats]:
    """A convex polygon minus a convex piece, as convex polygons; parts within `slack` of the piece are dropped."""
    height = polygon @ planes[:, :3].T - planes[:, 3]  # (corners, planes)
    if np.any(np.min(height, axis=0) > slack):
        return [polygon]
    remainder: list[Floats] = []
    for plane in planes[np.max(height, axis=0) > slack]:
        side = polygon @ plane[:3] - plane[3] - slack
        if np.max(side) <= 0:
            continue
        if np.min(side) >= 0:
            return [*remainder, polygon]
        remainder.append(_clipped(polygon, side))
        polygon = _clipped(polygon, -side)
    return remainder


def _clipped(polygon: Floats, side: Floats) -> Floats:
    """The part of a convex polygon where `side` >= 0 (Sutherland and Hodgman 1974, one plane)."""
    clipped = []
    for k in range(len(polygon)):
        j = (k + 1) % len(polygon)
        if side[k] >= 0:
            clipped.append(polygon[k])
        if (side[k] > 0 > side[j]) or (side[k] < 0 < side[j]):
            fraction = side[k] / (side[k] - side[j])
            clipped.append(polygon[k] + fraction * (polygon[j] - polygon[k]))
    return np.array(clipped).reshape(-1, 3)


def _surface_points(pieces: Sequence[Floats], count: int) -> Floats:
    """Points spread by area over the surfaces of hulls."""
    from scipy.spatial import ConvexHull

    corners = np.concatenate([p[ConvexHull(p).simplices] for p in pieces])  # (n, 3, 3)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    random = np.random.default_rng(0)
    a, b, c = np.moveaxis(corners[random.choice(len(area), count, p=area / area.sum())], 1, 0)
    u, v = random.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points: Floats = a + u * (b - a) + v * (c - a)
    return points


def _winding(vertices: Floats, faces: Ints, points: Floats) -> Floats:
    """Winding number of a closed surface about points (n, 3): 1 inside, 0 outside (van Oosterom and Strackee 1983)."""
    corners = vertices[faces]
    solid_angles = np.zeros(len(points))
    for start in range(0, len(points), 64):
        a, b, c = np.moveaxis(corners[None] - points[start : start + 64, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(x, axis=-1) for x in (a, b, c))
        top = np.einsum("...i,...i", a, np.cross(b, c))
        dots = [np.einsum("...i,...i", x, y) for x, y in ((a, b), (b, c), (c, a))]
        solid_angles[start : start + 64] = np.arctan2(
            top, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
        ).sum(-1)
    return solid_angles / (2 * np.pi)
