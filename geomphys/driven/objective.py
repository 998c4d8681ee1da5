"""Objective of a correction: squared distance of the surfaces of the links from their targets.

    E = ½ Σ_links w Σ_points |x(q) - x*|² / 6

over six points with the second moments of a link's surface. Its gradient and Gauss-Newton Hessian are those of rigid
bodies: with the mass w, the covariance of the surface as their second moments, and forces w (x - x*), the Hessian in
roots and joints is the joint-space inertia matrix, found by composite bodies from the tips to the root (Featherstone,
Rigid Body Dynamics Algorithms, 2008, chapter 6).

w is the link's area; in chains it is more where the link was off by more than `Weights.amplification` times the recorded depth
(`targets.set_link_targets`): squares alone would leave all to one finger that has a bad lever, where others can share.

A rigid hand may change shape and rotation too, at a higher weight: the same sum over links in the root's frame, and the
rotation of the root, have `Weights.shape` times the weight.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.postures import Posture, point_of, world_axis
from geomphys.driven.state import GENERAL_MOTION, LOCKED, DrivenWorkspace
from geomphys.jit.kernel import inlined, kernel, noinline
from geomphys.numerics.row_vectors import add_vec, rot_of, set_rot, set_vec, set_vec_from, vec_at, vec_from, vec_of
from geomphys.numerics.vec3 import (
    Quat,
    Rot,
    Vec,
    add,
    cross,
    dot,
    quat_conjugate,
    quat_mul,
    quat_rotate,
    rot_from_quat,
    rot_mul,
    rotate,
    rotation_vector,
    scale,
    sub,
)
from geomphys.scene.arrays import JOINT_FIXED, JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import orientation_of, position_of

Floats = NDArray[np.float64]
Inertia: TypeAlias = Any  # a record of `COMPOSITE_INERTIA`

ROTATION_ARM = 0.05  # m: lever of its rotation
LIMIT_PENALTY = 1e4  # lever²: penalty of a joint beyond its limits
REGULARISATION = 1e-6  # of the mean weight: regularisation of every unknown


@kernel
def is_rigid(scene: Scene, tree: int) -> bool:
    """Whether a tree moves as a rigid body, with the higher weight on shape and rotation: no joints, or no chains."""
    return bool(scene.trees.chains[tree] == 0 or scene.trees.dof_start[tree] == scene.trees.dof_start[tree + 1])


@kernel
def link_centre(ws: DrivenWorkspace, poses: Floats, body: int) -> Vec:
    """Centre of a link in the world."""
    return point_of(poses, body, vec_at(ws.links.centre, body))


@kernel
def pivot_of(ws: DrivenWorkspace, poses: Floats, tree: int) -> Vec:
    """The point about which the root rotates."""
    return link_centre(ws, poses, ws.links.pivot[tree])


@kernel
def _second_moment(ws: DrivenWorkspace, body: int) -> Rot:
    return rot_of(ws.links.second_moment[body])


@kernel
def _transposed(r: Rot) -> Rot:
    return (r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8])


@inlined
def _residual(centre: Vec, rotated_moments: Rot, s: Rot, c: Vec, q: Quat) -> tuple[Vec, Vec, float]:
    """Gradient (force and torque about the centre) of a link displaced from (c, q), per weight, and twice its cost.

    `centre` and `rotated_moments` as in `LINK_SURFACE`; `s`: its second moments.
    """
    away = sub(centre, c)
    n = rot_mul(rotated_moments, _transposed(rot_from_quat(q)))
    torque = (n[7] - n[5], n[2] - n[6], n[3] - n[1])
    cost = dot(away, away) + 2.0 * (s[0] + s[4] + s[8]) - 2.0 * (n[0] + n[4] + n[8])
    return away, torque, cost


@kernel
def tree_cost(scene: Scene, ws: DrivenWorkspace, poses: Floats, tree: int) -> float:
    """E of a tree, without the terms of rigid trees."""
    cost = 0.0
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        w = ws.work.weight[body]
        if w > 0.0:
            s, centre, target = _second_moment(ws, body), link_centre(ws, poses, body), ws.work.target
            moments = rot_mul(rot_from_quat(orientation_of(poses, body)), s)
            _, _, e = _residual(centre, moments, s, vec_at(target, body), orientation_of(target, body))
            cost += 0.5 * w * e
    return cost


@kernel
def _add_inertia(to: Inertia, other: Inertia) -> None:
    """Add a composite inertia to another."""
    to.mass += other.mass
    add_vec(to.first_moment, vec_of(other.first_moment), 1.0)
    to.xx += other.xx
    to.yy += other.yy
    to.zz += other.zz
    to.xy += other.xy
    to.xz += other.xz
    to.yz += other.yz


@kernel
def _gather(scene: Scene, ws: DrivenWorkspace, poses: Floats, tree: int) -> float:
    """Composite inertias and forces of a tree about its pivot; returns E."""
    inertia, force, target = ws.work.inertia, ws.work.force, ws.work.target
    first, last = scene.trees.body_start[tree], scene.trees.body_start[tree + 1]
    pivot, cost = pivot_of(ws, poses, tree), 0.0
    for body in range(first, last):
        w = ws.work.weight[body]
        own = inertia[body]
        own.mass = own.xx = own.yy = own.zz = own.xy = own.xz = own.yz = 0.0
        set_vec(own.first_moment, (0.0, 0.0, 0.0))
        for k in range(6):
            force[body, k] = 0.0
        if w == 0.0:
            continue
        s, centre = _second_moment(ws, body), link_centre(ws, poses, body)
        world_rotation = rot_from_quat(orientation_of(poses, body))
        moments = rot_mul(world_rotation, s)
        set_vec(ws.work.surface[body].centre, centre)
        set_rot(ws.work.surface[body].rotated_moments, moments)
        away, torque, e = _residual(centre, moments, s, vec_at(target, body), orientation_of(target, body))
        cost += 0.5 * w * e
        r = sub(centre, pivot)
        c = rot_mul(moments, _transposed(world_rotation))
        trace, square = c[0] + c[4] + c[8], dot(r, r)
        own.mass = w
        set_vec(own.first_moment, scale(r, w))
        own.xx = w * (square - r[0] * r[0] + trace - c[0])
        own.yy = w * (square - r[1] * r[1] + trace - c[4])
        own.zz = w * (square - r[2] * r[2] + trace - c[8])
        own.xy = -w * (r[0] * r[1] + c[1])
        own.xz = -w * (r[0] * r[2] + c[2])
        own.yz = -w * (r[1] * r[2] + c[5])
        moment = add(cross(r, away), torque)
        set_vec_from(force[body], 0, scale(away, w))
        set_vec_from(force[body], 3, scale(moment, w))
    for body in range(last - 1, first, -1):
        _add_inertia(inertia[scene.bodies.parent[body]], inertia[body])
        for k in range(6):
            force[scene.bodies.parent[body], k] += force[body, k]
    return cost


@kernel
def _gather_shape(scene: Scene, ws: DrivenWorkspace, poses: Floats, tree: int) -> float:
    """Composite forces of the shape term of a tree: targets of links in the root's frame; returns the cost.

    Surfaces of links are those of `_gather`.
    """
    force, links, target = ws.work.force, ws.links, ws.work.target
    first, last = scene.trees.body_start[tree], scene.trees.body_start[tree + 1]
    pivot, cost = pivot_of(ws, poses, tree), 0.0
    root = position_of(poses, first)
    rotation = quat_mul(orientation_of(poses, first), quat_conjugate(orientation_of(target, first)))
    middle = quat_rotate(orientation_of(target, first), vec_at(links.centre, first))
    target_root = sub(vec_at(target, first), middle)
    for body in range(first, last):
        w = ws.work.weight[body]
        for k in range(6):
            force[body, k] = 0.0
        if w == 0.0:
            continue
        c = add(root, quat_rotate(rotation, sub(vec_at(target, body), target_root)))
        centre, moments = vec_of(ws.work.surface[body].centre), rot_of(ws.work.surface[body].rotated_moments)
        q = quat_mul(rotation, orientation_of(target, body))
        away, torque, e = _residual(centre, moments, _second_moment(ws, body), c, q)
        cost += 0.5 * w * e
        moment = add(cross(sub(centre, pivot), away), torque)
        set_vec_from(force[body], 0, scale(away, w))
        set_vec_from(force[body], 3, scale(moment, w))
    for body in range(last - 1, first, -1):
        for k in range(6):
            force[scene.bodies.parent[body], k] += force[body, k]
    return cost


@kernel
def _twist(scene: Scene, poses: Floats, joint: int, pivot: Vec) -> tuple[Vec, Vec]:
    """Velocity at the pivot and angular velocity that a joint gives, per unit of its degree of freedom."""
    m = scene.bodies.multiplier[joint]
    axis = scale(world_axis(scene, poses, joint), m)
    if scene.bodies.joint[joint] == JOINT_PRISMATIC:
        return axis, (0.0, 0.0, 0.0)
    return cross(axis, sub(pivot, position_of(poses, joint))), axis


@kernel
def _second_moments(inertia: Inertia) -> Rot:
    """The second moments of a composite inertia as a matrix, row by row."""
    i = inertia
    return (i.xx, i.xy, i.xz, i.xy, i.yy, i.yz, i.xz, i.yz, i.zz)


@kernel
def _momentum(inertia: Inertia, v: Vec, w: Vec) -> tuple[Vec, Vec]:
    """Momentum and angular momentum about the pivot of a composite body in a motion."""
    h = vec_of(inertia.first_moment)
    p = add(scale(v, inertia.mass), cross(w, h))
    return p, add(cross(h, v), rotate(_second_moments(inertia), w))


@kernel
def _joint_column(scene: Scene, ws: DrivenWorkspace, joint: int) -> int:
    """Column of the joint above a body, -1: it has none."""
    q = scene.bodies.dof[joint]
    if q < 0 or scene.bodies.joint[joint] == JOINT_FIXED:
        return -1
    return int(ws.work.column[q])


@kernel
def _find_twists(scene: Scene, ws: DrivenWorkspace, poses: Floats, tree: int) -> None:
    """Motion that each joint of a tree gives, into `SearchWorkspace.twist`."""
    pivot = pivot_of(ws, poses, tree)
    for body in range(scene.trees.body_start[tree] + 1, scene.trees.body_start[tree + 1]):
        twist = ws.work.twist[body]
        twist.column = _joint_column(scene, ws, body)
        if twist.column >= 0:
            v, w = _twist(scene, poses, body, pivot)
            set_vec(twist.velocity, v)
            set_vec(twist.angular_velocity, w)


@kernel
def _add_joints(scene: Scene, ws: DrivenWorkspace, tree: int, factor: float) -> None:
    """Hessian of a tree's joints among each other and with its root, whose columns come before; the former `factor` times."""
    h, first, root = ws.problem.hessian, ws.work.first[tree], scene.trees.body_start[tree]
    for body in range(root + 1, scene.trees.body_start[tree + 1]):
        twist = ws.work.twist[body]
        i = twist.column
        if i < 0 or ws.work.inertia[body].mass == 0.0:
            continue
        p, angular = _momentum(ws.work.inertia[body], vec_of(twist.velocity), vec_of(twist.angular_velocity))
        for k in range(3):
            h[i, first + k] += p[k]
            h[i, first + 3 + k] += angular[k]
        other = body
        while other > root:
            above = ws.work.twist[other]
            j = above.column
            if j >= 0:
                value = factor * (dot(vec_of(above.velocity), p) + dot(vec_of(above.angular_velocity), angular))
                h[max(i, j), min(i, j)] += value
                if i == j and other != body:  # two joints of one degree of freedom
                    h[i, j] += value
            other = scene.bodies.parent[other]


