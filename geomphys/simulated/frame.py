"""Beginning and end of a frame: from the poses and velocities the caller gives to motions, and back."""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import (
    add,
    quat_mul,
    quat_rotate,
    sub,
)
from geomphys.simulated.cells import quat_at, set_quat, set_vec, vec_at
from geomphys.simulated.driven_paths import lay_courses
from geomphys.simulated.integrate import angular_momentum
from geomphys.simulated.motion import refresh
from geomphys.simulated.sleeping import REST_TIME, note_rest
from geomphys.simulated.state import (
    AT_COUNT,
    AT_RECOIL,
    AT_TOLD,
    AT_TREE_COUNT,
    AWAKE,
    BASE,
    CHANGED,
    EVENTS,
    FRESH,
    GRASP,
    GRAVITY,
    INERTIA,
    LAST_POSE,
    MOMENTUM,
    N_LOST,
    N_PAIRS,
    N_ROWS,
    OFFSET,
    POINT,
    PRINCIPAL,
    PULL,
    QUIET,
    SET_ASIDE,
    SPEED,
    SPIN,
    SUM_N,
    TOLD,
    TORQUE,
    TURN,
    YIELDED,
    end_of,
    entry,
    free_body,
    how_many,
    kind_of,
    motion_of,
    pair_at,
    set_how_many,
    slot_at,
    start_of,
    velocity_of,
)

QUARANTINED = 64


@kernel
def set_free(sim: int, body: int) -> None:
    """Motion of a simulated body at the frame's start, from its pose and the velocity told.

    The angular momentum is kept from the frame before unless the caller changed the angular velocity meanwhile.
    """
    m, told, start = motion_of(sim, body), velocity_of(entry(sim, AT_TOLD), body), start_of(sim, body)
    q = quat_at(start, 3)
    set_float(m, BASE, 0.0)
    set_vec(m, POINT, add(vec_at(start, 0), quat_rotate(q, vec_at(m, OFFSET))))
    set_quat(m, TURN, q)
    set_vec(m, SPEED, vec_at(told, 0))
    set_vec(m, PULL, vec_at(sim, GRAVITY))
    set_vec(m, TORQUE, (0.0, 0.0, 0.0))
    spin = vec_at(told, 3)
    if spin != vec_at(m, TOLD) or spin == (0.0, 0.0, 0.0):
        set_vec(m, MOMENTUM, angular_momentum(quat_mul(q, quat_at(m, PRINCIPAL)), vec_at(m, INERTIA), spin))
    refresh(m)
    same = True
    for i in range(7):
        same = same and float_at(start, i) == float_at(m, LAST_POSE + i)
    set_int(kind_of(sim, body), FRESH, 0 if same else 1)
    still = same and spin == (0.0, 0.0, 0.0) and vec_at(told, 0) == (0.0, 0.0, 0.0)
    if not still and float_at(m, QUIET) >= REST_TIME:
        set_float(m, QUIET, 0.0)


@kernel
def begin(sim: int, goes_on: bool) -> None:
    """Set up the motions of simulated bodies, and clear the sums of the frame before, unless it `goes_on`."""
    for s in range(entry(sim, AT_COUNT)):
        set_free(sim, free_body(sim, s))
    lay_courses(sim)
    for i in range(3 * entry(sim, AT_TREE_COUNT)):
        set_float(entry(sim, AT_RECOIL), i, 0.0)
    set_how_many(sim, N_ROWS, 0)
    set_how_many(sim, N_LOST, 0)
    for k in range(how_many(sim, N_PAIRS)):
        set_int(pair_at(sim, k), EVENTS, 0)
        set_int(pair_at(sim, k), YIELDED, 0)
        for m in range(4):
            if not goes_on:
                for i in range(7):
                    set_float(slot_at(sim, k, m), SUM_N + i, 0.0)
            set_float(slot_at(sim, k, m), GRASP, 0.0)


@kernel
def mark_all(sim: int) -> None:
    """Let all simulated bodies that are awake count as changed."""
    for s in range(entry(sim, AT_COUNT)):
        kind = kind_of(sim, free_body(sim, s))
        set_int(kind, CHANGED, int_at(kind, AWAKE))


@kernel
def put_back(sim: int, body: int) -> None:
    """Put a simulated body back to its pose at the frame's start, at rest; the pose it had is set aside."""
    m = motion_of(sim, body)
    set_vec(m, SET_ASIDE, vec_at(m, POINT))
    set_quat(m, SET_ASIDE + 3, quat_at(m, TURN))
    q = quat_at(start_of(sim, body), 3)
    set_vec(m, POINT, add(vec_at(start_of(sim, body), 0), quat_rotate(q, vec_at(m, OFFSET))))
    set_quat(m, TURN, q)
    set_vec(m, SPEED, (0.0, 0.0, 0.0))
    set_vec(m, MOMENTUM, (0.0, 0.0, 0.0))
    refresh(m)


@kernel
def undo_put_back(sim: int, body: int) -> None:
    """Return a body to the pose set aside by `put_back`; it stays at rest."""
    m = motion_of(sim, body)
    set_vec(m, POINT, vec_at(m, SET_ASIDE))
    set_quat(m, TURN, quat_at(m, SET_ASIDE + 3))
    refresh(m)


@kernel
def is_finite(row: int, first: int, count: int) -> bool:
    """Whether consecutive numbers of a row are all finite."""
    for i in range(first, first + count):  # noqa: SIM110
        if not math.isfinite(float_at(row, i)):
            return False
    return True


@kernel
def finish(sim: int) -> int:
    """Write the end poses and velocities of the simulated bodies.

    One that is not finite goes back to where it was, at rest; returns `QUARANTINED` if there is one, else 0.
    """
    flags = 0
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        m, told = motion_of(sim, body), velocity_of(entry(sim, AT_TOLD), body)
        pose, before = end_of(sim, body), start_of(sim, body)
        q = quat_at(m, TURN)
        set_vec(pose, 0, sub(vec_at(m, POINT), quat_rotate(q, vec_at(m, OFFSET))))
        set_quat(pose, 3, q)
        set_vec(told, 0, vec_at(m, SPEED))
        set_vec(told, 3, vec_at(m, SPIN))
        broken = not (is_finite(pose, 0, 7) and is_finite(told, 0, 6))
        if broken or int_at(kind_of(sim, body), AWAKE) == 0:
            for i in range(7):
                set_float(pose, i, float_at(before, i))
            for i in range(6):
                set_float(told, i, 0.0)
        if broken:
            flags = QUARANTINED
        note_rest(sim, m, told)
        set_vec(m, TOLD, vec_at(told, 3))
        for i in range(7):
            set_float(m, LAST_POSE + i, float_at(pose, i))
    return flags
