"""Solves groups of trees that may collide: how each may move, starts of the search, and fallbacks if nothing is free."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.sweep import update_boxes
from geomphys.driven.depenetration import find_depenetration
from geomphys.driven.goals import take_branch
from geomphys.driven.objective import is_stiff
from geomphys.driven.postures import Posture, copy_tree, is_recorded
from geomphys.driven.reachability import FREE, forget_pairs, judge, list_pairs, measure_drift, measure_swept_pairs
from geomphys.driven.sqp import ANY_PATH, EVERY_STEP, STRAIGHT, Found, search
from geomphys.driven.starts import ALONG, choose_shallowest, choose_start, shorten_start
from geomphys.driven.state import ARTICULATED, LOCKED, RIGID, STARTED_FREE, DrivenState, DrivenWorkspace
from geomphys.driven.stepping import copy_moving, pose_yielding
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import norm, slerp, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

PASSES = 25  # passes of a search
SHIFT_PASSES = 14  # passes where trees are only translated
FIRST_PASSES = 60  # passes of that of the first frame
PARTS = (4, 24)  # parts into which a step is divided where no start is free
GLOBAL, LEAST_DISTANCE, INTERPOLATED = 0, 1, 2  # methods, in the order of results.METHODS


class Outcome(NamedTuple):
    """Result of the driven loop in a frame."""

    rounds: int
    fallbacks: int  # steps divided into parts, and depenetration searches
    converged: bool
    yielded: bool  # a rigid tree changed its shape or rotation


@kernel
def both(a: Outcome, b: Outcome) -> Outcome:
    """The result of two groups, or of two substeps."""
    return Outcome(a.rounds + b.rounds, a.fallbacks + b.fallbacks, a.converged and b.converged, a.yielded or b.yielded)


@outlined
def settle(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, source: Posture) -> None:
    """Set the final posture of a driven tree; other trees are then kept clear of it."""
    work = ws.work
    for target in (state.last, work.before, work.now, work.trial, work.start, work.best):
        copy_tree(scene, source, tree, target)
    pose_pieces_of_tree(scene, tree, source.poses, ws.piece_frames.frames)
    update_boxes(scene, ws.piece_frames.frames, ws.detection.boxes, tree)


@kernel
def note_method(state: DrivenState, tree: int, fallbacks: int) -> None:
    """Store by which method a tree was freed: of a frame's substeps that of the highest number."""
    state.method[tree] = max(state.method[tree], LEAST_DISTANCE if fallbacks == 0 else INTERPOLATED)


@outlined
def set_around(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats, share: float) -> None:
    """Pose moving bodies that are not driven at a share of their path through the step."""
    work, p = ws.work, ws.piece_frames
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == DRIVEN:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            at, q = position_of(recorded, body), orientation_of(recorded, body)
            if share < 1.0:
                from_at, from_q = position_of(state.last.poses, body), orientation_of(state.last.poses, body)
                q = slerp(from_q, q, share)
                at = (
                    from_at[0] + share * (at[0] - from_at[0]),
                    from_at[1] + share * (at[1] - from_at[1]),
                    from_at[2] + share * (at[2] - from_at[2]),
                )
            for posture in (work.now, work.trial, work.start, work.best, work.goal):
                set_pose(posture.poses, body, at, q)
        pose_pieces_of_tree(scene, tree, work.now.poses, p.frames)
        update_boxes(scene, p.frames, ws.detection.boxes, tree)
    measure_drift(scene, ws, work.before.poses, work.now.poses)
    forget_pairs(ws)


@outlined
def choose_kinds(scene: Scene, state: DrivenState, ws: DrivenWorkspace, group: int, articulate: bool) -> bool:
    """Choose how the trees of a group may move; whether some of them are only translated."""
    work, shifts = ws.work, False
    for tree in range(len(work.kind)):
        work.kind[tree] = LOCKED
        if scene.trees.role[tree] != DRIVEN or work.hit[tree] == 0 or work.group[tree] != group:
            continue
        articulated = articulate or not is_stiff(scene, tree) or state.deformed[tree] == 1 or work.grips[tree] == 1
        work.kind[tree] = ARTICULATED if articulated else RIGID
        shifts = shifts or not articulated
    return shifts


