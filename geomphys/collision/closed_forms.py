"""Distance and depth of pairs with a formula: balls and capsules with each other, a ball with a box or a cylinder.

Each returns the signed separation s [m], the unit normal n out of B into A, and the point of A nearest to (or deepest
in) B; the point of B is that less s n.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, add_scaled, cross, dot, norm, perpendicular, scale, sub

PARALLEL = 1e-28
"""Square of the sine below which two axes are parallel to rounding."""

Answer: TypeAlias = tuple[float, Vec, Vec]


@kernel
def segments(p: Vec, u: Vec, h: float, r: float, q: Vec, v: Vec, k: float, s: float) -> Answer:
    """Balls and capsules A and B: centres p and q, unit axes u and v, half lengths h and k, radii r and s.

    Two segments are closest where their lines are, if that lies within both: there the normal is that of both axes,
    also where they cross. Otherwise an end of one of them is nearest; parallel ones are nearest in the middle of their
    common part.
    """
    w = sub(q, p)
    c = cross(u, v)
    cc = dot(c, c)
    if cc > PARALLEL and h > 0.0 and k > 0.0:
        x, y = dot(cross(w, v), c) / cc, dot(cross(w, u), c) / cc
        if abs(x) <= h and abs(y) <= k:
            n = scale(c, (-1.0 if dot(c, w) > 0.0 else 1.0) / math.sqrt(cc))
            return -dot(n, w) - r - s, n, add_scaled(add_scaled(p, u, x), n, -r)
    x, y = 0.0, 0.0
    if cc <= PARALLEL and h > 0.0 and k > 0.0:
        middle = dot(u, w)
        x = 0.5 * (max(-h, min(middle - k, h)) + min(h, max(middle + k, -h)))
        y = min(max(dot(v, sub(add_scaled(p, u, x), q)), -k), k)
    else:
        best = np.inf
        for end in range(4):
            if end < 2:
                i = h if end == 0 else -h
                j = min(max(dot(v, sub(add_scaled(p, u, i), q)), -k), k)
            else:
                j = k if end == 2 else -k
                i = min(max(dot(u, sub(add_scaled(q, v, j), p)), -h), h)
            d = sub(add_scaled(p, u, i), add_scaled(q, v, j))
            if dot(d, d) < best:
                best = dot(d, d)
                x, y = i, j
    a = add_scaled(p, u, x)
    d = sub(a, add_scaled(q, v, y))
    free_u, free_v = abs(x) < h, abs(y) < k
    length = norm(d)
    if length == 0.0:
        # an end of one lies on the other: out towards the middle of its own segment
        d = sub(scale(u, -x), scale(v, -y))
    if free_u:
        d = add_scaled(d, u, -dot(u, d))
    if free_v:
        d = add_scaled(d, v, -dot(v, d))
    reach = norm(d)
    n = scale(d, 1.0 / reach) if reach > 0.0 else perpendicular(u if h > 0.0 else v)
    distance = dot(n, sub(a, add_scaled(q, v, y)))
    return distance - r - s, n, add_scaled(a, n, -r)


@kernel
def ball_box(c: Vec, r: float, half: Vec) -> Answer:
    """Ball A of centre c and radius r, box B of half lengths `half`; box frame."""
    q = (
        min(max(c[0], -half[0]), half[0]),
        min(max(c[1], -half[1]), half[1]),
        min(max(c[2], -half[2]), half[2]),
    )
    d = sub(c, q)
    distance = norm(d)
    if distance > 0.0:
        n = scale(d, 1.0 / distance)
    else:
        x, y, z = half[0] - abs(c[0]), half[1] - abs(c[1]), half[2] - abs(c[2])
        distance = -min(x, y, z)
        if x == -distance:
            n = (1.0 if c[0] >= 0.0 else -1.0, 0.0, 0.0)
        elif y == -distance:
            n = (0.0, 1.0 if c[1] >= 0.0 else -1.0, 0.0)
        else:
            n = (0.0, 0.0, 1.0 if c[2] >= 0.0 else -1.0)
    return distance - r, n, add_scaled(c, n, -r)


@kernel
def ball_cylinder(c: Vec, r: float, radius: float, half_height: float) -> Answer:
    """Ball A of centre c and radius r, cylinder B along z; cylinder frame."""
    across = math.sqrt(c[0] * c[0] + c[1] * c[1])
    radial = (c[0] / across, c[1] / across, 0.0) if across > 0.0 else (1.0, 0.0, 0.0)
    up = 1.0 if c[2] >= 0.0 else -1.0
    x, z = across - radius, abs(c[2]) - half_height
    if x > 0.0 and z > 0.0:
        distance = math.sqrt(x * x + z * z)
        n = (radial[0] * x / distance, radial[1] * x / distance, up * z / distance)
    elif x > z:
        distance = x
        n = radial
    else:
        distance = z
        n = (0.0, 0.0, up)
    return distance - r, n, add_scaled(c, n, -r)
