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

NOTHING, STILL, MOVING = range(3)


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
    """Store the energies of the changed bodies, whose base times are the present one, and clear what they touched."""
    for s in range(sim.counts.changed):
        body = sim.changed[s]
        sim.energy[body] = energy(sim, body)
        sim.bodies[body].touched = 0


@kernel
def note_new_energies(sim: Simulation) -> None:
    """Store the energies of the changed bodies, all of an island, anew if the caller has just placed one of them.

    It may have overlapped another slightly and been moved out of it.
    """
    any_fresh = False
    for s in range(sim.counts.changed):
        any_fresh = any_fresh or sim.bodies[sim.changed[s]].fresh == 1
    if any_fresh:
        for s in range(sim.counts.changed):
            sim.energy[sim.changed[s]] = energy(sim, sim.changed[s])


@kernel
def support_of(sim: Simulation) -> int:
    """What an island touches, whose awake bodies are the changed ones."""
    support = NOTHING
    for i in range(sim.counts.concerned):
        p = sim.pairs[sim.concerned[i]]
        b = p.body[1]
        if is_simulated(sim, b):
            continue
        if is_moving(sim, b):
            return MOVING
        if p.point_count > 0:
            support = STILL
    return support


@noinline
def take_excess(sim: Simulation) -> None:
    """Scale the velocities of the changed bodies in contact, an island's, if it touches fixed bodies and no driven or moving
    ones, to the energy that `note_energies` stored.
    """
    excess, moving = 0.0, 0.0
    for s in range(sim.counts.changed):
        body = sim.changed[s]
        if sim.bodies[body].touched == 1:
            excess += energy(sim, body) - sim.energy[body]
            moving += kinetic(sim.motion[body])
    if excess <= 0.0 or moving <= 0.0 or support_of(sim) != STILL:
        return
    factor = math.sqrt(max(0.0, 1.0 - excess / moving))
    for s in range(sim.counts.changed):
        m = sim.motion[sim.changed[s]]
        if sim.bodies[sim.changed[s]].touched == 1:
            set_vec(m.velocity, scale(vec_of(m.velocity), factor))
            set_vec(m.angular_momentum, scale(vec_of(m.angular_momentum), factor))
            set_vec(m.angular_velocity, scale(vec_of(m.angular_velocity), factor))
