"""Impacts of driven and simulated bodies: impulses with the real masses, and the time of the next one."""

from __future__ import annotations

import math

from geomphys.engine.coupled_impulses import add_responses, relative_velocity, set_inequality_response
from geomphys.engine.coupled_solve import IMPACT_PRECISION, IMPACT_STEPS, solve_contacts
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import begin_impact, end_impact, end_unknown, first_unknown, solves
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec_from, vec_of
from geomphys.numerics.vec3 import dot
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.simulated.contact_points import clear_impulse, fill_masses
from geomphys.simulated.impulse_accumulation import commit
from geomphys.simulated.motion import refresh
from geomphys.simulated.state import ACTIVE, IMPACTING, INACTIVE, Contact, Simulation, is_coupled, is_simulated

MIN_SPLIT = 1e-5  # s
LEFT_OUT = -1e3  # m/s: target of a contact that does not act


@kernel
def load_coupled(sim: Simulation) -> None:
    """Write the velocities of the simulated bodies that take part to `velocity` of the simulation."""
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):
            set_vec_from(sim.velocity[body], 0, vec_of(sim.motion[body].velocity))
            set_vec_from(sim.velocity[body], 3, vec_of(sim.motion[body].angular_velocity))


@kernel
def was_touching(sim: Simulation, r: Contact) -> bool:
    """Whether the pair of a contact was in contact in the step before."""
    return bool(sim.pairs[r.pair].touching == 1)


@noinline
def resolve_impacts(scene: Scene, data: ReplayData) -> int:
    """Impulses at contacts that touch and approach faster than the threshold, with restitution if new.

    They are solved together and count as one impact: returns 1, or 0 where there are none.
    """
    sim, c = data.simulated, data.coupled
    load_coupled(sim)
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            begin_impact(c, 3 * tree, 3 * tree + 3)
            begin_impact(c, first_unknown(scene, tree), end_unknown(scene, tree))
    threshold, any_hit = sim.frame.restitution_threshold, False
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        touches = r.clearance <= sim.frame.touch
        r.mode = ACTIVE if touches else INACTIVE
        r.target_speed = 0.0
        v = relative_velocity(sim, c, r)[0]
        if touches and v < -threshold:
            any_hit = True
            if not was_touching(sim, r):
                r.target_speed = -r.restitution * v
    if not any_hit:
        return 0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        clear_impulse(r)
        r.tangent_target[0] = r.tangent_target[1] = 0.0
        fill_masses(sim.motion[r.a], sim.motion[r.b], r)
        add_responses(sim, c, r)
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        set_inequality_response(c, k)
        g.impulse = 0.0
        g.target_speed = 0.0 if g.clearance <= sim.frame.touch else LEFT_OUT
    solve_contacts(sim, c, IMPACT_STEPS, IMPACT_PRECISION, IMPACT_PRECISION)
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            end_impact(c, 3 * tree, 3 * tree + 3)
            end_impact(c, first_unknown(scene, tree), end_unknown(scene, tree))
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.normal_impulse > 0.0 and sim.bodies[r.b].role == DRIVEN:
            c.trees[sim.bodies[r.b].tree].touched = 1
    commit(sim)
    for s in range(len(sim.free)):
        if is_coupled(sim, sim.free[s]):
            refresh(sim.motion[sim.free[s]])
    load_coupled(sim)
    return 1


@kernel
def next_impact(sim: Simulation, c: Coupled, h: float) -> float:
    """Time until the first fast approaching contact touches, if within `h` seconds; else `h`. Marks them as IMPACTING."""
    soonest, gap = h, sim.frame.gap
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        r.mode = ACTIVE
        distance = r.clearance - gap
        if distance > 0.5 * sim.frame.touch:
            v = relative_velocity(sim, c, r)[0]
            if v < -sim.frame.restitution_threshold:
                r.mode = IMPACTING
                fall = 0.0 if is_simulated(sim, r.b) else dot(vec_of(r.normal), vec_of(sim.gravity))
                soonest = min(soonest, 2.0 * distance / (-v + math.sqrt(max(0.0, v * v - 2.0 * fall * distance))))
    return soonest if soonest > MIN_SPLIT else h
