"""Solves groups of trees that may collide: how each may move, starts of the search, and fallbacks if nothing is free."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.sweep import update_boxes
from geomphys.driven.depenetration import find_depenetration
from geomphys.driven.goals import choose_branch
from geomphys.driven.objective import is_rigid
from geomphys.driven.postures import Posture, copy_tree, is_recorded
from geomphys.driven.reachability import FREE, clear_pairs, judge, list_pairs, measure_drift, measure_swept_pairs
from geomphys.driven.sqp import ANY_PATH, EVERY_STEP, STRAIGHT, Found, search
from geomphys.driven.starts import choose_shallowest, choose_start
from geomphys.driven.state import GENERAL_MOTION, LOCKED, STARTED_FREE, TRANSLATION, DrivenState, DrivenWorkspace
from geomphys.driven.stepping import copy_unlocked, pose_unlocked, pose_unlocked_pieces
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import norm, slerp, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import (
    copy_tree_frames,
    orientation_of,
    pose_pieces_of_tree,
    pose_tree,
    position_of,
    set_pose,
)

Floats = NDArray[np.float64]

MAX_ITERATIONS = 25  # iterations of a search
TRANSLATION_ITERATIONS = 14  # iterations where trees are only translated
FIRST_ITERATIONS = 60  # iterations of that of the first frame
PARTS = 32  # least parts of a step that is divided, as no start is free
LARGEST_PART = 8  # of these, how many are taken at once at first
GLOBAL, LEAST_DISTANCE, INTERPOLATED = 0, 1, 2  # methods, in the order of results.METHODS


class Outcome(NamedTuple):
    """Result of the driven loop in a frame."""

    iterations: int
    fallbacks: int  # steps divided into parts, and depenetration searches
    converged: bool
    shape_changed: bool  # a rigid tree changed its shape or rotation


@kernel
def combine(a: Outcome, b: Outcome) -> Outcome:
    """The result of two groups, or of two substeps."""
    return Outcome(
        a.iterations + b.iterations,
        a.fallbacks + b.fallbacks,
        a.converged and b.converged,
        a.shape_changed or b.shape_changed,
    )


@noinline
def keep_posed(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, source: Posture) -> None:
    """Set the final posture of a driven tree at which its pieces and their boxes are; other trees are then kept clear of it."""
    work = ws.work
    for target in (state.last, work.before, work.iterate, work.trial, work.start, work.best):
        copy_tree(scene, source, tree, target)
    copy_tree_frames(scene, tree, ws.piece_frames.frames, ws.piece_frames.before)


@noinline
def set_final_posture(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, source: Posture) -> None:
    """Set the final posture of a driven tree, and pose its pieces."""
    pose_pieces_of_tree(scene, tree, source.poses, ws.piece_frames.frames)
    update_boxes(scene, ws.piece_frames.frames, ws.detection.boxes, tree)
    keep_posed(scene, state, ws, tree, source)


@kernel
def store_method(state: DrivenState, tree: int, fallbacks: int) -> None:
    """Store by which method a tree was freed: of a frame's substeps that of the highest number."""
    state.method[tree] = max(state.method[tree], LEAST_DISTANCE if fallbacks == 0 else INTERPOLATED)


@noinline
def pose_surroundings(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats, fraction: float) -> None:
    """Pose moving bodies that are not driven at a fraction of their path through the step, and all pieces at its start."""
    work, p = ws.work, ws.piece_frames
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 1:
            pose_pieces_of_tree(scene, tree, work.before.poses, p.before)
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == DRIVEN:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            at, q = position_of(recorded, body), orientation_of(recorded, body)
            if fraction < 1.0:
                from_at, from_q = position_of(state.last.poses, body), orientation_of(state.last.poses, body)
                q = slerp(from_q, q, fraction)
                at = (
                    from_at[0] + fraction * (at[0] - from_at[0]),
                    from_at[1] + fraction * (at[1] - from_at[1]),
                    from_at[2] + fraction * (at[2] - from_at[2]),
                )
            for posture in (work.iterate, work.trial, work.start, work.best, work.goal):
                set_pose(posture.poses, body, at, q)
        pose_pieces_of_tree(scene, tree, work.iterate.poses, p.frames)
        update_boxes(scene, p.frames, ws.detection.boxes, tree)
    measure_drift(scene, ws, work.before.poses, work.iterate.poses)
    clear_pairs(ws)


