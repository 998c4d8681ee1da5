"""Tremor of a hand against what it grips, taken out of its recorded pose.

In a grip every fingertip is on a surface, and by how much the recorded palm moves against what is held, tracker noise too, all
joints would have to give back: they would tremble many times as much as they were recorded to. So the pose of a gripping
hand against what it grips is low-pass filtered, causally: the filtered one follows the recorded one by a critically damped
spring,

    y'' = w² (x - y) - 2 w y',    w = w0 (1 + (|x - y| / r)²),

soft within the size r of the noise and stiff beyond. x - y has six components: the translation at the pivot, and the
rotation times `ARM`. y' is relative to what is gripped, whose own motion the hand follows without delay. r grows with the depth
of the grip, up to `Weights.tremor`: so the filter sets in and ends without a step, and without a grip it changes no bit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.grips import OPPOSING
from geomphys.driven.objective import link_centre
from geomphys.driven.state import STARTED_FREE, DrivenState, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, set_vec, vec_of
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    dot,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rotation_vector,
    scale,
    sub,
)
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

ARM = 0.1  # m: lever of a rotation in |x - y|
FREQUENCY = 2.0 * math.pi * 2.0  # rad/s: w0
FULL_GRIP = 2e-3  # m: depth of a grip from which on it counts as firm
NO_GRIP = 1e-6  # a looser grip counts as none
FARTHEST = 2.0  # times r: |x - y| at most


@kernel
def clear_tremor(state: DrivenState, tree: int) -> None:
    """End the filter of a tree."""
    t = state.tremor[tree]
    for i in range(3):
        t.translation[i] = t.rotation[i] = t.velocity[i] = t.angular_velocity[i] = 0.0


@kernel
def _grip_depth(scene: Scene, ws: DrivenWorkspace, tree: int) -> float:
    """Depth of the grip of a tree [m]: the largest to which two opposing fingertips are both recorded inside something."""
    work, depth = ws.work, 0.0
    for i in range(work.counts.touches):
        a = work.touches[i]
        if -a.gap <= depth or scene.bodies.tree[a.tip] != tree:
            continue
        for j in range(i):
            b = work.touches[j]
            both = min(-a.gap, -b.gap)
            if both <= depth or scene.bodies.tree[b.tip] != tree:
                continue
            if dot(vec_of(a.normal), vec_of(b.normal)) < OPPOSING:
                depth = both
    return depth


@kernel
def _motion_of_gripped(scene: Scene, ws: DrivenWorkspace, tree: int, recorded: Floats, point: Vec) -> tuple[Vec, Vec]:
    """How what a tree grips has moved in the step: (displacement at `point`, rotation vector), weighted by the depths."""
    work, total = ws.work, 0.0
    displacement, rotation = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(work.counts.touches):
        touch = work.touches[i]
        if touch.gap >= 0.0 or scene.bodies.tree[touch.tip] != tree:
            continue
        body, weight = touch.body, -touch.gap
        total += weight
        if scene.trees.moving[scene.bodies.tree[body]] == 0:
            continue
        before = work.before.poses
        change = quat_mul(orientation_of(recorded, body), quat_conjugate(orientation_of(before, body)))
        arm = sub(point, position_of(before, body))
        moved = add(sub(position_of(recorded, body), point), quat_rotate(change, arm))
        displacement = add_scaled(displacement, moved, weight)
        rotation = add_scaled(rotation, rotation_vector(change), weight)
    return (scale(displacement, 1.0 / total), scale(rotation, 1.0 / total)) if total > 0.0 else (displacement, rotation)


@kernel
def _follow(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, recorded: Floats, dt: float) -> bool:
    """Advance the filter of a tree by `dt` [s]; whether it changes the pose."""
    grip = min(_grip_depth(scene, ws, tree) / FULL_GRIP, 1.0)
    ws.work.grip[tree] = grip
    if grip < NO_GRIP or ws.weights.tremor == 0.0 or dt == 0.0 or state.progress.start != STARTED_FREE:
        clear_tremor(state, tree)
        return False
    t, pivot = state.tremor[tree], ws.links.pivot[tree]
    last, q = link_centre(ws, state.recorded.poses, pivot), orientation_of(state.recorded.poses, pivot)
    displacement, rotation = _motion_of_gripped(scene, ws, tree, recorded, last)
    away = sub(add(last, displacement), link_centre(ws, recorded, pivot))
    q = quat_mul(quat_from_rotation_vector(rotation), q)
    away_rotation = rotation_vector(quat_mul(q, quat_conjugate(orientation_of(recorded, pivot))))
    v, omega = vec_of(t.velocity), vec_of(t.angular_velocity)
    if vec_of(t.translation) == (0.0, 0.0, 0.0) and vec_of(t.rotation) == (0.0, 0.0, 0.0):
        v, omega = scale(away, -1.0 / dt), scale(away_rotation, -1.0 / dt)
    r = ws.weights.tremor * grip
    square = dot(away, away) + ARM * ARM * dot(away_rotation, away_rotation)
    step = dt * FREQUENCY * (1.0 + square / (r * r))
    loss = 1.0 / (1.0 + step) ** 2
    v = scale(add_scaled(v, away, -step * step / dt), loss)
    omega = scale(add_scaled(omega, away_rotation, -step * step / dt), loss)
    moved, rotated = add_scaled(away, v, dt), add_scaled(away_rotation, omega, dt)
    size = math.sqrt(dot(moved, moved) + ARM * ARM * dot(rotated, rotated))
    if size > FARTHEST * r:
        moved, rotated = scale(moved, FARTHEST * r / size), scale(rotated, FARTHEST * r / size)
        v, omega = scale(sub(moved, away), 1.0 / dt), scale(sub(rotated, away_rotation), 1.0 / dt)
    set_vec(t.translation, moved)
    set_vec(t.rotation, rotated)
    set_vec(t.velocity, v)
    set_vec(t.angular_velocity, omega)
    return True


@noinline
def filter_tremor(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, recorded: Floats, dt: float
) -> bool:
    """Filter the recorded poses of the trees that grip something: into `SearchWorkspace.filtered`, if there are any.

    `roots` (T, 7), `angles` (Q,), `recorded` (B, 7): the recording; `dt`: s since the last step, 0 in the first. Returns whether
    there are any. None is filtered where there are simulated bodies, whose contact solve has friction.
    """
    some = False
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == SIMULATED:
            return False
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            some = _follow(scene, state, ws, tree, recorded, dt) or some
    if not some:
        return False
    filtered = ws.work.filtered
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0:
            continue
        copy_pose(roots, tree, filtered.roots, tree)
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            copy_pose(recorded, body, filtered.poses, body)
        t = state.tremor[tree]
        if vec_of(t.translation) == (0.0, 0.0, 0.0) and vec_of(t.rotation) == (0.0, 0.0, 0.0):
            continue
        centre, rotation = (
            link_centre(ws, recorded, ws.links.pivot[tree]),
            quat_from_rotation_vector(vec_of(t.rotation)),
        )
        p = add(add(centre, vec_of(t.translation)), quat_rotate(rotation, sub(position_of(roots, tree), centre)))
        set_pose(filtered.roots, tree, p, quat_unit(quat_mul(rotation, orientation_of(roots, tree))))
        pose_tree(scene, ws.origins, tree, filtered.roots, angles, filtered.poses)
    return True