@kernel
def _add_joint_gradient(scene: Scene, ws: DrivenWorkspace, tree: int, factor: float) -> None:
    """Gradient of a tree's joints from its composite forces."""
    force = ws.work.force
    for body in range(scene.trees.body_start[tree] + 1, scene.trees.body_start[tree + 1]):
        twist = ws.work.twist[body]
        i = twist.column
        if i < 0:
            continue
        v, w = vec_of(twist.velocity), vec_of(twist.angular_velocity)
        f, t = vec_from(force[body], 0), vec_from(force[body], 3)
        ws.problem.gradient[i] += factor * (dot(v, f) + dot(w, t))


@kernel
def _add_rotation(scene: Scene, ws: DrivenWorkspace, poses: Floats, tree: int) -> float:
    """The rotation of a rigid tree's root gets the higher weight."""
    root, first = scene.trees.body_start[tree], ws.work.first[tree]
    stiffness = ws.weights.shape * ws.work.inertia[root].mass * ROTATION_ARM * ROTATION_ARM
    rotation = rotation_vector(
        quat_mul(orientation_of(poses, root), quat_conjugate(orientation_of(ws.work.target, root)))
    )
    for k in range(3):
        ws.problem.hessian[first + 3 + k, first + 3 + k] += stiffness
        ws.problem.gradient[first + 3 + k] += stiffness * rotation[k]
    return 0.5 * stiffness * dot(rotation, rotation)


