"""Certifies that a posture is free, and reachable from the start of the step.

Many postures are checked in a frame. The pairs that may collide in them are listed once, at the goal; the separation of a
pair at the goal, less the motion of both pieces from there to the posture, bounds its separation at the posture. Only pairs
that this bound does not separate on the whole path are measured.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import (
    NOWHERE,
    Near,
    Records,
    append_bound,
    approximate_separation,
    find_near,
    measure_near,
    separation_bound,
    set_motion_bound,
)
from geomphys.collision.sweep import update_boxes
from geomphys.driven.advancement import is_separated_on_path, pair_motion, path_is_free
from geomphys.driven.constraints import is_unlocked_pair
from geomphys.driven.postures import Posture
from geomphys.driven.state import LOCKED, DrivenWorkspace
from geomphys.driven.stepping import clear_travel, find_unlocked_pairs, measure_travel, pair_travel
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec_at, vec_at, vec_of
from geomphys.numerics.vec3 import Vec, norm
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import pose_pieces_of_tree

Floats = NDArray[np.float64]

FREE, IN_COLLISION, UNCERTIFIED = 0, 1, 2  # verdicts on a posture
LISTED_FACTOR, MARGIN = 2.0, 20e-3  # times the motion of the goal, and m: motion up to which pairs are listed


@noinline
def measure_drift(scene: Scene, ws: DrivenWorkspace, before: Floats, after: Floats) -> None:
    """Motion of the pieces of bodies that are not driven from poses `before` (B, 7) to `after`, into `travel`."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
            measure_travel(scene, before, after, tree, ws.work.travel)


@kernel
def _distance(travel: Records, piece: int) -> float:
    """Bound on the motion of a piece [m]."""
    return norm(vec_of(travel[piece].translation)) + float(travel[piece].rotation)


@kernel
def _farthest(scene: Scene, travel: Records, tree: int) -> float:
    """The largest motion of a tree's pieces [m]."""
    far = 0.0
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    for i in range(first, scene.bodies.piece_start[scene.trees.body_start[tree + 1]]):
        far = max(far, _distance(travel, i))
    return far


@kernel
def _farthest_within(scene: Scene, travel: Records, tree: int) -> float:
    """The largest motion of a tree's pieces against the translation of the first [m]."""
    far, first = 0.0, scene.bodies.piece_start[scene.trees.body_start[tree]]
    for i in range(first, scene.bodies.piece_start[scene.trees.body_start[tree + 1]]):
        far = max(far, pair_travel(travel, i, first) - travel[first].rotation)
    return far


