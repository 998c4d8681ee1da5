"""Penetration depth of two polytopes by trying every direction it can lie in.

Those are the normals of all faces of A and of B, and the common normals of all pairs of their edges.

Slow and robust: for pairs so degenerate that rounding spoils the growing polytope (`epa`).
"""

from __future__ import annotations

import numpy as np

from geomphys.collision.epa import blend
from geomphys.collision.gjk import difference, on_triangle, set_corner
from geomphys.collision.scratch import Scratch
from geomphys.collision.support import Core
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at, vec_of
from geomphys.numerics.vec3 import Rot, Vec, add, cross, dot, norm, rotate, scale, sub
from geomphys.scene.arrays import BOX, CAPSULE


@kernel
def corners_of(core: Core) -> int:
    """Number of corners; the ends of a segment are corners too."""
    if core.kind > CAPSULE:
        return core.corners
    return 2 if core.z > 0.0 else 1


@kernel
def corner_of(core: Core, i: int) -> Vec:
    """Corner i, piece frame."""
    if core.kind > CAPSULE:
        return vec_at(core.pieces.vertices, core.first + i)
    return (0.0, 0.0, core.z if i == 0 else -core.z)


@kernel
def degree(core: Core, i: int) -> int:
    """Number of edges at corner i."""
    if core.kind > CAPSULE:
        start = core.pieces.neighbour_start
        return int(np.int64(start[core.first + i + 1]) - np.int64(start[core.first + i]))
    return 1 if core.z > 0.0 else 0


@kernel
def neighbour(core: Core, i: int, k: int) -> int:
    """The corner at the other end of edge k of corner i."""
    if core.kind > CAPSULE:
        return int(np.int64(core.pieces.neighbours[core.pieces.neighbour_start[core.first + i] + k]))
    return 1 - i


@kernel
def joined(core: Core, i: int, j: int) -> bool:
    """Whether an edge joins corners i and j."""
    found = False
    for k in range(degree(core, i)):
        found |= neighbour(core, i, k) == j
    return found


@kernel
def try_direction(
    a: Core, b: Core, rot: Rot, t: Vec, n: Vec, level: float, size: float, found: tuple[float, Vec]
) -> tuple[float, Vec]:
    """The smaller of the best extent so far and M's extent along n or -n; n need not be a unit vector.

    `level` is where the feature lies whose normal n is: M reaches at least so far, so a feature that lies beyond the
    best extent, or behind the origin, needs no measuring. 0 if it is not known.
    """
    best, outward = found
    length = norm(n)
    if length == 0.0:
        return best, outward
    level /= length
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        if sign * level < max(best, 1e-12 * size) and sign * level > -1e-12 * size:
            d = scale(n, sign / length)
            w, _, _ = difference(a, b, rot, t, d)
            extent = dot(d, w)
            if extent < best:
                best, outward = extent, d
    return best, outward


@noinline
def exhaustive(a: Core, b: Core, rot: Rot, t: Vec, size: float, scratch: Scratch) -> tuple[float, Vec, Vec]:
    """Depth, outward normal and point of A of two cores, as `expand` has them; none of them curved."""
    best, outward = np.inf, (0.0, 0.0, 1.0)
    for side in range(2):
        core = a if side == 0 else b
        for i in range(corners_of(core)):
            o = corner_of(core, i)
            for k in range(degree(core, i)):
                j = neighbour(core, i, k)
                for m in range(k):
                    h = neighbour(core, i, m)
                    # two edges span a face if their ends are joined, at a box's corner always
                    if core.kind == BOX or joined(core, j, h):
                        n = cross(sub(corner_of(core, j), o), sub(corner_of(core, h), o))
                        if side == 1:
                            n = rotate(rot, n)
                        best, outward = try_direction(a, b, rot, t, n, 0.0, size, (best, outward))
    for i in range(corners_of(a)):
        p = corner_of(a, i)
        for k in range(degree(a, i)):
            if neighbour(a, i, k) < i:
                continue
            e = sub(corner_of(a, neighbour(a, i, k)), p)
            for j in range(corners_of(b)):
                q = add(t, rotate(rot, corner_of(b, j)))
                for m in range(degree(b, j)):
                    if neighbour(b, j, m) < j:
                        continue
                    n = cross(e, rotate(rot, sub(corner_of(b, neighbour(b, j, m)), corner_of(b, j))))
                    best, outward = try_direction(a, b, rot, t, n, dot(n, sub(p, q)), size, (best, outward))
    return best, outward, deepest_point(a, b, rot, t, outward, size, scratch)


@kernel
def deepest_point(a: Core, b: Core, rot: Rot, t: Vec, n: Vec, size: float, scratch: Scratch) -> Vec:
    """Point of A at the foot of the origin on M's face along n, from the corners of A and B that lie in it."""
    w, _, _ = difference(a, b, rot, t, n)
    level, used = dot(n, w), 0
    ground = scale(n, level)
    for i in range(corners_of(a)):
        p = corner_of(a, i)
        for j in range(corners_of(b)):
            u = sub(p, add(t, rotate(rot, corner_of(b, j))))
            if dot(n, u) >= level - 1e-12 * size and used < 64:
                set_corner(scratch.corners, used, sub(u, ground), p)
                used += 1
    best = np.inf
    point = vec_of(scratch.corners[0].on_a)
    for i in range(used):
        for j in range(i, used):
            for k in range(j, used):
                x, y, z, off = on_triangle(
                    vec_of(scratch.corners[i].difference),
                    vec_of(scratch.corners[j].difference),
                    vec_of(scratch.corners[k].difference),
                )
                if dot(off, off) < best:
                    best = dot(off, off)
                    point = blend(scratch, i, j, k, x, y, z)
    return point
