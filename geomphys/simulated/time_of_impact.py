"""When two moving pieces first come near: continuous collision, rotation included, nothing missed.

Along a direction n that is kept fixed in the world, or in one of the two bodies, the separation

    f(τ) = min over points x of a and y of b of n·(x - y)

never exceeds the distance and is a minimum of smooth functions whose second derivative is bounded by some C, so
between two times   f ≥ min(f(τ0), f(τ1)) - C (τ1 - τ0)²/8.   A span over which that stays positive is free. The search
advances from free span to free span, taking the exact distance and a new direction at each halt, until the distance is
down to the one asked for (conservative advancement, Mirtich 1996, with separating directions in place of a motion
bound, so that gliding over a surface costs one span).
"""

from __future__ import annotations

import math

from geomphys.collision.extent import extent
from geomphys.collision.penetration import separate
from geomphys.jit.addresses import float_at, int_at, set_float
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, dot, neg, norm, quat_from_rotation_vector, quat_rotate, sub
from geomphys.simulated.cells import set_vec, vec_at
from geomphys.simulated.motion import fastest_turn, place_piece, point_at, turned_by
from geomphys.simulated.state import (
    AT_ARM,
    AXIS,
    BASE,
    BEND,
    BODY_A,
    BODY_B,
    DISTANCE,
    N_LOOKS,
    N_SPANS,
    PIECE_A,
    PIECE_B,
    PULL,
    SEEN,
    SPEED,
    count_one,
    entry,
    kept_at,
    motion_of,
    pair_at,
    room_at,
    shapes_at,
)

MOST_SPANS = 200
MOST_TRIES = 60
LOOK_FAR = 1e-3  # m: farther apart, a lower bound of the distance is enough


@kernel
def place_pair(sim: int, pair: int, t: float) -> None:
    """Frame rows of the two pieces of a pair at time `t` of the frame."""
    p = pair_at(sim, pair)
    place_piece(sim, int_at(p, BODY_A), int_at(p, PIECE_A), t)
    place_piece(sim, int_at(p, BODY_B), int_at(p, PIECE_B), t)


@kernel
def look(sim: int, pair: int, t: float) -> tuple[float, Vec, Vec, Vec]:
    """Separation [m], normal out of b into a, and witness points of a pair at time `t`; remembered with the pair.

    Beyond `LOOK_FAR` the separation is only a lower bound, that along the normal, and the points are void.
    """
    count_one(sim, N_LOOKS)
    place_pair(sim, pair, t)
    p, kept = pair_at(sim, pair), kept_at(sim, pair)
    found = separate(
        shapes_at(sim), int_at(p, PIECE_A), int_at(p, PIECE_B), LOOK_FAR, vec_at(kept, AXIS), True, room_at(sim)
    )
    set_vec(kept, AXIS, found[1])
    set_float(kept, DISTANCE, found[0])
    set_float(kept, SEEN, t)
    return found


@kernel
def swing(m: int, arm: float) -> float:
    """Bound on the acceleration that turning gives a point `arm` from the reference point [m/s²]."""
    rate = fastest_turn(m)
    return (rate * rate + 2.0 * norm(vec_at(m, BEND))) * arm


@kernel
def carried_curvature(carrier: int, other: int, arm: float, t: float, h: float) -> float:
    """C for a direction fixed in the body `carrier` from time `t` on for `h` s; `arm` is that of the other's piece.

    Both bodies are rows of `motion`. With d the way from one reference point to a point of the other body, f = n·d, so
    |f''| ≤ |n''| |d| + 2 |n'| |d'| + |d''|.
    """
    turn = fastest_turn(carrier)
    drift = sub(vec_at(other, SPEED), vec_at(carrier, SPEED))
    pull = norm(sub(vec_at(other, PULL), vec_at(carrier, PULL)))
    since = max(t - float_at(other, BASE), t - float_at(carrier, BASE)) + h
    speed = norm(drift) + (norm(vec_at(other, PULL)) + norm(vec_at(carrier, PULL))) * since + fastest_turn(other) * arm
    far = norm(sub(point_at(other, t), point_at(carrier, t))) + arm + speed * h
    return pull + swing(other, arm) + swing(carrier, far) + 2.0 * turn * speed


