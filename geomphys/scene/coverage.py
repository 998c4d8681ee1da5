"""Grows convex pieces to cover a mesh's surface; measures what they leave uncovered and how far they protrude.

CoACD rounds the corners of its parts, to about 1e-4 of the mesh's size, and is given a mesh with fewer triangles, so its
hulls fall short of the surface here and there. Here each triangle is assigned to the piece that covers it with the
least growth, halves of it where none does. The rest is found exactly, by clipping triangles that are in no single piece
until nothing or a polygon outside all pieces remains.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REACH = 1.5e-4
"""Of the mesh's size: how far a piece grows to the surface at first; twice as far where something stays uncovered."""
DOUBLINGS = 6
GRAIN = 2e-4
"""Of the mesh's size: smaller parts of triangles are clipped rather than divided to test whether they are uncovered."""
MAX_PARTS = 50_000
"""Parts of triangles that are tested against the pieces at once; if there are more, they are clipped."""
BLOCK = 1 << 16
"""Distances from planes that are computed at once: as many as fit in a processor's cache"""
TOLERANCE = 1e-9
"""Of the mesh's size: less than that counts as covered."""


class Surface:
    """Triangles that distances are measured to, (n, 3) m and (m, 3)."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        import fcl

        model = fcl.BVHModel()
        model.beginModel(len(vertices), len(faces))
        model.addSubModel(vertices, faces)
        model.endModel()
        self._solid = fcl.CollisionObject(model)

    def distance(self, points: Floats) -> Floats:
        """Distances (n,) of points (n, 3) from the nearest triangle, on either side of it."""
        import fcl

        point = fcl.Sphere(1e-9)
        away = [fcl.distance(self._solid, fcl.CollisionObject(point, fcl.Transform(p))) for p in points]
        return np.array(away, dtype=np.float64)


def grow_to_cover(vertices: Floats, faces: Ints, pieces: Sequence[Floats], reach: float | None = None) -> list[Floats]:
    """Grow convex pieces until together they hold every point of a surface.

    Parameters
    ----------
    vertices, faces
        The surface, (n, 3) m and (m, 3).
    pieces
        Points (k, 3) whose hulls are the pieces.
    reach
        How far pieces grow at first, m; twice as far where something stays uncovered. None: `REACH` of the size.

    Returns
    -------
    list of ndarray
        The corners of the grown pieces. If after `DOUBLINGS` something is still uncovered, it stays so: see `uncovered_distance`.
    """
    size = float(np.ptp(vertices, axis=0).max())
    grown = [_hull(piece)[0] for piece in pieces]
    reach = REACH * size if reach is None else reach
    triangles = vertices[faces]
    surface: tuple[Floats, Ints] | None = (vertices, faces)
    for _ in range(DOUBLINGS if pieces else 0):
        starts, planes = list(grown), [_hull(piece)[1] for piece in grown]
        left = []
        while len(triangles):
            away = _away(*(surface or _apart(triangles)), planes, starts, reach)
            nearest = np.argmin(away, axis=1)
            out = away[np.arange(len(away)), nearest]
            surface, taken = None, (out > TOLERANCE * size) & (out <= reach)
            for k in np.unique(nearest[taken]):
                grown[k] = np.concatenate([grown[k], triangles[taken & (nearest == k)].reshape(-1, 3)])
            triangles = triangles[out > reach]
            small = np.ptp(triangles, axis=1).max(axis=1) < 0.5 * reach
            left.append(triangles[small])
            triangles = divided(triangles[~small])[0]
            if len(triangles) > MAX_PARTS:
                left.append(triangles)
                break
        grown = [_hull(piece)[0] for piece in grown]
        triangles = np.concatenate([*left, np.zeros((0, 3, 3))])
        if len(triangles) == 0:
            break
        reach *= 2.0
    return grown


def uncovered_distance(vertices: Floats, faces: Ints, pieces: Sequence[Floats]) -> float:
    """How far a surface protrudes from pieces, m: corners and middles of its uncovered polygons beyond the nearest piece."""
    size = float(np.ptp(vertices, axis=0).max())
    planes = [_hull(piece)[1] for piece in pieces]
    triangles = vertices[faces]
    away = _away(vertices, faces, planes, pieces, TOLERANCE * size)
    small: list[Floats] = []
    while True:
        triangles = triangles[np.min(away, axis=1) > TOLERANCE * size]
        fine = np.ptp(triangles, axis=1).max(axis=1) < GRAIN * size
        small.append(triangles[fine])
        triangles = divided(triangles[~fine])[0]
        if len(triangles) == 0 or len(triangles) > MAX_PARTS:
            break
        away = _away(*_apart(triangles), planes, pieces, TOLERANCE * size)
    polygons = _uncovered_polygons(np.concatenate([*small, triangles]), planes, TOLERANCE * size)
    if not polygons:
        return 0.0
    points = np.concatenate([np.vstack([polygon, polygon.mean(axis=0)]) for polygon in polygons])
    return float(np.max(np.min([_outside(points, p) for p in planes], axis=0), initial=0.0))


def piece_protrusion(
    vertices: Floats, faces: Ints, pieces: Sequence[Floats], samples: int = 2000, *, beyond: float = 0.0
) -> float:
    """How far convex pieces protrude from a closed surface, m: the largest distance outside it of points of theirs.

    The points are `samples` spread over the pieces by area, the same ones each time, and as many of their corners. Where
    none is farther outside than `beyond`, m, the result is 0, and is found faster.
    """
    from scipy.spatial import cKDTree

    corners = np.concatenate(pieces)
    points = np.concatenate([_surface_points(pieces, samples), corners[:: -(-len(corners) // samples)]])
    least = max(beyond, 1e-6 * float(np.ptp(vertices, axis=0).max()))
    points = points[cKDTree(vertices).query(points)[0] > least]  # the surface is no farther than its nearest vertex
    away = Surface(vertices, faces).distance(points)
    points, away = points[away > least], away[away > least]
    return float(np.max(away[_are_outside(vertices, faces, points, away)], initial=0.0))


def _are_outside(vertices: Floats, faces: Ints, points: Floats, away: Floats) -> NDArray[np.bool_]:
    """Which points (n, 3) are outside a closed surface at these distances (n,) from it.

    A ball of that radius about a point does not intersect the surface, so all points in it are on the same side.
    """
    outside, left = np.zeros(len(points), dtype=bool), np.argsort(-away, kind="stable")
    while len(left):
        first = left[0]
        beside = np.linalg.norm(points[left] - points[first], axis=1) < away[first]
        outside[left[beside]] = winding(vertices, faces, points[first : first + 1])[0] < 0.5
        left = left[~beside]
    return outside


def _away(vertices: Floats, faces: Ints, planes: Sequence[Floats], pieces: Sequence[Floats], reach: float) -> Floats:
    """How far (m, pieces) each triangle protrudes from each piece, negative inside; inf where farther than `reach`."""
    away = np.full((len(faces), len(pieces)), np.inf)
    for k, (piece, sides) in enumerate(zip(pieces, planes, strict=True)):
        low, high = piece.min(axis=0) - reach, piece.max(axis=0) + reach
        near = np.flatnonzero(np.all((vertices >= low) & (vertices <= high), axis=1))
        out = np.full(len(vertices), np.inf)
        out[near] = _outside(vertices[near], sides)
        away[:, k] = out[faces].max(axis=1)
    return away


def _apart(triangles: Floats) -> tuple[Floats, Ints]:
    """Triangles (n, 3, 3) as vertices and faces."""
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def _hull(points: Floats) -> tuple[Floats, Floats]:
    """Corners (k, 3) and planes (f, 4), n·x <= d, of the convex hull of points."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    planes = np.unique(hull.equations, axis=0) * np.array([1.0, 1.0, 1.0, -1.0])
    return points[np.sort(hull.vertices)], planes