@noinline
def choose_mobility(scene: Scene, state: DrivenState, ws: DrivenWorkspace, group: int, general_motion: bool) -> bool:
    """Choose how the trees of a group may move; whether some of them are only translated."""
    work, translated = ws.work, False
    for tree in range(len(work.mobility)):
        work.mobility[tree] = LOCKED
        if scene.trees.role[tree] != DRIVEN or work.blocked[tree] == 0 or work.group[tree] != group:
            continue
        if general_motion or not is_rigid(scene, tree) or state.general_motion[tree] == 1 or work.grips[tree] == 1:
            work.mobility[tree] = GENERAL_MOTION
        else:
            work.mobility[tree], translated = TRANSLATION, True
    return translated


@kernel
def is_translated_too_far(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats) -> bool:
    """Whether a rigid hand is translated farther than its recorded depth allows, or by too much in one frame."""
    work, w = ws.work, ws.weights
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != TRANSLATION or scene.trees.dof_start[tree + 1] == scene.trees.dof_start[tree]:
            continue
        offset = sub(vec_at(work.best.roots, tree), vec_at(roots, tree))
        limit = min(max(w.translation_of_depth * work.depth[tree], w.least_translation), w.most_translation)
        if norm(sub(offset, vec_at(state.offset, tree))) > limit:
            return True
        last = sub(vec_at(state.last.roots, tree), vec_at(state.recorded.roots, tree))
        if state.progress.start == STARTED_FREE and norm(sub(offset, last)) > work.translation_limit[tree]:
            return True
    return False


@noinline
def _search_straight(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float) -> Found:
    """Search from the free start in `SearchWorkspace.iterate`, whose links are posed; its result must be reachable straight from
    the start of the step.

    Only where that fails is it required in every pass.
    """
    work = ws.work
    copy_unlocked(scene, ws, work.iterate, work.start)
    pose_unlocked_pieces(scene, ws, work.iterate)
    found = search(scene, ws, angles, gap, MAX_ITERATIONS, True, EVERY_STEP)
    for tree in range(len(work.mobility)):
        if work.mobility[tree] == TRANSLATION:  # poses that were added to differ from those of the posture by rounding
            pose_tree(scene, ws.origins, tree, work.best.roots, work.best.angles, work.best.poses)
    pose_unlocked_pieces(scene, ws, work.best)
    if judge(scene, ws, work.best) == FREE:
        return found
    copy_unlocked(scene, ws, work.start, work.iterate)
    pose_unlocked_pieces(scene, ws, work.iterate)
    again = search(scene, ws, angles, gap, MAX_ITERATIONS, True, STRAIGHT)
    return Found(again.free, found.iterations + again.iterations, again.converged, again.rate_limited)


@noinline
def _attempt(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, gap: float, translated: bool
) -> Found:
    """Search from a free start, or for translated trees from an overlapping one if its result can be reached."""
    work, iterations = ws.work, 0
    if not choose_start(scene, state, ws, roots, angles):
        if not translated:
            return Found(False, 0, False, False)
        choose_shallowest(scene, state, ws, roots, angles)
        pose_unlocked(scene, ws, work.iterate)
        relaxed = search(scene, ws, angles, gap, TRANSLATION_ITERATIONS, False, ANY_PATH)
        iterations = relaxed.iterations
        if not relaxed.free:
            return relaxed
        copy_unlocked(scene, ws, work.best, work.iterate)
        pose_unlocked(scene, ws, work.iterate)
        if judge(scene, ws, work.iterate) != FREE:
            return Found(False, iterations, False, False)
    found = _search_straight(scene, ws, angles, gap)
    return Found(found.free, found.iterations + iterations, found.converged, found.rate_limited)


@noinline
def _separate_after_part(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float) -> Found:
    """Move the trees out of what has moved slightly into them in a part of a step."""
    work = ws.work
    copy_unlocked(scene, ws, work.before, work.iterate)
    pose_unlocked(scene, ws, work.iterate)
    return search(scene, ws, angles, gap, MAX_ITERATIONS, False, EVERY_STEP)


