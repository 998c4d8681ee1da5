"""Exact penetration depth of two overlapping convex cores: a polytope inside their Minkowski difference grows outward.

M = A − B holds the origin when A and B overlap, and the depth is the origin's distance to M's surface. The polytope's
face nearest to the origin bounds the depth from below; the extent of M along that face's normal bounds it from above,
as any direction does. Where both meet the depth is exact; otherwise M's farthest point along the normal becomes a new
corner: faces that see it go, and their outline is joined to it.
"""

from __future__ import annotations

import math

import numpy as np

from geomphys.collision.gjk import corner_of_simplex, difference, set_corner
from geomphys.collision.scratch import MAX_CORNERS, MAX_FACES, Scratch
from geomphys.collision.support import Core, is_curved
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Rot, Vec, add_scaled, cross, dot, norm, perpendicular, scale, sub

GONE = 0
SURFACE = 1
FLAT = 2  # of the surface, but without area: its plane is undefined, its points lie on the edges of others
FEW = 24
"""Corners from which on each new one is compared with all others."""


@kernel
def enqueue(scratch: Scratch, count: int, face: int, key: float) -> None:
    """Add a face at distance `key` to the heap of `count` faces."""
    at = count
    while at > 0:
        up = (at - 1) >> 1
        other = scratch.queue[up]
        if scratch.faces[other].distance <= key:
            break
        scratch.queue[at] = other
        at = up
    scratch.queue[at] = face


@kernel
def pop(scratch: Scratch, count: int) -> int:
    """Take the nearest face out of the heap of `count` faces."""
    top = scratch.queue[0]
    last = scratch.queue[count - 1]
    key = scratch.faces[last].distance
    at = 0
    while True:
        down = 2 * at + 1
        if down >= count - 1:
            break
        other = scratch.queue[down]
        near = scratch.faces[other].distance
        if down + 1 < count - 1:
            right = scratch.queue[down + 1]
            if scratch.faces[right].distance < near:
                down += 1
                other = right
                near = scratch.faces[right].distance
        if near >= key:
            break
        scratch.queue[at] = other
        at = down
    scratch.queue[at] = last
    return top


@kernel
def set_face(scratch: Scratch, face: int, i: int, j: int, k: int) -> float:
    """Store a face of three corners; returns its plane's distance, infinite for a face without area."""
    p = vec_of(scratch.corners[i].difference)
    u = sub(vec_of(scratch.corners[j].difference), p)
    v = sub(vec_of(scratch.corners[k].difference), p)
    n = cross(u, v)
    area = dot(n, n)
    record = scratch.faces[face]
    record.corner[0], record.corner[1], record.corner[2] = i, j, k
    state, distance = FLAT, np.inf
    if area > 1e-26 * dot(u, u) * dot(v, v):
        n = scale(n, 1.0 / math.sqrt(area))
        state, distance = SURFACE, dot(n, p)
    record.state = state
    set_vec(record.normal, n)
    record.distance = distance
    return distance


@kernel
def join(scratch: Scratch, f: int, i: int, g: int, j: int) -> None:
    """Edge i of face f and edge j of face g are the same; edge k goes from corner k to the next."""
    scratch.faces[f].across[i] = 3 * g + j
    scratch.faces[g].across[j] = 3 * f + i


@kernel
def first_tetrahedron(a: Core, b: Core, rot: Rot, t: Vec, simplex: Record, scratch: Scratch) -> bool:
    """Complete the simplex to a tetrahedron of M, the first four corners, positively oriented.

    Each new point is the farthest of six from the span of those there are. Returns False if M has no volume.
    """
    count = simplex.count
    for i in range(4):
        w, p, _ = corner_of_simplex(simplex, i, rot, t)
        set_corner(scratch.corners, i, w, p)
    while count < 4:
        o = vec_of(scratch.corners[0].difference)
        e = sub(vec_of(scratch.corners[1].difference), o)
        n = cross(e, sub(vec_of(scratch.corners[2].difference), o))
        if count == 2:
            n = perpendicular(e)
        m = cross(e, n)
        best = 0.0
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
            w, p, _ = difference(a, b, rot, t, d)
            off = sub(w, o)
            side = off if count == 1 else cross(e, off)
            size = dot(side, side) if count < 3 else abs(dot(n, off))
            if size > best:
                best = size
                set_corner(scratch.corners, count, w, p)
        if best == 0.0:
            return False
        count += 1
    o, x, y = (
        vec_of(scratch.corners[0].difference),
        vec_of(scratch.corners[1].difference),
        vec_of(scratch.corners[2].difference),
    )
    volume = dot(cross(sub(x, o), sub(y, o)), sub(vec_of(scratch.corners[3].difference), o))
    if volume < 0.0:
        p, q = vec_of(scratch.corners[0].on_a), vec_of(scratch.corners[1].on_a)
        set_corner(scratch.corners, 0, x, q)
        set_corner(scratch.corners, 1, o, p)
    return volume != 0.0


