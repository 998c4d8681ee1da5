"""Approximates a body by URDF primitives: its convex pieces, each hull by its bounding box or cylinder of the least volume.

A robot description names meshes by files, which do not exist on another machine; primitives are part of the text.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.query import outline
from geomphys.numerics.transforms import matrix_from_frame
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE
from geomphys.scene.world import World

Floats = NDArray[np.float64]

MIN_LENGTH_M = 1e-4
"""m; flat bodies are drawn this thick."""

MIN_DEVIATION_RATIO = 1.1
"""Least ratio of the standard deviations of points along two principal axes."""


class PlacedPrimitive(NamedTuple):
    """A box, cylinder (along z) or sphere in the frame of its body."""

    tag: str  # element of URDF
    sizes: tuple[float, ...]  # m: box: full lengths x y z; cylinder: radius, length; sphere: radius
    body_from_shape: Floats  # (4, 4)


def primitives_of_body(world: World, body: int) -> list[PlacedPrimitive]:
    """The pieces of a body; one box or cylinder about its display mesh where it has none; nothing without a surface."""
    bodies = world.scene.bodies
    found = [
        shape
        for piece in range(int(bodies.piece_start[body]), int(bodies.piece_start[body + 1]))
        for shape in _primitives_of_piece(world, piece)
    ]
    points = world.triangles[body][0]
    return found or ([fitted_primitive(points)] if len(points) else [])


def _primitives_of_piece(world: World, piece: int) -> Iterator[PlacedPrimitive]:
    pieces = world.scene.pieces
    kind, size = int(pieces.kind[piece]), pieces.size[piece]
    body_from_piece = matrix_from_frame(pieces.local[piece])
    if kind == SPHERE:
        yield PlacedPrimitive("sphere", (float(size[0]),), body_from_piece)
    elif kind == BOX:
        yield PlacedPrimitive("box", tuple((2.0 * size).tolist()), body_from_piece)
    elif kind in (CYLINDER, CAPSULE):
        radius, half = float(size[0]), float(size[1])
        yield PlacedPrimitive("cylinder", (radius, 2.0 * half), body_from_piece)
        for end in (-half, half) if kind == CAPSULE else ():
            yield PlacedPrimitive("sphere", (radius,), body_from_piece @ raised(end))
    else:
        start, stop = pieces.vertex_start[piece : piece + 2]
        points = pieces.vertices[start:stop] if kind == HULL else outline(pieces, piece)
        shape = fitted_primitive(points)
        yield shape._replace(body_from_shape=body_from_piece @ shape.body_from_shape)


def fitted_primitive(points: Floats) -> PlacedPrimitive:
    """The box or cylinder about points (n, 3) of the least volume, along the axes of their frame or their principal axes."""
    candidates = list(_along(points, np.eye(3)))
    if (axes := _principal_axes(points)) is not None:
        candidates += _along(points, axes)
    best = candidates[0]
    for shape in candidates[1:]:
        if _volume(shape) < 0.999 * _volume(best):  # the first of equal ones, independent of rounding
            best = shape
    return best


def _along(points: Floats, axes: Floats) -> Iterator[PlacedPrimitive]:
    """The box, and a cylinder for each of three axes (rows of (3, 3)), about points."""
    local = points @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    lengths, middle = np.maximum(high - low, MIN_LENGTH_M), (low + high) / 2
    placed = np.eye(4)
    placed[:3, :3], placed[:3, 3] = axes.T, axes.T @ middle
    yield PlacedPrimitive("box", tuple(lengths.tolist()), placed)
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        across = local[:, [x, y]] - middle[[x, y]]
        radius = max(float(np.sqrt((across * across).sum(axis=1)).max()), MIN_LENGTH_M / 2)
        rotated = placed.copy()
        rotated[:3, :3] = placed[:3, [x, y, z]]
        yield PlacedPrimitive("cylinder", (radius, float(lengths[z])), rotated)


def _principal_axes(points: Floats) -> Floats | None:
    """Principal axes (rows) of points; None where the deviations are too similar to determine them."""
    if len(points) < 4:
        return None
    _, deviations, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if deviations[0] < MIN_DEVIATION_RATIO * deviations[1] or deviations[1] < MIN_DEVIATION_RATIO * deviations[2]:
        return None
    signs = np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])  # signs differ between libraries
    first, second = signs[0] * axes[0], signs[1] * axes[1]
    return np.array([first, second, np.cross(first, second)])


def _volume(shape: PlacedPrimitive) -> float:
    if shape.tag == "box":
        return float(np.prod(shape.sizes))
    radius, length = shape.sizes
    return float(np.pi * radius * radius * length)


def raised(height: float) -> Floats:
    """(4, 4) of a translation along z [m]."""
    matrix = np.eye(4)
    matrix[2, 3] = height
    return matrix
