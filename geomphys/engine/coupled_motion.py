"""Moves driven and simulated bodies that may touch through a substep of a frame together.

In steps of at most `STEP`: contacts, impacts with the real masses, the time of the next impact, the coupled contact solve
with (6) implicit in it, motion. Without contact, bodies move on their parabolas and offsets relax by (6).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.postures import copy_tree
from geomphys.engine.coupled_contacts import find_coupled_contacts, find_inequalities, rotate_arms
from geomphys.engine.coupled_impacts import load_coupled, next_impact, resolve_impacts
from geomphys.engine.coupled_impulses import add_responses, apply, impulse_vector, set_inequality_response
from geomphys.engine.coupled_solve import PRECISION, PROXIMAL_STEPS, SWEPT_PRECISION, solve_contacts
from geomphys.engine.coupled_squeeze import add_squeeze, largest_squeeze
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import (
    begin_step,
    end_step,
    end_unknown,
    first_unknown,
    pose_driven,
    relax_rotation,
    solves,
)
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import (
    add_vec,
    add_vec_from,
    quat_of,
    set_quat,
    set_quat_from,
    set_vec,
    set_vec_from,
    vec_from,
    vec_of,
)
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    dot,
    norm,
    quat_conjugate,
    quat_rotate,
    scale,
    sub,
)
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, position_of
from geomphys.simulated.contact_points import clear_impulse
from geomphys.simulated.contact_solver import local_impulse
from geomphys.simulated.impulse_accumulation import give_velocity, impulse_of, note
from geomphys.simulated.motion import move_base, orientation_at, plan, point_at, refresh
from geomphys.simulated.state import ACTIVE, IMPACTING, INACTIVE, Simulation, is_coupled, is_simulated
from geomphys.simulated.update import STEP, STEP_TOLERANCE

Floats = NDArray[np.float64]

LIGHT = 50.0  # times an object's mass: where the implicit mass of what presses on it is more, steps are half as long
MARGIN = 4e-3  # m: nearer contacts of simulated bodies are solved
DRIVEN_MARGIN = 2e-3  # m: the same of driven links with each other and with fixed bodies
MARGIN_STEPS = 1.5  # so are those nearer than this times the motion in a step
ROTATION = 0.1  # rad: no body rotates farther in a step, unless that would be shorter than `FEWEST`
FEWEST = 1.0 / 16.0  # of `STEP`: the shortest step
SPLITS = 8  # splits of a step at times of impact
CORRECTION_FACTOR = 0.2  # fraction of an overlap, or of slip, that is corrected in a step
FASTEST_CORRECTION = 0.5  # m/s
STUCK = 0.9999  # of the friction available: beyond it a point slides
MIN_IMPEDANCE_SCALE = 0.02  # of a joint's K, m and R
IMPEDANCE_SCALE_GAIN = 0.2  # fraction by which the impedance of a joint follows its goal in a step
TOUCHED = 3.0  # gaps: a nearer pair counts as having been in contact


@kernel
def hold_tree(scene: Scene, data: ReplayData, tree: int, t: float) -> None:
    """Let the links of a driven tree stand where they are at time `t` of the substep, for the simulated loop."""
    c = data.coupled
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        k = data.simulated.motion[body]
        k.base_time = t
        set_vec(k.position, position_of(c.now.poses, body))
        set_quat(k.orientation, orientation_of(c.now.poses, body))
        set_vec(k.velocity, (0.0, 0.0, 0.0))
        set_vec(k.acceleration, (0.0, 0.0, 0.0))
        set_vec(k.rotation_rate, (0.0, 0.0, 0.0))
        set_vec(k.half_angular_acceleration, (0.0, 0.0, 0.0))


@noinline
def begin_poses(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, t: float, h: float, dt: float) -> None:
    """Poses of driven trees at time `t` of the substep, and at `t + h` with the offsets at `t`."""
    for tree in range(len(scene.trees.role)):
        if solves(scene, data.coupled, tree):
            pose_driven(scene, data, tree, roots, angles, t / dt, data.coupled.now)
            pose_driven(scene, data, tree, roots, angles, min(1.0, (t + h) / dt), data.coupled.after)
            hold_tree(scene, data, tree, t)


@noinline
def end_poses(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float) -> None:
    """Poses of driven trees at the end of a substep of `dt` seconds: those after its last step, rotations of roots by (6)."""
    c = data.coupled
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            if relax_rotation(scene, c, tree, dt):
                pose_driven(scene, data, tree, roots, angles, 1.0, c.after)
            copy_tree(scene, c.after, tree, c.now)
            hold_tree(scene, data, tree, dt)


@kernel
def fastest_motion(scene: Scene, data: ReplayData, h: float) -> float:
    """Bound on the motion of any body of the group in a step of `h` seconds [m]."""
    sim, c, fastest, driven = data.simulated, data.coupled, 0.0, 0.0
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):
            k = sim.motion[body]
            fastest = max(fastest, h * (norm(vec_of(k.velocity)) + norm(vec_of(k.angular_velocity)) * k.reach))
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                path = sub(position_of(c.after.poses, body), position_of(c.now.poses, body))
                driven = max(driven, norm(path))
    return fastest + driven


@kernel
def set_targets(sim: Simulation, c: Coupled, h: float, to_impact: bool) -> None:
    """Set the targets of contacts and inequalities over a step of `h` seconds; if that ends at an impact, fast ones approach."""
    gap = sim.frame.gap
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        distance = r.clearance - gap
        r.mode = INACTIVE if to_impact and r.mode == IMPACTING else ACTIVE
        r.target_speed = -distance / h if distance > 0.0 else min(-CORRECTION_FACTOR * distance / h, FASTEST_CORRECTION)
        debt = vec_of(r.slip_debt)
        r.tangent_target[0] = -CORRECTION_FACTOR * dot(debt, vec_of(r.tangent)) / h
        r.tangent_target[1] = -CORRECTION_FACTOR * dot(debt, vec_of(r.binormal)) / h
    for k in range(c.solve.inequalities):
        g = c.inequalities[k]
        distance = g.clearance - gap
        g.target_speed = -distance / h if distance > 0.0 else min(-CORRECTION_FACTOR * distance / h, FASTEST_CORRECTION)


@kernel
def begin_with_forces(sim: Simulation, c: Coupled, h: float) -> None:
    """Warm start: impulses of contacts from their points' forces of the step before, over `h` seconds."""
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        clear_impulse(r)
        if r.mode == INACTIVE:
            continue
        slot = sim.slots[r.pair, r.slot]
        f = vec_of(slot.friction_force)
        r.normal_impulse = h * slot.normal_force
        r.tangent_impulse[0], r.tangent_impulse[1] = h * dot(f, vec_of(r.tangent)), h * dot(f, vec_of(r.binormal))
        if r.normal_impulse != 0.0:
            apply(sim, c, r, local_impulse(r))


