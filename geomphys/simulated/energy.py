"""The energy of islands: contact with things that stand still never adds to it.

Contact forces are constant over a step, so on a body that wobbles they lag behind, and do a little work where they
should do none; so do a solution that has not quite settled and the micrometres by which surfaces are kept apart. What
a step has added is taken off the motion of the bodies that touched something in it, all of an island's in the same
proportion, so that energy never rises but by what driven and moving bodies put in. Bodies that touch nothing, and
islands that touch nothing still, whose momentum must stay, are left alone.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import dot, scale
from geomphys.simulated.sleeping import is_moving
from geomphys.simulated.state import Motion, Simulation, is_simulated

NOTHING, STILL, MOVING = 0, 1, 2  # what an island touches


@kernel
def kinetic(m: Motion) -> float:
    """½ m v² + ½ ω·L of a simulated body [J]; `m` is its record of `motion`."""
    v = vec_of(m.velocity)
    return 0.5 * m.mass * dot(v, v) + 0.5 * dot(vec_of(m.angular_velocity), vec_of(m.angular_momentum))


@kernel
def energy(sim: Simulation, body: int) -> float:
    """Kinetic and potential energy of a simulated body [J]."""
    m = sim.motion[body]
    return kinetic(m) - m.mass * dot(vec_of(sim.gravity), vec_of(m.position))


@kernel
def note_energies(sim: Simulation) -> None:
    """Note the energies of all simulated bodies, whose bases stand at the present time; none has touched anything yet."""
    for s in range(len(sim.free)):
        body = sim.free[s]
        sim.energy[body].before = energy(sim, body)
        sim.bodies[body].touched = 0


@kernel
def note_new_energies(sim: Simulation) -> None:
    """Note the energies anew in islands with a body that the caller has just put where it stands.

    It may have been somewhat inside another, and has been lifted out of that.
    """
    for s in range(len(sim.free)):
        sim.energy[sim.bodies[sim.free[s]].island].excess = 0.0
    for s in range(len(sim.free)):
        body = sim.free[s]
        if sim.bodies[body].fresh == 1:
            sim.energy[sim.bodies[body].island].excess = 1.0
    for s in range(len(sim.free)):
        body = sim.free[s]
        if sim.energy[sim.bodies[body].island].excess == 1.0:
            sim.energy[body].before = energy(sim, body)


@kernel
def add_up(sim: Simulation) -> None:
    """Add up what the islands have gained since `note_energies`, and note what they touch."""
    for s in range(len(sim.free)):
        island = sim.energy[sim.bodies[sim.free[s]].island]
        island.excess, island.kinetic, island.support = 0.0, 0.0, NOTHING
    for s in range(len(sim.free)):
        body = sim.free[s]
        island, kind = sim.energy[sim.bodies[body].island], sim.bodies[body]
        if kind.touched == 1:
            gain = energy(sim, body) - sim.energy[body].before
            island.excess = island.excess + gain
            island.kinetic = island.kinetic + kinetic(sim.motion[body])
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        island, b = sim.energy[sim.bodies[p.body[0]].island], p.body[1]
        if is_simulated(sim, b):
            continue
        if is_moving(sim, b):
            island.support = MOVING
        elif p.point_count > 0 and island.support == NOTHING:
            island.support = STILL


@outlined
def take_excess(sim: Simulation) -> None:
    """Slow down what touched something, in islands that touch still things and none that move by themselves, to the
    energy `note_energies` found.
    """
    add_up(sim)
    for s in range(len(sim.free)):
        body = sim.free[s]
        island, m = sim.energy[sim.bodies[body].island], sim.motion[body]
        excess, moving = island.excess, island.kinetic
        if sim.bodies[body].touched == 0 or island.support != STILL:
            continue
        if excess > 0.0 and moving > 0.0:
            share = math.sqrt(max(0.0, 1.0 - excess / moving))
            set_vec(m.velocity, scale(vec_of(m.velocity), share))
            set_vec(m.angular_momentum, scale(vec_of(m.angular_momentum), share))
            set_vec(m.angular_velocity, scale(vec_of(m.angular_velocity), share))