@kernel
def is_shifted_too_far(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats) -> bool:
    """Whether a rigid hand is translated farther than its recorded depth allows, or by too much in one frame."""
    work, w = ws.work, ws.weights
    for tree in range(len(work.kind)):
        if work.kind[tree] != RIGID or scene.trees.dof_start[tree + 1] == scene.trees.dof_start[tree]:
            continue
        offset = sub(vec_at(work.best.roots, tree), vec_at(roots, tree))
        limit = min(max(w.shift_of_depth * work.depth[tree], w.least_shift), w.most_shift)
        if norm(sub(offset, vec_at(state.offset, tree))) > limit:
            return True
        last = sub(vec_at(state.last.roots, tree), vec_at(state.recorded.roots, tree))
        if state.progress.start == STARTED_FREE and norm(sub(offset, last)) > work.shift_limit[tree]:
            return True
    return False


@outlined
def _search_straight(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float, tethered: bool) -> Found:
    """Search from the free start in `SearchWorkspace.now`; its result must be reachable straight from the start of the step.

    Only where that fails is it required in every pass.
    """
    work = ws.work
    copy_moving(scene, ws, work.now, work.start)
    pose_yielding(scene, ws, work.now)
    found = search(scene, ws, angles, gap, PASSES, True, tethered, EVERY_STEP)
    pose_yielding(scene, ws, work.best)
    if judge(scene, ws, work.best) == FREE:
        return found
    copy_moving(scene, ws, work.start, work.now)
    pose_yielding(scene, ws, work.now)
    again = search(scene, ws, angles, gap, PASSES, True, tethered, STRAIGHT)
    return Found(again.free, found.passes + again.passes, again.converged, again.energy, again.paced)


@outlined
def _attempt(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, gap: float, shifts: bool
) -> Found:
    """Search from a free start, or for translated trees from an overlapping one if its result can be reached."""
    work, passes = ws.work, 0
    chosen = choose_start(scene, state, ws, roots, angles)
    if chosen < 0:
        if not shifts:
            return Found(False, 0, False, math.inf, False)
        choose_shallowest(scene, state, ws, roots, angles)
        pose_yielding(scene, ws, work.now)
        relaxed = search(scene, ws, angles, gap, SHIFT_PASSES, False, False, ANY_PATH)
        passes = relaxed.passes
        if not relaxed.free:
            return relaxed
        copy_moving(scene, ws, work.best, work.now)
        pose_yielding(scene, ws, work.now)
        if judge(scene, ws, work.now) != FREE:
            return Found(False, passes, False, math.inf, False)
    if chosen >= ALONG:
        shorten_start(scene, state, ws, roots, angles)
    found = _search_straight(scene, ws, angles, gap, chosen >= ALONG)
    return Found(found.free, found.passes + passes, found.converged, found.energy, found.paced)


@outlined
def _yield_partially(scene: Scene, ws: DrivenWorkspace, angles: Floats, gap: float) -> Found:
    """Move the trees out of what has moved slightly into them in a part of a step."""
    work = ws.work
    copy_moving(scene, ws, work.before, work.now)
    pose_yielding(scene, ws, work.now)
    return search(scene, ws, angles, gap, PASSES, False, False, EVERY_STEP)


