"""Which collisions there are at a moment, and their resolution one at a time."""

from __future__ import annotations

from geomphys.kernel import kernel
from geomphys.memory import float_at, int_at, set_float, set_int
from geomphys.simulated.cells import add_vec, set_vec, vec_at
from geomphys.simulated.impulses import collide
from geomphys.simulated.ledger import commit
from geomphys.simulated.motion import load_velocities, refresh, turn_at
from geomphys.simulated.points import normal_speed
from geomphys.simulated.resting import set_limits, stop_slow_approach
from geomphys.simulated.state import (
    ARM_A,
    ARM_B,
    AT_COUNT,
    AT_RECOIL,
    AT_THRESHOLD,
    AT_TOLD,
    AT_TOUCH,
    AT_VELOCITY,
    CLEARANCE,
    HITS,
    LIGHTNESS,
    MASS,
    MASS_N,
    MASS_T,
    N_PAIRS,
    N_ROWS,
    NORMAL,
    RATE,
    ROLE,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    SPEED,
    TREE,
    WISH_ARM,
    entry,
    free_body,
    has_changed,
    has_yielded,
    how_many,
    kind_of,
    knob,
    motion_of,
    owner,
    pair_at,
    row,
    velocity_of,
)
from geomphys.vec3 import Vec, add, cross, dot, quat_rotate, sub
from geomphys.world.scene import DRIVEN, FIXED

IDLE = 1e-7  # m/s: a slower approach of a driven body's wish is none
MOST_HITS = 3  # of a pair at one moment: what then still approaches is stopped, all of it together
MOST_WISHES = 40  # of a driven body and another at one moment


@kernel
def wish(sim: int, body: int, t: float) -> Vec:
    """Velocity that a driven body's origin wants to have [m/s], less what recoil has taken."""
    told = velocity_of(entry(sim, AT_TOLD), body)
    arm = quat_rotate(turn_at(motion_of(sim, body), t), vec_at(motion_of(sim, body), WISH_ARM))
    v = sub(vec_at(told, 0), cross(vec_at(told, 3), arm))
    return add(v, vec_at(entry(sim, AT_RECOIL), 3 * int_at(kind_of(sim, body), TREE)))


@kernel
def wished_speed(sim: int, k: int, t: float) -> float:
    """v_n of row k, whose b is driven, if b moved as it wants to [m/s]."""
    r, a, b = row(sim, k), int_at(owner(sim, k), ROW_A), int_at(owner(sim, k), ROW_B)
    va = velocity_of(entry(sim, AT_VELOCITY), a)
    of_a = add(vec_at(va, 0), cross(vec_at(va, 3), vec_at(r, ARM_A)))
    of_b = add(wish(sim, b, t), cross(vec_at(velocity_of(entry(sim, AT_TOLD), b), 3), vec_at(r, ARM_B)))
    return dot(vec_at(r, NORMAL), sub(of_a, of_b))


@kernel
def join_collision(sim: int, chosen: int) -> None:
    """Mark with `ROW_ON` = 2 the points that collide together with row `chosen`: the touching ones between the same
    bodies, and, against fixed things, all touching points of the body on fixed things.
    """
    a, b = int_at(owner(sim, chosen), ROW_A), int_at(owner(sim, chosen), ROW_B)
    fixed = int_at(kind_of(sim, b), ROLE) == FIXED
    for k in range(how_many(sim, N_ROWS)):
        o = owner(sim, k)
        other = int_at(o, ROW_B)
        same = other == b or (fixed and int_at(kind_of(sim, other), ROLE) == FIXED)
        on = same and int_at(o, ROW_A) == a and float_at(row(sim, k), CLEARANCE) <= knob(sim, AT_TOUCH)
        set_int(o, ROW_ON, 2 if on else 0)


@kernel
def lighten(sim: int, by: float) -> None:
    """Add an inverse mass [1/kg] to what impulses do at the colliding points."""
    for k in range(how_many(sim, N_ROWS)):
        if int_at(owner(sim, k), ROW_ON) == 2:
            r = row(sim, k)
            set_float(r, MASS_N, float_at(r, MASS_N) + by)
            set_float(r, MASS_T, float_at(r, MASS_T) + by)
            set_float(r, MASS_T + 2, float_at(r, MASS_T + 2) + by)


