"""Resting contact: the contact points of touching bodies solved together.

Below a threshold approach speed nothing bounces. Over a step of h seconds the contact forces are constant; the motion
along the normal that they give, ½ h (v_n⁰ + v_n¹), must leave every point at least the gap apart, normal
forces are >= 0, and friction is in Coulomb's cone: it sticks if it can and else opposes the sliding. As the mean of the
velocities at both ends of the step counts, gravity does exactly its work, a body slides down a slope on the exact
parabola, and the force on a body at rest is exactly its weight.
"""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec_from, set_vec, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, dot, norm, quat_conjugate, quat_mul, quat_rotate, scale, sub
from geomphys.simulated.contact_points import apply_impulses, clear_impulse, fill_masses, normal_speed, speed_at
from geomphys.simulated.contact_solver import solve_contacts
from geomphys.simulated.driven_paths import load_paths
from geomphys.simulated.impulse_accumulation import commit, give_force, impulse_of
from geomphys.simulated.impulses import exclude_disabled
from geomphys.simulated.motion import load_velocities, orientation_at, plan
from geomphys.simulated.state import ACTIVE, INACTIVE, Simulation, has_changed, is_disabled, is_simulated

SWEEPS = 400  # sweeps at most; the rest is small, and the next step starts from there
FEW_SWEEPS = 60  # sweeps at most after an impact within the step
APPROACH = 2e-4  # m/s: touching points that approach no faster are stopped within the step
FAINT = 5e-3  # m/s: points that separate no faster are solved as if they did not
WEIGHT_TIME = 0.01  # s: more than twice the longest step
MAX_SOLVES = 4  # solves of a step; each disables pairs that the next leaves out
ALONG = 0.1  # of the angular velocity of its support: a body that rotates otherwise does not move along with it


@kernel
def set_limits(sim: Simulation) -> None:
    """Bound the normal impulses of bodies with prescribed motion.

    Such a body may press another against a fixed one, where no impulse is enough. The bound is four times what stops the
    whole island's approach and supports its weight.
    """
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        a, b = r.a, r.b
        if is_simulated(sim, b) or sim.bodies[b].moves == 0:
            continue
        v = norm(speed_at(sim.velocity, r, a, b))
        effective_mass = sim.islands[sim.bodies[a].island].mass
        r.impulse_limit = 4.0 * effective_mass * (v + WEIGHT_TIME * sim.frame.weight)


@kernel
def clear_impulses_of_contacts(sim: Simulation) -> None:
    """Set the impulses of the contacts to zero."""
    for k in range(sim.counts.contacts):
        clear_impulse(sim.contacts[k])


@kernel
def disable_squeezed(sim: Simulation) -> bool:
    """Disable pairs whose body with prescribed motion would need more than its bound. Returns whether there were any."""
    any_disabled = False
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.mode == ACTIVE and r.normal_impulse >= 0.999 * r.impulse_limit:
            sim.pairs[r.pair].disabled = 1
            any_disabled = True
    exclude_disabled(sim)
    return any_disabled


@noinline
def stop_slow_approach(sim: Simulation) -> None:
    """Stop the approach at all touching points together, with ε = 0, unless it is slower than `APPROACH`."""
    least = 0.0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        a, b = r.a, r.b
        on = r.clearance <= sim.frame.touch and not is_disabled(sim, r.pair)
        r.mode = ACTIVE if on else INACTIVE
        r.target_speed = 0.0
        if on:
            v = normal_speed(sim.velocity, r, a, b)
            r.speed = max(0.0, -v)
            least = min(least, v)
    if least >= -APPROACH:
        return
    set_limits(sim)
    for _ in range(MAX_SOLVES):
        solve_contacts(sim, SWEEPS, APPROACH, False)
        if not disable_squeezed(sim):
            break
        clear_impulses_of_contacts(sim)
        load_velocities(sim)
    commit(sim)


@kernel
def choose_active_contacts(sim: Simulation, h: float) -> None:
    """Mark the points that contact forces act at over the next `h` seconds, and set their target velocities.

    Points that do not touch, but others of their pair do, are among them if they approach below the restitution threshold.
    """
    for i in range(sim.counts.concerned):
        if has_changed(sim, sim.pairs[sim.concerned[i]].body[0]):
            sim.pairs[sim.concerned[i]].resting = 0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.clearance <= sim.frame.touch and not is_disabled(sim, r.pair):
            sim.pairs[r.pair].resting = 1
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        r.mode = INACTIVE
        if not is_disabled(sim, r.pair):
            speed = speed_at(sim.velocity, r, r.a, r.b)
            v, clearance = dot(speed, vec_of(r.normal)), r.clearance
            held = sim.pairs[r.pair].resting == 1
            slowest = -sim.frame.restitution_threshold if held else 0.0
            if clearance <= sim.frame.touch or v > slowest:
                r.speed = norm(speed)
                separating_speed = v if v > FAINT else 0.0
                r.target_speed = -2.0 * max(0.0, clearance - sim.frame.gap) / h - separating_speed
                r.mode = ACTIVE
                sim.pairs[r.pair].resting = 1


