"""Resting contact: the contact points of touching bodies solved together.

Below a threshold approach speed nothing bounces. Over a step of h seconds the contact forces are constant; the motion
along the normal that they give, ½ h (v_n⁰ + v_n¹), must leave every point no nearer than the gap kept, forces only
push, and friction stays in Coulomb's cone: it holds if it can and else opposes the sliding. With the velocities of
both ends of the step in the mean, gravity does exactly the work it should, a body slides down a slope on the exact
parabola, and a body at rest is pushed by exactly its weight.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import add_scaled, dot, norm, scale
from geomphys.simulated.cells import add_vec, set_vec, vec_at
from geomphys.simulated.contact_points import normal_speed, push, speed_at
from geomphys.simulated.driven_paths import load_paths
from geomphys.simulated.driven_targets import reload
from geomphys.simulated.impulse_accumulation import commit, give, impulse_of
from geomphys.simulated.impulses import let_go, settle, settle_normals
from geomphys.simulated.motion import load_velocities, plan
from geomphys.simulated.state import (
    AT_COUNT,
    AT_DT,
    AT_GAP,
    AT_HEFT,
    AT_THRESHOLD,
    AT_TOUCH,
    AT_VELOCITY,
    AT_WEIGHT,
    BINORMAL,
    BODY_A,
    CLEARANCE,
    FORCE,
    GOAL,
    GRASP,
    GRAVITY,
    GRIP,
    HELD,
    ISLAND,
    LIGHTNESS,
    LIMIT,
    MOVES,
    N_PAIRS,
    N_ROWS,
    NORMAL,
    PULL,
    PUSH,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    ROW_SLOT,
    RUB,
    TANGENT,
    TORQUE,
    YIELDED,
    entry,
    free_body,
    has_changed,
    has_yielded,
    how_many,
    is_simulated,
    kind_of,
    knob,
    motion_of,
    owner,
    pair_at,
    row,
    slot_at,
    velocity_of,
)

SWEEPS = 400  # at most; what is left then is small, and the next step goes on from there
FEW_SWEEPS = 60  # after a halt within the step
STILL = 1e-11  # m/s: the solving ends when no sweep changes a velocity by more ...
STILL_PART = 1e-6  # ... or by more than this share of the fastest motion at a contact point
APPROACH = 2e-4  # m/s: touching points that approach no faster are stopped in the course of the step
FAINT = 5e-3  # m/s: points that part no faster are held as if they did not part
SLOW_PART = (
    1.0  # of the threshold: points near but not touching that approach no faster are held if others of the pair touch
)
WEIGHT_TIME = 0.01  # s: more than twice the longest step
MOST_YIELDS = 4
GRIPPED = 1e-4  # m/s: a point that a driven body pressed and that does not part faster is gripped


@kernel
def set_limits(sim: int) -> None:
    """Bound the normal impulses of bodies that follow a path.

    Such a body may squeeze another against something that does not yield, and no impulse would ever be enough. Four
    times what stops the whole island's approach, and holds its weight, is enough for all that can be done.
    """
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        a, b = int_at(o, ROW_A), int_at(o, ROW_B)
        if not has_changed(sim, a) or is_simulated(sim, b) or int_at(kind_of(sim, b), MOVES) == 0:
            continue
        if float_at(motion_of(sim, b), LIGHTNESS) > 0.0:
            set_float(r, LIMIT, math.inf)  # it gives way
        else:
            v = norm(speed_at(entry(sim, AT_VELOCITY), r, a, b))
            heft = float_at(entry(sim, AT_HEFT), int_at(kind_of(sim, a), ISLAND))
            set_float(r, LIMIT, 4.0 * heft * (v + WEIGHT_TIME * knob(sim, AT_WEIGHT)))


@kernel
def clear_rows(sim: int) -> None:
    """Take the impulses out of the rows of changed bodies."""
    for k in range(how_many(sim, N_ROWS)):
        if has_changed(sim, int_at(owner(sim, k), ROW_A)):
            set_vec(row(sim, k), PUSH, (0.0, 0.0, 0.0))


@kernel
def yield_squeezed(sim: int) -> bool:
    """Let go of pairs whose path-following body would need more than its bound. Returns whether there were any."""
    any_yielded = False
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        if int_at(o, ROW_ON) == 1 and float_at(r, PUSH) >= 0.999 * float_at(r, LIMIT):
            set_int(pair_at(sim, int_at(o, ROW_PAIR)), YIELDED, 1)
            any_yielded = True
    let_go(sim)
    return any_yielded


@kernel
def stop_slow_approach(sim: int, t: float, wishes: bool) -> None:
    """Take the approach out of all touching points of changed bodies at once, with ε = 0.

    `wishes` says that driven bodies are as they want to move at time `t`, not on their paths.
    """
    least = 0.0
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        a, b = int_at(o, ROW_A), int_at(o, ROW_B)
        on = has_changed(sim, a) and float_at(r, CLEARANCE) <= knob(sim, AT_TOUCH)
        on = on and not has_yielded(sim, int_at(o, ROW_PAIR))
        set_int(o, ROW_ON, 1 if on else 0)
        set_float(r, GOAL, 0.0)
        if on:
            least = min(least, normal_speed(entry(sim, AT_VELOCITY), r, a, b))
    if least >= -APPROACH:
        return
    set_limits(sim)
    for _ in range(MOST_YIELDS):
        settle(sim, entry(sim, AT_VELOCITY), SWEEPS, max(STILL, -STILL_PART * least))
        if not yield_squeezed(sim):
            break
        clear_rows(sim)
        reload(sim, t, wishes)
    commit(sim)


@kernel
def choose_held(sim: int, h: float) -> float:
    """Mark the points that contact forces hold over the next `h` seconds, and set what they must hold.

    Returns the fastest motion at one of them [m/s].
    """
    fastest = 0.0
    for k in range(how_many(sim, N_PAIRS)):
        if has_changed(sim, int_at(pair_at(sim, k), BODY_A)):
            set_int(pair_at(sim, k), HELD, 0)
    for k in range(how_many(sim, N_ROWS)):
        o = owner(sim, k)
        touches = float_at(row(sim, k), CLEARANCE) <= knob(sim, AT_TOUCH)
        if touches and has_changed(sim, int_at(o, ROW_A)) and not has_yielded(sim, int_at(o, ROW_PAIR)):
            set_int(pair_at(sim, int_at(o, ROW_PAIR)), HELD, 1)
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        set_int(o, ROW_ON, 0)
        if has_changed(sim, int_at(o, ROW_A)) and not has_yielded(sim, int_at(o, ROW_PAIR)):
            speed = speed_at(entry(sim, AT_VELOCITY), r, int_at(o, ROW_A), int_at(o, ROW_B))
            v, clearance = dot(speed, vec_at(r, NORMAL)), float_at(r, CLEARANCE)
            held = int_at(pair_at(sim, int_at(o, ROW_PAIR)), HELD) == 1
            slowest = -SLOW_PART * knob(sim, AT_THRESHOLD) if held else 0.0
            if clearance <= knob(sim, AT_TOUCH) or v > slowest:
                fastest = max(fastest, norm(speed))
                parting = v if v > FAINT else 0.0
                set_float(r, GOAL, -2.0 * max(0.0, clearance - knob(sim, AT_GAP)) / h - parting)
                slot = slot_at(sim, int_at(o, ROW_PAIR), int_at(o, ROW_SLOT))
                set_float(r, GRIP, h / knob(sim, AT_DT) * float_at(slot, GRASP) if abs(v) < GRIPPED else 0.0)
                set_int(o, ROW_ON, 1)
                set_int(pair_at(sim, int_at(o, ROW_PAIR)), HELD, 1)
    return fastest


@kernel
def begin_with_old_force(sim: int, k: int, h: float) -> bool:
    """Set the impulses of row k to what its point's forces of the step before do in `h` seconds, and apply them.

    Returns whether there were any.
    """
    o, r = owner(sim, k), row(sim, k)
    a, b = int_at(o, ROW_A), int_at(o, ROW_B)
    slot = slot_at(sim, int_at(o, ROW_PAIR), int_at(o, ROW_SLOT))
    f = vec_at(slot, FORCE + 1)
    set_float(r, PUSH, min(float_at(r, LIMIT), h * float_at(slot, FORCE)))
    set_float(r, RUB, h * dot(f, vec_at(r, TANGENT)))
    set_float(r, RUB + 1, h * dot(f, vec_at(r, BINORMAL)))
    if float_at(r, PUSH) == 0.0 and float_at(r, RUB) == 0.0 and float_at(r, RUB + 1) == 0.0:
        return False
    push(sim, entry(sim, AT_VELOCITY), r, a, b, 0, float_at(r, PUSH))
    push(sim, entry(sim, AT_VELOCITY), r, a, b, 1, float_at(r, RUB))
    push(sim, entry(sim, AT_VELOCITY), r, a, b, 2, float_at(r, RUB + 1))
    return True


@kernel
def keep_force(sim: int, k: int, h: float) -> None:
    """Turn the impulses of row k into constant forces over `h` seconds: its point's, and those on both bodies."""
    o, r = owner(sim, k), row(sim, k)
    j, normal = impulse_of(r), float_at(r, PUSH)
    give(sim, k, j, 1.0 / h, PULL, TORQUE)
    slot = slot_at(sim, int_at(o, ROW_PAIR), int_at(o, ROW_SLOT))
    set_float(slot, FORCE, normal / h)
    set_vec(slot, FORCE + 1, scale(add_scaled(j, vec_at(r, NORMAL), -normal), 1.0 / h))
    set_vec(r, PUSH, (0.0, 0.0, 0.0))