@kernel
def collide_with_driven(sim: int, b: int, t: float, elastic: float) -> None:
    """One collision with a driven body b: its mass is that of the coupling, it does not turn, and it is pushed back."""
    m, v = motion_of(sim, b), velocity_of(entry(sim, AT_VELOCITY), b)
    before = wish(sim, b, t)
    light = 1.0 / float_at(m, MASS)
    set_float(m, LIGHTNESS, light)
    set_vec(v, 0, before)
    set_vec(v, 3, vec_at(velocity_of(entry(sim, AT_TOLD), b), 3))
    lighten(sim, light)
    collide(sim, entry(sim, AT_VELOCITY), elastic)
    lighten(sim, -light)
    add_vec(entry(sim, AT_RECOIL), 3 * int_at(kind_of(sim, b), TREE), sub(vec_at(v, 0), before), 1.0)
    set_float(m, LIGHTNESS, 0.0)
    set_vec(v, 0, vec_at(m, SPEED))
    set_vec(v, 3, vec_at(m, RATE))


@kernel
def fastest_approach(sim: int, t: float) -> tuple[int, float]:
    """The touching point that approaches fastest, of those that must collide, and its v_n [m/s]; -1 for none.

    Collisions are approaches above the threshold; with a driven body, any approach as it wants to move.
    """
    worst, chosen = 0.0, -1
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        a, b = int_at(o, ROW_A), int_at(o, ROW_B)
        pair = int_at(o, ROW_PAIR)
        if not has_changed(sim, a) or has_yielded(sim, pair) or float_at(r, CLEARANCE) > knob(sim, AT_TOUCH):
            continue
        hits = int_at(pair_at(sim, pair), HITS)
        if int_at(kind_of(sim, b), ROLE) == DRIVEN:
            v, least, most = wished_speed(sim, k, t), IDLE, MOST_WISHES
        else:
            v, least, most = normal_speed(entry(sim, AT_VELOCITY), r, a, b), knob(sim, AT_THRESHOLD), MOST_HITS
        if hits < most and v < -least and v < worst:
            worst, chosen = v, k
    return chosen, worst


@kernel
def resolve(sim: int, t: float, room: int) -> tuple[int, bool]:
    """Resolve the collisions of the changed bodies' contact points at time `t` of the frame.

    The fastest goes first; each changes velocities, and what then approaches is a collision again. What approaches
    slower than the threshold is stopped, all of it together.

    Parameters
    ----------
    sim
        Its rows must be those of time `t`.
    t
        s of the frame.
    room
        Collisions the frame still has room for; beyond, nothing bounces.

    Returns
    -------
    tuple
        Number of collisions resolved; whether `room` was too little.
    """
    load_velocities(sim)
    set_limits(sim)
    done, full = 0, False
    for k in range(how_many(sim, N_PAIRS)):
        set_int(pair_at(sim, k), HITS, 0)
    while True:
        chosen, v = fastest_approach(sim, t)
        if chosen < 0:
            break
        p = pair_at(sim, int_at(owner(sim, chosen), ROW_PAIR))
        set_int(p, HITS, int_at(p, HITS) + 1)
        b = int_at(owner(sim, chosen), ROW_B)
        driven = int_at(kind_of(sim, b), ROLE) == DRIVEN
        bounces = v < -knob(sim, AT_THRESHOLD) and int_at(p, HITS) <= MOST_HITS
        if bounces and done >= room:
            full = True
            bounces = False
            if not driven:
                break
        join_collision(sim, chosen)
        if driven:
            collide_with_driven(sim, b, t, 1.0 if bounces else 0.0)
        else:
            collide(sim, entry(sim, AT_VELOCITY), 1.0)
        commit(sim)
        done += 1 if bounces else 0
    stop_slow_approach(sim)
    for s in range(entry(sim, AT_COUNT)):
        if has_changed(sim, free_body(sim, s)):
            refresh(motion_of(sim, free_body(sim, s)))
    load_velocities(sim)
    return done, full
