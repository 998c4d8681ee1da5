"""Exact penetration depth of two overlapping convex cores: a polytope inside their Minkowski difference grows outward.

M = A − B holds the origin when A and B overlap, and the depth is the origin's distance to M's surface. The polytope's
face nearest to the origin bounds the depth from below; the extent of M along that face's normal bounds it from above,
as any direction does. Where both meet the depth is exact; otherwise M's farthest point along the normal becomes a new
corner: faces that see it go, and their outline is joined to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from geomphys.collision.gjk import difference
from geomphys.collision.support import Core, Corners
from geomphys.kernel import kernel
from geomphys.vec3 import Rot, Vec, add_scaled, cross, dot, neg, norm, perpendicular, scale, sub
from geomphys.world.scene import CYLINDER, Floats, Ints

MAX_CORNERS = 2048
MAX_FACES = 8192


class Scratch(NamedTuple):
    """Memory of the narrow phase; holds nothing between two calls."""

    simplex: Floats  # (4, 6) points of M and the points of A they come from
    points: Floats  # (MAX_CORNERS, 6) the same for the polytope's corners
    planes: Floats  # (MAX_FACES, 4) unit normal and distance of the polytope's faces
    corners: Ints  # (MAX_FACES, 3) counter-clockwise seen from outside
    across: Ints  # (MAX_FACES, 3) three times the face across edge k, plus that face's number of the edge
    alive: Ints  # (MAX_FACES,) 1 for faces of the surface, 2 for those without area, 0 for those gone
    queue: Ints  # (MAX_FACES,) heap of faces, the nearest first
    stack: Ints  # (MAX_FACES,) edges still to visit
    polygons: Floats  # (4, 64, 3) of the manifold's clipping


def make_scratch() -> Scratch:
    """Memory for `separation` and `manifold`; one per thread."""
    return Scratch(
        simplex=np.zeros((4, 6)),
        points=np.zeros((MAX_CORNERS, 6)),
        planes=np.zeros((MAX_FACES, 4)),
        corners=np.zeros((MAX_FACES, 3), dtype=np.int64),
        across=np.zeros((MAX_FACES, 3), dtype=np.int64),
        alive=np.zeros(MAX_FACES, dtype=np.int64),
        queue=np.zeros(MAX_FACES, dtype=np.int64),
        stack=np.zeros(3 * MAX_FACES, dtype=np.int64),
        polygons=np.zeros((4, 64, 3)),
    )


@kernel
def corner(points: Floats, i: int) -> Vec:
    """Point of M of a row."""
    return (points[i, 0], points[i, 1], points[i, 2])


@kernel
def set_corner(points: Floats, i: int, w: Vec, p: Vec) -> None:
    """Store a point of M and the point of A it comes from."""
    points[i, 0] = w[0]
    points[i, 1] = w[1]
    points[i, 2] = w[2]
    points[i, 3] = p[0]
    points[i, 4] = p[1]
    points[i, 5] = p[2]


@kernel
def push(queue: Ints, planes: Floats, count: int, face: int) -> None:
    """Add a face to the heap of `count` faces."""
    key = planes[face, 3]
    at = count
    while at > 0:
        up = (at - 1) >> 1
        if planes[queue[up], 3] <= key:
            break
        queue[at] = queue[up]
        at = up
    queue[at] = face


@kernel
def pop(queue: Ints, planes: Floats, count: int) -> int:
    """Take the nearest face out of the heap of `count` faces."""
    top = queue[0]
    last = queue[count - 1]
    key = planes[last, 3]
    at = 0
    while True:
        down = 2 * at + 1
        if down >= count - 1:
            break
        if down + 1 < count - 1 and planes[queue[down + 1], 3] < planes[queue[down], 3]:
            down += 1
        if planes[queue[down], 3] >= key:
            break
        queue[at] = queue[down]
        at = down
    queue[at] = last
    return top


@kernel
def set_face(scratch: Scratch, face: int, i: int, j: int, k: int) -> float:
    """Store a face of three corners; returns its plane's distance, infinite for a face without area."""
    p = corner(scratch.points, i)
    u = sub(corner(scratch.points, j), p)
    v = sub(corner(scratch.points, k), p)
    n = cross(u, v)
    area = dot(n, n)
    scratch.corners[face, 0] = i
    scratch.corners[face, 1] = j
    scratch.corners[face, 2] = k
    if area <= 1e-26 * dot(u, u) * dot(v, v):
        scratch.alive[face] = 2
        scratch.planes[face, 3] = np.inf
        return np.inf
    n = scale(n, 1.0 / math.sqrt(area))
    distance = dot(n, p)
    scratch.alive[face] = 1
    scratch.planes[face, 0] = n[0]
    scratch.planes[face, 1] = n[1]
    scratch.planes[face, 2] = n[2]
    scratch.planes[face, 3] = distance
    return distance


