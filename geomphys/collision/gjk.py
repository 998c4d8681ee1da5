"""Distance of two convex cores: Gilbert, Johnson and Keerthi's descent over the Minkowski difference.

M = A − B, in A's frame, holds all differences of a point of A and a point of B; its point v closest to the origin is
the shortest way from B to A. A simplex of at most four points of M walks towards it. The plane through the farthest
point of M in direction −v bounds the distance from below, which certifies the result. Points closest on segments and
triangles are computed at right angles to their edges, so that the direction stays exact however small the distance is.
"""

from __future__ import annotations

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from geomphys.collision.scratch import Corners
from geomphys.collision.support import Core, support
from geomphys.jit.kernel import inlined, kernel
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import set_vec, set_vec_at, vec_at
from geomphys.numerics.vec3 import Rot, Vec, add_scaled, cross, dot, neg, rotate, rotate_back, scale, sub

Weights: TypeAlias = tuple[float, float, float, float]

SEPARATED = 0
FAR = 1
OVERLAP = 2

ROUNDING = 4e-16
"""Share of the coordinates' size that the arithmetic may err."""
TIGHT = 1e-12
"""Fraction of the distance that is left between its bounds."""
ROUNDS = 128


class Goal(NamedTuple):
    """What of a distance is asked for."""

    limit: float  # m: distances, less `radius`, above this need not be known
    radius: float  # m, by which both cores together are grown
    share: float  # below 1: it is enough to know the distance, less `radius`, to this share, or that it is below 0


@inlined
def difference(a: Core, b: Core, rot: Rot, t: Vec, d: Vec) -> tuple[Vec, Vec, Vec]:
    """Point of M = A − B farthest in direction `d`, and the points of A and B, each in its own frame, it comes from.

    A's frame; `rot`, `t` are the pose of B in it.
    """
    p = support(a, d)
    q = support(b, neg(rotate_back(rot, d)))
    return sub(sub(p, t), rotate(rot, q)), p, q


@kernel
def on_segment(p: Vec, q: Vec) -> tuple[float, float, Vec]:
    """Weights of p and q, and the point of their segment closest to the origin."""
    e = sub(q, p)
    ee = dot(e, e)
    along = -dot(p, e)
    if along <= 0.0:
        return 1.0, 0.0, p
    if along >= ee:
        return 0.0, 1.0, q
    weight = along / ee
    v = add_scaled(p, e, weight)
    return 1.0 - weight, weight, add_scaled(v, e, -dot(v, e) / ee)


@inlined
def on_triangle(p: Vec, q: Vec, r: Vec) -> tuple[float, float, float, Vec]:
    """Weights of the three corners, and the point of the triangle closest to the origin.

    A negative area coordinate says which edges can hold the point; without one it is the foot on the plane.
    """
    n = cross(sub(q, p), sub(r, p))
    nn = dot(n, n)
    wp = dot(n, cross(q, r))
    wq = dot(n, cross(r, p))
    wr = dot(n, cross(p, q))
    if nn > 0.0 and wp > 0.0 and wq > 0.0 and wr > 0.0:
        total = wp + wq + wr
        return wp / total, wq / total, wr / total, scale(n, dot(n, p) / nn)
    best = np.inf
    lp, lq, lr = 1.0, 0.0, 0.0
    v = p
    if wp <= 0.0 or nn == 0.0:
        x, y, u = on_segment(q, r)
        best = dot(u, u)
        lp, lq, lr, v = 0.0, x, y, u
    if wq <= 0.0 or nn == 0.0:
        x, y, u = on_segment(p, r)
        if dot(u, u) < best:
            best = dot(u, u)
            lp, lq, lr, v = x, 0.0, y, u
    if wr <= 0.0 or nn == 0.0:
        x, y, u = on_segment(p, q)
        if dot(u, u) < best:
            lp, lq, lr, v = x, y, 0.0, u
    return lp, lq, lr, v


@kernel
def on_tetrahedron(p: Vec, q: Vec, r: Vec, s: Vec, size: float) -> tuple[Weights, Vec, bool]:
    """Weights of the corners, the point closest to the origin, and whether the origin is inside (both undefined then)."""
    best = np.inf
    weights = (0.0, 0.0, 0.0, 0.0)
    v = s
    for face in range(4):
        if face == 0:
            x, y, z, o = q, r, s, p
        elif face == 1:
            x, y, z, o = p, r, s, q
        elif face == 2:
            x, y, z, o = p, q, s, r
        else:
            x, y, z, o = p, q, r, s
        n = cross(sub(y, x), sub(z, x))
        inward = dot(n, sub(o, x))
        height = -dot(n, x)
        if inward * height > 0.0 and inward * inward > 1e-28 * size * size * dot(n, n):
            continue
        i, j, k, u = on_triangle(x, y, z)
        uu = dot(u, u)
        if uu < best:
            best = uu
            v = u
            if face == 0:
                weights = (0.0, i, j, k)
            elif face == 1:
                weights = (i, 0.0, j, k)
            elif face == 2:
                weights = (i, j, 0.0, k)
            else:
                weights = (i, j, k, 0.0)
    return weights, v, best == np.inf


@kernel
def set_corner(corners: Corners, i: int, w: Vec, p: Vec) -> None:
    """Store a point of M and the point of A it comes from in a record of `corners`."""
    set_vec(corners[i].difference, w)
    set_vec(corners[i].on_a, p)


