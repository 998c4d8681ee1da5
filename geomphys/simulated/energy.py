"""Energy of islands: contact with fixed bodies never increases it.

Contact forces are constant over a step, so on a body that wobbles they lag and do a little work where they should do
none; so do a solve that has not fully converged and the clearance of micrometres between surfaces. The energy that a step
added is removed from the velocities of the bodies that touched something in it, in the same proportion for all of an
island, so that energy only rises by the work of driven and moving bodies. Bodies without contact, and islands without
contact with a fixed body, whose momentum must be conserved, are not changed.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import dot, scale
from geomphys.simulated.sleeping import is_moving
from geomphys.simulated.state import Motion, Simulation, is_simulated

NOTHING, STILL, MOVING = 0, 1, 2  # contacts of an island


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
    """Store the energies of all simulated bodies, whose base times are the present one, and clear what they touched."""
    for s in range(len(sim.free)):
        body = sim.free[s]
        sim.energy[body].before = energy(sim, body)
        sim.bodies[body].touched = 0


@kernel
def note_new_energies(sim: Simulation) -> None:
    """Store the energies anew in islands with a body that the caller has just placed.

    It may have overlapped another slightly and been moved out of it.
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
    """Sum the energy that islands have gained since `note_energies`, and mark what they touch."""
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


@noinline
def take_excess(sim: Simulation) -> None:
    """Scale the velocities of bodies in contact, in islands that touch fixed bodies and no driven or moving ones, to the
    energy that `note_energies` stored.
    """
    add_up(sim)
    for s in range(len(sim.free)):
        body = sim.free[s]
        island, m = sim.energy[sim.bodies[body].island], sim.motion[body]
        excess, moving = island.excess, island.kinetic
        if sim.bodies[body].touched == 0 or island.support != STILL:
            continue
        if excess > 0.0 and moving > 0.0:
            factor = math.sqrt(max(0.0, 1.0 - excess / moving))
            set_vec(m.velocity, scale(vec_of(m.velocity), factor))
            set_vec(m.angular_momentum, scale(vec_of(m.angular_momentum), factor))
            set_vec(m.angular_velocity, scale(vec_of(m.angular_velocity), factor))