def _outside(points: Floats, planes: Floats) -> Floats:
    """Distance of points (n, 3) beyond the farthest plane (n·x <= d); negative inside."""
    found, step = np.empty(len(points)), max(1, BLOCK // len(planes))
    for start in range(0, len(points), step):
        height = planes[:, :3] @ points[start : start + step].T
        height -= planes[:, 3:]
        found[start : start + step] = height.max(axis=0)
    return found


def _uncovered_polygons(triangles: Floats, planes: Sequence[Floats], slack: float) -> list[Floats]:
    """Parts of triangles (n, 3, 3) that lie in no piece, as convex polygons (k, 3)."""
    if len(triangles) == 0:
        return []
    left: list[Floats] = []
    points, faces = _apart(triangles)
    beyond = np.stack([_outside(points, p)[faces].max(axis=1) for p in planes], axis=1)
    for triangle, away in zip(triangles, beyond, strict=True):
        polygons = [triangle]
        for k in np.argsort(away, kind="stable"):  # pieces that contain most of it first
            polygons = [rest for polygon in polygons for rest in _subtract(polygon, planes[k], slack)]
            if not polygons:
                break
        left += polygons
    return left


def _subtract(polygon: Floats, planes: Floats, slack: float) -> list[Floats]:
    """A convex polygon less a convex piece, as convex polygons; parts within the slack of the piece are dropped."""
    height = polygon @ planes[:, :3].T - planes[:, 3]  # (corners, planes)
    if np.any(np.min(height, axis=0) > slack):
        return [polygon]
    rest: list[Floats] = []
    for plane in planes[np.max(height, axis=0) > slack]:
        side = polygon @ plane[:3] - plane[3] - slack
        if np.max(side) <= 0:
            continue
        if np.min(side) >= 0:
            return [*rest, polygon]
        rest.append(_clipped(polygon, side))
        polygon = _clipped(polygon, -side)
    return rest


def _clipped(polygon: Floats, side: Floats) -> Floats:
    """The part of a convex polygon where `side` >= 0 (Sutherland and Hodgman 1974, one plane)."""
    clipped = []
    for k in range(len(polygon)):
        j = (k + 1) % len(polygon)
        if side[k] >= 0:
            clipped.append(polygon[k])
        if (side[k] > 0 > side[j]) or (side[k] < 0 < side[j]):
            share = side[k] / (side[k] - side[j])
            clipped.append(polygon[k] + share * (polygon[j] - polygon[k]))
    return np.array(clipped).reshape(-1, 3)


def divided(triangles: Floats) -> tuple[Floats, NDArray[np.int64]]:
    """Parts of triangles, and which triangle each is of.

    Two halves, cut across the longest edge; of one whose shortest edge is less than half of that, three of half its
    length, cut across both long edges.
    """
    lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)  # of ab, bc, ca
    rows = np.arange(len(triangles))
    slim = lengths.min(axis=1) < 0.5 * lengths.max(axis=1)
    first = np.where(slim, np.argmin(lengths, axis=1), np.argmax(lengths, axis=1))
    a, b, c = (triangles[rows, (first + k) % 3] for k in range(3))  # ab is the shortest of the slim, else the longest
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    fat = ~slim
    parts = [
        *(np.stack(part, axis=1)[fat] for part in ((a, ab, c), (ab, b, c))),
        *(np.stack(part, axis=1)[slim] for part in ((a, b, bc), (a, bc, ca), (ca, bc, c))),
    ]
    return np.concatenate(parts), np.concatenate([rows[fat], rows[fat], rows[slim], rows[slim], rows[slim]])


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


def winding(vertices: Floats, faces: Ints, points: Floats) -> Floats:
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