@kernel
def _add_joint_terms(scene: Scene, ws: DrivenWorkspace, angles: Floats, tree: int) -> float:
    """Terms of the joints: they stay near their goals by the coupling, and near the range in which they were used.

    Goals, not their last offsets: a finger that nothing touches relaxes as fast whether or not another one is in contact. One of
    the terms has the same lever for all joints of a tree: in the metric of the links alone what a fingertip is moved by, tracker
    noise too, is left to the last joint, whose lever is the shortest and which trembles most. That term grows in a grip: joints
    of fingers that have closed on something stop together; otherwise the last ones would go back as the first close further.
    """
    cost, work = 0.0, ws.work
    smooth, posture = ws.weights.rigid_smooth, ws.weights.rigid_posture
    if not is_rigid(scene, tree):
        smooth, posture = ws.weights.smooth, ws.weights.posture
    posture += ws.weights.grip_posture * work.stopped[tree]
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        i = work.column[q]
        if i < 0:
            continue
        away = angles[q] - work.preferred[q]
        weight = smooth * ws.links.lever[q] ** 2 + posture * ws.links.mean_lever[q] ** 2
        ws.problem.hessian[i, i] += weight
        ws.problem.gradient[i] += weight * away
        cost += 0.5 * weight * away * away
        away = angles[q] - min(max(angles[q], work.used_low[q]), work.used_high[q])
        if away != 0.0:
            weight = ws.weights.unusual * ws.links.lever[q] ** 2
            ws.problem.hessian[i, i] += weight
            ws.problem.gradient[i] += weight * away
            cost += 0.5 * weight * away * away
    return cost