@kernel
def _move_before(scene: Scene, ws: DrivenWorkspace) -> None:
    """Set the start of the next part for bodies that are not driven to their present poses."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                copy_pose(ws.work.iterate.poses, body, ws.work.before.poses, body)
            copy_tree_frames(scene, tree, ws.piece_frames.frames, ws.piece_frames.before)


@noinline
def _in_parts(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, recorded: Floats, gap: float
) -> tuple[bool, int]:
    """Move the surroundings of a group in parts of the step, and the group with them: (whether it is free, iterations).

    Parts are halved from where one is not solved.
    """
    work, iterations, done, part = ws.work, 0, 0, LARGEST_PART
    while done < PARTS and part > 0:
        end = min(done + part, PARTS)
        pose_surroundings(scene, state, ws, recorded, end / PARTS)
        list_pairs(scene, ws)
        found = _attempt(scene, state, ws, roots, angles, gap, False)
        iterations += found.iterations
        if not found.free:
            found = _separate_after_part(scene, ws, angles, gap)
            iterations += found.iterations
        if not found.free:
            part //= 2
            continue
        copy_unlocked(scene, ws, work.best, work.before)
        _move_before(scene, ws)
        done = end
    if done == PARTS:
        return True, iterations
    for tree in range(len(work.mobility)):
        if is_recorded(scene, tree) and (work.mobility[tree] != LOCKED or scene.trees.role[tree] != DRIVEN):
            copy_tree(scene, state.last, tree, work.before)
    pose_surroundings(scene, state, ws, recorded, 1.0)
    return False, iterations


@noinline
def search_from_free_position(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float) -> Found:
    """Depenetration of the trees being solved, and a search from there, into `best`, with every step certified.

    It is to positions that can be reached; past what closes on the trees if none can.
    """
    work = ws.work
    for certified in (True, False):
        copy_unlocked(scene, ws, work.before, work.iterate)
        pose_unlocked(scene, ws, work.iterate)
        if find_depenetration(scene, ws, gap, certified):
            copy_unlocked(scene, ws, work.best, work.iterate)
            pose_unlocked(scene, ws, work.iterate)
            return search(scene, ws, angles, gap, MAX_ITERATIONS, False, EVERY_STEP)
    return Found(False, 0, False, False)


@noinline
def solve_group(
    scene: Scene,
    state: DrivenState,
    ws: DrivenWorkspace,
    group: int,
    roots: Floats,
    angles: Floats,
    recorded: Floats,
    gap: float,
) -> Outcome:
    """Find the posture of the trees of a group."""
    work = ws.work
    translated = choose_mobility(scene, state, ws, group, False)
    list_pairs(scene, ws)
    found = _attempt(scene, state, ws, roots, angles, gap, translated)
    iterations, fallbacks = found.iterations, 0
    if translated and (not found.free or is_translated_too_far(scene, state, ws, roots)):
        choose_mobility(scene, state, ws, group, True)
        found = _attempt(scene, state, ws, roots, angles, gap, False)
        iterations += found.iterations
    converged = found.converged
    if not found.free:
        fallbacks = 1
        free, more = _in_parts(scene, state, ws, roots, angles, recorded, gap)
        iterations += more
        converged = free
        if not free:
            fallbacks += 1
            for tree in range(len(work.mobility)):
                work.deviation_limit[tree] = math.inf
            found = search_from_free_position(scene, ws, angles, gap)
            iterations, converged = iterations + found.iterations, found.free
        for tree in range(len(work.mobility)):  # the next group has the whole step before it
            if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
                copy_tree(scene, state.last, tree, work.before)
        pose_surroundings(scene, state, ws, recorded, 1.0)
    shape_changed = False
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != LOCKED:
            shape_changed = shape_changed or (work.mobility[tree] == GENERAL_MOTION and is_rigid(scene, tree))
            work.blocked[tree] = 0
            changed = choose_branch(scene, ws, tree, angles, work.best)
            if changed or fallbacks > 0 or work.mobility[tree] == TRANSLATION:
                pose_tree(scene, ws.origins, tree, work.best.roots, work.best.angles, work.best.poses)
            set_final_posture(scene, state, ws, tree, work.best)
            store_method(state, tree, fallbacks)
    return Outcome(iterations, fallbacks, converged, shape_changed)


@noinline
def _set_joints_to_zero(scene: Scene, ws: DrivenWorkspace, source: Posture, target: Posture) -> None:
    """Copy the trees of the group with joints at zero, or as near as limits allow: links that overlap there never collide."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] == LOCKED:
            continue
        copy_tree(scene, source, tree, target)
        if ws.work.mobility[tree] == GENERAL_MOTION:
            for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                target.angles[q] = min(max(0.0, ws.work.low[q]), ws.work.high[q])
            pose_tree(scene, ws.origins, tree, target.roots, target.angles, target.poses)


