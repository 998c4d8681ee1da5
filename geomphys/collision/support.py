"""Placing pieces in the world, and the farthest point of a piece in a direction.

Spheres and capsules are a *core*, a point or a segment, grown by their radius: everything below sees the core only.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import rot_of, vec_at, vec_from
from geomphys.numerics.vec3 import Quat, Rot, Vec, dot, quat_unit, rot_from_quat, rot_mul, rotate
from geomphys.scene.arrays import CAPSULE, CYLINDER, HULL, Floats, Pieces
from geomphys.scene.direction_cells import cell_of


class Shapes(NamedTuple):
    """Pieces, and where they are: what the narrow phase reads."""

    pieces: Pieces
    frames: Floats  # (P, 12) world_from_piece


class Core(NamedTuple):
    """What the farthest point of a piece depends on."""

    pieces: Pieces
    kind: int
    first: int  # corner of it in `Pieces.vertices`
    corners: int  # how many
    cells: int  # its first in `Pieces.cells`; -1: it is small, and searched from end to end
    x: float  # m: box half extents; cylinder radius and half height; capsule half height as the third
    y: float
    z: float


@kernel
def pose_pieces(pieces: Pieces, poses: Floats, frames: Floats) -> None:
    """Write world_from_piece of every piece into `frames` (P, 12), given the bodies' world poses (B, 7)."""
    for p in range(len(pieces.kind)):
        pose_piece(pieces, poses, frames, p)


@kernel
def pose_piece(pieces: Pieces, poses: Floats, frames: Floats, p: int) -> None:
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
def shapes_of(pieces: Pieces, frames: Floats) -> Shapes:
    """Pieces and their `frames` (P, 12), world_from_piece."""
    return Shapes(pieces, frames)


@kernel
def rotation_of(shapes: Shapes, p: int) -> Rot:
    """Rotation world_from_piece."""
    return rot_of(shapes.frames[p])


@kernel
def position_of(shapes: Shapes, p: int) -> Vec:
    """Position of a piece's frame in the world [m]."""
    return vec_from(shapes.frames[p], 9)


@kernel
def core_of(shapes: Shapes, p: int) -> Core:
    """Core of a piece."""
    pieces = shapes.pieces
    kind, first = pieces.kind[p], pieces.vertex_start[p]
    x, y, z = vec_at(pieces.size, p)
    if kind <= CAPSULE:
        x, y, z = 0.0, 0.0, y
    return Core(pieces, kind, first, pieces.vertex_start[p + 1] - first, pieces.cell_start[p], x, y, z)


@kernel
def radius_of(shapes: Shapes, p: int) -> float:
    """By how much the core of a piece is grown [m]."""
    return shapes.pieces.size[p, 0] if shapes.pieces.kind[p] <= CAPSULE else 0.0


@kernel
def support(core: Core, d: Vec) -> Vec:
    """A point of the core farthest in direction `d` (not zero), piece frame."""
    if core.kind == HULL:
        return vec_at(core.pieces.vertices, core.first + farthest_corner(core, d))
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
    # unsigned: numba need not look whether an index counts from the end
    pieces, vertices = core.pieces, core.pieces.vertices
    first: Any = np.uintp(core.first)
    best: Any = np.uintp(0)
    if core.cells < 0:
        reach = -np.inf
        for i in range(np.uintp(core.corners)):
            x = dot(vec_at(vertices, first + i), d)
            if x > reach:
                reach = x
                best = i
        return int(np.int64(best))
    best = np.uintp(pieces.cells[np.uintp(core.cells + cell_of(d))])
    reach = dot(vec_at(vertices, first + best), d)
    while True:
        at = best
        start = first + at
        for k in range(np.uintp(pieces.neighbour_start[start]), np.uintp(pieces.neighbour_start[start + np.uintp(1)])):
            other: Any = np.uintp(pieces.neighbours[k])
            x = dot(vec_at(vertices, first + other), d)
            if x > reach:
                reach = x
                best = other
        if best == at:
            return int(np.int64(best))
