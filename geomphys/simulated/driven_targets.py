"""Driven bodies as they want to move: with the mass of their coupling, and pushed back by what they hit.

Where a driven body goes in the frame is settled before simulated bodies move: its path. What it wants is another
thing: a hand that a ball holds back stands still and wants to go on. Collisions are with the wish; the recoil is taken
off it at once, off all links of the tree, which move together, and given to the coupling by the caller.
"""

from __future__ import annotations

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import add_vec_at, set_vec_from, vec_at, vec_from, vec_of
from geomphys.numerics.vec3 import Vec, add, cross, quat_rotate, sub
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.contact_points import invert_mass
from geomphys.simulated.motion import load_velocities, turn_at
from geomphys.simulated.state import Simulation, has_changed


@kernel
def wish(sim: Simulation, body: int, t: float) -> Vec:
    """Velocity that a driven body's origin wants to have [m/s], less what recoil has taken."""
    m, told = sim.motion[body], sim.reported[body]
    arm = quat_rotate(turn_at(m, t), vec_of(m.coupling_arm))
    v = sub(vec_from(told, 0), cross(vec_from(told, 3), arm))
    return add(v, vec_at(sim.recoil, sim.bodies[body].tree))


@kernel
def meets_driven(sim: Simulation, k: int) -> bool:
    """Whether row k is one of a changed body with a driven one."""
    r = sim.rows[k]
    return has_changed(sim, r.a) and sim.bodies[r.b].role == DRIVEN


@kernel
def lighten(sim: Simulation, k: int, by: float) -> None:
    """Add an inverse mass [1/kg] to what impulses do at row k."""
    r = sim.rows[k]
    r.inverse_mass_n = r.inverse_mass_n + by
    r.inverse_mass_t[0] = r.inverse_mass_t[0] + by
    r.inverse_mass_t[2] = r.inverse_mass_t[2] + by
    invert_mass(r)


@kernel
def follow_wishes(sim: Simulation, t: float) -> bool:
    """Give the driven bodies that changed bodies touch their mass and the velocities they want at time `t`.

    Returns whether there are any. `follow_paths` undoes it.
    """
    found = False
    for k in range(sim.counts[0].rows):
        if meets_driven(sim, k):
            found = True
            b = sim.rows[k].b
            light = 1.0 / sim.motion[b].mass
            sim.motion[b].inverse_mass = light
            lighten(sim, k, light)
    if found:
        load_wishes(sim, t)
    return found


@kernel
def load_wishes(sim: Simulation, t: float) -> None:
    """Write what the driven bodies that changed bodies touch want to the velocities being solved for."""
    for k in range(sim.counts[0].rows):
        if meets_driven(sim, k):
            b = sim.rows[k].b
            v = sim.velocity[b]
            set_vec_from(v, 0, wish(sim, b, t))
            set_vec_from(v, 3, vec_from(sim.reported[b], 3))


@kernel
def reload(sim: Simulation, t: float, wishes: bool) -> None:
    """Write the velocities that bodies have before what is being solved."""
    load_velocities(sim)
    if wishes:
        load_wishes(sim, t)


@kernel
def is_first_of(sim: Simulation, k: int) -> bool:
    """Whether row k is the first with its body b among those with driven ones."""
    for i in range(k):  # noqa: SIM110
        if meets_driven(sim, i) and sim.rows[i].b == sim.rows[k].b:
            return False
    return True


@kernel
def take_recoil(sim: Simulation, t: float) -> None:
    """Take from the wishes what the velocities being solved for have lost, each body's from those of its whole tree."""
    for k in range(sim.counts[0].rows):
        if meets_driven(sim, k) and is_first_of(sim, k):
            b = sim.rows[k].b
            v = sim.velocity[b]
            set_vec_from(v, 0, sub(vec_from(v, 0), wish(sim, b, t)))
    for k in range(sim.counts[0].rows):
        if meets_driven(sim, k) and is_first_of(sim, k):
            b = sim.rows[k].b
            lost = vec_from(sim.velocity[b], 0)
            add_vec_at(sim.recoil, sim.bodies[b].tree, lost, 1.0)
    load_wishes(sim, t)


@kernel
def follow_paths(sim: Simulation) -> None:
    """Let driven bodies follow their paths again, whatever pushes them."""
    for k in range(sim.counts[0].rows):
        if meets_driven(sim, k):
            b = sim.rows[k].b
            m, v = sim.motion[b], sim.velocity[b]
            lighten(sim, k, -1.0 / m.mass)
            m.inverse_mass = 0.0
            set_vec_from(v, 0, vec_of(m.velocity))
            set_vec_from(v, 3, vec_of(m.rotation_rate))
