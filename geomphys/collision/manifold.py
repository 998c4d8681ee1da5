"""Contact manifold: up to four pairs of points at which two pieces touch.

Each piece turns a feature towards the other: a face, the side line of a capsule or cylinder, a point. Seen along the
normal, one feature is clipped by the outline of the other; the result are points of the one, and the points of the
other behind them along the normal.
"""

from __future__ import annotations

import numpy as np

from geomphys.collision.penetration import Separation
from geomphys.collision.scratch import Scratch
from geomphys.collision.support import Shapes, feature
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec_at, vec_at
from geomphys.numerics.vec3 import Vec, add, add_scaled, cross, dot, neg, norm, scale, sub
from geomphys.scene.arrays import SPHERE, Floats

SLOP = 1e-3
"""m; points whose surfaces lie farther apart than this beyond the deepest ones are no contact."""
SLOP_PART = 0.02
"""... nor those beyond this fraction of the smaller piece's reach."""
STEEP = 0.1
"""Faces whose normal has less than this along the contact normal are no support."""
SKEW = 0.005
"""Sine of the angle from which on two lines cross at a point instead of touching along their length."""


@kernel
def clip(points: Floats, count: int, out: Floats, origin: Vec, inward: Vec) -> int:
    """Part of a polygon, or of a line of two points, on the inner side of a plane; returns its number of corners."""
    written = 0
    last = count - 1
    previous = vec_at(points, last)
    before = dot(inward, sub(previous, origin))
    for i in range(count):
        here = vec_at(points, i)
        now = dot(inward, sub(here, origin))
        if (before >= 0.0) != (now >= 0.0) and (count > 2 or i == 1):
            set_vec_at(out, written, add_scaled(previous, sub(here, previous), before / (before - now)))
            written += 1
        if now >= 0.0:
            set_vec_at(out, written, here)
            written += 1
        previous, before = here, now
    return written


@noinline
def manifold(shapes: Shapes, a: int, b: int, found: Separation, out_a: Floats, out_b: Floats, scratch: Scratch) -> int:
    """Points where the pieces `a` and `b` touch, from what `separation` found for them.

    Parameters
    ----------
    shapes
        The pieces and their frames (P, 12), world_from_piece.
    found
        Separation s [m], unit normal out of B into A, and points of `separation`, world frame.
    out_a, out_b
        (>= 4, 3), written: points of A and of B, world frame. out_a - out_b is along n, and its length the
        separation there, below 0 where they overlap; s at the deepest.

    Returns
    -------
    count
        1 to 4.
    """
    s, n, pa, pb = found
    reference, incident, from_a, from_b = (
        scratch.polygons[0],
        scratch.polygons[1],
        scratch.polygons[2],
        scratch.polygons[3],
    )
    set_vec_at(out_a, 0, pa)
    set_vec_at(out_b, 0, pb)
    if shapes.pieces.kind[a] == SPHERE or shapes.pieces.kind[b] == SPHERE:
        return 1
    count, face = feature(shapes, a, neg(n), reference)
    others, other_face = feature(shapes, b, n, incident)
    if count == 1 or others == 1:
        return 1
    # the feature that is clipped is A's, unless B's is a line and A's is not
    d = n
    swapped = others < count and others <= 2
    if swapped:
        reference, incident, count, others, other_face, d = incident, reference, others, count, face, neg(n)
    if others == 2:
        first, second = vec_at(incident, 0), vec_at(incident, 1)
        count = shared_part(reference, first, second, n, from_b)
    else:
        if abs(dot(other_face, n)) < STEEP:
            return 1
        count = inside(reference, count, incident, others, d, scratch.polygons[4])
        level = dot(other_face, vec_at(incident, 0))
        for i in range(count):
            p = vec_at(reference, i)
            set_vec_at(from_b, i, add_scaled(p, n, (level - dot(other_face, p)) / dot(other_face, n)))
    for i in range(count):
        set_vec_at(from_a, i, vec_at(reference, i))
    if swapped:
        from_a, from_b = from_b, from_a
    slop = min(SLOP, SLOP_PART * min(shapes.pieces.reach[a], shapes.pieces.reach[b]))
    return chosen(from_a, from_b, count, s, n, slop, out_a, out_b)