@kernel
def fall(sim: int, t: float, h: float) -> None:
    """Let gravity act for `h` seconds on the velocities and motions of changed bodies, nothing else.

    What follows its path gets the velocities it has then, at `t` + `h`.
    """
    load_paths(sim, t + h)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if has_changed(sim, body):
            add_vec(velocity_of(entry(sim, AT_VELOCITY), body), 0, vec_at(sim, GRAVITY), h)
            set_vec(motion_of(sim, body), PULL, vec_at(sim, GRAVITY))
            set_vec(motion_of(sim, body), TORQUE, (0.0, 0.0, 0.0))


@kernel
def hold(sim: int, t: float, h: float, sweeps: int) -> None:
    """Contact forces on the changed bodies from time `t` of the frame for `h` seconds, and their motions under them.

    Points that touch or approach slowly are held; what comes in faster is left to collide. `velocity` of the state
    must hold the present velocities.
    """
    set_limits(sim)
    fastest = choose_held(sim, h)
    count = how_many(sim, N_ROWS)
    for _ in range(MOST_YIELDS):
        fall(sim, t, h)
        known = False
        for k in range(count):
            if int_at(owner(sim, k), ROW_ON) == 1:
                known = begin_with_old_force(sim, k, h) or known
        if not known:
            settle_normals(sim, entry(sim, AT_VELOCITY), SWEEPS, STILL)
        settle(sim, entry(sim, AT_VELOCITY), sweeps, max(STILL, STILL_PART * fastest))
        if not yield_squeezed(sim):
            break
        clear_rows(sim)
        load_velocities(sim)
    for k in range(count):
        if has_changed(sim, int_at(owner(sim, k), ROW_A)):
            keep_force(sim, k, h)
    for s in range(entry(sim, AT_COUNT)):
        if has_changed(sim, free_body(sim, s)):
            plan(motion_of(sim, free_body(sim, s)), h)
