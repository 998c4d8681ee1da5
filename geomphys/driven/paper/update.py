"""The driven loop as published: coupling, detection, elimination, once a frame, at the frame's poses alone.

The coupling (6) acts on the offsets of roots and, as pseudo-magnetic attraction, on those of joints from their recorded
angles. Nothing between two frames is checked: a fast body passes through a thin one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.sweep import update_boxes
from geomphys.driven.coupling import relax_by, relaxation_of
from geomphys.driven.groups import INTERPOLATED, Outcome
from geomphys.driven.paper.chains import update_tree
from geomphys.driven.paper.descent import fit_cone
from geomphys.driven.paper.elimination import eliminate, overlaps_others
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.postures import copy_tree, is_recorded
from geomphys.driven.reach_cones import cone_limit
from geomphys.driven.state import NOT_STARTED, STARTED_FREE, DrivenState
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import dot, norm, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import pose_pieces_of_tree

Floats = NDArray[np.float64]

MOVED = 1e-7  # m: a tree that elimination moves by less keeps the speed of its offset
FASTEST = 1e12  # rad/s or m/s: a faster joint offset is none


@noinline
def take_recording(scene: Scene, state: DrivenState, w: PaperWorkspace, angles: Floats, recorded: Floats) -> None:
    """Limits of this frame, widened to the recorded angles (Q,); bodies that are not driven are posed as recorded (B, 7)."""
    for q in range(len(angles)):
        w.lower[q], w.upper[q] = min(scene.dofs.lower[q], angles[q]), max(scene.dofs.upper[q], angles[q])
    for cone in range(len(w.cone_limit)):
        w.cone_limit[cone] = cone_limit(scene, cone, angles)
    stand_around(scene, w, recorded)


@noinline
def stand_around(scene: Scene, w: PaperWorkspace, recorded: Floats) -> None:
    """Pose moving bodies that are not driven at `recorded` (B, 7)."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == DRIVEN:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            copy_pose(recorded, body, w.iterate.poses, body)
        pose_pieces_of_tree(scene, tree, w.iterate.poses, w.frames)
        update_boxes(scene, w.frames, w.detection.boxes, tree)


@noinline
def attract(
    scene: Scene, state: DrivenState, w: PaperWorkspace, tree: int, roots: Floats, angles: Floats, dt: float
) -> None:
    """Relax the offsets of a tree by (6) over `dt` [s] and set the iterate; without an offset it is the recording."""
    trees, relaxation = scene.trees, relaxation_of(scene.trees, tree, dt)
    copy_pose(roots, tree, w.iterate.roots, tree)
    for i in range(3):
        x, v = relax_by(relaxation, state.offset[tree, i], state.offset_velocity[tree, i])
        state.offset_velocity[tree, i] = v
        if x != 0.0:
            w.iterate.roots[tree, i] += x
    for q in range(trees.dof_start[tree], trees.dof_start[tree + 1]):
        offset, rate = state.last.angles[q] - state.recorded.angles[q], w.joint_rate[q]
        if not abs(rate) < FASTEST:
            rate = 0.0
        offset, w.joint_rate[q] = relax_by(relaxation, offset, rate)
        w.iterate.angles[q] = angles[q]
        if offset != 0.0:
            w.iterate.angles[q] = min(max(angles[q] + offset, w.lower[q]), w.upper[q])
    for cone in range(len(w.cone_limit)):
        if scene.bodies.tree[scene.cones.joints[scene.cones.joint_start[cone]]] == tree:
            fit_cone(scene, w, cone)
    update_tree(scene, w, tree)


@kernel
def store_tree_offsets(
    scene: Scene, state: DrivenState, w: PaperWorkspace, tree: int, roots: Floats, angles: Floats
) -> None:
    """Offsets of a tree at the iterate; a correction against the rate of its offset sets that rate to zero."""
    path = sub(vec_at(w.iterate.roots, tree), vec_at(w.target.roots, tree))
    size = norm(path)
    against = dot(vec_at(state.offset_velocity, tree), path) / size if size > MOVED else 0.0
    for i in range(3):
        if against < 0.0:
            state.offset_velocity[tree, i] -= against * path[i] / size
        state.offset[tree, i] = w.iterate.roots[tree, i] - roots[tree, i]
        state.last_offset_velocity[tree, i] = state.offset_velocity[tree, i]
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        if w.joint_rate[q] * (w.iterate.angles[q] - w.target.angles[q]) < 0.0:
            w.joint_rate[q] = 0.0
    copy_tree(scene, w.iterate, tree, state.last)


@noinline
def store_offsets(
    scene: Scene, state: DrivenState, w: PaperWorkspace, roots: Floats, angles: Floats, recorded: Floats
) -> None:
    """Take the iterate as the result of the frame, and store the recording."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            store_tree_offsets(scene, state, w, tree, roots, angles)
            update_boxes(scene, w.frames, w.detection.boxes, tree)
            if not overlaps_others(w, tree):
                copy_tree(scene, w.iterate, tree, w.free)
                w.has_free[tree] = 1
        if not is_recorded(scene, tree):
            continue
        copy_pose(roots, tree, state.recorded.roots, tree)
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            state.recorded.angles[q] = angles[q]
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(7):
                state.recorded.poses[body, k] = recorded[body, k]
                if scene.trees.role[tree] != DRIVEN:
                    state.last.poses[body, k] = recorded[body, k]


@noinline
def update_driven_as_published(
    scene: Scene, state: DrivenState, w: PaperWorkspace, roots: Floats, angles: Floats, recorded: Floats, dt: float
) -> Outcome:
    """Couple the driven trees to this frame's recording and eliminate their overlaps; see `update_driven`."""
    take_recording(scene, state, w, angles, recorded)
    first = state.progress.start == NOT_STARTED
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            attract(scene, state, w, tree, roots, angles, 0.0 if first else dt)
    done = eliminate(scene, w, state.progress.updates)
    store_offsets(scene, state, w, roots, angles, recorded)
    state.progress.start = STARTED_FREE
    state.progress.updates += 1
    for tree in range(len(w.interpolated)):
        if w.interpolated[tree] == 1:
            state.method[tree] = INTERPOLATED
    return Outcome(done.passes, done.interpolations, done.overlap == 0.0, False)


@noinline
def separate_as_published(scene: Scene, state: DrivenState, w: PaperWorkspace, recorded: Floats) -> int:
    """Move driven trees out of what has moved into them since; see `separate_driven`."""
    stand_around(scene, w, recorded)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            copy_tree(scene, state.last, tree, w.iterate)
    done = eliminate(scene, w, state.progress.updates)
    store_offsets(scene, state, w, state.recorded.roots, state.recorded.angles, recorded)
    return done.passes