@kernel
def shared_part(reference: Floats, first: Vec, second: Vec, n: Vec, out: Floats) -> int:
    """Two lines seen along n: cuts the line `reference` to the part beside the other; 0 points if they cross.

    Writes the points of the other line behind those of `reference`, along n, to `out`.
    """
    p, q = vec_at(reference, 0), vec_at(reference, 1)
    e, f = sub(second, first), sub(q, p)
    length, other = norm(e), norm(f)
    if length == 0.0 or other == 0.0 or abs(dot(n, cross(e, f))) > SKEW * length * other:
        return 0
    e = scale(e, 1.0 / length)
    x, y = dot(e, sub(p, first)), dot(e, sub(q, first))
    if x == y:
        return 0
    low, high = max(min(x, y), 0.0), min(max(x, y), length)
    if low > high:
        return 0
    for i in range(2):
        along = low if i == 0 else high
        point = add_scaled(p, f, (along - x) / (y - x))
        there = add_scaled(first, e, along)
        set_vec_at(reference, i, point)
        set_vec_at(out, i, add_scaled(point, n, dot(n, sub(there, point))))
    return 2


@kernel
def inside(reference: Floats, count: int, incident: Floats, others: int, d: Vec, buffer: Floats) -> int:
    """Clip a polygon or line by the outline of a face, both seen along the face's outward direction `d`; in place."""
    source, target = reference, buffer
    for k in range(others):
        origin = vec_at(incident, k)
        edge = sub(vec_at(incident, k + 1 if k + 1 < others else 0), origin)
        count = clip(source, count, target, origin, cross(d, edge))
        source, target = target, source
        if count == 0:
            return 0
    if others % 2 == 1:  # it ended up in `buffer`
        for i in range(count):
            set_vec_at(reference, i, vec_at(source, i))
    return count


@kernel
def chosen(
    from_a: Floats, from_b: Floats, count: int, s: float, n: Vec, slop: float, out_a: Floats, out_b: Floats
) -> int:
    """Keep at most four of the pairs: a deepest one, the farthest from it, and the farthest beside their line.

    Where none is as deep as `s`, the pair that stands in the first row of the output is the deepest.
    """
    written = 0
    deepest = np.inf
    for i in range(count):
        p, q = vec_at(from_a, i), vec_at(from_b, i)
        gap = dot(n, sub(p, q))
        if gap <= s + slop:
            deepest = min(deepest, gap)
            set_vec_at(from_a, written, p)
            set_vec_at(from_b, written, q)
            written += 1
    near = 1e-3 * slop
    if deepest > s + near:
        set_vec_at(from_a, written, vec_at(out_a, 0))
        set_vec_at(from_b, written, vec_at(out_b, 0))
        written += 1
        deepest = s
    first = 0
    for i in range(written - 1, -1, -1):
        if dot(n, sub(vec_at(from_a, i), vec_at(from_b, i))) <= deepest + near:
            first = i
    o = vec_at(from_a, first)
    far, second = 0.0, first
    for i in range(written):
        e = sub(vec_at(from_a, i), o)
        if dot(e, e) > far:
            far = dot(e, e)
            second = i
    set_vec_at(out_a, 0, o)
    set_vec_at(out_b, 0, vec_at(from_b, first))
    if far <= slop * slop * 1e-6:
        return 1
    edge = sub(vec_at(from_a, second), o)
    set_vec_at(out_a, 1, add(o, edge))
    set_vec_at(out_b, 1, vec_at(from_b, second))
    left, right = 0.0, 0.0
    third, fourth = -1, -1
    for i in range(written):
        side = dot(n, cross(edge, sub(vec_at(from_a, i), o)))
        if side > left:
            left = side
            third = i
        if side < right:
            right = side
            fourth = i
    total = 2
    flat = 1e-3 * far
    if left > flat:
        set_vec_at(out_a, total, vec_at(from_a, third))
        set_vec_at(out_b, total, vec_at(from_b, third))
        total += 1
    if -right > flat:
        set_vec_at(out_a, total, vec_at(from_a, fourth))
        set_vec_at(out_b, total, vec_at(from_b, fourth))
        total += 1
    return total