@kernel
def _move_before(scene: Scene, ws: DrivenWorkspace) -> None:
    """Set the start of the next part for bodies that are not driven to their present poses."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                for k in range(7):
                    ws.work.before.poses[body, k] = ws.work.now.poses[body, k]


@outlined
def _in_parts(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, recorded: Floats, gap: float
) -> tuple[bool, int]:
    """Move the surroundings of a group in parts of the step, and the group with them: (whether it is free, passes)."""
    work, passes = ws.work, 0
    for parts in PARTS:
        free = True
        for part in range(1, parts + 1):
            set_around(scene, state, ws, recorded, part / parts if part < parts else 1.0)
            list_pairs(scene, ws)
            found = _attempt(scene, state, ws, roots, angles, gap, False)
            passes += found.passes
            if not found.free:
                found = _yield_partially(scene, ws, angles, gap)
                passes += found.passes
            if not found.free:
                free = False
                break
            copy_moving(scene, ws, work.best, work.before)
            _move_before(scene, ws)
        if free:
            return True, passes
        for tree in range(len(work.kind)):
            if is_recorded(scene, tree) and (work.kind[tree] != LOCKED or scene.trees.role[tree] != DRIVEN):
                copy_tree(scene, state.last, tree, work.before)
    set_around(scene, state, ws, recorded, 1.0)
    return False, passes


@outlined
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
    shifts = choose_kinds(scene, state, ws, group, False)
    list_pairs(scene, ws)
    found = _attempt(scene, state, ws, roots, angles, gap, shifts)
    passes, fallbacks = found.passes, 0
    if shifts and (not found.free or is_shifted_too_far(scene, state, ws, roots)):
        choose_kinds(scene, state, ws, group, True)
        found = _attempt(scene, state, ws, roots, angles, gap, False)
        passes += found.passes
    converged = found.converged
    if not found.free:
        fallbacks = 1
        free, more = _in_parts(scene, state, ws, roots, angles, recorded, gap)
        passes += more
        converged = free
        if not free:
            copy_moving(scene, ws, work.before, work.now)
            pose_yielding(scene, ws, work.now)
            fallbacks += 1
            if find_depenetration(scene, ws, gap, state.progress.start == STARTED_FREE):
                copy_moving(scene, ws, work.best, work.now)
                pose_yielding(scene, ws, work.now)
                for tree in range(len(work.kind)):
                    work.deviation_limit[tree] = math.inf
                more_found = search(scene, ws, angles, gap, PASSES, False, False, EVERY_STEP)
                passes, converged = passes + more_found.passes, more_found.free
            else:
                copy_moving(scene, ws, work.now, work.best)
    yielded = False
    for tree in range(len(work.kind)):
        if work.kind[tree] != LOCKED:
            yielded = yielded or (work.kind[tree] == ARTICULATED and is_stiff(scene, tree))
            work.hit[tree] = 0
            take_branch(scene, ws, tree, angles, work.best)
            pose_tree(scene, ws.origins, tree, work.best.roots, work.best.angles, work.best.poses)
            settle(scene, state, ws, tree, work.best)
            note_method(state, tree, fallbacks)
    return Outcome(passes, fallbacks, converged, yielded)


@outlined
def _set_joints_to_zero(scene: Scene, ws: DrivenWorkspace, source: Posture, target: Posture) -> None:
    """Copy the trees of the group with joints at zero, or as near as limits allow: links that overlap there never collide."""
    for tree in range(len(ws.work.kind)):
        if ws.work.kind[tree] == LOCKED:
            continue
        copy_tree(scene, source, tree, target)
        if ws.work.kind[tree] == ARTICULATED:
            for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                target.angles[q] = min(max(0.0, ws.work.low[q]), ws.work.high[q])
            pose_tree(scene, ws.origins, tree, target.roots, target.angles, target.poses)


@outlined
def solve_first(scene: Scene, state: DrivenState, ws: DrivenWorkspace, angles: Floats, gap: float) -> Outcome:
    """The first frame: without earlier motion any free posture near the recorded one is valid."""
    work, passes, fallbacks, converged = ws.work, 0, 0, True
    for tree in range(len(work.kind)):
        work.deviation_limit[tree] = math.inf
    measure_swept_pairs(scene, ws, work.goal)
    for tree in range(len(work.kind)):
        work.hit[tree], work.group[tree] = 0, 0
    overlaps = False
    for k in range(ws.near.counts.filled):
        if ws.near.separation[k] < 0.0:
            work.hit[ws.near.tree_a[k]] = work.hit[ws.near.tree_b[k]] = 1
            overlaps = True
    for tree in range(len(work.kind)):
        if scene.trees.role[tree] == DRIVEN:
            settle(scene, state, ws, tree, work.goal)
    if not overlaps:
        return Outcome(0, 0, True, False)
    found = Found(False, 0, False, math.inf, False)
    for articulate in (False, True):
        shifts = choose_kinds(scene, state, ws, 0, articulate)
        if articulate and not shifts and found.free:
            break
        if articulate and found.free and not is_shifted_too_far(scene, state, ws, work.goal.roots):
            choose_kinds(scene, state, ws, 0, False)
            break
        copy_moving(scene, ws, work.goal, work.now)
        pose_yielding(scene, ws, work.now)
        found = search(scene, ws, angles, gap, FIRST_PASSES, False, False, ANY_PATH)
        passes += found.passes
        if not shifts:
            break
    converged = found.free
    if not found.free:
        fallbacks = 1
        _set_joints_to_zero(scene, ws, work.goal, work.now)
        pose_yielding(scene, ws, work.now)
        found = search(scene, ws, angles, gap, FIRST_PASSES, False, False, ANY_PATH)
        passes, converged = passes + found.passes, found.free
    if not found.free:
        copy_moving(scene, ws, work.goal, work.now)
        pose_yielding(scene, ws, work.now)
        converged = find_depenetration(scene, ws, gap, False)
        if converged:
            copy_moving(scene, ws, work.best, work.now)
            pose_yielding(scene, ws, work.now)
            found = search(scene, ws, angles, gap, PASSES, False, False, EVERY_STEP)
            passes, converged = passes + found.passes, found.free
        else:
            copy_moving(scene, ws, work.now, work.best)
    for tree in range(len(work.kind)):
        if work.kind[tree] != LOCKED:
            settle(scene, state, ws, tree, work.best)
            note_method(state, tree, fallbacks)
    return Outcome(passes, fallbacks, converged, False)
