"""Distance and depth of pairs with a formula: balls and capsules with each other, a ball with a box or a cylinder.

Each returns the signed separation s [m], the unit normal n out of B into A, and the point of A nearest to (or deepest
in) B; the point of B is that less s n.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from geomphys.kernel import kernel
from geomphys.vec3 import Vec, add_scaled, cross, dot, norm, perpendicular, scale, sub

Answer: TypeAlias = tuple[float, Vec, Vec]


@kernel
def segments(p: Vec, u: Vec, h: float, r: float, q: Vec, v: Vec, k: float, s: float) -> Answer:
    """Balls and capsules A and B: centres p and q, unit axes u and v, half lengths h and k, radii r and s.

    The closest points of two segments; on parallel ones the middle of the part they share. Where the axes cross, the
    way out is along the normal of both.
    """
    w = sub(p, q)
    c = dot(u, v)
    along_u, along_v = dot(u, w), dot(v, w)
    slant = 1.0 - c * c
    if slant > 1e-14 and h > 0.0 and k > 0.0:
        x = min(max((c * along_v - along_u) / slant, -h), h)
    else:
        # B's segment on A's axis reaches from -along_u - k to -along_u + k: the middle of what both cover
        x = 0.5 * (max(-h, min(-along_u - k, h)) + min(h, max(-along_u + k, -h)))
    y = min(max(along_v + c * x, -k), k)
    x = min(max(c * y - along_u, -h), h) if slant > 1e-14 or k == 0.0 else x
    a, b = add_scaled(p, u, x), add_scaled(q, v, y)
    d = sub(a, b)
    free_u, free_v = abs(x) < h, abs(y) < k
    if free_u and free_v and slant > 1e-14:
        n = cross(u, v)
        n = scale(n, (1.0 if dot(n, d) >= 0.0 else -1.0) / norm(n))
    else:
        if free_u:
            d = add_scaled(d, u, -dot(u, d))
        if free_v:
            d = add_scaled(d, v, -dot(v, d))
        length = norm(d)
        if length > 0.0:
            n = scale(d, 1.0 / length)
        elif free_u or k == 0.0:
            n = perpendicular(u)
        else:
            n = perpendicular(v)
    return dot(n, sub(a, b)) - r - s, n, add_scaled(a, n, -r)


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
