"""Contacts of the coupled solve: contacts of the simulated loop's pairs, and inequalities of driven links and joints.

A contact with a driven link has the effects of its tree's unknowns on the relative velocity, and the velocity by the
recording alone, as the displacement of the link's point over the step: the prescribed velocity.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near
from geomphys.collision.sweep import update_boxes
from geomphys.driven.postures import world_axis
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import solves, unknown_of_joint
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec, quat_of, set_vec, vec_at, vec_of
from geomphys.numerics.vec3 import (
    Quat,
    Rot,
    Vec,
    add,
    cross,
    dot,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_half,
    quat_mul,
    quat_rotate,
    rotate,
    rotation_vector,
    scale,
    sub,
)
from geomphys.scene.arrays import DRIVEN, JOINT_FIXED, JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, position_of
from geomphys.simulated.contact_points import add_contacts_within, fill_masses
from geomphys.simulated.motion import orientation_at, point_at
from geomphys.simulated.resting_contact import rotates_with
from geomphys.simulated.state import Contact, is_coupled, is_simulated

Floats = NDArray[np.float64]

JOINT_LIMIT_NEAR = 0.1  # rad or m: limits of joints farther away are ignored


@kernel
def add_effect(c: Coupled, first: int, unknown: int, speeds: Vec) -> None:
    """Add to the effect of a unit rate of an unknown along the three axes, in the effects from number `first` on."""
    solve = c.solve
    for e in range(first, solve.effects):
        if c.effects[e].unknown == unknown:
            add_vec(c.effects[e].jacobian, speeds, 1.0)
            return
    if solve.effects == len(c.effects):
        solve.lost += 1
        return
    effect = c.effects[solve.effects]
    effect.unknown = unknown
    set_vec(effect.jacobian, speeds)
    solve.effects += 1


@kernel
def add_effects(scene: Scene, c: Coupled, first: int, body: int, point: Vec, axes: Rot, sign: float) -> None:
    """Add the effects of the unknowns of a driven body's tree on the velocity of its `point`, times `sign`, along three axes.

    They are the rows of `axes`; zeros where there is none.
    """
    tree = scene.bodies.tree[body]
    for i in range(3):
        if c.unknowns[3 * tree + i].mass > 0.0:
            add_effect(c, first, 3 * tree + i, (sign * axes[i], sign * axes[3 + i], sign * axes[6 + i]))
    joint = body
    while joint >= 0:
        q = scene.bodies.dof[joint]
        if q >= 0 and scene.bodies.joint[joint] != JOINT_FIXED:
            k = unknown_of_joint(scene, q)
            if c.unknowns[k].mass > 0.0:
                direction = world_axis(scene, c.now.poses, joint)
                if scene.bodies.joint[joint] != JOINT_PRISMATIC:
                    direction = cross(direction, sub(point, position_of(c.now.poses, joint)))
                add_effect(c, first, k, rotate(axes, scale(direction, sign * scene.bodies.multiplier[joint])))
        joint = scene.bodies.parent[joint]


@kernel
def is_solved(scene: Scene, c: Coupled, body: int) -> bool:
    """Whether a body is a link of a driven tree that takes part in the solve."""
    return solves(scene, c, scene.bodies.tree[body])


@kernel
def displacement(scene: Scene, data: ReplayData, body: int, point: Vec, t: float, h: float) -> Vec:
    """Displacement by the recording alone of a point of a body that is not simulated, in a step [m].

    `t` is the time of the substep at which the step of `h` seconds begins.
    """
    c = data.coupled
    if is_solved(scene, c, body):
        inside = quat_rotate(
            quat_conjugate(orientation_of(c.now.poses, body)), sub(point, position_of(c.now.poses, body))
        )
        there = add(position_of(c.after.poses, body), quat_rotate(orientation_of(c.after.poses, body), inside))
        return sub(there, point)
    if data.simulated.bodies[body].moves == 0:
        return (0.0, 0.0, 0.0)
    path = data.simulated.motion[body]
    inside = quat_rotate(quat_conjugate(orientation_at(path, t)), sub(point, point_at(path, t)))
    return sub(add(point_at(path, t + h), quat_rotate(orientation_at(path, t + h), inside)), point)


@kernel
def complete_contact(scene: Scene, data: ReplayData, r: Contact, t: float, h: float) -> None:
    """Set the fields of a contact for a driven or moving body b."""
    c, sim = data.coupled, data.simulated
    point = add(vec_of(r.arm_a), vec_of(sim.motion[r.a].position))
    set_vec(r.point, point)
    r.first_effect = c.solve.effects
    set_vec(r.prescribed, (0.0, 0.0, 0.0))
    debt = vec_of(sim.slots[r.pair, r.slot].slip_debt)
    set_vec(r.slip_debt, quat_rotate(quat_of(sim.motion[r.a].orientation), debt))
    if not is_simulated(sim, r.b):
        travel = displacement(scene, data, r.b, point, t, h)
        axes = (*vec_of(r.normal), *vec_of(r.tangent), *vec_of(r.binormal))
        set_vec(r.prescribed, scale(rotate(axes, travel), -1.0 / h))
        if is_solved(scene, c, r.b):
            add_effects(scene, c, r.first_effect, r.b, point, axes, -1.0)
        for i in range(6):
            sim.velocity[r.b, i] = 0.0
    r.end_effect = c.solve.effects


@noinline
def find_coupled_contacts(scene: Scene, data: ReplayData, t: float, h: float, margin: float) -> None:
    """Contacts of the simulated bodies of the group, at time `t` of the substep, for a step of `h` seconds."""
    sim = data.simulated
    data.coupled.solve.effects = data.coupled.solve.inequalities = 0
    sim.counts.contacts = 0
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        if not is_coupled(sim, p.body[0]):
            continue
        add_contacts_within(sim, k, t, margin)
    for k in range(sim.counts.contacts):
        complete_contact(scene, data, sim.contacts[k], t, h)


@noinline
def find_inequalities(scene: Scene, data: ReplayData, t: float, h: float, margin: float) -> None:
    """Limits of driven trees that take part: contacts with bodies that are not simulated, and limits of their joints."""
    c, p, near = data.coupled, data.workspace.piece_frames, data.workspace.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN and c.trees[tree].solved == 1:
            pose_pieces_of_tree(scene, tree, c.now.poses, p.frames)
            update_boxes(scene, p.frames, data.detection.boxes, tree)
            add_joint_limits(scene, data, tree, h)
    find_near(scene, p.frames, data.without_simulated, margin, math.inf, near, data.detection)
    for k in range(near.counts.filled):
        a, b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        if not (is_solved(scene, c, a) or is_solved(scene, c, b)):
            continue
        first = c.solve.effects
        n, clearance, prescribed = vec_at(near.normal, k), near.separation[k], 0.0
        for side in range(2):
            body = a if side == 0 else b
            point = vec_at(near.point_a, k) if side == 0 else vec_at(near.point_b, k)
            sign = 1.0 if side == 0 else -1.0
            prescribed += sign * dot(displacement(scene, data, body, point, t, h), n) / h
            if is_solved(scene, c, body):
                add_effects(scene, c, first, body, point, (*n, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), sign)
        add_inequality(c, first, clearance, prescribed)


@kernel
def add_inequality(c: Coupled, first: int, clearance: float, prescribed: float) -> None:
    """Append a limit whose effects are those from number `first` on."""
    solve = c.solve
    if solve.inequalities == len(c.inequalities):
        solve.lost += 1
        return
    g = c.inequalities[solve.inequalities]
    solve.inequalities += 1
    g.first_effect, g.end_effect = first, solve.effects
    g.clearance, g.prescribed, g.impulse = clearance, prescribed, 0.0


@kernel
def add_joint_limits(scene: Scene, data: ReplayData, tree: int, h: float) -> None:
    """Near limits of the joints of a tree; widened to the recorded values."""
    c = data.coupled
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        k = unknown_of_joint(scene, q)
        if c.unknowns[k].mass == 0.0:
            continue
        angle, change = c.now.angles[q], c.after.angles[q] - c.now.angles[q]
        low = min(scene.dofs.lower[q], angle + min(change, 0.0) - max(c.unknowns[k].offset, 0.0))
        high = max(scene.dofs.upper[q], angle + max(change, 0.0) - min(c.unknowns[k].offset, 0.0))
        for side in range(2):
            sign = 1.0 if side == 0 else -1.0
            clearance = angle - low if side == 0 else high - angle
            if clearance < JOINT_LIMIT_NEAR:
                first = c.solve.effects
                add_effect(c, first, k, (sign, 0.0, 0.0))
                add_inequality(c, first, clearance, sign * change / h)


@kernel
def half_rotation(scene: Scene, data: ReplayData, body: int, t: float, h: float) -> Quat:
    """Rotation of a body over the first half of a step of `h` seconds that begins at time `t` of the substep."""
    sim, c = data.simulated, data.coupled
    if is_simulated(sim, body):
        return quat_from_rotation_vector(scale(vec_of(sim.motion[body].angular_velocity), 0.5 * h))
    if is_solved(scene, c, body):
        before, after = orientation_of(c.now.poses, body), orientation_of(c.after.poses, body)
    elif sim.bodies[body].moves == 1:
        before, after = orientation_at(sim.motion[body], t), orientation_at(sim.motion[body], t + h)
    else:
        return (0.0, 0.0, 0.0, 1.0)
    return quat_half(quat_mul(after, quat_conjugate(before)))


@noinline
def rotate_arms(scene: Scene, data: ReplayData, t: float, h: float) -> None:
    """Set the arms of simulated bodies to those in the middle of the step, relative to their support.

    A body that rotates with body b of a contact keeps its distance from the axis then: otherwise a turntable would throw its
    load outwards by ω² r h. The arm of a ball that rolls on b does not change.
    """
    sim, support = data.simulated, -1
    of_support, omega = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.b != support:
            support = r.b
            of_support = half_rotation(scene, data, support, t, h)
            omega = scale(rotation_vector(of_support), 2.0 / h)
        half = of_support
        if not rotates_with(vec_of(sim.motion[r.a].angular_velocity), omega):
            half = (0.0, 0.0, 0.0, 1.0)
        set_vec(r.arm_a, quat_rotate(half, sub(vec_of(r.point), vec_of(sim.motion[r.a].position))))
        if is_simulated(sim, r.b):
            set_vec(r.arm_b, quat_rotate(half, sub(vec_of(r.point), vec_of(sim.motion[r.b].position))))
        fill_masses(sim.motion[r.a], sim.motion[r.b], r)