@noinline
def fit_stiffness(scene: Scene, sim: Simulation, c: Coupled) -> None:
    """Set the joints behind a pressed contact to yield by K together: k_j = s K lever_j², 1/K = sum over them of arm_j²/k_j.

    So a link presses with K x where its joints yield one after the other, and where it touches near a joint. A joint behind
    more contacts takes the mean over them, weighted by their moments; what it had is forgotten at a rate, as forces flicker.
    """
    first = 3 * len(scene.trees.role)
    for k in range(first, len(c.unknowns)):
        c.unknowns[k].moments = c.unknowns[k].yielding = 0.0
    for i in range(sim.counts.contacts):
        r = sim.contacts[i]
        force, yielding = sim.slots[r.pair, r.slot].normal_force, 0.0
        if force == 0.0:
            continue
        for e in range(r.first_effect, r.end_effect):
            if c.effects[e].unknown >= first:
                yielding += (c.effects[e].jacobian[0] / c.unknowns[c.effects[e].unknown].lever) ** 2
        for e in range(r.first_effect, r.end_effect):
            x = c.unknowns[c.effects[e].unknown]
            x.moments += force * abs(c.effects[e].jacobian[0])
            x.yielding += force * abs(c.effects[e].jacobian[0]) * yielding
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            for k in range(first_unknown(scene, tree), end_unknown(scene, tree)):
                x = c.unknowns[k]
                goal = max(MIN_IMPEDANCE_SCALE, x.yielding / x.moments) if x.moments > 0.0 else 1.0
                x.impedance_scale += IMPEDANCE_SCALE_GAIN * (goal - x.impedance_scale)