@kernel
def carried(m: int, n: Vec, t0: float, t1: float) -> Vec:
    """Direction n at t0, turned with a body until t1."""
    back = quat_rotate(quat_from_rotation_vector(neg(turned_by(m, t0))), n)
    return quat_rotate(quat_from_rotation_vector(turned_by(m, t1)), back)


@kernel
def reach_along(sim: int, pair: int, n: Vec) -> float:
    """Separation of a pair along n where its pieces are placed [m]."""
    p = pair_at(sim, pair)
    return -extent(shapes_at(sim), int_at(p, PIECE_A), neg(n)) - extent(shapes_at(sim), int_at(p, PIECE_B), n)


@kernel
def span(sim: int, pair: int, n: Vec, f0: float, t0: float, t1: float, enough: float) -> tuple[float, float]:
    """Separation along a direction, and how low it may have been since `t0`.

    Parameters
    ----------
    sim, pair
        The pair.
    n, f0
        Direction and the separation along it at `t0` [m].
    t0, t1
        s of the frame.
    enough
        m; a direction along which the separation never gets lower will do.

    Returns
    -------
    tuple
        Separation at `t1` and lower bound of that between [m], for the best of the directions n fixed in the world,
        in b and in a.
    """
    p = pair_at(sim, pair)
    a, b = motion_of(sim, int_at(p, BODY_A)), motion_of(sim, int_at(p, BODY_B))
    arm_a, arm_b = float_at(entry(sim, AT_ARM), int_at(p, PIECE_A)), float_at(entry(sim, AT_ARM), int_at(p, PIECE_B))
    count_one(sim, N_SPANS)
    place_pair(sim, pair, t1)
    h = t1 - t0
    pull = abs(dot(n, sub(vec_at(a, PULL), vec_at(b, PULL))))
    f = reach_along(sim, pair, n)
    low = min(f0, f) - 0.125 * (pull + swing(a, arm_a) + swing(b, arm_b)) * h * h
    for side in range(2):
        carrier, other, arm = (b, a, arm_a) if side == 0 else (a, b, arm_b)
        if low >= enough:
            break
        if fastest_turn(carrier) > 0.0:
            g = reach_along(sim, pair, carried(carrier, n, t0, t1))
            bound = min(f0, g) - 0.125 * carried_curvature(carrier, other, arm, t0, h) * h * h
            if bound > low:
                f, low = g, bound
    return f, low


@kernel
def free_until(sim: int, pair: int, n: Vec, f0: float, t0: float, t1: float, target: float, slack: float) -> float:
    """A time up to `t1`, as late as found, before which the pair's separation stays above `target` - `slack`.

    n and `f0` > `target` are direction and separation at `t0`. Unless it is `t1` itself, or something turns fast, the
    separation along n comes down to about the target there.
    """
    ahead = t1
    for _ in range(MOST_TRIES):
        f, low = span(sim, pair, n, f0, t0, ahead, target - slack)
        if f >= target and low >= target - slack:
            return ahead
        share = 0.5
        if f < target:
            share = min(0.98, max(0.02, (f0 - target - 0.5 * slack) / (f0 - f)))
        ahead = t0 + (ahead - t0) * share
    return ahead


@kernel
def first_touch(sim: int, pair: int, t0: float, t1: float, target: float, slack: float) -> float:
    """When the pieces of a pair first are `target` apart.

    Parameters
    ----------
    sim, pair
        The pair; its remembered separation is used if it was looked at at `t0`.
    t0, t1
        Span to search, s of the frame.
    target
        m; may be negative (an overlap).
    slack
        m; the distance at the time returned is below `target` + `slack`, and is nowhere before smaller than
        `target` - `slack`.

    Returns
    -------
    float
        Time [s of the frame]; inf if it does not happen before `t1`.
    """
    kept = kept_at(sim, pair)
    t = t0
    s, n = float_at(kept, DISTANCE), vec_at(kept, AXIS)
    if float_at(kept, SEEN) != t0:
        s, n, _, _ = look(sim, pair, t)
    for _ in range(MOST_SPANS):
        if s <= target + slack:
            return t
        after = free_until(sim, pair, n, s, t, t1, target, slack)
        if after >= t1:
            return math.inf
        if after - t <= 1e-14 * max(1.0, t):
            return t
        t = after
        s, n, _, _ = look(sim, pair, t)
    return t
