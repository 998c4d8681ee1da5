"""Signed separation of two convex pieces: the distance, or minus the exact minimum translation that frees them."""

from __future__ import annotations

from typing import TypeAlias

from geomphys.collision.closed_forms import Answer, ball_box, ball_cylinder, segments
from geomphys.collision.epa import expand
from geomphys.collision.exhaustive import exhaustive
from geomphys.collision.gjk import FAR, OVERLAP, SEPARATED, Goal, closest, difference
from geomphys.collision.scratch import Scratch, make_scratch
from geomphys.collision.support import Core, Shapes, core_of, is_curved, position_of, radius_of, rotation_of
from geomphys.jit.kernel import inlined, kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import (
    Rot,
    Vec,
    add,
    add_scaled,
    dot,
    neg,
    norm,
    rot_transposed_mul,
    rotate,
    rotate_back,
    sub,
)
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Floats, Pieces

__all__ = ["Scratch", "Separation", "make_scratch", "separation"]

Separation: TypeAlias = tuple[float, Vec, Vec, Vec]


@inlined
def separation(pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axis: Vec, scratch: Scratch) -> Separation:
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
        Points on the surfaces of A and B, world frame, pa - pb = s n; undefined beyond `limit`.
    """
    scratch.simplex.count = 0
    return separate(Shapes(pieces, frames), a, b, limit, axis, 1.0, scratch.simplex, scratch)


@noinline
def separate(
    shapes: Shapes, a: int, b: int, limit: float, axis: Vec, share: float, simplex: Record, scratch: Scratch
) -> Separation:
    """`separation`, or less: a `share` of a distance suffices, and anything below 0 for an overlap if that is less than 1.

    Calls `ordered` with the pieces in ascending order of their kinds.
    """
    kind_a, kind_b = shapes.pieces.kind[a], shapes.pieces.kind[b]
    if kind_a > kind_b or (kind_a == kind_b and a > b):
        s, n, pa = ordered(shapes, b, a, limit, neg(axis), share, simplex, scratch)
        return s, neg(n), add_scaled(pa, n, -s), pa
    s, n, pa = ordered(shapes, a, b, limit, axis, share, simplex, scratch)
    return s, n, pa, add_scaled(pa, n, -s)


@kernel
def ordered(
    shapes: Shapes, a: int, b: int, limit: float, axis: Vec, share: float, simplex: Record, scratch: Scratch
) -> Answer:
    """Separation, normal and point of A, by formula where there is one."""
    kind_a, kind_b = shapes.pieces.kind[a], shapes.pieces.kind[b]
    if kind_b > CYLINDER or (kind_a > SPHERE and kind_b > CAPSULE):
        return general(shapes, a, b, limit, axis, share, simplex, scratch)
    pa, pb = position_of(shapes, a), position_of(shapes, b)
    r, h, _ = vec_at(shapes.pieces.size, a)
    size = vec_at(shapes.pieces.size, b)
    rot = rotation_of(shapes, b)
    if kind_b <= CAPSULE:
        rot_a = rotation_of(shapes, a)
        u, v = (rot_a[2], rot_a[5], rot_a[8]), (rot[2], rot[5], rot[8])
        return segments(pa, u, h, r, pb, v, size[1], size[0])
    c = rotate_back(rot, sub(pa, pb))
    if kind_b == BOX:
        s, n, p = ball_box(c, r, size)
    else:
        s, n, p = ball_cylinder(c, r, size[0], size[1])
    return s, rotate(rot, n), add(pb, rotate(rot, p))


@kernel
def _nearest_in_box(core: Core, x: Vec) -> Vec:
    """The point nearest to x in a core's box about its centre, which for a hull is about where it is."""
    z = core.y if core.kind == CYLINDER else core.z
    y = core.x if core.kind == CYLINDER else core.y
    return (min(max(x[0], -core.x), core.x), min(max(x[1], -y), y), min(max(x[2], -z), z))


@kernel
def _between_boxes(a: Core, b: Core, rot: Rot, apart: Vec) -> Vec:
    """About the shortest way from core B to A, in A's frame: from the point of B's box nearest to A's centre to A's box.

    `apart` leads from B's centre to A's; the answer where that point lies in A's box.
    """
    on_b = sub(rotate(rot, _nearest_in_box(b, rotate_back(rot, apart))), apart)
    path = sub(_nearest_in_box(a, on_b), on_b)
    return path if dot(path, path) > 0.0 else apart


