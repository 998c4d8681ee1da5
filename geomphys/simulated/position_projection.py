"""Position projection: moves overlapping surfaces apart, without changing velocities; touching ones may stay so.

Where not all can be free of overlap, it is distributed.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec, quat_of, set_quat, set_vec_from, vec_from
from geomphys.numerics.vec3 import norm, quat_from_rotation_vector, quat_mul, quat_unit
from geomphys.simulated.contact_points import normal_speed
from geomphys.simulated.impulses import solve_normal
from geomphys.simulated.motion import refresh
from geomphys.simulated.state import ACTIVE, INACTIVE, Simulation, is_disabled

PROJECTION_SWEEPS = 200
SETTLED = 1e-3  # of the gap: the sweeps end when none changes a distance by more
TOUCHING = 0.75  # gaps: surfaces that overlap by no more count as touching: rounding of written poses
LEFT = 0.025  # gaps: the same of those solved together with driven bodies
CLEAR = 0.05  # gaps: the clearance given to surfaces that overlap by more; a smaller gain counts as none
GIVE = 0.02  # where not all can be free: regularisation of the contacts, which distributes the overlap


@kernel
def is_short(sim: Simulation, k: int, tolerance: float) -> bool:
    """Whether the clearance of contact k has to grow, as it overlaps by more than `tolerance` [m].

    Bodies that the scene file places in contact may stay so: lifting one off the other would add energy.
    """
    return bool(sim.contacts[k].clearance < -tolerance)


@kernel
def any_short(sim: Simulation, tolerance: float) -> bool:
    """Whether any contact of a changed body has to grow."""
    for k in range(sim.counts.contacts):  # noqa: SIM110
        if is_short(sim, k, tolerance):
            return True
    return False


@kernel
def distance_to_keep(sim: Simulation, k: int, tolerance: float) -> float:
    """Clearance that contact k must have after the projection [m]."""
    gap, clearance = sim.frame.gap, sim.contacts[k].clearance
    return CLEAR * gap if is_short(sim, k, tolerance) else min(gap, clearance)


@kernel
def sweep_apart(sim: Simulation, give: float, tolerance: float) -> bool:
    """Sweeps over the contacts of `project_positions`, from zero. Returns whether they converged.

    With `give` above 0 a contact's target is lower by that fraction of the displacement by its own impulse.
    """
    gap, count = sim.frame.gap, sim.counts.contacts
    for s in range(sim.counts.changed):
        for i in range(6):
            sim.displacement[sim.changed[s]][i] = 0.0
    for k in range(count):
        sim.contacts[k].normal_impulse = 0.0
        for i in range(6):  # of a simulated body that has not changed
            sim.displacement[sim.contacts[k].b][i] = 0.0
    for _ in range(PROJECTION_SWEEPS):
        most = 0.0
        for k in range(count):
            r = sim.contacts[k]
            if sim.contacts[k].mode == ACTIVE:
                back = give * r.inverse_mass_n * r.normal_impulse
                r.target_speed = distance_to_keep(sim, k, tolerance) - r.clearance - back
                most = max(most, solve_normal(sim, sim.displacement, k))
        if most <= SETTLED * gap:
            return True
    return False


@kernel
def is_first_of_island(sim: Simulation, s: int) -> bool:
    """Whether none of the changed bodies before number s is of its island."""
    for i in range(s):  # noqa: SIM110 - a kernel cannot take a generator
        if sim.bodies[sim.changed[i]].island == sim.bodies[sim.changed[s]].island:
            return False
    return True


@kernel
def stay_if_useless(sim: Simulation) -> None:
    """Undo the displacements of islands in which the last sweeps increased no clearance.

    Bodies pressed from two sides would otherwise oscillate.
    """
    count = sim.counts.contacts
    for s in range(sim.counts.changed):
        island = sim.bodies[sim.changed[s]].island
        if not is_first_of_island(sim, s):
            continue
        before, after = math.inf, math.inf
        for k in range(count):
            r = sim.contacts[k]
            if r.mode == ACTIVE and sim.bodies[r.a].island == island:
                moved = normal_speed(sim.displacement, r, r.a, r.b)
                before = min(before, r.clearance)
                after = min(after, r.clearance + moved)
        if after < before + CLEAR * sim.frame.gap:
            for i in range(sim.counts.changed):
                if sim.bodies[sim.changed[i]].island == island:
                    displacement = sim.displacement[sim.changed[i]]
                    set_vec_from(displacement, 0, (0.0, 0.0, 0.0))
                    set_vec_from(displacement, 3, (0.0, 0.0, 0.0))


@noinline
def project_positions(sim: Simulation, tolerance: float) -> float:
    """Move changed bodies, the lightest most, out of overlaps deeper than `tolerance` [m]; velocities do not change.

    Corrects the error of a step's linearised contacts on a rotating body, micrometres, and resolves overlap of the first
    frame. Updates the clearances of the contacts to first order; returns the least of them [m].
    """
    count = sim.counts.contacts
    for k in range(count):
        r = sim.contacts[k]
        r.mode = INACTIVE if is_disabled(sim, r.pair) else ACTIVE
        r.impulse_limit = math.inf
    if not sweep_apart(sim, 0.0, tolerance):
        sweep_apart(sim, GIVE, tolerance)
        stay_if_useless(sim)
    least = math.inf
    for k in range(count):
        r = sim.contacts[k]
        if r.mode == ACTIVE:
            moved = normal_speed(sim.displacement, r, r.a, r.b)
            r.clearance = r.clearance + moved
            least = min(least, r.clearance)
            r.normal_impulse = 0.0
    for s in range(sim.counts.changed):
        m, displacement = sim.motion[sim.changed[s]], sim.displacement[sim.changed[s]]
        add_vec(m.position, vec_from(displacement, 0), 1.0)
        rotation = vec_from(displacement, 3)
        m.travelled += norm(vec_from(displacement, 0)) + norm(rotation) * m.reach
        if rotation[0] != 0.0 or rotation[1] != 0.0 or rotation[2] != 0.0:
            set_quat(m.orientation, quat_unit(quat_mul(quat_from_rotation_vector(rotation), quat_of(m.orientation))))
            refresh(m)
    return least
