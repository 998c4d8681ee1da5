"""The energy of islands: contact with things that stand still never adds to it.

Contact forces are constant over a step, so on a body that wobbles they lag behind, and do a little work where they
should do none; so do a solution that has not quite settled and the micrometres by which surfaces are kept apart. What
a step has added is taken off the motion of the bodies that touched something in it, all of an island's in the same
proportion, so that energy never rises but by what driven and moving bodies put in. Bodies that touch nothing, and
islands that touch nothing still, whose momentum must stay, are left alone.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import dot, scale
from geomphys.simulated.cells import set_vec, vec_at
from geomphys.simulated.sleeping import stirs
from geomphys.simulated.state import (
    AT_COUNT,
    AT_ENERGY,
    BODY_A,
    BODY_B,
    FRESH,
    GRAVITY,
    ISLAND,
    MASS,
    MOMENTUM,
    N_PAIRS,
    POINT,
    POINTS,
    SPEED,
    SPIN,
    TOUCHED,
    entry,
    free_body,
    how_many,
    is_simulated,
    kind_of,
    motion_of,
    pair_at,
)

BEFORE = 0  # J: of a body, at the step's start
EXCESS = 1  # J: what the bodies of an island that touched something have gained
MOVING = 2  # J: their kinetic energy
SUPPORT = 3  # what the island touches: one of the following
NOTHING, STILL, STIRRED = 0.0, 1.0, 2.0


@kernel
def energy_of(sim: int, body: int) -> int:
    """Row of `energy`."""
    return entry(sim, AT_ENERGY) + 32 * body


@kernel
def island_of(sim: int, body: int) -> int:
    """Row of `energy` that stands for a simulated body's island."""
    return energy_of(sim, int_at(kind_of(sim, body), ISLAND))


@kernel
def kinetic(m: int) -> float:
    """½ m v² + ½ ω·L of a simulated body [J]; `m` is its row of `motion`."""
    v = vec_at(m, SPEED)
    return 0.5 * float_at(m, MASS) * dot(v, v) + 0.5 * dot(vec_at(m, SPIN), vec_at(m, MOMENTUM))


@kernel
def energy(sim: int, body: int) -> float:
    """Kinetic and potential energy of a simulated body [J]."""
    m = motion_of(sim, body)
    return kinetic(m) - float_at(m, MASS) * dot(vec_at(sim, GRAVITY), vec_at(m, POINT))


@kernel
def note_energies(sim: int) -> None:
    """Note the energies of all simulated bodies, whose bases stand at the present time; none has touched anything yet."""
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        set_float(energy_of(sim, body), BEFORE, energy(sim, body))
        set_int(kind_of(sim, body), TOUCHED, 0)


@kernel
def note_fresh_energies(sim: int) -> None:
    """Note the energies anew in islands with a body that the caller has just put where it stands.

    It may have been somewhat inside another, and has been lifted out of that.
    """
    for s in range(entry(sim, AT_COUNT)):
        set_float(island_of(sim, free_body(sim, s)), EXCESS, 0.0)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if int_at(kind_of(sim, body), FRESH) == 1:
            set_float(island_of(sim, body), EXCESS, 1.0)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if float_at(island_of(sim, body), EXCESS) == 1.0:
            set_float(energy_of(sim, body), BEFORE, energy(sim, body))


@kernel
def add_up(sim: int) -> None:
    """Add up what the islands have gained since `note_energies`, and note what they touch."""
    for s in range(entry(sim, AT_COUNT)):
        island = island_of(sim, free_body(sim, s))
        for i in range(3):
            set_float(island, EXCESS + i, 0.0)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        island, kind = island_of(sim, body), kind_of(sim, body)
        if int_at(kind, TOUCHED) == 1:
            gain = energy(sim, body) - float_at(energy_of(sim, body), BEFORE)
            set_float(island, EXCESS, float_at(island, EXCESS) + gain)
            set_float(island, MOVING, float_at(island, MOVING) + kinetic(motion_of(sim, body)))
    for k in range(how_many(sim, N_PAIRS)):
        p = pair_at(sim, k)
        island, b = island_of(sim, int_at(p, BODY_A)), int_at(p, BODY_B)
        if is_simulated(sim, b):
            continue
        if stirs(sim, b):
            set_float(island, SUPPORT, STIRRED)
        elif int_at(p, POINTS) > 0 and float_at(island, SUPPORT) == NOTHING:
            set_float(island, SUPPORT, STILL)


@kernel
def take_excess(sim: int) -> None:
    """Slow down what touched something, in islands that touch still things and none that move by themselves, to the
    energy `note_energies` found.
    """
    add_up(sim)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        island, m = island_of(sim, body), motion_of(sim, body)
        excess, moving = float_at(island, EXCESS), float_at(island, MOVING)
        if int_at(kind_of(sim, body), TOUCHED) == 0 or float_at(island, SUPPORT) != STILL:
            continue
        if excess > 0.0 and moving > 0.0:
            share = math.sqrt(max(0.0, 1.0 - excess / moving))
            set_vec(m, SPEED, scale(vec_at(m, SPEED), share))
            set_vec(m, MOMENTUM, scale(vec_at(m, MOMENTUM), share))
            set_vec(m, SPIN, scale(vec_at(m, SPIN), share))