@kernel
def corner_of_simplex(simplex: Record, i: int, rot: Rot, t: Vec) -> tuple[Vec, Vec, Vec]:
    """Corner i, a point of M, and the points of A and B it comes from; `rot`, `t` as in `difference`."""
    p, q = vec_at(simplex.on_a, i), vec_at(simplex.on_b, i)
    return sub(sub(p, t), rotate(rot, q)), p, q


@kernel
def _store(simplex: Record, i: int, p: Vec, q: Vec) -> None:
    """Store the points of A and B that corner i of a simplex comes from."""
    set_vec_at(simplex.on_a, i, p)
    set_vec_at(simplex.on_b, i, q)


@kernel
def closest(
    a: Core, b: Core, rot: Rot, t: Vec, size: float, goal: Goal, start: Vec, simplex: Record
) -> tuple[int, float, Vec, Vec]:
    """Distance of the cores A and B in A's frame; `rot`, `t` are the pose of B, `size` the length of M's coordinates.

    The descent starts from the corners of `simplex`, where the last one for this pair has ended, and stores those at its own end
    there; without any it starts towards `start`.

    Returns
    -------
    state
        SEPARATED; FAR: farther than the limit, what follows is a bound; OVERLAP: they touch or overlap, and the simplex holds the
        origin.
    distance
        Largest known lower bound of the distance [m]: the extent of M along the normal.
    normal
        Unit, out of B into A.
    point
        Of A, closest to B.
    """
    zero = (0.0, 0.0, 0.0)
    floor = ROUNDING * size
    w0, w1, w2, w3 = zero, zero, zero, zero
    l0, l1, l2 = 1.0, 0.0, 0.0
    m0, m1, m2, m3 = 1.0, 0.0, 0.0, 0.0
    known, count = simplex.count, 0
    v = start
    vv = dot(v, v)
    gap = -np.inf
    normal = zero
    inside = False
    for k in range(ROUNDS):
        is_known = k < known
        if is_known:
            w, p, q = corner_of_simplex(simplex, k, rot, t)
        else:
            length = math.sqrt(vv)
            w, p, q = difference(a, b, rot, t, neg(v))
            bound = dot(v, w) / length
            if bound > gap:
                gap = bound
                normal = scale(v, 1.0 / length)
                if gap > goal.limit + goal.radius:
                    simplex.count = count
                    return FAR, gap, normal, p
            if count > 0 and length - bound <= TIGHT * length + floor:
                break
            above = length - goal.radius
            if count > 0 and goal.share < 1.0 and (above < 0.0 or length - bound <= (1.0 - goal.share) * above):
                break
        if (count > 0 and w == w0) or (count > 1 and w == w1) or (count > 2 and w == w2):
            if is_known:
                continue
            break
        _store(simplex, count, p, q)
        if count == 0:
            w0, u, m0 = w, w, 1.0
        elif count == 1:
            w1 = w
            m0, m1, u = on_segment(w0, w1)
        elif count == 2:
            w2 = w
            m0, m1, m2, u = on_triangle(w0, w1, w2)
        else:
            w3 = w
            (m0, m1, m2, m3), u, inside = on_tetrahedron(w0, w1, w2, w3, size)
            if inside:
                count = 4
                break
        uu = dot(u, u)
        if count > 0 and uu >= vv and not is_known:
            break
        v, vv = u, uu
        l0, l1, l2 = m0, m1, m2
        # drop the corners without weight
        last, count = count, 0
        if l0 > 0.0:
            count = 1
        if last >= 1 and l1 > 0.0:
            if count == 0:
                w0, l0 = w1, l1
                _store(simplex, 0, vec_at(simplex.on_a, 1), vec_at(simplex.on_b, 1))
            count += 1
        if last >= 2 and l2 > 0.0:
            if count == 0:
                w0, l0 = w2, l2
                _store(simplex, 0, vec_at(simplex.on_a, 2), vec_at(simplex.on_b, 2))
            elif count == 1:
                w1, l1 = w2, l2
                _store(simplex, 1, vec_at(simplex.on_a, 2), vec_at(simplex.on_b, 2))
            count += 1
        if last >= 3 and m3 > 0.0:
            if count == 0:
                w0, l0 = w3, m3
                _store(simplex, 0, vec_at(simplex.on_a, 3), vec_at(simplex.on_b, 3))
            elif count == 1:
                w1, l1 = w3, m3
                _store(simplex, 1, vec_at(simplex.on_a, 3), vec_at(simplex.on_b, 3))
            elif count == 2:
                w2, l2 = w3, m3
                _store(simplex, 2, vec_at(simplex.on_a, 3), vec_at(simplex.on_b, 3))
            count += 1
        if vv <= floor * floor:
            inside = True
            break
    simplex.count = count
    if inside or gap <= 0.0:
        return OVERLAP, gap, normal, vec_at(simplex.on_a, 0)
    point = scale(vec_at(simplex.on_a, 0), l0)
    if count > 1:
        point = add_scaled(point, vec_at(simplex.on_a, 1), l1)
    if count > 2:
        point = add_scaled(point, vec_at(simplex.on_a, 2), l2)
    return SEPARATED, gap, normal, point
