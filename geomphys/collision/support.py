"""Placing pieces in the world, and the farthest point of a piece in a direction.

Spheres and capsules are a *core*, a point or a segment, grown by their radius: everything below sees the core only.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from geomphys.kernel import kernel
from geomphys.vec3 import Quat, Rot, Vec, quat_unit, rot_from_quat, rot_mul, rotate
from geomphys.world.scene import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Floats, Ints, Pieces

Core: TypeAlias = tuple[int, int, int, float, float, float]
"""Kind, first and one past the last corner, and three lengths (see `core_of`)."""

CLIMB = 24
"""Hulls of more corners are climbed over their edges, smaller ones searched from end to end (measured cut-over)."""


class Corners(NamedTuple):
    """The arrays of `Pieces` that supports read."""

    vertices: Floats
    neighbour_start: Ints
    neighbours: Ints


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
def rotation_of(frames: Floats, p: int) -> Rot:
    """Rotation of a frame row."""
    return (
        frames[p, 0],
        frames[p, 1],
        frames[p, 2],
        frames[p, 3],
        frames[p, 4],
        frames[p, 5],
        frames[p, 6],
        frames[p, 7],
        frames[p, 8],
    )


@kernel
def position_of(frames: Floats, p: int) -> Vec:
    """Position of a frame row [m]."""
    return (frames[p, 9], frames[p, 10], frames[p, 11])


@kernel
def core_of(pieces: Pieces, p: int) -> Core:
    """What supports of a piece need: its kind, corners and lengths.

    The lengths are a segment's half length as the third, a box's half extents, a cylinder's radius and half height.
    """
    kind = pieces.kind[p]
    first, last = pieces.vertex_start[p], pieces.vertex_start[p + 1]
    if kind == SPHERE:
        return (kind, first, last, 0.0, 0.0, 0.0)
    if kind == CAPSULE:
        return (kind, first, last, 0.0, 0.0, pieces.size[p, 1])
    return (kind, first, last, pieces.size[p, 0], pieces.size[p, 1], pieces.size[p, 2])


@kernel
def radius_of(pieces: Pieces, p: int) -> float:
    """By how much the core of a piece is grown [m]."""
    return pieces.size[p, 0] if pieces.kind[p] <= CAPSULE else 0.0


@kernel
def support(corners: Corners, core: Core, d: Vec, hint: int) -> tuple[Vec, int]:
    """A point of the core farthest in direction `d` (not zero), piece frame, and the corner to begin at next time."""
    kind = core[0]
    if kind == BOX:
        x = core[3] if d[0] >= 0.0 else -core[3]
        y = core[4] if d[1] >= 0.0 else -core[4]
        z = core[5] if d[2] >= 0.0 else -core[5]
        return (x, y, z), hint
    if kind == HULL:
        best = farthest_corner(corners.vertices, corners.neighbour_start, corners.neighbours, core[1], core[2], d, hint)
        return (corners.vertices[best, 0], corners.vertices[best, 1], corners.vertices[best, 2]), best
    if kind == CYLINDER:
        z = core[4] if d[2] >= 0.0 else -core[4]
        length = math.sqrt(d[0] * d[0] + d[1] * d[1])
        if length == 0.0:
            return (core[3], 0.0, z), hint
        k = core[3] / length
        return (k * d[0], k * d[1], z), hint
    z = core[5] if d[2] >= 0.0 else -core[5]
    return (0.0, 0.0, z), hint


@kernel
def farthest_corner(
    vertices: Floats, neighbour_start: Ints, neighbours: Ints, first: int, last: int, d: Vec, hint: int
) -> int:
    """Row of the corner of a hull farthest in direction `d`; `hint` is the row to begin climbing at.

    Climbing ends at a corner none of whose neighbours is farther, which on a convex surface is the farthest of all.
    """
    if last - first <= CLIMB:
        best = first
        reach = -np.inf
        for i in range(first, last):
            x = vertices[i, 0] * d[0] + vertices[i, 1] * d[1] + vertices[i, 2] * d[2]
            if x > reach:
                reach = x
                best = i
        return best
    best = hint
    reach = vertices[best, 0] * d[0] + vertices[best, 1] * d[1] + vertices[best, 2] * d[2]
    while True:
        at = best
        for k in range(neighbour_start[at], neighbour_start[at + 1]):
            i = first + neighbours[k]
            x = vertices[i, 0] * d[0] + vertices[i, 1] * d[1] + vertices[i, 2] * d[2]
            if x > reach:
                reach = x
                best = i
        if best == at:
            return best
