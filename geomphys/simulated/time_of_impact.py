"""Time of impact of two moving pieces: conservative, rotation included.

Along a direction n that is kept fixed in the world, or in one of the two bodies, the separation

    f(τ) = min over points x of a and y of b of n·(x - y)

is at most the distance, and a minimum of smooth functions whose second derivative is bounded by some C, so
between two times   f ≥ min(f(τ0), f(τ1)) - C (τ1 - τ0)²/8.   A span over which that stays positive is free. The search
advances from free span to free span, taking the exact distance and a new direction after each, until the distance is
down to the one asked for (conservative advancement, Mirtich 1996, with separating directions in place of a motion
bound, so that gliding over a surface costs one span).
"""

from __future__ import annotations

import math

from geomphys.collision.extent import gap_along
from geomphys.collision.penetration import separate
from geomphys.collision.support import Shapes
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import Vec, dot, neg, norm, quat_from_rotation_vector, quat_rotate, scale, sub
from geomphys.simulated.motion import (
    angular_speed_bound,
    point_at,
    pose_piece,
    rotation_at,
    travelled_at,
    velocity_at,
)
from geomphys.simulated.state import Motion, Simulation, is_simulated

MAX_SPANS = 200
MAX_TRIES = 60
LOOK_FAR = 1e-3  # m: for pairs farther apart a lower bound of the distance is enough


@kernel
def pose_pair(sim: Simulation, pair: int, t: float) -> None:
    """Frame rows of the two pieces of a pair at time `t` of the frame."""
    p = sim.pairs[pair]
    pose_piece(sim, p.body[0], p.piece[0], t)
    pose_piece(sim, p.body[1], p.piece[1], t)


@kernel
def measure_pair(sim: Simulation, pair: int, t: float) -> tuple[float, Vec, Vec, Vec]:
    """`measure_pair_within` of `LOOK_FAR`."""
    return measure_pair_within(sim, pair, t, LOOK_FAR)


@noinline
def measure_pair_within(sim: Simulation, pair: int, t: float, far: float) -> tuple[float, Vec, Vec, Vec]:
    """Separation [m], normal out of b into a, and witness points of a pair at time `t`; cached with the pair.

    Beyond `far` [m] the separation is only a lower bound, that along the normal, and the points are undefined.
    """
    pose_pair(sim, pair, t)
    p = sim.pairs[pair]
    shapes = Shapes(sim.pieces, sim.frames)
    found = separate(shapes, p.piece[0], p.piece[1], far, vec_of(p.axis), 1.0, p.simplex, sim.scratch)
    set_vec(p.axis, found[1])
    p.distance = found[0]
    p.measured_at = t
    return found


@kernel
def note_distance(sim: Simulation, pair: int, t: float, distance: float) -> None:
    """Store the separation of a pair [m], or a lower bound, at the present time `t`, for `is_apart`."""
    sim.pairs[pair].known_distance = distance
    sim.pairs[pair].travelled = travelled_by(sim, pair, t)


@kernel
def travelled_by(sim: Simulation, pair: int, t: float) -> float:
    """Sum of `travelled_at` of a pair's bodies at time `t` [m]; 0 for one that never moves, -inf if b has prescribed motion."""
    a, b = sim.pairs[pair].body[0], sim.pairs[pair].body[1]
    total = travelled_at(sim.motion[a], t)
    if is_simulated(sim, b):
        return total + travelled_at(sim.motion[b], t)
    return -math.inf if sim.bodies[b].moves == 1 else total


@kernel
def is_apart(sim: Simulation, pair: int, t: float, clearance: float) -> bool:
    """Whether a pair cannot have come as near as a clearance [m] at the present time `t` since its distance was stored."""
    p = sim.pairs[pair]
    if not is_simulated(sim, p.body[1]) and sim.bodies[p.body[1]].moves == 1:
        return False
    return bool(p.known_distance - (travelled_by(sim, pair, t) - p.travelled) > clearance)


@kernel
def stays_apart(sim: Simulation, pair: int, t0: float, t1: float, clearance: float) -> bool:
    """Whether a pair cannot come as near as a clearance [m] from the present time `t0` to `t1`, by bounds of its motion."""
    p = sim.pairs[pair]
    if not is_simulated(sim, p.body[1]) and sim.bodies[p.body[1]].moves == 1:
        return False
    a, b, h = sim.motion[p.body[0]], sim.motion[p.body[1]], t1 - t0
    v = sub(velocity_at(a, t0), velocity_at(b, t0))
    change = scale(sub(vec_of(a.acceleration), vec_of(b.acceleration)), 0.5 * h * h)
    swing = h * (angular_speed_bound(a) * sim.arm[p.piece[0]] + angular_speed_bound(b) * sim.arm[p.piece[1]])
    if p.measured_at == t0:
        n = vec_of(p.axis)
        approach = max(0.0, -h * dot(n, v)) + abs(dot(n, change))
        if p.distance - approach - swing > clearance:
            return True
    return is_apart(sim, pair, t0, clearance + h * norm(v) + norm(change) + swing)


