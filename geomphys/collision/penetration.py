"""Signed separation of two convex pieces: the distance, or minus the exact minimum translation that frees them."""

from __future__ import annotations

import math
from typing import TypeAlias

from geomphys.collision.closed_forms import ball_box, ball_cylinder, segments
from geomphys.collision.epa import Scratch, expand, make_scratch
from geomphys.collision.gjk import FAR, SEPARATED, closest, difference
from geomphys.collision.support import Corners, core_of, position_of, radius_of, rotation_of
from geomphys.kernel import kernel
from geomphys.vec3 import (
    Vec,
    add,
    add_scaled,
    dot,
    neg,
    norm,
    rot_transposed_mul,
    rotate,
    rotate_back,
    scale,
    sub,
)
from geomphys.world.scene import BOX, CAPSULE, CYLINDER, SPHERE, Floats, Pieces

__all__ = ["Scratch", "Separation", "make_scratch", "separation"]

Separation: TypeAlias = tuple[float, Vec, Vec, Vec]


@kernel
def separation(
    pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axis: Vec, scratch: Scratch
) -> Separation:
    """Signed separation of the pieces `a` and `b`.

    Parameters
    ----------
    frames
        (P, 12) world_from_piece.
    limit
        m; pieces farther apart than this need not be measured: s is then a lower bound above `limit`.
    axis
        The normal of an earlier call for this pair, world frame, or zeros: only saves time.

    Returns
    -------
    s
        m. Above 0 the distance, never more than the extent of the gap along n; below 0 minus the penetration depth:
        moving A by -s n separates the pieces, and no shorter translation does.
    n
        Unit normal, out of B into A, world frame.
    pa, pb
        Points on the surfaces of A and B, world frame, pa - pb = s n; void beyond `limit`.
    """
    if pieces.kind[a] > pieces.kind[b] or (pieces.kind[a] == pieces.kind[b] and a > b):
        s, n, pa = ordered(pieces, frames, b, a, limit, neg(axis), scratch)
        return s, neg(n), add_scaled(pa, n, -s), pa
    s, n, pa = ordered(pieces, frames, a, b, limit, axis, scratch)
    return s, n, pa, add_scaled(pa, n, -s)


@kernel
def ordered(
    pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axis: Vec, scratch: Scratch
) -> tuple[float, Vec, Vec]:
    """`separation` for a kind of A that is not above that of B, without the point of B."""
    kind_a, kind_b = pieces.kind[a], pieces.kind[b]
    pa, pb = position_of(frames, a), position_of(frames, b)
    if kind_b <= CAPSULE:
        u = (frames[a, 2], frames[a, 5], frames[a, 8])
        v = (frames[b, 2], frames[b, 5], frames[b, 8])
        return segments(
            pa, u, pieces.size[a, 1], pieces.size[a, 0], pb, v, pieces.size[b, 1], pieces.size[b, 0]
        )
    if kind_a == SPHERE and kind_b <= CYLINDER:
        rot = rotation_of(frames, b)
        c = rotate_back(rot, sub(pa, pb))
        if kind_b == BOX:
            half = (pieces.size[b, 0], pieces.size[b, 1], pieces.size[b, 2])
            s, n, p = ball_box(c, pieces.size[a, 0], half)
        else:
            s, n, p = ball_cylinder(c, pieces.size[a, 0], pieces.size[b, 0], pieces.size[b, 1])
        return s, rotate(rot, n), add(pb, rotate(rot, p))
    return general(pieces, frames, a, b, limit, axis, scratch)


@kernel
def general(
    pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axis: Vec, scratch: Scratch
) -> tuple[float, Vec, Vec]:
    """`ordered` by descent over the Minkowski difference of the cores, in A's frame."""
    corners = Corners(pieces.vertices, pieces.neighbour_start, pieces.neighbours)
    core_a, core_b = core_of(pieces, a), core_of(pieces, b)
    radius = radius_of(pieces, a) + radius_of(pieces, b)
    world = rotation_of(frames, a)
    origin = position_of(frames, a)
    rot = rot_transposed_mul(world, rotation_of(frames, b))
    t = rotate_back(world, sub(position_of(frames, b), origin))
    if dot(axis, axis) > 0.0:
        d = rotate_back(world, axis)
        w, p, _, _ = difference(corners, core_a, core_b, rot, t, neg(d), core_a[1], core_b[1])
        s = dot(w, d) - radius
        if s > limit:
            return s, axis, add(origin, rotate(world, p))
    centre_a = (pieces.centre[a, 0], pieces.centre[a, 1], pieces.centre[a, 2])
    centre_b = (pieces.centre[b, 0], pieces.centre[b, 1], pieces.centre[b, 2])
    start = sub(sub(centre_a, t), rotate(rot, centre_b))
    if dot(start, start) == 0.0:
        start = (0.0, 0.0, 1.0)
    size = pieces.reach[a] + pieces.reach[b] + norm(centre_a) + norm(centre_b) + norm(t)
    state, s, n, p, count = closest(
        corners, core_a, core_b, rot, t, size, limit + radius, start, scratch.simplex
    )
    if state != SEPARATED and state != FAR:
        _, depth, outward, p = expand(corners, core_a, core_b, rot, t, size, count, scratch)
        s, n = -depth, neg(outward)
    p = add_scaled(p, n, -radius_of(pieces, a))
    return s - radius, rotate(world, n), add(origin, rotate(world, p))