@kernel
def _limit_cost(scene: Scene, ws: DrivenWorkspace, angles: Floats, tree: int) -> float:
    """Penalty of joints beyond limits, which occurs only where the recording returns within them."""
    cost, work = 0.0, ws.work
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        if work.column[q] >= 0:
            beyond = angles[q] - min(max(angles[q], work.low[q]), work.high[q])
            cost += 0.5 * LIMIT_PENALTY * (ws.links.lever[q] * beyond) ** 2
    return cost


@noinline
def assemble(scene: Scene, ws: DrivenWorkspace, iterate: Posture, smooth: bool) -> float:
    """Hessian and gradient of all trees in the problem at a posture; returns the cost.

    `smooth`: with the terms of joints.
    """
    h, g, work = ws.problem.hessian, ws.problem.gradient, ws.work
    cost, poses = 0.0, iterate.poses
    for tree in range(len(work.mobility)):
        mobility = work.mobility[tree]
        if mobility == LOCKED:
            continue
        root, first = scene.trees.body_start[tree], work.first[tree]
        cost += _gather(scene, ws, poses, tree)
        composite, force = work.inertia[root], work.force[root]
        mass = composite.mass
        for k in range(3):
            h[first + k, first + k] += mass + REGULARISATION
            g[first + k] += force[k]
        if mobility != GENERAL_MOTION:
            continue
        x, y, z = vec_of(composite.first_moment)
        skew = (0.0, z, -y, -z, 0.0, x, y, -x, 0.0)  # ω x h: how the first moment couples a rotation to a translation
        for i in range(3):
            for j in range(3):
                h[first + 3 + j, first + i] += skew[3 * i + j]
        moments, torque = _second_moments(composite), vec_from(force, 3)
        for i in range(3):
            g[first + 3 + i] += torque[i]
            h[first + 3 + i, first + 3 + i] += 1e-3 * REGULARISATION
            for j in range(i + 1):
                h[first + 3 + i, first + 3 + j] += moments[3 * i + j]
        rigid = is_rigid(scene, tree)
        _find_twists(scene, ws, poses, tree)
        _add_joint_gradient(scene, ws, tree, 1.0)
        _add_joints(scene, ws, tree, 1.0 + ws.weights.shape if rigid else 1.0)
        if rigid:
            cost += _add_rotation(scene, ws, poses, tree)
            cost += ws.weights.shape * _gather_shape(scene, ws, poses, tree)
            _add_joint_gradient(scene, ws, tree, ws.weights.shape)
        cost += _limit_cost(scene, ws, iterate.angles, tree)
        if smooth:
            cost += _add_joint_terms(scene, ws, iterate.angles, tree)
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            if work.column[q] >= 0:
                h[work.column[q], work.column[q]] += REGULARISATION * ws.links.lever[q] ** 2
    return cost
