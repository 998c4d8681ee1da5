"""Bodies at rest that nothing moving is near are left out of the loop until that changes.

An island sleeps when all its bodies have been at rest for `REST_TIME`: no point of them has gone farther than
`REST_WAY` from where it was, which is less than would be seen in an hour, whatever it trembles by. Asleep, a body keeps
its pose bit for bit.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import norm, sub
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.cells import add_vec, quat_at, set_quat, set_vec, vec_at
from geomphys.simulated.state import (
    ARM,
    AT_COUNT,
    AT_DT,
    AT_TOLD,
    AWAKE,
    AXIS,
    BEND,
    BODY_A,
    BODY_B,
    FORCE,
    ISLAND,
    ISLAND_AWAKE,
    MOMENTUM,
    MOVES,
    N_PAIRS,
    POINT,
    POINTS,
    PULL,
    QUIET,
    RATE,
    REST_POSE,
    ROLE,
    SPEED,
    SPIN,
    SUM_N,
    SUM_T,
    SUM_V,
    TORQUE,
    TURN,
    entry,
    free_body,
    how_many,
    is_simulated,
    kept_at,
    kind_of,
    knob,
    motion_of,
    pair_at,
    slot_at,
    velocity_of,
)

REST_TIME = 0.25  # s
REST_WAY = 4e-9  # m
REST_SPEED = 1e-6  # m/s, of any point
REST_PULL = 1e-3  # m/s²


@kernel
def note_rest(sim: int, m: int, told: int) -> None:
    """Count for how long a simulated body has been at rest at the frame's end, and take what motion is left away.

    `m` is its row of `motion`, `told` that of the velocities for the caller.
    """
    fastest = norm(vec_at(m, SPEED)) + norm(vec_at(m, SPIN)) * float_at(m, ARM)
    square = 0.0
    for i in range(4):
        change = float_at(m, TURN + i) - float_at(m, REST_POSE + 3 + i)
        square += change * change
    way = norm(sub(vec_at(m, POINT), vec_at(m, REST_POSE))) + 2.0 * math.sqrt(square) * float_at(m, ARM)
    if way < REST_WAY and fastest < REST_SPEED and norm(vec_at(m, PULL)) < REST_PULL:
        set_float(m, QUIET, float_at(m, QUIET) + knob(sim, AT_DT))
    else:
        set_float(m, QUIET, 0.0)
        set_vec(m, REST_POSE, vec_at(m, POINT))
        set_quat(m, REST_POSE + 3, quat_at(m, TURN))
    if float_at(m, QUIET) >= REST_TIME:
        set_vec(told, 0, (0.0, 0.0, 0.0))
        set_vec(told, 3, (0.0, 0.0, 0.0))


@kernel
def stirs(sim: int, body: int) -> bool:
    """Whether a body that is not simulated moves in this frame, or wants to."""
    if int_at(kind_of(sim, body), MOVES) == 0:
        return False
    m = motion_of(sim, body)
    moving = norm(vec_at(m, SPEED)) > 0.0 or norm(vec_at(m, RATE)) > 0.0
    moving = moving or norm(vec_at(m, PULL)) > 0.0 or norm(vec_at(m, BEND)) > 0.0
    if int_at(kind_of(sim, body), ROLE) == DRIVEN:
        told = velocity_of(entry(sim, AT_TOLD), body)
        moving = moving or norm(vec_at(told, 0)) > 0.0 or norm(vec_at(told, 3)) > 0.0
    return moving


@kernel
def wake_island(sim: int, body: int) -> None:
    """Let the island of a body be awake."""
    set_int(kind_of(sim, int_at(kind_of(sim, body), ISLAND)), ISLAND_AWAKE, 1)


@kernel
def lay_to_rest(sim: int, body: int) -> None:
    """Take all motion out of a body."""
    m, nothing = motion_of(sim, body), (0.0, 0.0, 0.0)
    set_vec(m, SPEED, nothing)
    set_vec(m, PULL, nothing)
    set_vec(m, RATE, nothing)
    set_vec(m, BEND, nothing)
    set_vec(m, MOMENTUM, nothing)
    set_vec(m, TORQUE, nothing)
    set_vec(m, SPIN, nothing)


@kernel
def wake(sim: int, first: bool) -> bool:
    """Decide which bodies are awake, from the pairs just found.

    `first` says that the frame begins; in its course none falls asleep. Returns whether any is awake.
    """
    for s in range(entry(sim, AT_COUNT)):
        set_int(kind_of(sim, free_body(sim, s)), ISLAND_AWAKE, 0)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if float_at(motion_of(sim, body), QUIET) < REST_TIME or (not first and int_at(kind_of(sim, body), AWAKE) == 1):
            wake_island(sim, body)
    for k in range(how_many(sim, N_PAIRS)):
        b = int_at(pair_at(sim, k), BODY_B)
        if not is_simulated(sim, b) and stirs(sim, b):
            wake_island(sim, int_at(pair_at(sim, k), BODY_A))
    any_awake = False
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        awake = int_at(kind_of(sim, int_at(kind_of(sim, body), ISLAND)), ISLAND_AWAKE)
        set_int(kind_of(sim, body), AWAKE, awake)
        any_awake = any_awake or awake == 1
        if awake == 0:
            lay_to_rest(sim, body)
    if first:
        sum_sleeping_forces(sim)
    return any_awake


@kernel
def sum_sleeping_forces(sim: int) -> None:
    """Contact forces of sleeping bodies go on: add what they do in the frame to its sums."""
    dt = knob(sim, AT_DT)
    for k in range(how_many(sim, N_PAIRS)):
        if int_at(kind_of(sim, int_at(pair_at(sim, k), BODY_A)), AWAKE) == 0:
            for m in range(int_at(pair_at(sim, k), POINTS)):
                slot = slot_at(sim, k, m)
                set_float(slot, SUM_N, float_at(slot, SUM_N) + dt * float_at(slot, FORCE))
                add_vec(slot, SUM_T, vec_at(slot, FORCE + 1), dt)
                add_vec(slot, SUM_V, vec_at(kept_at(sim, k), AXIS), dt * float_at(slot, FORCE))
