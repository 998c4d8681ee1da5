"""The driven loop of a frame: one problem for each group of trees that may collide.

The coupling relaxes the offsets of the last frame, which gives the target of every link. A tree whose goal is free, and can
be reached, goes there. The others are solved in groups that may collide: from a free start nearest to the targets
(`starts`), by sequential quadratic programming with every step certified (`sqp`). A rigid tree is first only translated;
where that is too far, or does not free it, or where its fingers close on something (`grips`), its joints and rotation may
change too, at a much higher weight. Where moving surroundings leave no free start, the step is divided in parts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import approximate_separation
from geomphys.collision.sweep import update_boxes
from geomphys.driven.constraints import is_unlocked_pair
from geomphys.driven.contacts_kept import drop_touches
from geomphys.driven.goals import set_goals, set_joint_limits
from geomphys.driven.grips import find_grips, update_mean_tips
from geomphys.driven.groups import (
    MAX_ITERATIONS,
    Outcome,
    combine,
    keep_posed,
    pose_surroundings,
    search_from_free_position,
    set_final_posture,
    solve_first,
    solve_group,
)
from geomphys.driven.objective import is_rigid, link_centre
from geomphys.driven.postures import copy_tree
from geomphys.driven.reachability import measure_swept_pairs, path_of_pair_is_free
from geomphys.driven.sqp import ANY_PATH, Found, search
from geomphys.driven.state import (
    GENERAL_MOTION,
    LOCKED,
    NEVER_FREE,
    PRESCRIBED,
    STARTED_FREE,
    TRANSLATION,
    WAS_PRESCRIBED,
    DrivenState,
    DrivenWorkspace,
)
from geomphys.driven.stepping import measure_near_pairs, pose_unlocked_pieces
from geomphys.driven.targets import clear_offsets, find_recorded_motion, set_link_targets, store_offsets
from geomphys.driven.tremor import filter_tremor
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, pose_tree, set_pose

Floats = NDArray[np.float64]


@kernel
def _is_blocked_again(scene: Scene, ws: DrivenWorkspace) -> bool:
    """Whether the only driven tree overlaps at its goal where it did most when last it was not free: to know saves time."""
    driven, a, b = 0, ws.work.counts.overlap_a, ws.work.counts.overlap_b
    for tree in range(len(scene.trees.role)):
        driven += int(scene.trees.role[tree] == DRIVEN)
    if driven != 1 or a == b or ws.work.ignored[scene.bodies.tree[scene.pieces.body[b]]] == 1:
        return False
    frames, detection = ws.piece_frames.frames, ws.detection
    s, _ = approximate_separation(scene.pieces, frames, a, b, 0.0, detection.axes, detection.scratch)
    return s < 0.0


@noinline
def _go_where_free(scene: Scene, state: DrivenState, ws: DrivenWorkspace) -> bool:
    """Set the trees whose goals are free and reachable, put the others back and group them; whether there are any."""
    work, near = ws.work, ws.near
    some = _is_blocked_again(scene, ws)
    for tree in range(len(work.mobility)):
        work.blocked[tree], work.group[tree] = int(some and scene.trees.role[tree] == DRIVEN), tree
    if some:
        near.counts.filled = 0
    else:
        measure_swept_pairs(scene, ws, work.goal)
    deepest = 0.0
    for k in range(near.counts.filled):
        if near.separation[k] < deepest and is_unlocked_pair(ws, k):
            deepest, work.counts.overlap_a, work.counts.overlap_b = near.separation[k], near.a[k], near.b[k]
        if not is_unlocked_pair(ws, k) or (work.blocked[near.tree_a[k]] == 1 and work.blocked[near.tree_b[k]] == 1):
            continue
        if near.separation[k] < 0.0 or not path_of_pair_is_free(scene, ws, work.goal, k):
            work.blocked[near.tree_a[k]] = work.blocked[near.tree_b[k]] = 1
            some = True
    changed = some
    while changed:  # trees that may collide with one that is stopped
        changed = False
        for k in range(near.counts.filled):
            a, b = near.tree_a[k], near.tree_b[k]
            if scene.trees.role[b] != DRIVEN or work.blocked[a] + work.blocked[b] == 0:
                continue
            if work.blocked[a] + work.blocked[b] == 1 or work.group[a] != work.group[b]:
                work.blocked[a] = work.blocked[b] = 1
                work.group[a] = work.group[b] = min(work.group[a], work.group[b])
                changed = True
    several, first = False, -1
    for tree in range(len(work.mobility)):
        if scene.trees.role[tree] == DRIVEN and work.blocked[tree] == 1:
            first = work.group[tree] if first < 0 else first
            several = several or work.group[tree] != first
    for tree in range(len(work.mobility)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        if work.blocked[tree] == 0:
            keep_posed(scene, state, ws, tree, work.goal)  # `measure_swept_pairs` has posed it there
        else:
            for target in (work.iterate, work.trial, work.start, work.best):
                copy_tree(scene, work.before, tree, target)
            pose_tree(scene, ws.origins, tree, work.before.roots, work.before.angles, work.before.poses)
            if several:  # a group that is solved alone is posed where it is solved
                pose_pieces_of_tree(scene, tree, work.before.poses, ws.piece_frames.frames)
                update_boxes(scene, ws.piece_frames.frames, ws.detection.boxes, tree)
    return some


@noinline
def update_driven(
    scene: Scene,
    state: DrivenState,
    ws: DrivenWorkspace,
    roots: Floats,
    angles: Floats,
    recorded: Floats,
    dt: float,
    gap: float,
) -> Outcome:
    """Couple the driven trees to this frame's recording and keep them out of everything.

    Parameters
    ----------
    scene
        The scene.
    state, ws
        State, updated (`state.last` is the corrected posture), and workspace (`ws.piece_frames.frames`: the
        final frames). Bodies that are not driven are at `state.last.poses` before the step.
    roots, angles, recorded
        (T, 7), (Q,), (B, 7): the recording of this frame and its forward kinematics; of simulated bodies the poses they
        are to have.
    dt
        s since the last step.
    gap
        m; clearance kept.
    """
    for tree in range(len(scene.trees.role)):
        if state.prescription[tree] == PRESCRIBED:
            drop_touches(scene, ws, tree)
        if scene.trees.moving[tree] == 1:
            copy_tree(scene, state.last, tree, ws.work.before)
    if filter_tremor(scene, state, ws, roots, angles, recorded, dt):
        filtered = ws.work.filtered
        return _update(scene, state, ws, filtered.roots, angles, filtered.poses, dt, gap)
    return _update(scene, state, ws, roots, angles, recorded, dt, gap)


@noinline
def _update(
    scene: Scene,
    state: DrivenState,
    ws: DrivenWorkspace,
    roots: Floats,
    angles: Floats,
    recorded: Floats,
    dt: float,
    gap: float,
) -> Outcome:
    """`update_driven` to goals whose tremor is filtered; postures at the start of the step are in `SearchWorkspace.before`."""
    work, first = ws.work, state.progress.start != STARTED_FREE
    state.progress.dt = 0.0 if first else dt
    if first:
        for tree in range(len(scene.trees.role)):
            if scene.trees.role[tree] == DRIVEN:
                clear_offsets(scene, state, tree)
    set_joint_limits(scene, state, ws, angles)
    set_link_targets(scene, state, ws, recorded, 0.0 if first else dt)
    if first:
        for tree in range(len(scene.trees.role)):
            if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
                for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                    copy_pose(recorded, body, work.before.poses, body)
    pose_surroundings(scene, state, ws, recorded, 1.0)
    set_goals(scene, state, ws, roots, angles)
    find_grips(scene, state, ws, recorded)
    done = Outcome(0, 0, True, False)
    update_mean_tips(scene, state, ws, recorded, math.inf if first else dt)
    if first:
        for tree in range(len(scene.trees.role)):
            if scene.trees.role[tree] == DRIVEN:
                copy_tree(scene, work.goal, tree, work.before)
        done = solve_first(scene, state, ws, angles, gap)
    elif _go_where_free(scene, state, ws):
        for group in range(len(scene.trees.role)):
            if scene.trees.role[group] != DRIVEN or work.blocked[group] == 0 or work.group[group] != group:
                continue
            done = combine(done, solve_group(scene, state, ws, group, roots, angles, recorded, gap))
    _finish(scene, state, ws)
    store_offsets(scene, state, ws, roots, angles, recorded)
    state.progress.updates += 1
    state.progress.start = NEVER_FREE if first and not done.converged else STARTED_FREE
    shape_changed = done.shape_changed
    for tree in range(len(scene.trees.role)):
        if state.general_motion[tree] == 0 and state.prescription[tree] == WAS_PRESCRIBED:
            state.prescription[tree] = 0
        shape_changed = shape_changed or (
            state.general_motion[tree] == 1 and state.prescription[tree] == 0 and is_rigid(scene, tree)
        )
    return Outcome(done.iterations, done.fallbacks, done.converged, shape_changed)


@kernel
def _finish(scene: Scene, state: DrivenState, ws: DrivenWorkspace) -> None:
    """Store the poses of bodies that are not driven."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                copy_pose(ws.work.iterate.poses, body, state.last.poses, body)


