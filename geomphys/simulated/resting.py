"""Resting contact: the contact points of touching bodies solved together.

Below a threshold approach speed nothing bounces. Over a step of h seconds the contact forces are constant; the motion
along the normal that they give, ½ h (v_n⁰ + v_n¹), must leave every point no nearer than the gap kept, forces only
push, and friction stays in Coulomb's cone: it holds if it can and else opposes the sliding. With the velocities of
both ends of the step in the mean, gravity does exactly the work it should, a body slides down a slope on the exact
parabola, and a body at rest is pushed by exactly its weight.
"""

from __future__ import annotations

import math

from geomphys.kernel import kernel
from geomphys.memory import float_at, int_at, set_float, set_int
from geomphys.simulated.cells import add_vec, quat_at, set_quat, set_vec, vec_at
from geomphys.simulated.impulses import push_more, settle, settle_normals
from geomphys.simulated.ledger import commit, give, impulse_of
from geomphys.simulated.motion import load_velocities, plan, refresh
from geomphys.simulated.paths import load_paths
from geomphys.simulated.points import normal_speed, push, speed_at
from geomphys.simulated.state import (
    AT_COUNT,
    AT_DT,
    AT_GAP,
    AT_HEFT,
    AT_SHOVE,
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
    MASS_N,
    MOVES,
    N_PAIRS,
    N_ROWS,
    NORMAL,
    POINT,
    PULL,
    PUSH,
    ROLE,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    ROW_SLOT,
    RUB,
    TANGENT,
    TORQUE,
    TURN,
    WEDGED,
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
from geomphys.simulated.wishes import reload
from geomphys.vec3 import add_scaled, dot, norm, quat_from_rotation_vector, quat_mul, quat_unit, scale
from geomphys.world.scene import DRIVEN

SWEEPS = 400  # at most; what is left then is small, and the next step goes on from there
FEW_SWEEPS = 60  # after a halt within the step
STILL = 1e-11  # m/s: the solving ends when no sweep changes a velocity by more ...
STILL_PART = 1e-6  # ... or by more than this share of the fastest motion at a contact point
APPROACH = 2e-4  # m/s: touching points that approach no faster are stopped in the course of the step
FAINT = 5e-3  # m/s: points that part no faster are held as if they did not part
SLOW_PART = 1.0  # of the threshold: points near but not touching that approach no faster are held, not left to collide
WEIGHT_TIME = 0.01  # s: more than twice the longest step
MOST_YIELDS = 4
GRIPPED = 1e-4  # m/s: a point that a driven body pressed and that does not part faster is gripped
SHOVES = 200
SETTLED = 1e-3  # of the gap kept: the moving apart ends when no sweep changes a distance by more
WEDGE = 3.0  # gaps: what is left overlapping by more had no room
GIVE = 0.02  # where there is no room: share by which rows give in to what pushes back, so that overlap is shared out


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
    for k in range(how_many(sim, N_ROWS)):
        if has_yielded(sim, int_at(owner(sim, k), ROW_PAIR)):
            set_int(owner(sim, k), ROW_ON, 0)
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
        o, r = owner(sim, k), row(sim, k)
        set_int(o, ROW_ON, 0)
        if has_changed(sim, int_at(o, ROW_A)) and not has_yielded(sim, int_at(o, ROW_PAIR)):
            speed = speed_at(entry(sim, AT_VELOCITY), r, int_at(o, ROW_A), int_at(o, ROW_B))
            v, clearance = dot(speed, vec_at(r, NORMAL)), float_at(r, CLEARANCE)
            if clearance <= knob(sim, AT_TOUCH) or v > -SLOW_PART * knob(sim, AT_THRESHOLD):
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


@kernel
def sweep_apart(sim: int, give: float) -> bool:
    """Sweeps over the rows of `push_apart`, from the start. Returns whether they settled.

    With `give` above 0 a row's goal is lower by that share of what its own impulse alone would move it.
    """
    gap, count = knob(sim, AT_GAP), how_many(sim, N_ROWS)
    for s in range(entry(sim, AT_COUNT)):
        for i in range(6):
            set_float(velocity_of(entry(sim, AT_SHOVE), free_body(sim, s)), i, 0.0)
    for k in range(count):
        set_float(row(sim, k), PUSH, 0.0)
    for _ in range(SHOVES):
        most = 0.0
        for k in range(count):
            r = row(sim, k)
            if int_at(owner(sim, k), ROW_ON) == 1:
                back = give * float_at(r, MASS_N) * float_at(r, PUSH)
                set_float(r, GOAL, gap - float_at(r, CLEARANCE) - back)
                most = max(most, push_more(sim, entry(sim, AT_SHOVE), k))
        if most <= SETTLED * gap:
            return True
    return False


@kernel
def is_wedged(sim: int) -> bool:
    """Mark the islands that the last sweeps left with an overlap. Returns whether there are any."""
    found = False
    for s in range(entry(sim, AT_COUNT)):
        set_int(kind_of(sim, free_body(sim, s)), WEDGED, 0)
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        if int_at(o, ROW_ON) == 1:
            moved = normal_speed(entry(sim, AT_SHOVE), r, int_at(o, ROW_A), int_at(o, ROW_B))
            if float_at(r, CLEARANCE) + moved < -WEDGE * knob(sim, AT_GAP):
                set_int(kind_of(sim, int_at(kind_of(sim, int_at(o, ROW_A)), ISLAND)), WEDGED, 1)
                found = True
    return found


@kernel
def let_driven_through(sim: int) -> bool:
    """Let go of driven bodies that press on wedged islands: it is they who give way at the frame's end.

    Returns whether there were any.
    """
    found = False
    for k in range(how_many(sim, N_ROWS)):
        o = owner(sim, k)
        island = int_at(kind_of(sim, int_at(o, ROW_A)), ISLAND)
        presses = int_at(o, ROW_ON) == 1 and float_at(row(sim, k), PUSH) > 0.0
        if (
            presses
            and int_at(kind_of(sim, island), WEDGED) == 1
            and int_at(kind_of(sim, int_at(o, ROW_B)), ROLE) == DRIVEN
        ):
            set_int(pair_at(sim, int_at(o, ROW_PAIR)), YIELDED, 1)
            found = True
    for k in range(how_many(sim, N_ROWS)):
        if has_yielded(sim, int_at(owner(sim, k), ROW_PAIR)):
            set_int(owner(sim, k), ROW_ON, 0)
    return found


@kernel
def push_apart(sim: int) -> float:
    """Move changed bodies, the lightest most, so that no row stays below the gap kept; velocities are left alone.

    Corrects what a step's straight-line contact missed of a turning body's path, micrometres, and resolves an overlap
    there was at the start. Clearances of the rows are brought up to date to first order; returns the least of them [m].
    """
    count = how_many(sim, N_ROWS)
    for k in range(count):
        o, r = owner(sim, k), row(sim, k)
        on = has_changed(sim, int_at(o, ROW_A)) and not has_yielded(sim, int_at(o, ROW_PAIR))
        set_int(o, ROW_ON, 1 if on else 0)
        set_float(r, LIMIT, math.inf)
    if not sweep_apart(sim, 0.0):
        sweep_apart(sim, GIVE)
        if is_wedged(sim) and let_driven_through(sim) and not sweep_apart(sim, 0.0):
            sweep_apart(sim, GIVE)
    least = math.inf
    for k in range(count):
        o, r = owner(sim, k), row(sim, k)
        if int_at(o, ROW_ON) == 1:
            moved = normal_speed(entry(sim, AT_SHOVE), r, int_at(o, ROW_A), int_at(o, ROW_B))
            set_float(r, CLEARANCE, float_at(r, CLEARANCE) + moved)
            least = min(least, float_at(r, CLEARANCE))
            set_float(r, PUSH, 0.0)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if has_changed(sim, body):
            m, shove = motion_of(sim, body), velocity_of(entry(sim, AT_SHOVE), body)
            add_vec(m, POINT, vec_at(shove, 0), 1.0)
            turn = vec_at(shove, 3)
            if turn[0] != 0.0 or turn[1] != 0.0 or turn[2] != 0.0:
                set_quat(m, TURN, quat_unit(quat_mul(quat_from_rotation_vector(turn), quat_at(m, TURN))))
                refresh(m)
    return least
