"""Goals of the coupling: the posture of each driven tree nearest to its targets, collisions ignored; limits, branches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.constraints import add_cones, bound_unknowns, number_unknowns, set_cone_limits
from geomphys.driven.least_distance import SOLVED
from geomphys.driven.objective import assemble
from geomphys.driven.postures import Posture, copy_tree
from geomphys.driven.qp import solve_quadratic
from geomphys.driven.starts import JUMP, moved_as_recorded, unwrapped_change
from geomphys.driven.state import (
    GENERAL_MOTION,
    LOCKED,
    PRESCRIBED,
    STARTED_FREE,
    TRANSLATION,
    DrivenState,
    DrivenWorkspace,
)
from geomphys.driven.stepping import copy_unlocked, is_within, step_to_trial
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import quat_rotate, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

FIT_ITERATIONS = 8
FIT_RADIUS = 0.1  # m
FITTED = 1e-7  # m


@noinline
def set_joint_limits(scene: Scene, state: DrivenState, ws: DrivenWorkspace, angles: Floats) -> None:
    """Limits of joints, widened to recorded and present values; and extrapolated angles."""
    work, last = ws.work, state.last.angles
    for q in range(len(angles)):
        work.low[q] = min(scene.dofs.lower[q], angles[q])
        work.high[q] = max(scene.dofs.upper[q], angles[q])
        work.extrapolated[q] = angles[q]
        work.used_low[q] = min(state.used_low[q], angles[q]) - ws.weights.stretch
        work.used_high[q] = max(state.used_high[q], angles[q]) + ws.weights.stretch
        if state.progress.start == STARTED_FREE:
            change = unwrapped_change(ws, q, angles[q] - state.recorded.angles[q])
            work.extrapolated[q] = min(max(last[q] + change, work.low[q]), work.high[q])
        if state.prescription[scene.dofs.tree[q]] == PRESCRIBED:  # the contact solve has set its posture
            work.extrapolated[q] = min(max(state.prescribed_posture.angles[q], work.low[q]), work.high[q])


@noinline
def _fit(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, roots: Floats, angles: Floats) -> bool:
    """Fit a tree with joint offsets, in `goal`, to its targets, collisions ignored; returns whether its links are posed too."""
    work, goal, target = ws.work, ws.work.goal, ws.work.target
    root = scene.trees.body_start[tree]
    if scene.trees.body_start[tree + 1] == root + 1:
        q = orientation_of(target, root)
        set_pose(goal.roots, tree, sub(position_of(target, root), quat_rotate(q, vec_at(ws.links.centre, root))), q)
        return False
    for other in range(len(work.mobility)):
        work.mobility[other] = GENERAL_MOTION if other == tree else LOCKED
    copy_tree(scene, state.last, tree, work.iterate)
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        work.iterate.angles[j] = work.extrapolated[j]
    p, q = moved_as_recorded(state, ws, tree, roots)
    set_pose(work.iterate.roots, tree, p, q)
    pose_tree(scene, ws.origins, tree, work.iterate.roots, work.iterate.angles, work.iterate.poses)
    set_cone_limits(scene, ws, angles)
    last = 0.0
    for _ in range(FIT_ITERATIONS):
        n = number_unknowns(scene, ws)
        assemble(scene, ws, work.iterate, False)
        bound_unknowns(scene, ws, work.iterate, FIT_RADIUS, True)
        m = add_cones(scene, ws, work.iterate, 0, n)
        if solve_quadratic(ws.problem, n, m)[0] != SOLVED:
            break
        far = step_to_trial(scene, ws)
        copy_unlocked(scene, ws, work.trial, work.iterate)
        if is_within(FITTED, far, last):
            break
        last = far
    copy_tree(scene, work.iterate, tree, goal)
    return True


@kernel
def choose_branch(scene: Scene, ws: DrivenWorkspace, tree: int, angles: Floats, posture: Posture) -> bool:
    """Of equivalent angles (multiples of 2π apart) within limits, take the nearest to the recorded ones; whether any change."""
    changed = False
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        revolutions = math.floor((angles[q] - posture.angles[q]) / (2.0 * math.pi) + 0.5)
        there = posture.angles[q] + revolutions * 2.0 * math.pi
        if ws.links.periodic[q] == 1 and revolutions != 0.0 and ws.work.low[q] <= there <= ws.work.high[q]:
            posture.angles[q], changed = there, True
    return changed


@noinline
def set_goals(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> None:
    """Goal of every driven tree by the coupling, posed."""
    work = ws.work
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        posed = False
        copy_pose(roots, tree, work.goal.roots, tree)
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            work.goal.angles[q] = angles[q]
        if state.prescription[tree] == PRESCRIBED:
            copy_tree(scene, state.prescribed_posture, tree, work.goal)
        elif state.general_motion[tree] == 1:
            posed = _fit(scene, state, ws, tree, roots, angles)
            posed = not choose_branch(scene, ws, tree, angles, work.goal) and posed
        else:
            for i in range(3):
                if state.offset[tree, i] != 0.0:  # -0.0 + 0.0 would be 0.0
                    work.goal.roots[tree, i] += state.offset[tree, i]
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            is_steady = abs(work.goal.angles[q] - work.extrapolated[q]) <= JUMP  # else it is on another branch
            work.preferred[q] = work.goal.angles[q] if is_steady else work.extrapolated[q]
        if not posed:
            pose_tree(scene, ws.origins, tree, work.goal.roots, work.goal.angles, work.goal.poses)
        pose_pieces_of_tree(scene, tree, work.goal.poses, ws.piece_frames.frames)
    for tree in range(len(scene.trees.role)):
        work.mobility[tree] = TRANSLATION if scene.trees.role[tree] == DRIVEN else LOCKED
