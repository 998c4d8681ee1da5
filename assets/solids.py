"""Closed triangle meshes made from a few numbers: rounded limbs, extruded outlines, solids from flat faces.

Every mesh is watertight and its triangles wind counter-clockwise seen from outside. Lengths are in metres.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Solid(NamedTuple):
    """A triangle mesh: ``vertices`` (n, 3) in metres, ``triangles`` (m, 3) indices into them."""

    vertices: np.ndarray
    triangles: np.ndarray

    def moved(self, offset: tuple[float, float, float]) -> Solid:
        """The same solid shifted by ``offset``."""
        return Solid(self.vertices + np.asarray(offset, dtype=float), self.triangles)


def lathe(rings: list[np.ndarray], start: np.ndarray, end: np.ndarray) -> Solid:
    """Skin over rings of equally many points, closed by one point at either end.

    The points of a ring go round the axis from ``start`` to ``end`` by the right-hand rule. k rings of n points make
    2 n k triangles.
    """
    n, k = len(rings[0]), len(rings)
    vertices = np.vstack([start, *rings, end])
    last = len(vertices) - 1
    triangles = []
    for j in range(n):
        triangles.append((0, 1 + (j + 1) % n, 1 + j))
    for i in range(k - 1):
        for j in range(n):
            a, b = 1 + i * n + j, 1 + i * n + (j + 1) % n
            triangles += [(a, b, b + n), (a, b + n, a + n)]
    for j in range(n):
        base = 1 + (k - 1) * n
        triangles.append((base + j, base + (j + 1) % n, last))
    return Solid(vertices, np.array(triangles))


def limb(
    length: float,
    radii: tuple[float, float],
    sides: int,
    rings: int,
    top: float = 1.0,
    bottom: float = 1.0,
) -> Solid:
    """Convex rounded limb along +x: the hull of a ball at x = 0 and a ball at x = ``length``, flattened in z.

    ``radii`` are those of the two balls; ``top`` and ``bottom`` scale z above and below the axis. ``rings`` is even:
    half of them round off each end. 2 * ``sides`` * ``rings`` triangles.
    """
    r0, r1 = radii
    tilt = np.arcsin((r0 - r1) / length)
    half = rings // 2
    start_angles = np.linspace(np.pi, np.pi / 2 - tilt, half + 1)[1:]
    end_angles = np.linspace(np.pi / 2 - tilt, 0.0, half + 1)[:-1]
    profile = [(r0 * np.cos(a), r0 * np.sin(a)) for a in start_angles]
    profile += [(length + r1 * np.cos(a), r1 * np.sin(a)) for a in end_angles]
    turn = 2 * np.pi * np.arange(sides) / sides
    y, z = np.cos(turn), np.sin(turn)
    z = np.where(z > 0, top * z, bottom * z)
    skins = [np.stack([np.full(sides, x), r * y, r * z], axis=1) for x, r in profile]
    return lathe(skins, np.array([-r0, 0.0, 0.0]), np.array([length + r1, 0.0, 0.0]))


def globe(radius: float, sides: int, bands: int) -> Solid:
    """Ball of meridians and parallels about z: 2 * ``sides`` * (``bands`` - 1) triangles."""
    turn = 2 * np.pi * np.arange(sides) / sides
    rings = []
    for i in range(1, bands):
        polar = np.pi - np.pi * i / bands
        r, z = radius * np.sin(polar), radius * np.cos(polar)
        rings.append(np.stack([r * np.cos(turn), r * np.sin(turn), np.full(sides, z)], axis=1))
    return lathe(rings, np.array([0.0, 0.0, -radius]), np.array([0.0, 0.0, radius]))


def ear_clipped(outline: np.ndarray) -> list[tuple[int, int, int]]:
    """Triangles of a simple polygon (n, 2) that runs counter-clockwise, as indices; n - 2 of them."""
    rest = list(range(len(outline)))
    triangles = []
    while len(rest) > 3:
        for k in range(len(rest)):
            a, b, c = rest[k - 1], rest[k], rest[(k + 1) % len(rest)]
            if _side(outline[a], outline[b], outline[c]) <= 1e-12:
                continue
            others = [p for p in rest if p not in (a, b, c)]
            if any(_inside(outline[p], outline[a], outline[b], outline[c]) for p in others):
                continue
            triangles.append((a, b, c))
            rest.pop(k)
            break
        else:
            raise ValueError("the outline crosses itself or runs clockwise")
    triangles.append((rest[0], rest[1], rest[2]))
    return triangles


def _side(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _inside(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> bool:
    return min(_side(a, b, p), _side(b, c, p), _side(c, a, p)) > -1e-12


def from_faces(vertices: np.ndarray, faces: list[tuple[int, ...]]) -> Solid:
    """Solid from flat simple polygons (also concave ones), each counter-clockwise seen from outside."""
    triangles = []
    for face in faces:
        corners = vertices[list(face)]
        following = np.roll(corners, -1, axis=0)
        normal = np.cross(corners, following).sum(axis=0)
        u = following[0] - corners[0]
        flat = np.stack([corners @ u, corners @ np.cross(normal, u)], axis=1)
        triangles += [(face[a], face[b], face[c]) for a, b, c in ear_clipped(flat / np.ptp(flat, axis=0))]
    return Solid(vertices, np.array(triangles))


def extruded(outline: list[tuple[float, float]], height: float, taper: float = 1.0) -> Solid:
    """Prism over a counter-clockwise outline in x, y from z = 0 to ``height``; 4 n - 4 triangles.

    ``taper`` scales the upper outline about the origin.
    """
    n = len(outline)
    flat = np.asarray(outline, dtype=float)
    vertices = np.vstack([np.c_[flat, np.zeros(n)], np.c_[taper * flat, np.full(n, height)]])
    faces: list[tuple[int, ...]] = [tuple(range(n - 1, -1, -1)), tuple(range(n, 2 * n))]
    faces += [(j, (j + 1) % n, n + (j + 1) % n, n + j) for j in range(n)]
    return from_faces(vertices, faces)


def upright(solid: Solid) -> Solid:
    """The solid turned so that x, y, z become x, z, -y: an extrusion stands with its outline in the x, z plane."""
    v = solid.vertices
    return Solid(np.stack([v[:, 0], -v[:, 2], v[:, 1]], axis=1), solid.triangles)


def block(x: float, y: float, z: float) -> Solid:
    """Box of full lengths x, y, z standing on z = 0, centred in x and y; 12 triangles."""
    return extruded([(-x / 2, -y / 2), (x / 2, -y / 2), (x / 2, y / 2), (-x / 2, y / 2)], z)


def regular(corners: int, radius: float, turned: float = 0.0) -> list[tuple[float, float]]:
    """Corners of a regular polygon, counter-clockwise, the first at angle ``turned`` (rad) from x."""
    angles = turned + 2 * np.pi * np.arange(corners) / corners
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angles]
