"""Moves bodies at the end of a step out of what they overlap: first by all contact points together, then pair by pair."""

from __future__ import annotations

import math

from geomphys.collision.penetration import separation
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec, set_vec, vec_of
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.contact_points import add_contacts, clear_impulse
from geomphys.simulated.position_projection import project_positions
from geomphys.simulated.state import Simulation, has_changed, is_simulated
from geomphys.simulated.time_of_impact import pose_pair

CLEARING_ROUNDS = 4  # pair by pair, after one of all pairs together


@kernel
def depth_inside(sim: Simulation, k: int, t: float) -> float:
    """Depth of the changed body of pair k in a body that is not driven, at time `t` of the frame [m]; below 0: none."""
    p = sim.pairs[k]
    if not has_changed(sim, p.body[0]) or p.point_count == 0 or sim.bodies[p.body[1]].role == DRIVEN:
        return -math.inf
    pose_pair(sim, k, t)
    found = separation(sim.pieces, sim.frames, p.piece[0], p.piece[1], 0.0, vec_of(p.axis), sim.scratch)
    set_vec(p.axis, found[1])
    return -float(found[0])


@kernel
def deepest_inside(sim: Simulation, t: float) -> float:
    """The largest `depth_inside` of the pairs of changed bodies [m]."""
    deepest = -math.inf
    for i in range(sim.counts.concerned):
        deepest = max(deepest, depth_inside(sim, sim.concerned[i], t))
    return deepest


@kernel
def clear_together(sim: Simulation, t: float, tolerance: float) -> None:
    """Move changed bodies out of overlaps deeper than `tolerance` [m], by the contact points of all pairs together."""
    sim.counts.contacts = 0
    for i in range(sim.counts.concerned):
        k = sim.concerned[i]
        if has_changed(sim, sim.pairs[k].body[0]):
            add_contacts(sim, k, t)
    project_positions(sim, tolerance)
    for k in range(sim.counts.contacts):
        clear_impulse(sim.contacts[k])
    sim.counts.contacts = 0


@kernel
def clear_pair_by_pair(sim: Simulation, t: float, tolerance: float) -> float:
    """Move the bodies of each pair apart that overlaps deeper than `tolerance` [m]; returns how deep the deepest did [m]."""
    deepest = -math.inf
    for i in range(sim.counts.concerned):
        k = sim.concerned[i]
        depth = depth_inside(sim, k, t)
        deepest = max(deepest, depth)
        if depth > tolerance:
            p = sim.pairs[k]
            a, b = sim.motion[p.body[0]], sim.motion[p.body[1]]
            part_of_a = a.inverse_mass / (a.inverse_mass + b.inverse_mass)
            add_vec(a.position, vec_of(p.axis), part_of_a * (depth + tolerance))
            a.travelled += depth + tolerance
            if is_simulated(sim, p.body[1]):
                add_vec(b.position, vec_of(p.axis), (part_of_a - 1.0) * (depth + tolerance))
                b.travelled += depth + tolerance
    return deepest


@noinline
def clear_overlaps(sim: Simulation, t: float, tolerance: float) -> None:
    """Move the changed bodies out of overlaps of more than `tolerance` [m] with what is not driven, at time `t` of the step.

    Removes the error of unfinished sweeps and of the step, micrometres; velocities do not change. First by all contact
    points, then pair by pair: contact points of a curved surface need not be its deepest. Driven links, which must be posed at
    `t`, are moved afterwards out of what moved into them.
    """
    if deepest_inside(sim, t) <= tolerance:
        return
    clear_together(sim, t, tolerance)
    for _ in range(CLEARING_ROUNDS):
        if clear_pair_by_pair(sim, t, tolerance) <= tolerance:
            return