@kernel
def join(across: Ints, f: int, i: int, g: int, j: int) -> None:
    """Edge i of face f and edge j of face g are the same."""
    across[f, i] = 3 * g + j
    across[g, j] = 3 * f + i


@kernel
def first_tetrahedron(corners: Corners, a: Core, b: Core, rot: Rot, t: Vec, count: int, scratch: Scratch) -> bool:
    """Complete the simplex of `count` points to a tetrahedron of M, the first four corners, positively oriented.

    Returns False if M has no volume.
    """
    points = scratch.points
    for i in range(count):
        for k in range(6):
            points[i, k] = scratch.simplex[i, k]
    while count < 4:
        best = 0.0
        o = corner(points, 0)
        e = (0.0, 0.0, 0.0)
        if count > 1:
            e = sub(corner(points, 1), o)
        n = e
        if count == 2:
            n = perpendicular(e)
        elif count == 3:
            n = cross(e, sub(corner(points, 2), o))
        m = cross(e, n)
        for k in range(6):
            sign = 1.0 if k % 2 == 0 else -1.0
            if count == 1:
                d = (sign if k < 2 else 0.0, sign if k // 2 == 1 else 0.0, sign if k >= 4 else 0.0)
            elif count == 2:
                angle = 1.0471975511965976 * k
                d = add_scaled(scale(n, math.cos(angle) * norm(e)), m, math.sin(angle))
            else:
                d = scale(n, sign)
            if dot(d, d) == 0.0:
                return False
            w, p, _, _ = difference(corners, a, b, rot, t, d, a[1], b[1])
            off = sub(w, o)
            if count == 1:
                size = dot(off, off)
            elif count == 2:
                side = cross(e, off)
                size = dot(side, side)
            else:
                size = abs(dot(n, off))
            if size > best:
                best = size
                set_corner(points, count, w, p)
        if best == 0.0:
            return False
        count += 1
    o, x, y, z = corner(points, 0), corner(points, 1), corner(points, 2), corner(points, 3)
    volume = dot(cross(sub(x, o), sub(y, o)), sub(z, o))
    if volume < 0.0:
        for k in range(6):
            points[0, k], points[1, k] = points[1, k], points[0, k]
    return volume != 0.0


@kernel
def outline(scratch: Scratch, face: int, new: int, faces: int, size: float) -> int:
    """Take away the faces that see corner `new`, from `face` on, and join their outline to it.

    The outline is met counter-clockwise, so each new face stands beside the one before. Returns the number of faces,
    -1 if the outline does not close or there is no more room.
    """
    w = corner(scratch.points, new)
    planes, across, alive, stack = scratch.planes, scratch.across, scratch.alive, scratch.stack
    eps = 1e-15 * size
    alive[face] = 0
    stack[0] = across[face, 2]
    stack[1] = across[face, 1]
    stack[2] = across[face, 0]
    depth = 3
    start = faces
    while depth > 0:
        depth -= 1
        g = stack[depth] // 3
        e = stack[depth] - 3 * g
        if alive[g] == 0:
            continue
        if alive[g] == 2 or planes[g, 0] * w[0] + planes[g, 1] * w[1] + planes[g, 2] * w[2] - planes[g, 3] > eps:
            alive[g] = 0
            stack[depth] = across[g, (e + 2) % 3]
            stack[depth + 1] = across[g, (e + 1) % 3]
            depth += 2
            continue
        if faces == MAX_FACES:
            return -1
        i, j = scratch.corners[g, (e + 1) % 3], scratch.corners[g, e]
        if faces > start and scratch.corners[faces - 1, 1] != i:
            return -1
        set_face(scratch, faces, i, j, new)
        join(across, faces, 0, g, e)
        if faces > start:
            join(across, faces - 1, 1, faces, 2)
        faces += 1
    if faces - start < 3 or scratch.corners[faces - 1, 1] != scratch.corners[start, 0]:
        return -1
    join(across, faces - 1, 1, start, 2)
    return faces


@kernel
def foot(scratch: Scratch, face: int) -> Vec:
    """Point of A that belongs to the foot of the origin on a face's plane.

    The foot may lie in another triangle of the same plane: the walk goes across the edge it lies behind.
    """
    points = scratch.points
    for _ in range(32):
        n = (scratch.planes[face, 0], scratch.planes[face, 1], scratch.planes[face, 2])
        i, j, k = scratch.corners[face, 0], scratch.corners[face, 1], scratch.corners[face, 2]
        p, q, r = corner(points, i), corner(points, j), corner(points, k)
        x, y, z = dot(n, cross(q, r)), dot(n, cross(r, p)), dot(n, cross(p, q))
        worst = min(x, y, z)
        if worst >= 0.0:
            break
        edge = 1 if worst == x else (2 if worst == y else 0)
        other = scratch.across[face, edge] // 3
        m = (scratch.planes[other, 0], scratch.planes[other, 1], scratch.planes[other, 2])
        if scratch.alive[other] != 1 or dot(n, m) < 1.0 - 1e-12:
            break
        face = other
    x, y, z = max(x, 0.0), max(y, 0.0), max(z, 0.0)
    total = x + y + z
    if total == 0.0:
        return (points[i, 3], points[i, 4], points[i, 5])
    x, y, z = x / total, y / total, z / total
    return (
        x * points[i, 3] + y * points[j, 3] + z * points[k, 3],
        x * points[i, 4] + y * points[j, 4] + z * points[k, 4],
        x * points[i, 5] + y * points[j, 5] + z * points[k, 5],
    )


@kernel
def expand(
    corners: Corners, a: Core, b: Core, rot: Rot, t: Vec, size: float, count: int, scratch: Scratch
) -> tuple[bool, float, Vec, Vec]:
    """Penetration depth of the cores A and B in A's frame, from the simplex of `count` points that `closest` left.

    `rot`, `t` are the pose of B, `size` the length of M's coordinates.

    Returns
    -------
    exact
        Whether the bounds met: to 1e-12 of the depth, 1e-7 where a cylinder takes part.
    depth
        M's extent along the normal [m]: the smallest upper bound found.
    outward
        Unit normal of M's surface where it is nearest: points out of A into B.
    point
        Of A, deepest in B.
    """
    curved = a[0] == CYLINDER or b[0] == CYLINDER
    tight = 1e-7 if curved else 1e-12
    best, outward, point = np.inf, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    if not first_tetrahedron(corners, a, b, rot, t, count, scratch):
        return False, best, outward, point
    planes, across, queue, points = scratch.planes, scratch.across, scratch.queue, scratch.points
    set_face(scratch, 0, 0, 2, 1)
    set_face(scratch, 1, 0, 1, 3)
    set_face(scratch, 2, 0, 3, 2)
    set_face(scratch, 3, 1, 2, 3)
    join(across, 0, 0, 2, 2)
    join(across, 0, 1, 3, 0)
    join(across, 0, 2, 1, 0)
    join(across, 1, 1, 3, 2)
    join(across, 1, 2, 2, 0)
    join(across, 2, 1, 3, 1)
    waiting = 0
    for f in range(4):
        if scratch.alive[f] == 1:
            push(queue, planes, waiting, f)
            waiting += 1
    faces, used = 4, 4
    at_a, at_b = a[1], b[1]
    while waiting > 0:
        f = pop(queue, planes, waiting)
        waiting -= 1
        if scratch.alive[f] != 1:
            continue
        low = planes[f, 3]
        if low >= best - tight * best:
            return True, best, outward, point
        n = (planes[f, 0], planes[f, 1], planes[f, 2])
        w, p, at_a, at_b = difference(corners, a, b, rot, t, n, at_a, at_b)
        high = dot(n, w)
        known = (
            w == corner(points, scratch.corners[f, 0])
            or w == corner(points, scratch.corners[f, 1])
            or w == corner(points, scratch.corners[f, 2])
        )
        done = known or high - low <= tight * abs(high) + 2e-15 * size
        if high < best:
            best, outward, point = high, n, p
        if done:
            if high <= best + tight * abs(best) + 2e-15 * size:
                return True, high, n, foot(scratch, f)
            return True, best, outward, point
        if used == MAX_CORNERS:
            return False, best, outward, point
        set_corner(points, used, w, p)
        start = faces
        faces = outline(scratch, f, used, faces, size)
        used += 1
        if faces < 0:
            return False, best, outward, point
        for g in range(start, faces):
            distance = planes[g, 3]
            if distance < -1e-13 * size - abs(low):
                return False, best, outward, point
            if distance <= best and waiting < MAX_FACES:
                push(queue, planes, waiting, g)
                waiting += 1
    return best < np.inf, best, outward, point
