"""How much of a mesh's surface its convex pieces leave bare, and how to cover it.

CoACD rounds the corners of its parts, to about 1e-4 of the mesh's size, so its hulls fall short of the surface here and
there. Here each piece takes in the surface that runs within that reach of it; what sticks out afterwards is found
exactly, by clipping each triangle against the pieces until nothing of it is left or a polygon that lies in none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from geomphys.world.hulls import polytope

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 1.5e-4
"""Of the mesh's size: how far a piece first reaches for the surface; twice that where something stays bare, and so on."""
DOUBLINGS = 6
SLACK = 1e-9
"""Of the mesh's size: less than that is not bare."""


def covering(vertices: Floats, faces: Ints, pieces: Sequence[Floats]) -> list[Floats]:
    """Grow convex pieces until together they hold every point of a surface.

    Parameters
    ----------
    vertices, faces
        The surface, (n, 3) m and (m, 3).
    pieces
        Points (k, 3) whose hulls are the pieces.

    Returns
    -------
    list of ndarray
        The corners of the grown pieces. If after `DOUBLINGS` something is still bare, it stays so: `uncovered` tells.
    """
    size = float(np.ptp(vertices, axis=0).max())
    grown, reach = list(pieces), ROUNDING * size
    for _ in range(DOUBLINGS):
        grown = [_with_surface(vertices, faces, piece, reach) for piece in grown]
        planes = [polytope(piece).planes for piece in grown]
        bare = _bare_polygons(vertices, faces, planes, SLACK * size)
        if not bare:
            break
        reach *= 2.0
    return grown


def uncovered(vertices: Floats, faces: Ints, pieces: Sequence[Floats]) -> float:
    """How far a surface sticks out of pieces, m: over corners and middles of its bare polygons, beyond the piece nearest."""
    slack = SLACK * float(np.ptp(vertices, axis=0).max())
    planes = [polytope(p).planes for p in pieces]
    bare = _bare_polygons(vertices, faces, planes, slack)
    if not bare:
        return 0.0
    points = np.concatenate([np.vstack([polygon, polygon.mean(axis=0)]) for polygon in bare])
    return float(np.max(np.min([_outside(points, p) for p in planes], axis=0), initial=0.0))


def _with_surface(vertices: Floats, faces: Ints, piece: Floats, reach: float) -> Floats:
    """Corners of a piece that took in the surface which runs within `reach` beyond its planes."""
    planes = polytope(piece).planes.copy()
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
    return polytope(np.concatenate([piece, *added])).vertices


def _outside(points: Floats, planes: Floats) -> Floats:
    """Distance of points (n, 3) beyond the farthest plane (n·x <= d); negative inside."""
    found: Floats = np.max(points @ planes[:, :3].T - planes[:, 3], axis=1)
    return found


def _bare_polygons(vertices: Floats, faces: Ints, planes: Sequence[Floats], slack: float) -> list[Floats]:
    """Parts of triangles that lie in no piece, as convex polygons (k, 3)."""
    inside = np.stack([_outside(vertices, p) <= slack for p in planes], axis=1)  # (n, pieces)
    covered = np.any(inside[faces].all(axis=1), axis=1)
    left: list[Floats] = []
    for face in faces[~covered]:
        polygons = [vertices[face]]
        near = np.argsort(-inside[face].sum(axis=0), kind="stable")  # pieces that hold corners of it first
        for k in near:
            polygons = [rest for polygon in polygons for rest in _without(polygon, planes[k], slack)]
            if not polygons:
                break
        left += polygons
    return left


def _without(polygon: Floats, planes: Floats, slack: float) -> list[Floats]:
    """A convex polygon less a convex piece, as convex polygons; what lies within the slack of the piece is dropped."""
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
    kept = []
    for k in range(len(polygon)):
        j = (k + 1) % len(polygon)
        if side[k] >= 0:
            kept.append(polygon[k])
        if (side[k] > 0 > side[j]) or (side[k] < 0 < side[j]):
            share = side[k] / (side[k] - side[j])
            kept.append(polygon[k] + share * (polygon[j] - polygon[k]))
    return np.array(kept).reshape(-1, 3)