@kernel
def outline(scratch: Scratch, face: int, new: int, faces: int, eps: float) -> int:
    """Take away the faces that see corner `new`, starting with `face`, and join their outline to it.

    A face sees the corner if that lies more than `eps` [m] above its plane. The outline is traversed counter-clockwise, so
    each new face is adjacent to the one before. Returns the number of faces,
    -1 if the outline does not close or the tables are full.
    """
    w = vec_of(scratch.corners[new].difference)
    scratch.faces[face].state = GONE
    for k in range(3):
        scratch.stack[k] = scratch.faces[face].across[2 - k]
    depth = 3
    start = faces
    first, end = -1, -1
    while depth > 0:
        depth -= 1
        edge = scratch.stack[depth]
        g = edge // 3
        e = edge - 3 * g
        record = scratch.faces[g]
        state = record.state
        if state == GONE:
            continue
        next_edge = 0 if e == 2 else e + 1
        if state == FLAT or dot(vec_of(scratch.faces[g].normal), w) - scratch.faces[g].distance > eps:
            record.state = GONE
            scratch.stack[depth] = record.across[2 if e == 0 else e - 1]
            scratch.stack[depth + 1] = record.across[next_edge]
            depth += 2
            continue
        i, j = record.corner[next_edge], record.corner[e]
        if faces == start:
            first = i
        elif end != i:
            return -1
        if faces == MAX_FACES:
            return -1
        end = j
        set_face(scratch, faces, i, j, new)
        join(scratch, faces, 0, g, e)
        if faces > start:
            join(scratch, faces - 1, 1, faces, 2)
        faces += 1
    if faces - start < 3 or end != first:
        return -1
    join(scratch, faces - 1, 1, start, 2)
    return faces


@kernel
def foot(scratch: Scratch, n: Vec, face: int, faces: int) -> Vec:
    """Point of A that belongs to where the ray from the origin along n leaves the polytope.

    Walks from `face` across the edges that the ray passes; where slivers stop the walk, all faces that the ray crosses
    are tested.
    """
    best = -np.inf
    found = face
    for step in range(16 + faces):
        f = face if step < 16 else step - 16
        record = scratch.faces[f]
        if record.state != SURFACE or dot(n, vec_of(scratch.faces[f].normal)) < 0.5:
            continue
        i, j, k = record.corner[0], record.corner[1], record.corner[2]
        p, q, r = (
            vec_of(scratch.corners[i].difference),
            vec_of(scratch.corners[j].difference),
            vec_of(scratch.corners[k].difference),
        )
        x, y, z = dot(n, cross(q, r)), dot(n, cross(r, p)), dot(n, cross(p, q))
        total = x + y + z
        worst = min(x, y, z)
        if total > 0.0 and worst > best * total:
            best = worst / total
            found = f
        if best >= -1e-10:
            break
        edge = 1 if worst == x else (2 if worst == y else 0)
        face = record.across[edge] // 3
    record = scratch.faces[found]
    i, j, k = record.corner[0], record.corner[1], record.corner[2]
    p, q, r = (
        vec_of(scratch.corners[i].difference),
        vec_of(scratch.corners[j].difference),
        vec_of(scratch.corners[k].difference),
    )
    x, y, z = max(dot(n, cross(q, r)), 0.0), max(dot(n, cross(r, p)), 0.0), max(dot(n, cross(p, q)), 0.0)
    total = x + y + z
    if total == 0.0:
        return vec_of(scratch.corners[i].on_a)
    return blend(scratch, i, j, k, x / total, y / total, z / total)