@noinline
def _search_outside(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float, joints_at_zero: bool) -> Found:
    """Search of the first frame from outside of everything: trees whose links do not overlap each other are translated there.

    The links are first parted by a search among themselves, or stand with their `joints_at_zero`.
    """
    work, parted = ws.work, Found(True, 0, True, False)
    copy_unlocked(scene, ws, work.goal, work.iterate)
    if joints_at_zero:
        _set_joints_to_zero(scene, ws, work.goal, work.iterate)
        pose_unlocked(scene, ws, work.iterate)
    else:
        pose_unlocked(scene, ws, work.iterate)
        for tree in range(len(work.mobility)):
            work.ignored[tree] = int(work.mobility[tree] == LOCKED)
        parted = search(scene, ws, angles, gap, FIRST_ITERATIONS, False, ANY_PATH)
        for tree in range(len(work.mobility)):
            work.ignored[tree] = 0
        copy_unlocked(scene, ws, work.best, work.iterate)
        pose_unlocked(scene, ws, work.iterate)
    if not parted.free or not find_depenetration(scene, ws, gap, False):
        copy_unlocked(scene, ws, work.iterate, work.best)
        return Found(False, parted.iterations, False, False)
    copy_unlocked(scene, ws, work.best, work.iterate)
    pose_unlocked(scene, ws, work.iterate)
    found = search(scene, ws, angles, gap, FIRST_ITERATIONS, False, ANY_PATH)
    return Found(found.free, parted.iterations + found.iterations, found.converged, found.rate_limited)


@noinline
def solve_first(scene: Scene, state: DrivenState, ws: DrivenWorkspace, angles: Floats, gap: float) -> Outcome:
    """The first frame: without earlier motion any free posture near the recorded one is valid."""
    work, iterations, fallbacks = ws.work, 0, 0
    for tree in range(len(work.mobility)):
        work.deviation_limit[tree] = math.inf
    measure_swept_pairs(scene, ws, work.goal)
    for tree in range(len(work.mobility)):
        work.blocked[tree], work.group[tree] = 0, 0
    overlaps = False
    for k in range(ws.near.counts.filled):
        if ws.near.separation[k] < 0.0:
            work.blocked[ws.near.tree_a[k]] = work.blocked[ws.near.tree_b[k]] = 1
            overlaps = True
    for tree in range(len(work.mobility)):
        if scene.trees.role[tree] == DRIVEN:
            set_final_posture(scene, state, ws, tree, work.goal)
    if not overlaps:
        return Outcome(0, 0, True, False)
    found = Found(False, 0, False, False)
    for general_motion in (False, True):
        translated = choose_mobility(scene, state, ws, 0, general_motion)
        if general_motion and not translated and found.free:
            break
        if general_motion and found.free and not is_translated_too_far(scene, state, ws, work.goal.roots):
            choose_mobility(scene, state, ws, 0, False)
            break
        copy_unlocked(scene, ws, work.goal, work.iterate)
        pose_unlocked(scene, ws, work.iterate)
        found = search(scene, ws, angles, gap, FIRST_ITERATIONS, False, ANY_PATH)
        iterations += found.iterations
        if not translated:
            break
    for joints_at_zero in (False, True):
        if not found.free:
            fallbacks = 1
            found = _search_outside(scene, ws, angles, gap, joints_at_zero)
            iterations += found.iterations
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != LOCKED:
            set_final_posture(scene, state, ws, tree, work.best)
            store_method(state, tree, fallbacks)
    return Outcome(iterations, fallbacks, found.free, False)