@noinline
def measure_swept_pairs(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> float:
    """Near pairs of the trees being solved, posed at `posture`, that they may have touched on the path there.

    Returns the least separation; it is measured where pairs overlap, and a lower bound elsewhere.
    """
    p, work = ws.piece_frames, ws.work
    for tree in range(len(work.mobility)):
        set_motion_bound(p.motion_bounds, tree, -math.inf if work.ignored[tree] == 1 else 0.0)
        if work.mobility[tree] != LOCKED:
            p.motion_bounds[tree].world = measure_travel(scene, work.before.poses, posture.poses, tree, work.travel)
            p.motion_bounds[tree].joints = _farthest_within(scene, work.travel, tree)
            update_boxes(scene, p.frames, ws.detection.boxes, tree)
        elif scene.trees.role[tree] == DRIVEN:
            clear_travel(scene, tree, work.travel)
        elif work.ignored[tree] == 0 and scene.trees.moving[tree] == 1:
            p.motion_bounds[tree].world = _farthest(scene, work.travel, tree)
    return find_unlocked_pairs(scene, ws, 0.0)


@kernel
def path_of_pair_is_free(scene: Scene, ws: DrivenWorkspace, posture: Posture, k: int) -> bool:
    """Whether near pair k of `measure_swept_pairs`, separated, got to `posture` without passing through."""
    near, work = ws.near, ws.work
    a, b, s, n = near.a[k], near.b[k], near.separation[k], vec_at(near.normal, k)
    motion = pair_travel(work.travel, a, b)
    if s <= motion and n == NOWHERE:
        s, n = separation_bound(scene.pieces, ws.piece_frames.frames, a, b, ws.detection.axes)
    if s > motion or (
        s >= 0.0
        and is_separated_on_path(scene, work.before.poses, posture.poses, a, b, (s, n), motion, ws.piece_frames.before)
    ):
        return True
    return path_is_free(
        scene, work.before.poses, posture.poses, a, b, ws.piece_frames.moved, ws.detection.axes, ws.detection.scratch
    )  # fmt: skip


@kernel
def straight_path_is_free(scene: Scene, ws: DrivenWorkspace, a: int, b: int, bound: tuple[float, Vec]) -> bool:
    """Whether two pieces get straight from the start of the step to the trial, where `bound` is as in `is_separated_on_path`."""
    before, trial, p = ws.work.before.poses, ws.work.trial.poses, ws.piece_frames
    motion, _ = pair_motion(scene, before, trial, a, b)
    if bound[0] >= 0.0 and is_separated_on_path(scene, before, trial, a, b, bound, motion, p.before):
        return True
    return path_is_free(scene, before, trial, a, b, p.moved, ws.detection.axes, ws.detection.scratch)


@kernel
def clear_pairs(ws: DrivenWorkspace) -> None:
    """Discard the listed pairs: the surroundings have changed."""
    for tree in range(len(ws.work.covered)):
        ws.work.covered[tree] = -1.0


@kernel
def _row_of(listed: Near, a: int, b: int) -> int:
    """The row of the pair of pieces a and b; the first without one."""
    for k in range(listed.counts.filled):
        if listed.a[k] == a and listed.b[k] == b:
            return k
    return 0


@noinline
def list_pairs(scene: Scene, ws: DrivenWorkspace) -> None:
    """List the pairs that may touch on the path of the trees being solved to a posture near the goal; poses them at the goal.

    None is measured: a lower bound of the separation suffices, also where they overlap.
    """
    p, work, listed = ws.piece_frames, ws.work, ws.listed
    a, b = listed.a[work.counts.witness], listed.b[work.counts.witness]
    for tree in range(len(work.mobility)):
        work.covered[tree] = 0.0
        set_motion_bound(p.motion_bounds, tree, -math.inf if work.ignored[tree] == 1 else 0.0)
        if work.mobility[tree] != LOCKED:
            pose_pieces_of_tree(scene, tree, work.goal.poses, p.frames)
            update_boxes(scene, p.frames, ws.detection.boxes, tree)
            far = measure_travel(scene, work.before.poses, work.goal.poses, tree, work.travel)
            work.covered[tree] = LISTED_FACTOR * far + MARGIN
            set_motion_bound(p.motion_bounds, tree, work.covered[tree])
        elif scene.trees.role[tree] == DRIVEN:
            clear_travel(scene, tree, work.travel)
            clear_travel(scene, tree, work.from_goal)
        elif work.ignored[tree] == 0 and scene.trees.moving[tree] == 1:
            p.motion_bounds[tree].world = work.covered[tree] = _farthest(scene, work.travel, tree)
    listed.counts.lost = 0
    find_near(scene, p.frames, p.motion_bounds, 0.0, -math.inf, listed, ws.detection)
    work.counts.witness = _row_of(listed, a, b)  # mostly the last posture is not free by the same pair again
    if listed.counts.lost > 0:  # the table was full: pairs are searched each time
        for tree in range(len(work.mobility)):
            work.covered[tree] = -1.0


@kernel
def _measure_travels(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> tuple[bool, float]:
    """Motion of the trees being solved to a posture, from the start of the step and from the goal.

    Returns whether pairs are listed, and the least separation [m] at the goal from which on they cannot have touched.
    """
    work, covers, farthest, drift = ws.work, True, 0.0, 0.0
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != LOCKED:
            far = measure_travel(scene, work.before.poses, posture.poses, tree, work.travel)
            far += measure_travel(scene, work.goal.poses, posture.poses, tree, work.from_goal)
            covers, farthest = covers and far <= work.covered[tree], max(farthest, far)
        elif scene.trees.role[tree] != DRIVEN:
            drift = max(drift, work.covered[tree])
    return covers, 2.0 * farthest + drift


@noinline
def measure_listed_pairs(scene: Scene, ws: DrivenWorkspace, reach: float, enough: float) -> tuple[bool, float]:
    """`measure_near_pairs` at the posed iterate from the listed pairs: (whether the list is complete, least separation)."""
    work, listed, near, least, farthest = ws.work, ws.listed, ws.near, math.inf, 0.0
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != LOCKED:
            far = measure_travel(scene, work.goal.poses, work.iterate.poses, tree, work.from_goal)
            farthest = max(farthest, far)
            if far + reach > work.covered[tree]:
                return False, least
    near.counts.filled = 0
    for k in range(listed.counts.filled):
        if listed.separation[k] > 2.0 * (farthest + reach):
            continue
        a, b, limit = listed.a[k], listed.b[k], 0.0
        for tree in (listed.tree_a[k], listed.tree_b[k]):
            limit += reach if work.mobility[tree] != LOCKED else 0.0
        s, n = listed.separation[k] - pair_travel(work.from_goal, a, b), vec_at(listed.normal, k)
        if s > limit or limit == 0.0:
            continue
        if s < enough:
            s, n = separation_bound(scene.pieces, ws.piece_frames.frames, a, b, ws.detection.axes)
        if s > limit:
            continue
        append_bound(near, a, b, listed.tree_a[k], listed.tree_b[k], s, n)
        last = near.counts.filled - 1
        if s < enough:
            s = measure_near(
                scene.pieces, ws.piece_frames.frames, last, limit, near, ws.detection.axes, ws.detection.scratch
            )
        least = min(least, s)
    return True, least


@noinline
def _judge_pair(scene: Scene, ws: DrivenWorkspace, posture: Posture, k: int, motion: float, from_goal: float) -> int:
    """FREE, IN_COLLISION or UNCERTIFIED: listed pair k at a posture, as in `judge`.

    `motion`, `from_goal` [m]: how far its pieces move to there, from the start of the step and from the goal.
    """
    work, listed, p = ws.work, ws.listed, ws.piece_frames
    a, b = listed.a[k], listed.b[k]
    if work.mobility[listed.tree_a[k]] == LOCKED and work.mobility[listed.tree_b[k]] == LOCKED:
        return FREE
    s, n = separation_bound(scene.pieces, p.frames, a, b, ws.detection.axes)
    if s < 0.0:
        s, n = approximate_separation(scene.pieces, p.frames, a, b, motion, ws.detection.axes, ws.detection.scratch)
    if s < 0.0:
        return IN_COLLISION
    if s - from_goal > listed.separation[k]:
        listed.separation[k] = s - from_goal
        set_vec_at(listed.normal, k, n)
    if s <= motion and not is_separated_on_path(
        scene, work.before.poses, posture.poses, a, b, (s, n), motion, p.before
    ) and not path_is_free(
        scene, work.before.poses, posture.poses, a, b, p.moved, ws.detection.axes, ws.detection.scratch
    ):  # fmt: skip
        return UNCERTIFIED
    return FREE


@noinline
def _judge_listed(scene: Scene, ws: DrivenWorkspace, posture: Posture, enough: float) -> int:
    """As `judge`, where the listed pairs are all that may collide, and those `enough` [m] apart at the goal cannot.

    The pair by which the last posture was found not to be free is tried first.
    """
    listed, work, witness = ws.listed, ws.work, ws.work.counts.witness
    for i in range(-1, listed.counts.filled):
        k = i if i >= 0 else witness
        if i == witness or k >= listed.counts.filled or listed.separation[k] > enough:
            continue
        motion = pair_travel(work.travel, listed.a[k], listed.b[k])
        from_goal = pair_travel(work.from_goal, listed.a[k], listed.b[k])
        if listed.separation[k] - from_goal > motion:
            continue
        verdict = _judge_pair(scene, ws, posture, k, motion, from_goal)
        if verdict != FREE:
            work.counts.witness = k
            return verdict
    return FREE


@noinline
def find_obstruction(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> int:
    """The first near pair of `measure_swept_pairs` that is not certified to get to `posture` freely; -1: all are."""
    for k in range(ws.near.counts.filled):
        if is_unlocked_pair(ws, k) and not path_of_pair_is_free(scene, ws, posture, k):
            return k
    return -1


@noinline
def judge_anew(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> int:
    """As `judge`, for any posture."""
    if measure_swept_pairs(scene, ws, posture) < 0.0:
        return IN_COLLISION
    return FREE if find_obstruction(scene, ws, posture) < 0 else UNCERTIFIED


@noinline
def judge(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> int:
    """FREE, IN_COLLISION or UNCERTIFIED: a posture of the trees being solved, for which pairs are listed and pieces posed."""
    is_listed, enough = _measure_travels(scene, ws, posture)
    if is_listed:
        return _judge_listed(scene, ws, posture, enough)
    return judge_anew(scene, ws, posture)


@kernel
def _reference_separation(scene: Scene, ws: DrivenWorkspace, k: int, limit: float) -> float:
    """About the separation [m] of listed pair k at the present frames of its pieces, or a bound above `limit`."""
    a, b = ws.listed.a[k], ws.listed.b[k]
    s = ws.listed.separation[k] - pair_travel(ws.work.from_goal, a, b)
    if s < limit:
        s, _ = separation_bound(scene.pieces, ws.piece_frames.frames, a, b, ws.detection.axes)
    if s < limit:
        s, _ = approximate_separation(
            scene.pieces, ws.piece_frames.frames, a, b, limit, ws.detection.axes, ws.detection.scratch
        )
    return s


@noinline
def find_reference_body(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> int:
    """The nearest body that the recording moves, of the listed pairs at a posture whose pieces are posed; -1: none."""
    _measure_travels(scene, ws, posture)
    least, nearest = math.inf, -1
    for k in range(ws.listed.counts.filled):
        body = scene.pieces.body[ws.listed.b[k]]
        if scene.bodies.role[body] == DRIVEN or _distance(ws.work.travel, ws.listed.b[k]) == 0.0:
            continue
        if ws.work.mobility[ws.listed.tree_a[k]] == LOCKED:  # near a tree of another group
            continue
        s = _reference_separation(scene, ws, k, least)
        if s < least:
            least, nearest = s, body
    return nearest