@noinline
def solve_step(scene: Scene, data: ReplayData, t: float, h: float, to_impact: bool) -> None:
    """The coupled solve over a step of `h` seconds from time `t` of the substep: velocities at its end, and impulses."""
    sim, c = data.simulated, data.coupled
    fit_stiffness(scene, sim, c)
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            begin_step(c, 3 * tree, 3 * tree + 3, h)
            begin_step(c, first_unknown(scene, tree), end_unknown(scene, tree), h)
    add_squeeze(scene, sim, c, h)
    load_coupled(sim)
    for s in range(len(sim.free)):
        if is_coupled(sim, sim.free[s]):
            add_vec_from(sim.velocity[sim.free[s]], 0, vec_of(sim.gravity), h)
    rotate_arms(scene, data, t, h)
    for k in range(sim.counts.contacts):
        add_responses(sim, c, sim.contacts[k])
    for k in range(c.solve.inequalities):
        set_inequality_response(c, k)
        c.inequalities[k].impulse = 0.0
    set_targets(sim, c, h, to_impact)
    begin_with_forces(sim, c, h)
    solve_contacts(sim, c, PROXIMAL_STEPS, PRECISION, SWEPT_PRECISION)


@noinline
def move_bodies(scene: Scene, data: ReplayData, t: float, h: float, dt: float) -> None:
    """Motions of a step from the solved impulses: of simulated bodies, then of driven trees."""
    sim, c = data.simulated, data.coupled
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):
            k = sim.motion[body]
            set_vec_from(k.saved_pose, 0, vec_of(k.position))
            set_quat_from(k.saved_pose, 3, quat_of(k.orientation))
            set_vec(k.acceleration, vec_of(sim.gravity))
            set_vec(k.torque, (0.0, 0.0, 0.0))
    for tree in range(len(scene.trees.role)):
        c.trees[tree].pressed = 0 if solves(scene, c, tree) else c.trees[tree].pressed
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.normal_impulse == 0.0:
            continue
        # a body in contact moves with its velocity at the end of the step
        for side in range(2):
            body = r.a if side == 0 else r.b
            if is_simulated(sim, body):
                apply_gravity_at_once(sim, body, h)
        if sim.bodies[r.b].role == DRIVEN:
            tree = sim.bodies[r.b].tree
            c.trees[tree].pressed = c.trees[tree].touched = 1
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        j = impulse_of(r)
        slot = sim.slots[r.pair, r.slot]
        friction = impulse_vector(r)
        give_velocity(sim, k, j)
        note(slot, vec_of(r.normal), r.normal_impulse, friction)
        slot.normal_force = r.normal_impulse / h
        set_vec(slot.friction_force, scale(friction, 1.0 / h))
    for s in range(len(sim.free)):
        body = sim.free[s]
        if is_coupled(sim, body):
            k = sim.motion[body]
            refresh(k)
            plan(k, h)
            move_base(k, t + h)
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree):
            pressed = c.trees[tree].pressed == 1
            end_step(c, 3 * tree, 3 * tree + 3, h, pressed)
            end_step(c, first_unknown(scene, tree), end_unknown(scene, tree), h, pressed)


@kernel
def apply_gravity_at_once(sim: Simulation, body: int, h: float) -> None:
    """Apply gravity to the velocity of a body before a step instead of during it, once."""
    k = sim.motion[body]
    a = vec_of(k.acceleration)
    if a != (0.0, 0.0, 0.0):
        add_vec(k.velocity, a, h)
        set_vec(k.acceleration, (0.0, 0.0, 0.0))