@kernel
def swing(m: Motion, arm: float) -> float:
    """Bound on the acceleration by rotation of a point `arm` from the reference point [m/s²]."""
    rate = angular_speed_bound(m)
    return (rate * rate + 2.0 * norm(vec_of(m.half_angular_acceleration))) * arm


@kernel
def attached_curvature(reference: Motion, other: Motion, arm: float, t: float, h: float) -> float:
    """C for a direction fixed in the body `reference` from time `t` on for `h` s; `arm` is that of the other's piece.

    Both bodies are records of `motion`. With d the vector from one reference point to a point of the other body, f = n·d, so
    |f''| ≤ |n''| |d| + 2 |n'| |d'| + |d''|.
    """
    angular_speed = angular_speed_bound(reference)
    drift = sub(vec_of(other.velocity), vec_of(reference.velocity))
    acceleration = norm(sub(vec_of(other.acceleration), vec_of(reference.acceleration)))
    since = max(t - other.base_time, t - reference.base_time) + h
    speed = (
        norm(drift)
        + (norm(vec_of(other.acceleration)) + norm(vec_of(reference.acceleration))) * since
        + angular_speed_bound(other) * arm
    )
    far = norm(sub(point_at(other, t), point_at(reference, t))) + arm + speed * h
    return acceleration + swing(other, arm) + swing(reference, far) + 2.0 * angular_speed * speed


@kernel
def attached_direction(m: Motion, n: Vec, t0: float, t1: float) -> Vec:
    """Direction n at t0, rotated with a body until t1."""
    back = quat_rotate(quat_from_rotation_vector(neg(rotation_at(m, t0))), n)
    return quat_rotate(quat_from_rotation_vector(rotation_at(m, t1)), back)


@kernel
def reach_along(sim: Simulation, pair: int, n: Vec) -> float:
    """Separation of a pair along n at the present frames of its pieces [m]."""
    p = sim.pairs[pair]
    return gap_along(Shapes(sim.pieces, sim.frames), p.piece[0], p.piece[1], n)


@noinline
def span(sim: Simulation, pair: int, n: Vec, f0: float, t0: float, t1: float, enough: float) -> tuple[float, float]:
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
        m; a direction along which the separation stays above this suffices.

    Returns
    -------
    tuple
        Separation at `t1` and lower bound of that between [m], for the best of the directions n fixed in the world,
        in b and in a.
    """
    p = sim.pairs[pair]
    a, b = sim.motion[p.body[0]], sim.motion[p.body[1]]
    arm_a, arm_b = sim.arm[p.piece[0]], sim.arm[p.piece[1]]
    pose_pair(sim, pair, t1)
    h = t1 - t0
    acceleration = abs(dot(n, sub(vec_of(a.acceleration), vec_of(b.acceleration))))
    f = reach_along(sim, pair, n)
    low = min(f0, f) - 0.125 * (acceleration + swing(a, arm_a) + swing(b, arm_b)) * h * h
    for side in range(2):
        reference, other, arm = (b, a, arm_a) if side == 0 else (a, b, arm_b)
        if low >= enough:
            break
        if angular_speed_bound(reference) > 0.0:
            g = reach_along(sim, pair, attached_direction(reference, n, t0, t1))
            bound = min(f0, g) - 0.125 * attached_curvature(reference, other, arm, t0, h) * h * h
            if bound > low:
                f, low = g, bound
    return f, low


@kernel
def free_until(
    sim: Simulation, pair: int, n: Vec, f0: float, t0: float, t1: float, target: float, slack: float
) -> float:
    """A time up to `t1`, as late as found, before which the pair's separation stays above `target` - `slack`.

    n and `f0` > `target` are direction and separation at `t0`. Unless it is `t1` itself, or a body rotates fast, the
    separation along n is about the target there.
    """
    ahead = t1
    for _ in range(MAX_TRIES):
        f, low = span(sim, pair, n, f0, t0, ahead, target - slack)
        if f >= target and low >= target - slack:
            return ahead
        fraction = 0.5
        if f < target:
            fraction = min(0.98, max(0.02, (f0 - target - 0.5 * slack) / (f0 - f)))
        ahead = t0 + (ahead - t0) * fraction
    return ahead


@noinline
def first_touch(sim: Simulation, pair: int, t0: float, t1: float, target: float, slack: float) -> float:
    """When the pieces of a pair first are `target` apart.

    Parameters
    ----------
    sim, pair
        The pair; its cached separation is used if it was measured at `t0`.
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
        Time [s of the frame]; inf if there is none before `t1`.
    """
    cached = sim.pairs[pair]
    t = t0
    s, n = cached.distance, vec_of(cached.axis)
    if cached.measured_at != t0:
        s, n, _, _ = measure_pair(sim, pair, t)
        note_distance(sim, pair, t, s)
    for _ in range(MAX_SPANS):
        if s <= target + slack:
            return t
        after = free_until(sim, pair, n, s, t, t1, target, slack)
        if after >= t1:
            return math.inf
        if after - t <= 1e-14 * max(1.0, t):
            return t
        t = after
        s, n, _, _ = measure_pair(sim, pair, t)
    return t
