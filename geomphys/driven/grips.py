"""Rigid hands that close on something: their shape changes, instead of the whole hand leaving what it grasps.

A hand that is moved into a surface is translated out of it with its recorded shape. A fingertip that the joints have moved
into something stops there instead. How far they have moved it is how far it is, in the frame of the palm, from the exponential
mean of its recorded positions with the time constant `MEMORY`: a speed, at every frame rate. Fingertips that close more slowly
count once they are inside something from opposing sides: no translation but one off it frees them all.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.objective import is_rigid, link_centre
from geomphys.driven.state import DrivenState, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import add_vec, vec_at, vec_of
from geomphys.numerics.vec3 import Vec, dot, quat_conjugate, quat_mul, quat_rotate, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, position_of

Floats = NDArray[np.float64]

MEMORY = 0.1  # s
OPPOSING = -0.5  # cosine of the normals of contacts on opposing sides


@kernel
def _beside_palm(ws: DrivenWorkspace, poses: Floats, tip: int) -> Vec:
    """Centre of a fingertip in the frame of its palm."""
    palm = ws.links.palm[tip]
    return quat_rotate(
        quat_conjugate(orientation_of(poses, palm)), sub(link_centre(ws, poses, tip), position_of(poses, palm))
    )


@noinline
def update_mean_tips(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats, dt: float) -> None:
    """Update the mean positions of the fingertips of rigid trees.

    `recorded` (B, 7): recorded poses; `dt`: s since the last step, infinite in the first.
    """
    gain = 1.0 - math.exp(-dt / MEMORY)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN or not is_rigid(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            if ws.links.tip[body] == 1:
                path = sub(_beside_palm(ws, recorded, body), vec_at(state.mean_tip, body))
                add_vec(state.mean_tip[body], path, gain)


@kernel
def _advances(ws: DrivenWorkspace, before: Floats, after: Floats, touch: Record) -> bool:
    """Whether a fingertip goes deeper into what it touches, from poses `before` to `after` (B, 7)."""
    tip, other = touch.tip, touch.body
    rotation = quat_mul(orientation_of(after, other), quat_conjugate(orientation_of(before, other)))
    from_other = sub(link_centre(ws, before, tip), position_of(before, other))
    path = sub(sub(link_centre(ws, after, tip), position_of(after, other)), quat_rotate(rotation, from_other))
    return bool(dot(path, vec_of(touch.normal)) < 0.0)


@kernel
def _closes(ws: DrivenWorkspace, state: DrivenState, recorded: Floats, touch: Record) -> bool:
    """Whether joints have moved a fingertip more than `Weights.grip_depth` into what it touches, and it goes deeper."""
    path = sub(_beside_palm(ws, recorded, touch.tip), vec_at(state.mean_tip, touch.tip))
    path = quat_rotate(orientation_of(recorded, ws.links.palm[touch.tip]), path)
    closed = -dot(path, vec_of(touch.normal)) > ws.weights.grip_depth
    return bool(closed and _advances(ws, state.recorded.poses, recorded, touch))


@noinline
def find_grips(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats) -> None:
    """Find the rigid trees that close on something: into `SearchWorkspace.grips`, and whose joints stop together: `stopped`.

    Only fingertips recorded more than `Weights.grip_depth` inside something count; `recorded` (B, 7): recorded poses. A rigid
    tree that has gripped counts as gripping until its shape is that of the recording again.
    """
    work, deep = ws.work, -ws.weights.grip_depth
    for tree in range(len(work.grips)):
        work.grips[tree] = 0
    for i in range(work.counts.touches):
        touch = work.touches[i]
        tree = scene.bodies.tree[touch.tip]
        if touch.gap > deep or not is_rigid(scene, tree):
            continue
        for j in range(i):
            other = work.touches[j]
            if other.gap > deep or scene.bodies.tree[other.tip] != tree:
                continue
            if dot(vec_of(touch.normal), vec_of(other.normal)) < OPPOSING:
                work.grips[tree] = 1
        if _closes(ws, state, recorded, touch):
            work.grips[tree] = 1
    for tree in range(len(work.grips)):
        if work.grips[tree] == 1:
            state.has_gripped[tree] = 1
        elif state.general_motion[tree] == 0:
            state.has_gripped[tree] = 0
        work.stopped[tree] = max(work.grip[tree], 1.0 * state.has_gripped[tree])