@kernel
def attached_point(sim: Simulation, c: Coupled, body: int, point: Vec, t: float, h: float) -> Vec:
    """Position of a point of a body after the step from time `t` that was just made."""
    k = sim.motion[body]
    if is_simulated(sim, body):
        saved = k.saved_pose
        inside = quat_rotate(quat_conjugate((saved[3], saved[4], saved[5], saved[6])), sub(point, vec_from(saved, 0)))
        return add(vec_of(k.position), quat_rotate(quat_of(k.orientation), inside))
    if sim.bodies[body].role == DRIVEN:
        q = orientation_of(c.now.poses, body)
        inside = quat_rotate(quat_conjugate(q), sub(point, position_of(c.now.poses, body)))
        return add(position_of(c.after.poses, body), quat_rotate(orientation_of(c.after.poses, body), inside))
    if sim.bodies[body].moves == 0:
        return point
    inside = quat_rotate(quat_conjugate(orientation_at(k, t)), sub(point, point_at(k, t)))
    return add(point_at(k, t + h), quat_rotate(orientation_at(k, t + h), inside))


@noinline
def store_slip(data: ReplayData, t: float, h: float) -> None:
    """Store the drift of sticking points, for the next step to correct; zero for sliding ones."""
    sim, c = data.simulated, data.coupled
    for k in range(sim.counts.pairs):
        if is_coupled(sim, sim.pairs[k].body[0]):
            sim.pairs[k].touching = 0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        slot = sim.slots[r.pair, r.slot]
        p, x, y = local_impulse(r)
        debt = (0.0, 0.0, 0.0)
        if p > 0.0 and math.sqrt(x * x + y * y) < STUCK * r.friction * p:
            n, point = vec_of(r.normal), vec_of(r.point)
            slip = sub(attached_point(sim, c, r.a, point, t, h), attached_point(sim, c, r.b, point, t, h))
            debt = add(vec_of(r.slip_debt), add_scaled(slip, n, -dot(slip, n)))
            debt = quat_rotate(quat_conjugate(quat_of(sim.motion[r.a].orientation)), debt)
        set_vec(slot.slip_debt, debt)
        if p > 0.0 or r.clearance <= TOUCHED * sim.frame.gap:
            sim.pairs[r.pair].touching = 1
        clear_impulse(r)


@kernel
def longest_step(scene: Scene, data: ReplayData) -> float:
    """Longest step [s]: half as long where a driven tree, with its coupling, is much heavier than the body it presses."""
    sim, c, lightest, fastest = data.simulated, data.coupled, math.inf, 0.0
    for s in range(len(sim.free)):
        k = sim.motion[sim.free[s]]
        if is_coupled(sim, sim.free[s]):
            lightest, fastest = min(lightest, k.mass), max(fastest, norm(vec_of(k.angular_velocity)))
    h = min(STEP, max(FEWEST * STEP, ROTATION / max(fastest, 1e-9)))
    for tree in range(len(scene.trees.role)):
        x = c.unknowns[3 * tree]
        if solves(scene, c, tree) and x.mass + STEP * (x.damping + STEP * x.stiffness) > LIGHT * lightest:
            h = min(h, 0.5 * STEP)
    return h


@noinline
def advance_together(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float) -> int:
    """Move the group through a substep of `dt` seconds, to the recorded `roots` and `angles`; returns the number of impacts."""
    count = max(1, math.ceil(dt / longest_step(scene, data) - STEP_TOLERANCE))
    impacts = 0
    for step in range(count):
        t, end = dt * step / count, dt * (step + 1) / count
        splits = 0
        while t < end:
            h = end - t
            begin_poses(scene, data, roots, angles, t, h, dt)
            motion = MARGIN_STEPS * fastest_motion(scene, data, h)
            find_coupled_contacts(scene, data, t, h, max(MARGIN, motion, largest_squeeze(scene, data.coupled)))
            find_inequalities(scene, data, t, h, max(DRIVEN_MARGIN, motion))
            impacts += resolve_impacts(scene, data)
            first = next_impact(data.simulated, data.coupled, h) if splits < SPLITS else h
            splits += 1 if first < h else 0
            solve_step(scene, data, t, first, first < h)
            move_bodies(scene, data, t, first, dt)
            for tree in range(len(scene.trees.role)):
                if solves(scene, data.coupled, tree):
                    pose_driven(scene, data, tree, roots, angles, min(1.0, (t + first) / dt), data.coupled.after)
            store_slip(data, t, first)
            t = end if first == h else t + first
    end_poses(scene, data, roots, angles, dt)
    return impacts