@kernel
def _start_at_present(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, mobility: int) -> None:
    """Start the search for a driven tree, which may move by `mobility`, at its present posture, which is also its target."""
    work = ws.work
    work.mobility[tree] = LOCKED
    if scene.trees.role[tree] != DRIVEN:
        return
    work.mobility[tree] = mobility
    copy_tree(scene, state.last, tree, work.iterate)
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        q = orientation_of(state.last.poses, body)
        set_pose(work.target, body, link_centre(ws, state.last.poses, body), q)


@noinline
def separate_driven(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats, gap: float) -> int:
    """Move driven trees out of what has moved into them since `update_driven`, by the least motion; returns the iterations.

    `recorded` (B, 7): present poses of bodies that are not driven, recorded poses of those that are.
    """
    work, iterations, found = ws.work, 0, Found(False, 0, False, False)
    angles = state.recorded.angles
    pose_surroundings(scene, state, ws, recorded, 1.0)
    for tree in range(len(work.mobility)):
        _start_at_present(scene, state, ws, tree, TRANSLATION)
    if measure_near_pairs(scene, ws, 0.0, 0.0) < 0.0:
        for mobility in (TRANSLATION, GENERAL_MOTION):  # a grip from several sides has to open its joints
            if not found.free:
                for tree in range(len(work.mobility)):
                    _start_at_present(scene, state, ws, tree, mobility)
                pose_unlocked_pieces(scene, ws, work.iterate)
                found = search(scene, ws, angles, gap, MAX_ITERATIONS, False, ANY_PATH)
                iterations += found.iterations
        if not found.free:
            found = search_from_free_position(scene, ws, angles, gap)
            iterations += found.iterations
        for tree in range(len(work.mobility)):
            if work.mobility[tree] != LOCKED:
                set_final_posture(scene, state, ws, tree, work.best if found.free else state.last)
    _finish(scene, state, ws)
    for tree in range(len(work.mobility)):
        if scene.trees.role[tree] == DRIVEN:
            find_recorded_motion(scene, state, ws, tree, recorded)
    store_offsets(scene, state, ws, state.recorded.roots, state.recorded.angles, recorded)
    return iterations
