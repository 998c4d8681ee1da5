"""Poses pieces in the world; support points of pieces, and their features (face or edge) towards a direction.

Spheres and capsules are a *core*, a point or a segment, grown by their radius: everything below sees the core only.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from geomphys.collision.scratch import MAX_POLYGON
from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import set_vec_at, vec_at
from geomphys.numerics.vec3 import (
    Rot,
    Vec,
    add,
    add_scaled,
    dot,
    quat_unit,
    rot_from_quat,
    rot_mul,
    rotate,
    rotate_back,
    scale,
)
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Floats, Pieces
from geomphys.scene.direction_cells import cell_of
from geomphys.scene.kinematics import frame_position, frame_rotation, orientation_of, set_frame

RIM = 16
"""Corners that stand for a cylinder's cap."""
TILT = 0.01
"""Sine of the angle from which on a capsule's feature is its end instead of its side."""


class Shapes(NamedTuple):
    """Pieces and their frames, as the narrow phase reads them."""

    pieces: Pieces
    frames: Floats  # (P, 12) world_from_piece


class Core(NamedTuple):
    """The part of a piece that its support point depends on."""

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
    b, local = pieces.body[p], pieces.local
    body = rot_from_quat(quat_unit(orientation_of(poses, b)))
    at = rotate(body, frame_position(local, p))
    set_frame(frames, p, rot_mul(body, frame_rotation(local, p)), add(vec_at(poses, b), at))


@kernel
def shapes_of(pieces: Pieces, frames: Floats) -> Shapes:
    """Pieces and their `frames` (P, 12), world_from_piece."""
    return Shapes(pieces, frames)


@kernel
def rotation_of(shapes: Shapes, p: int) -> Rot:
    """Rotation world_from_piece."""
    return frame_rotation(shapes.frames, p)


@kernel
def position_of(shapes: Shapes, p: int) -> Vec:
    """Position of a piece's frame in the world [m]."""
    return frame_position(shapes.frames, p)


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
def is_curved(core: Core) -> bool:
    """Whether a core has no corners: not a point, a segment or a polytope."""
    return bool(core.kind > CAPSULE and core.corners == 0)


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

    Hill climbing starts at the corner stored for the direction's cell, and ends at one without a farther neighbour, which on
    a convex surface is the farthest of all.
    """
    # unsigned: numba omits the check for negative indices
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


@kernel
def face_towards(pieces: Pieces, p: int, d: Vec) -> int:
    """Face of a hull whose normal is nearest to `d`, piece frame."""
    first, last = pieces.face_start[p], pieces.face_start[p + 1]
    planes = pieces.planes[first:last]  # indexed from 0, numba omits the check for negative indices
    best, found = -np.inf, 0
    for f in range(last - first):
        x = dot(vec_at(planes, f), d)
        if x > best:
            best = x
            found = f
    return int(first + found)


@kernel
def feature(shapes: Shapes, p: int, d: Vec, out: Floats) -> tuple[int, Vec]:
    """Feature of piece `p` towards direction `d` (unit, world): writes its corners in the world to `out`.

    Returns their number (2 a line, more a face, counter-clockwise seen from outside; 1 a point, which is not written)
    and a face's normal.
    """
    pieces = shapes.pieces
    kind = pieces.kind[p]
    rot, at = rotation_of(shapes, p), position_of(shapes, p)
    axis = (rot[2], rot[5], rot[8])
    x, y, _ = vec_at(pieces.size, p)
    if kind == SPHERE:
        return 1, d
    if kind == CAPSULE:
        low = add_scaled(at, d, x)
        if abs(dot(axis, d)) > TILT:
            return 1, d
        set_vec_at(out, 0, add_scaled(low, axis, y))
        set_vec_at(out, 1, add_scaled(low, axis, -y))
        return 2, d
    local = rotate_back(rot, d)
    if kind == CYLINDER:
        if abs(local[2]) < math.sqrt(0.5):
            k = x / math.sqrt(local[0] * local[0] + local[1] * local[1])
            set_vec_at(out, 0, add(at, rotate(rot, (k * local[0], k * local[1], y))))
            set_vec_at(out, 1, add(at, rotate(rot, (k * local[0], k * local[1], -y))))
            return 2, d
        up = 1.0 if local[2] > 0.0 else -1.0
        for k in range(RIM):
            angle = up * k * (2.0 * math.pi / RIM)
            set_vec_at(out, k, add(at, rotate(rot, (x * math.cos(angle), x * math.sin(angle), up * y))))
        return RIM, scale(axis, up)
    if kind == BOX:
        i, j, k = abs(local[0]), abs(local[1]), abs(local[2])
        across = 0 if i >= j and i >= k else (1 if j >= k else 2)
        f = pieces.face_start[p] + 2 * across + (1 if local[across] > 0.0 else 0)
    else:
        f = face_towards(pieces, p, local)
    first, last = pieces.loop_start[f], pieces.loop_start[f + 1]
    step = 1 + 4 * (last - first - 1) // MAX_POLYGON
    count = 0
    for k in range(first, last, step):
        set_vec_at(out, count, add(at, rotate(rot, vec_at(pieces.vertices, pieces.vertex_start[p] + pieces.loops[k]))))
        count += 1
    return count, rotate(rot, vec_at(pieces.planes, f))