@kernel
def _axis_of(core: Core) -> Core:
    """The axis of a cylinder, as the core of a capsule."""
    return Core(core.pieces, CAPSULE, core.first, 0, core.cells, 0.0, 0.0, core.y)


@kernel
def _is_beside(cylinder: Core, p: Vec, n: Vec, s: float) -> bool:
    """Whether a hull's distance `s` [m] from a cylinder's axis, less the radius, is its exact separation from the cylinder.

    It is that from the capsule around the cylinder: theirs too where the capsule's nearest point is one of the cylinder. Where
    they overlap, it is if the hull's point nearest to the axis stays inside however the cylinder is moved by less than the
    depth: it lies so far from both ends. `p`: the axis's nearest point, `n`: the normal towards it, both in the cylinder's frame.
    """
    return abs(p[2] - min(s, cylinder.x) * n[2]) + max(cylinder.x - s, 0.0) <= cylinder.y


@kernel
def general(
    shapes: Shapes, a: int, b: int, limit: float, axis: Vec, share: float, simplex: Record, scratch: Scratch
) -> Answer:
    """`ordered` by descent over the Minkowski difference of the cores, in A's frame.

    Of a cylinder and a hull the cylinder's axis is tried first: there the descent ends after a few corners.
    """
    core_a, core_b = core_of(shapes, a), core_of(shapes, b)
    radius_a = radius_of(shapes, a)
    radius = radius_a + radius_of(shapes, b)
    world = rotation_of(shapes, a)
    origin = position_of(shapes, a)
    rot = rot_transposed_mul(world, rotation_of(shapes, b))
    t = rotate_back(world, sub(position_of(shapes, b), origin))
    is_known, d = dot(axis, axis) > 0.0, rotate_back(world, axis)
    if is_known and share == 1.0:
        w, p, _ = difference(core_a, core_b, rot, t, neg(d))
        s = dot(w, d) - radius
        if s > limit:
            return s, axis, add(origin, rotate(world, p))
    centre_a, centre_b = vec_at(shapes.pieces.centre, a), vec_at(shapes.pieces.centre, b)
    start = d
    if not is_known or share == 1.0:
        start = _between_boxes(core_a, core_b, rot, sub(sub(centre_a, t), rotate(rot, centre_b)))
    if dot(start, start) == 0.0:
        start = (0.0, 0.0, 1.0)
    size = shapes.pieces.reach[a] + shapes.pieces.reach[b] + norm(centre_a) + norm(centre_b) + norm(t)
    core, around = core_a, 0.0
    if share == 1.0 and simplex.count == 0 and core_a.kind == CYLINDER and core_b.kind == HULL:
        core, around = _axis_of(core_a), core_a.x
    while True:
        state, s, n, p = closest(core, core_b, rot, t, size, Goal(limit, radius + around, share), start, simplex)
        if around == 0.0:
            break
        if state == FAR or (state == SEPARATED and _is_beside(core_a, p, n, s)):
            return s - around, rotate(world, n), add(origin, rotate(world, add_scaled(p, n, -around)))
        core, around, simplex.count = core_a, 0.0, 0
    if state == OVERLAP and share < 1.0:
        s = min(s, 0.0)
    elif state == OVERLAP:
        exact, depth, outward = False, 0.0, n
        for attempt in range(3):
            # faces that see a corner by less than rounding count as seen in one attempt and not in another
            eps = size * (1e-15 if attempt == 0 else (-1e-14 if attempt == 1 else 1e-12))
            exact, depth, outward, p = expand(core_a, core_b, rot, t, size, eps, simplex, scratch)
            if exact:
                break
        if not exact and not is_curved(core_a) and not is_curved(core_b):
            depth, outward, p = exhaustive(core_a, core_b, rot, t, size, scratch)
        s, n = -depth, neg(outward)
    p = add_scaled(p, n, -radius_a)
    return s - radius, rotate(world, n), add(origin, rotate(world, p))
