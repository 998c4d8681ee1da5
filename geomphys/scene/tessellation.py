"""Triangle meshes of primitives, for display and for triangle-based checks; the physics uses the exact shapes.

Vertices lie on the surface; triangles are counter-clockwise seen from outside.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Triangles = tuple[Floats, Ints]

DISPLAY_SEGMENTS = 24
"""Segments of round shapes for display: at most 0.9 % of the radius inside the circle."""
COLLISION_SEGMENTS = 96
"""Segments of round shapes for triangle-based checks: at most 0.05 % of the radius inside the circle."""


@lru_cache(maxsize=4096)
def box_triangles(size: tuple[float, float, float]) -> Triangles:
    """Box of full edge lengths about the origin: 8 corners, 12 triangles."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * np.array(size)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]
    return _read_only(corners, np.array(faces, dtype=np.int64))


@lru_cache(maxsize=4096)
def sphere_triangles(radius: float, segments: int) -> Triangles:
    """Ball about the origin with its poles on z."""
    polar = np.linspace(-0.5 * np.pi, 0.5 * np.pi, segments // 2 + 1)
    return surface_of_revolution(radius * np.cos(polar), radius * np.sin(polar), segments)


@lru_cache(maxsize=4096)
def cylinder_triangles(radius: float, height: float, segments: int) -> Triangles:
    """Cylinder of full height along z about the origin."""
    half = 0.5 * height
    return surface_of_revolution(np.array([0.0, radius, radius, 0.0]), np.array([-half, -half, half, half]), segments)


@lru_cache(maxsize=4096)
def capsule_triangles(radius: float, height: float, segments: int) -> Triangles:
    """Capsule along z about the origin, `height` without its caps."""
    cap = np.linspace(0.0, 0.5 * np.pi, segments // 4 + 1)
    around, up = radius * np.cos(cap), radius * np.sin(cap) + 0.5 * height
    return surface_of_revolution(np.concatenate([around[::-1], around]), np.concatenate([-up[::-1], up]), segments)


def triangulate_faces(vertices: Floats, loops: Ints, loop_start: Ints) -> Triangles:
    """Triangulate convex faces: fans about the first vertex of each loop, whose rows of `loops` `loop_start` (F + 1,) tells."""
    rows = np.arange(loop_start[0], loop_start[-1])
    face = np.repeat(np.arange(len(loop_start) - 1), np.diff(loop_start))
    first, end = loop_start[face], loop_start[face + 1]
    inner = (rows > first) & (rows + 1 < end)
    corners = np.stack([first, rows, rows + 1], axis=1)[inner]
    return _read_only(vertices, loops[corners].astype(np.int64))


def merge_surfaces(parts: list[Triangles]) -> Triangles:
    """Several surfaces as one."""
    if not parts:
        return _read_only(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64))
    if len(parts) == 1:
        return parts[0]
    starts = np.concatenate([[0], np.cumsum([len(v) for v, _ in parts])])
    faces = [f + start for (_, f), start in zip(parts, starts[:-1], strict=True)]
    return _read_only(np.concatenate([v for v, _ in parts]), np.concatenate(faces))


def surface_of_revolution(radii: Floats, heights: Floats, segments: int) -> Triangles:
    """Surface of revolution about z of a profile; its first and last points are poles on the axis."""
    angles = np.arange(segments) * (2 * np.pi / segments)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [
        np.column_stack([r * circle, np.full(segments, z)]) for r, z in zip(radii[1:-1], heights[1:-1], strict=True)
    ]
    corners = np.concatenate([[[0.0, 0.0, heights[0]]], *rings, [[0.0, 0.0, heights[-1]]]])
    index, next_index = np.arange(segments), np.roll(np.arange(segments), -1)
    first, last, top = 1, 1 + segments * (len(rings) - 1), len(corners) - 1
    faces = [np.column_stack([np.zeros_like(index), first + next_index, first + index])]
    for k in range(len(rings) - 1):
        low, high = 1 + segments * k, 1 + segments * (k + 1)
        faces.append(np.column_stack([low + index, low + next_index, high + next_index]))
        faces.append(np.column_stack([low + index, high + next_index, high + index]))
    faces.append(np.column_stack([np.full_like(index, top), last + index, last + next_index]))
    return _read_only(corners, np.concatenate(faces).astype(np.int64))


def _read_only(vertices: Floats, faces: Ints) -> Triangles:
    """Make the arrays read-only: surfaces are shared between bodies."""
    vertices.flags.writeable = faces.flags.writeable = False
    return vertices, faces
