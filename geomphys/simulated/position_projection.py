"""Surfaces that overlap are moved apart; what touches may go on touching.

Nothing but the poses changes. Where there is no room for all, what overlap must be is shared out, and driven bodies that
press are let through: they give way at the frame's end.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import quat_from_rotation_vector, quat_mul, quat_unit
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.cells import (
    add_vec,
    quat_at,
    set_quat,
    set_vec,
    vec_at,
)
from geomphys.simulated.contact_points import normal_speed
from geomphys.simulated.driven_targets import meets_driven
from geomphys.simulated.impulses import let_go, push_more
from geomphys.simulated.motion import refresh
from geomphys.simulated.state import (
    AT_COUNT,
    AT_GAP,
    AT_SHOVE,
    CLEARANCE,
    GOAL,
    ISLAND,
    LIMIT,
    MASS_N,
    N_ROWS,
    POINT,
    PUSH,
    ROLE,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    TURN,
    WEDGED,
    YIELDED,
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

SHOVES = 200
SETTLED = 1e-3  # of the gap kept: the moving apart ends when no sweep changes a distance by more
WEDGE = 3.0  # gaps: what is left overlapping by more had no room
TOUCHING = (
    0.75  # gaps: surfaces that overlap by no more only touch: the last digit of whoever wrote down where they are
)
CLEAR = 0.05  # gaps: what overlaps by more is moved so far apart; a move that gains less is none
GIVE = 0.02  # where there is no room: share by which rows give in to what pushes back, so that overlap is shared out


@kernel
def is_short(sim: int, k: int) -> bool:
    """Whether the surfaces of row k are too near each other to stay so.

    Things of the scene may touch, as whoever wrote it placed them: to lift one off the other would take energy from
    nowhere. Driven bodies are kept a gap away: they are to find no overlap, and it is theirs to pay.
    """
    return float_at(row(sim, k), CLEARANCE) < (0.5 if meets_driven(sim, k) else -TOUCHING) * knob(sim, AT_GAP)


@kernel
def any_short(sim: int) -> bool:
    """Whether any row of a changed body is short."""
    for k in range(how_many(sim, N_ROWS)):  # noqa: SIM110
        if has_changed(sim, int_at(owner(sim, k), ROW_A)) and is_short(sim, k):
            return True
    return False


@kernel
def distance_to_keep(sim: int, k: int) -> float:
    """Clearance that the surfaces of row k must have after the moving apart [m]."""
    gap, clearance = knob(sim, AT_GAP), float_at(row(sim, k), CLEARANCE)
    if meets_driven(sim, k):
        return gap
    return CLEAR * gap if is_short(sim, k) else min(gap, clearance)


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
                set_float(r, GOAL, distance_to_keep(sim, k) - float_at(r, CLEARANCE) - back)
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
    let_go(sim)
    return found


@kernel
def stay_if_useless(sim: int) -> None:
    """Take back the displacements of islands in which the last sweeps gave nothing more room.

    What is squeezed would else be moved to and fro for ever.
    """
    count = how_many(sim, N_ROWS)
    for s in range(entry(sim, AT_COUNT)):
        island = free_body(sim, s)
        if int_at(kind_of(sim, island), ISLAND) != island:
            continue
        before, after = math.inf, math.inf
        for k in range(count):
            o, r = owner(sim, k), row(sim, k)
            if int_at(o, ROW_ON) == 1 and int_at(kind_of(sim, int_at(o, ROW_A)), ISLAND) == island:
                moved = normal_speed(entry(sim, AT_SHOVE), r, int_at(o, ROW_A), int_at(o, ROW_B))
                before = min(before, float_at(r, CLEARANCE))
                after = min(after, float_at(r, CLEARANCE) + moved)
        if after < before + CLEAR * knob(sim, AT_GAP):
            for i in range(entry(sim, AT_COUNT)):
                if int_at(kind_of(sim, free_body(sim, i)), ISLAND) == island:
                    shove = velocity_of(entry(sim, AT_SHOVE), free_body(sim, i))
                    set_vec(shove, 0, (0.0, 0.0, 0.0))
                    set_vec(shove, 3, (0.0, 0.0, 0.0))


@kernel
def push_apart(sim: int) -> float:
    """Move changed bodies, the lightest most, so that no row stays short; velocities are left alone.

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
        stay_if_useless(sim)
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
