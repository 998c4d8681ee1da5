"""Placing pieces in the world, and the farthest point of a piece in a direction.

Spheres and capsules are a *core*, a point or a segment, grown by their radius: everything below sees the core only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from geomphys.jit.addresses import address, float_at, int32_at, int_at
from geomphys.jit.kernel import inlined, kernel
from geomphys.numerics.vec3 import Quat, Rot, Vec, dot, quat_unit, rot_from_quat, rot_mul, rotate
from geomphys.scene.arrays import CAPSULE, CYLINDER, HULL, Floats, Pieces
from geomphys.scene.direction_cells import cell_of


class Shapes(NamedTuple):
    """What the narrow phase reads of `Pieces` and their frames, by address: valid for as long as the arrays are."""

    kind: int
    size: int
    centre: int
    reach: int
    vertex_start: int
    vertices: int
    neighbour_start: int
    neighbours: int
    cell_start: int
    cells: int
    frames: int


class Core(NamedTuple):
    """What the farthest point of a piece depends on; arrays by address."""

    kind: int
    corners: int  # how many
    vertices: int
    neighbour_start: int  # per corner, into `neighbours`
    neighbours: int
    cells: int  # 0: it is small, and searched from end to end
    x: float  # m: box half extents; cylinder radius and half height; capsule half height as the third
    y: float
    z: float


@kernel
def place_pieces(pieces: Pieces, poses: Floats, frames: Floats) -> None:
    """Write world_from_piece of every piece into `frames` (P, 12), given the bodies' world poses (B, 7)."""
    for p in range(len(pieces.kind)):
        place_piece(pieces, poses, frames, p)


@kernel
def place_piece(pieces: Pieces, poses: Floats, frames: Floats, p: int) -> None:
    """Write world_from_piece of piece `p` into its row of `frames` (P, 12), given the bodies' world poses (B, 7)."""
    b = pieces.body[p]
    q: Quat = (poses[b, 3], poses[b, 4], poses[b, 5], poses[b, 6])
    body = rot_from_quat(quat_unit(q))
    local = pieces.local
    rot = rot_mul(
        body,
        (
            local[p, 0],
            local[p, 1],
            local[p, 2],
            local[p, 3],
            local[p, 4],
            local[p, 5],
            local[p, 6],
            local[p, 7],
            local[p, 8],
        ),
    )
    at = rotate(body, (local[p, 9], local[p, 10], local[p, 11]))
    for k in range(9):
        frames[p, k] = rot[k]
    frames[p, 9] = poses[b, 0] + at[0]
    frames[p, 10] = poses[b, 1] + at[1]
    frames[p, 11] = poses[b, 2] + at[2]


@kernel
def vec_at(row: int, i: int) -> Vec:
    """Three consecutive numbers from element i on of an array at address `row`."""
    return (float_at(row, i), float_at(row, i + 1), float_at(row, i + 2))


@inlined
def shapes_of(pieces: Pieces, frames: Floats) -> Shapes:
    """Addresses of the arrays of `pieces` and of `frames` (P, 12), world_from_piece."""
    return Shapes(
        address(pieces.kind),
        address(pieces.size),
        address(pieces.centre),
        address(pieces.reach),
        address(pieces.vertex_start),
        address(pieces.vertices),
        address(pieces.neighbour_start),
        address(pieces.neighbours),
        address(pieces.cell_start),
        address(pieces.cells),
        address(frames),
    )


@kernel
def rotation_of(shapes: Shapes, p: int) -> Rot:
    """Rotation world_from_piece."""
    f, i = shapes.frames, 12 * p
    x, y, z = vec_at(f, i), vec_at(f, i + 3), vec_at(f, i + 6)
    return (x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])


@kernel
def position_of(shapes: Shapes, p: int) -> Vec:
    """Position of a piece's frame in the world [m]."""
    return vec_at(shapes.frames, 12 * p + 9)


@kernel
def core_of(shapes: Shapes, p: int) -> Core:
    """Core of a piece."""
    kind, first = int_at(shapes.kind, p), int_at(shapes.vertex_start, p)
    cells = int_at(shapes.cell_start, p)
    x, y, z = vec_at(shapes.size, 3 * p)
    if kind <= CAPSULE:
        x, y, z = 0.0, 0.0, y
    return Core(
        kind,
        int_at(shapes.vertex_start, p + 1) - first,
        shapes.vertices + 24 * first,
        shapes.neighbour_start + 4 * first,
        shapes.neighbours,
        shapes.cells + 4 * cells if cells >= 0 else 0,
        x,
        y,
        z,
    )


@kernel
def radius_of(shapes: Shapes, p: int) -> float:
    """By how much the core of a piece is grown [m]."""
    return float_at(shapes.size, 3 * p) if int_at(shapes.kind, p) <= CAPSULE else 0.0


@kernel
def support(core: Core, d: Vec) -> Vec:
    """A point of the core farthest in direction `d` (not zero), piece frame."""
    if core.kind == HULL:
        return vec_at(core.vertices, 3 * farthest_corner(core, d))
    if core.kind == CYLINDER:
        z = core.y if d[2] >= 0.0 else -core.y
        length = math.sqrt(d[0] * d[0] + d[1] * d[1])
        if length == 0.0:
            return (core.x, 0.0, z)
        k = core.x / length
        return (k * d[0], k * d[1], z)
    x = core.x if d[0] >= 0.0 else -core.x
    y = core.y if d[1] >= 0.0 else -core.y
    z = core.z if d[2] >= 0.0 else -core.z
    return (x, y, z)


@kernel
def farthest_corner(core: Core, d: Vec) -> int:
    """Corner of a hull farthest in direction `d`.

    Climbing begins where the direction's cell says, and ends at a corner none of whose neighbours is farther, which on a
    convex surface is the farthest of all.
    """
    if core.cells == 0:
        best = 0
        reach = -np.inf
        for i in range(core.corners):
            x = dot(vec_at(core.vertices, 3 * i), d)
            if x > reach:
                reach = x
                best = i
        return best
    best = int32_at(core.cells, cell_of(d))
    reach = dot(vec_at(core.vertices, 3 * best), d)
    while True:
        at = best
        for k in range(int32_at(core.neighbour_start, at), int32_at(core.neighbour_start, at + 1)):
            i = int32_at(core.neighbours, k)
            x = dot(vec_at(core.vertices, 3 * i), d)
            if x > reach:
                reach = x
                best = i
        if best == at:
            return best