@kernel
def begin_with_old_force(sim: Simulation, k: int, h: float) -> None:
    """Warm start: set and apply the impulses of contact k that its point's forces of the step before give over `h` seconds."""
    r = sim.contacts[k]
    slot = sim.slots[r.pair, r.slot]
    f = vec_of(slot.friction_force)
    r.normal_impulse = min(r.impulse_limit, h * slot.normal_force)
    r.tangent_impulse[0] = h * dot(f, vec_of(r.tangent))
    r.tangent_impulse[1] = h * dot(f, vec_of(r.binormal))
    if r.normal_impulse == 0.0 and r.tangent_impulse[0] == 0.0 and r.tangent_impulse[1] == 0.0:
        return
    apply_impulses(sim, r, (r.normal_impulse, r.tangent_impulse[0], r.tangent_impulse[1]))


@kernel
def keep_force(sim: Simulation, k: int, t: float, h: float) -> None:
    """Convert the impulses of contact k to constant forces over `h` seconds from time `t`: of its point, and on both bodies."""
    r = sim.contacts[k]
    j, normal = impulse_of(r), r.normal_impulse
    give_force(sim, k, j, 1.0 / h)
    slot = sim.slots[r.pair, r.slot]
    slot.normal_force, slot.since = normal / h, t
    set_vec(slot.normal, vec_of(r.normal))
    set_vec(slot.friction_force, scale(add_scaled(j, vec_of(r.normal), -normal), 1.0 / h))
    clear_impulse(r)


@kernel
def fall(sim: Simulation, t: float, h: float) -> None:
    """Apply gravity alone for `h` seconds to the velocities and motions of changed bodies.

    Bodies with prescribed motion get their velocities at `t` + `h`.
    """
    load_paths(sim, t + h)
    for s in range(sim.counts.changed):
        body = sim.changed[s]
        add_vec_from(sim.velocity[body], 0, vec_of(sim.gravity), h)
        set_vec(sim.motion[body].acceleration, vec_of(sim.gravity))
        set_vec(sim.motion[body].torque, (0.0, 0.0, 0.0))


@kernel
def rotates_with(omega: Vec, support_omega: Vec) -> bool:
    """Whether a body that rotates at `omega` [rad/s] rotates with its support, at `support_omega`; a ball that rolls does not."""
    return norm(sub(omega, support_omega)) <= ALONG * norm(support_omega)


@kernel
def advance_arms(sim: Simulation, t: float, h: float) -> None:
    """Rotate the arms of solved points to the end of the step with the kinematic bodies that support them.

    Velocities at both ends of the step then have the directions of both ends, and a body on a turntable moves along
    its circle; otherwise the table would throw it outwards by ω² r h.
    """
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        path = sim.motion[r.b]
        omega = vec_of(path.rotation_rate)
        if r.mode == INACTIVE or is_simulated(sim, r.b) or omega == (0.0, 0.0, 0.0):
            continue
        if not rotates_with(vec_of(sim.motion[r.a].angular_velocity), omega):
            continue
        rotation = quat_mul(orientation_at(path, t + h), quat_conjugate(orientation_at(path, t)))
        set_vec(r.arm_a, quat_rotate(rotation, vec_of(r.arm_a)))
        set_vec(r.arm_b, quat_rotate(rotation, vec_of(r.arm_b)))
        fill_masses(sim.motion[r.a], path, r)


@noinline
def solve_resting_contact(sim: Simulation, t: float, h: float, sweeps: int) -> None:
    """Contact forces on the changed bodies from time `t` of the frame for `h` seconds, and their motions under them.

    Points that touch or approach slowly are solved; faster ones are left to collide. `velocity` of the state
    must be the present velocities.
    """
    set_limits(sim)
    choose_active_contacts(sim, h)
    advance_arms(sim, t, h)
    count = sim.counts.contacts
    for _ in range(MAX_SOLVES):
        fall(sim, t, h)
        for k in range(count):
            if sim.contacts[k].mode == ACTIVE:
                begin_with_old_force(sim, k, h)
        solve_contacts(sim, sweeps, 0.0, True)
        if not disable_squeezed(sim):
            break
        clear_impulses_of_contacts(sim)
        load_velocities(sim)
    for k in range(count):
        keep_force(sim, k, t, h)
    for s in range(sim.counts.changed):
        plan(sim.motion[sim.changed[s]], h)