@kernel
def blend(scratch: Scratch, i: int, j: int, k: int, x: float, y: float, z: float) -> Vec:
    """Weighted mean of the points of A that corners i, j, k come from."""
    point = scale(vec_of(scratch.corners[i].on_a), x)
    point = add_scaled(point, vec_of(scratch.corners[j].on_a), y)
    return add_scaled(point, vec_of(scratch.corners[k].on_a), z)


@noinline
def expand(
    a: Core, b: Core, rot: Rot, t: Vec, size: float, eps: float, simplex: Record, scratch: Scratch
) -> tuple[bool, float, Vec, Vec]:
    """Penetration depth of the cores A and B in A's frame, from the simplex that `closest` left.

    `rot`, `t` are the pose of B, `size` the length of M's coordinates.

    Returns
    -------
    exact
        Whether the bounds met: to rounding, or 1e-7 of the depth and 1e-11 of the size where a curved core takes part.
    depth
        M's extent along the normal [m]: the smallest upper bound found.
    outward
        Unit normal of M's surface where it is nearest: points out of A into B.
    point
        Of A, deepest in B.
    """
    curved = is_curved(a) or is_curved(b)
    tight = 1e-7 if curved else 1e-12
    floor = size * (1e-11 if curved else 2e-15)
    relative, absolute = 1e-6, 1e-11 * size
    best, outward = np.inf, (0.0, 0.0, 1.0)
    if not first_tetrahedron(a, b, rot, t, simplex, scratch):
        return False, best, outward, vec_of(scratch.corners[0].on_a)
    waiting = 0
    for f in range(4):
        i, j, k = 0, 2, 1
        if f == 1:
            i, j, k = 0, 1, 3
        elif f == 2:
            i, j, k = 0, 3, 2
        elif f == 3:
            i, j, k = 1, 2, 3
        distance = set_face(scratch, f, i, j, k)
        if distance < np.inf:
            enqueue(scratch, waiting, f, distance)
            waiting += 1
    join(scratch, 0, 0, 2, 2)
    join(scratch, 0, 1, 3, 0)
    join(scratch, 0, 2, 1, 0)
    join(scratch, 1, 1, 3, 2)
    join(scratch, 1, 2, 2, 0)
    join(scratch, 2, 1, 3, 1)
    faces, used = 4, 4
    nearest, lowest, deepest = 0, np.inf, vec_of(scratch.corners[0].on_a)
    while waiting > 0:
        f = pop(scratch, waiting)
        waiting -= 1
        if scratch.faces[f].state != SURFACE:
            continue
        low = scratch.faces[f].distance
        n = vec_of(scratch.faces[f].normal)
        w, p, _ = difference(a, b, rot, t, n)
        high = dot(n, w)
        known = False
        for k in range(3):
            known |= w == vec_of(scratch.corners[scratch.faces[f].corner[k]].difference)
        slack = tight * abs(min(high, best)) + floor
        if (known or high - low <= slack) and high <= best + slack:
            return high - lowest <= relative * abs(high) + absolute, high, n, foot(scratch, n, f, faces)
        if known or low >= best - slack:
            return best - lowest <= relative * abs(best) + absolute, best, outward, foot(scratch, outward, f, faces)
        if high < best:
            best, outward, nearest, deepest = high, n, f, p
        if curved and used >= FEW:
            for i in range(used):
                known |= w == vec_of(scratch.corners[i].difference)
            if known:
                # an existing corner: rounding has deformed the surface, and this face is the best one
                lowest = min(lowest, low)
                continue
        if used == MAX_CORNERS:
            break
        set_corner(scratch.corners, used, w, p)
        start = faces
        faces = outline(scratch, f, used, faces, eps)
        used += 1
        if faces < 0:
            return False, best, outward, deepest
        for g in range(start, faces):
            distance = scratch.faces[g].distance
            if distance <= best and waiting < MAX_FACES:
                enqueue(scratch, waiting, g, distance)
                waiting += 1
    return (
        waiting == 0 and best - lowest <= relative * abs(best) + absolute,
        best,
        outward,
        foot(scratch, outward, nearest, faces),
    )
