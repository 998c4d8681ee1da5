"""Steps of a search: poses at the iterate and the trial, motion of pieces between them, and its bounds."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import (
    NOWHERE,
    Records,
    copy_measured,
    find_near,
    measure_near,
    separation_bound,
    set_motion_bound,
)
from geomphys.collision.extent import gap_along
from geomphys.collision.support import shapes_of
from geomphys.collision.sweep import update_boxes
from geomphys.driven.advancement import path_tolerance, rotation_between
from geomphys.driven.constraints import is_unlocked_pair
from geomphys.driven.objective import link_centre, pivot_of
from geomphys.driven.postures import Posture, copy_tree
from geomphys.driven.state import GENERAL_MOTION, LOCKED, TRANSLATION, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, set_vec, set_vec_at, vec_at, vec_from, vec_of
from geomphys.numerics.vec3 import (
    Vec,
    add,
    dot,
    norm,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rot_from_quat,
    rot_sub,
    rotate,
    scale,
    sub,
)
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

NO_CHANGE = (0.0,) * 9  # of a rotation matrix
SHALLOW = 2e-4  # m: overlap that iterates may have, if it is no more than `path_tolerance`


@kernel
def pose_with_pieces(scene: Scene, ws: DrivenWorkspace, posture: Posture, tree: int) -> None:
    """Pose a tree, and its pieces."""
    pose_tree(scene, ws.origins, tree, posture.roots, posture.angles, posture.poses)
    pose_pieces_of_tree(scene, tree, posture.poses, ws.piece_frames.frames)


@noinline
def pose_unlocked_links(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> None:
    """Pose the links of the trees being solved."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            pose_tree(scene, ws.origins, tree, posture.roots, posture.angles, posture.poses)


@noinline
def copy_unlocked(scene: Scene, ws: DrivenWorkspace, source: Posture, target: Posture) -> None:
    """Copy the trees being solved."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            copy_tree(scene, source, tree, target)


@noinline
def copy_targets(scene: Scene, ws: DrivenWorkspace, source: Floats, target: Floats) -> None:
    """Copy targets (B, 7) of the trees being solved."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                copy_pose(source, body, target, body)


@noinline
def set_targets_to(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> None:
    """Set the targets of the links to their poses in a posture."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                q = orientation_of(posture.poses, body)
                set_pose(ws.work.target, body, link_centre(ws, posture.poses, body), q)


@kernel
def pose_unlocked_pieces(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> None:
    """Pose the pieces of the trees being solved, whose link poses are known."""
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            pose_pieces_of_tree(scene, tree, posture.poses, ws.piece_frames.frames)


@noinline
def pose_unlocked(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> None:
    """Pose the trees being solved, and their pieces."""
    pose_unlocked_links(scene, ws, posture)
    pose_unlocked_pieces(scene, ws, posture)


@noinline
def copy_frames(scene: Scene, ws: DrivenWorkspace, only_unlocked: bool) -> None:
    """Set the frames of pieces at the iterate to the current ones: of the trees being solved, or of all that move."""
    p = ws.piece_frames
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED or (scene.trees.moving[tree] == 1 and not only_unlocked):
            copy_tree_frames(scene, tree, p.frames, p.iterate)


@kernel
def find_unlocked_pairs(scene: Scene, ws: DrivenWorkspace, enough: float) -> float:
    """Near pairs within the reach of their trees; returns the least separation among the trees being solved.

    Pairs that a cached direction separates by `enough` [m] are not measured: theirs is a lower bound.
    """
    p = ws.piece_frames
    find_near(scene, p.frames, p.motion_bounds, 0.0, enough, ws.near, ws.detection)
    least = math.inf
    for k in range(ws.near.counts.filled):
        if is_unlocked_pair(ws, k):
            least = min(least, ws.near.separation[k])
    return least


@noinline
def measure_near_pairs(scene: Scene, ws: DrivenWorkspace, reach: float, enough: float) -> float:
    """Near pairs of the trees being solved, within `reach` [m] of each; returns the least separation found.

    Pairs that a cached direction separates by `enough` [m] are not measured.
    """
    p = ws.piece_frames
    for tree in range(len(ws.work.mobility)):
        set_motion_bound(p.motion_bounds, tree, -math.inf if ws.work.ignored[tree] == 1 else 0.0)
        if ws.work.mobility[tree] != LOCKED:
            set_motion_bound(p.motion_bounds, tree, reach)
            update_boxes(scene, p.frames, ws.detection.boxes, tree)
    return find_unlocked_pairs(scene, ws, enough)


@kernel
def measure_travel(scene: Scene, before: Floats, after: Floats, tree: int, travel: Records) -> float:
    """Motion of the pieces of a tree between poses (B, 7), to `travel` (P,) TRAVEL; returns the largest [m]."""
    far = 0.0
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        first, last = scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]
        if first == last:
            continue
        rotation, rotation_change = rotation_between(before, after, body), NO_CHANGE
        path = sub(position_of(after, body), position_of(before, body))
        if rotation > 0.0:
            rotation_change = rot_sub(
                rot_from_quat(orientation_of(after, body)), rot_from_quat(orientation_of(before, body))
            )
        for i in range(first, last):
            centre = vec_at(scene.pieces.body_centre, i)
            translation = add(path, rotate(rotation_change, centre)) if rotation > 0.0 else path
            set_vec(travel[i].translation, translation)
            travel[i].rotation, travel[i].angle = rotation * scene.pieces.reach[i], rotation
            far = max(far, norm(translation) + travel[i].rotation)
    return far


@kernel
def clear_travel(scene: Scene, tree: int, travel: Records) -> None:
    """Set the motion of the pieces of a tree to zero."""
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    for i in range(first, scene.bodies.piece_start[scene.trees.body_start[tree + 1]]):
        set_vec(travel[i].translation, (0.0, 0.0, 0.0))
        travel[i].rotation = travel[i].angle = 0.0


@kernel
def pair_travel(travel: Records, a: int, b: int) -> float:
    """Bound on the relative motion of two pieces [m]."""
    apart = norm(sub(vec_of(travel[a].translation), vec_of(travel[b].translation)))
    return apart + float(travel[a].rotation) + float(travel[b].rotation)


@noinline
def update_separations(scene: Scene, ws: DrivenWorkspace, limit: float, enough: float) -> float:
    """Update the near pairs after the step that `measure_motion` was called for; returns the least separation.

    A separation, and the gap along a direction, shrinks by no more than the motion of the two pieces. Only pairs that may be
    nearer than `enough` [m] are measured, within `limit` [m], unless the certification of the step has done so.
    """
    near, at_trial, least = ws.near, ws.at_trial, math.inf
    for k in range(near.counts.filled):
        if not is_unlocked_pair(ws, k):
            continue
        a, b = near.a[k], near.b[k]
        s = near.separation[k] - pair_travel(ws.work.motion, a, b)
        near.exact[k] = 0
        if s < enough:
            s, n = separation_bound(scene.pieces, ws.piece_frames.frames, a, b, ws.detection.axes)
            for i in range(3):
                near.normal[k, i] = n[i]
        near.separation[k] = s
        if s < enough and at_trial.exact[k] == 1:
            s = copy_measured(at_trial, near, k)
        elif s < enough:
            s = measure_near(
                scene.pieces, ws.piece_frames.frames, k, limit, near, ws.detection.axes, ws.detection.scratch
            )
        least = min(least, s)
    return least


@noinline
def measure_motion(scene: Scene, ws: DrivenWorkspace, before: Posture, after: Posture) -> float:
    """Motion of the pieces of driven trees from one posture to another, 0 where locked; returns the largest [m]."""
    farthest = 0.0
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            farthest = max(farthest, measure_travel(scene, before.poses, after.poses, tree, ws.work.motion))
        elif scene.trees.role[tree] == DRIVEN:
            clear_travel(scene, tree, ws.work.motion)
    return farthest


@kernel
def _translate(scene: Scene, source: Posture, tree: int, path: Vec, target: Posture) -> None:
    """Copy a tree's part of a posture, translated by `path` [m]."""
    copy_tree(scene, source, tree, target)
    for i in range(3):
        target.roots[tree, i] += path[i]
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            target.poses[body, i] += path[i]


@kernel
def apply_solution(scene: Scene, ws: DrivenWorkspace, step_length: float) -> None:
    """Set the trial: the iterate plus `step_length` times the solution; joints stay within their limits."""
    x, work = ws.problem.x, ws.work
    iterate, trial = work.iterate, work.trial
    for tree in range(len(work.mobility)):
        if work.mobility[tree] == LOCKED:
            continue
        first = work.first[tree]
        path = scale(vec_from(x, first), step_length)
        if work.mobility[tree] != GENERAL_MOTION:
            _translate(scene, iterate, tree, path, trial)
            continue
        rotation = quat_from_rotation_vector(scale(vec_from(x, first + 3), step_length))
        pivot, p = pivot_of(ws, iterate.poses, tree), position_of(iterate.roots, tree)
        p = add(add(pivot, quat_rotate(rotation, sub(p, pivot))), path)
        set_pose(trial.roots, tree, p, quat_unit(quat_mul(rotation, orientation_of(iterate.roots, tree))))
        for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            i = work.column[j]
            trial.angles[j] = angle = iterate.angles[j] + (step_length * x[i] if i >= 0 else 0.0)
            if step_length > 1.0:  # farther than the bounds of the unknowns allow
                low, high = min(work.low[j], iterate.angles[j]), max(work.high[j], iterate.angles[j])
                trial.angles[j] = min(max(angle, low), high)
        pose_tree(scene, ws.origins, tree, trial.roots, trial.angles, trial.poses)


@noinline
def step_to_trial(scene: Scene, ws: DrivenWorkspace) -> float:
    """Take the whole solution, collisions ignored; returns a bound on the motion of any piece [m]."""
    apply_solution(scene, ws, 1.0)
    return measure_motion(scene, ws, ws.work.iterate, ws.work.trial)


@kernel
def is_within(distance: float, step: float, last_step: float) -> bool:
    """Whether iterations that converge linearly, with these steps [m] at the end, are within `distance` [m] of their limit.

    They are after a step shorter than that too. `last_step` 0: there was none, or it tells nothing.
    """
    return step < distance or step * step < distance * (last_step - step)


@kernel
def only_translations_allowed(ws: DrivenWorkspace) -> bool:
    """Whether no tree may do more than be translated."""
    only = True
    for tree in range(len(ws.work.mobility)):
        only = only and (ws.work.mobility[tree] == LOCKED or ws.work.mobility[tree] == TRANSLATION)
    return only


@kernel
def some_joints(scene: Scene, ws: DrivenWorkspace) -> bool:
    """Whether some tree that may move has joints: others converge so fast that no pass is to be saved."""
    some, start = False, scene.trees.dof_start
    for tree in range(len(ws.work.mobility)):
        some = some or (ws.work.mobility[tree] == GENERAL_MOTION and start[tree + 1] > start[tree])
    return some


@kernel
def allowed_depth(scene: Scene, a: int, b: int) -> float:
    """Depth [m] at which two pieces may overlap at an iterate."""
    return min(SHALLOW, 0.5 * path_tolerance(scene, a, b))


@noinline
def _find_direction(scene: Scene, ws: DrivenWorkspace, k: int) -> bool:
    """Take the cached direction of near pair k, if it separates the pair at the iterate; whether it does."""
    near = ws.near
    s, n = separation_bound(scene.pieces, ws.piece_frames.iterate, near.a[k], near.b[k], ws.detection.axes)
    if s <= 0.0:
        return False
    near.separation[k] = max(near.separation[k], s)
    set_vec_at(near.normal, k, n)
    return True


@noinline
def gap_along_normal(scene: Scene, ws: DrivenWorkspace, k: int, motion: float) -> float:
    """Gap [m] at the trial along the direction that separates near pair k at the iterate; the pair moves `motion` [m].

    Above minus `path_tolerance`, that direction separates the pair on the whole path; -inf where
    rotation is too large to tell, or none is known.
    """
    a, b = ws.near.a[k], ws.near.b[k]
    rotation = ws.work.motion[a].angle + ws.work.motion[b].angle
    if rotation * motion > path_tolerance(scene, a, b):
        return -math.inf
    if vec_at(ws.near.normal, k) == NOWHERE and not _find_direction(scene, ws, k):
        return -math.inf
    return gap_along(shapes_of(scene.pieces, ws.piece_frames.frames), a, b, vec_at(ws.near.normal, k))


@kernel
def distance_from_path(ws: DrivenWorkspace, poses: Floats, body: int) -> float:
    """Distance [m] of a link's centre from its straight path by the coupling alone."""
    c, a, b = link_centre(ws, poses, body), vec_at(ws.work.anchor, body), vec_at(ws.work.target, body)
    path, off = sub(b, a), sub(c, a)
    square = dot(path, path)
    fraction = min(max(dot(off, path) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return norm(sub(off, scale(path, fraction)))


@kernel
def _step_length_within(before: float, after: float, most: float) -> float:
    """The step length after which a distance, convex along it, is `most`, or as it was; 1: it stays below."""
    if after <= most or after <= before + 1e-9:
        return 1.0
    return max(most - before, 0.0) / (after - before)


@kernel
def step_length_within_rate(scene: Scene, ws: DrivenWorkspace) -> float:
    """The step length at which some link reaches the rate limit, its largest distance from its path; 1: none."""
    step_length, work = 1.0, ws.work
    for tree in range(len(work.mobility)):
        deviation_limit = work.deviation_limit[tree]
        if work.mobility[tree] == LOCKED or deviation_limit == math.inf:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            after = distance_from_path(ws, work.trial.poses, body)
            if after > deviation_limit:
                before = distance_from_path(ws, work.iterate.poses, body)
                step_length = min(step_length, _step_length_within(before, after, deviation_limit))
    return step_length


@kernel
def compare_steps(scene: Scene, ws: DrivenWorkspace) -> tuple[float, float]:
    """The solution beside that of the last iteration, which it replaces: (cosine of their angle, part along it as a share).

    Both are 0 in the first iteration.
    """
    x, last_step, work = ws.problem.x, ws.problem.last_step, ws.work
    product, here, last = 0.0, 0.0, 0.0
    for tree in range(len(work.mobility)):
        if work.mobility[tree] == LOCKED:
            continue
        first = work.first[tree]
        for k in range(6 if work.mobility[tree] == GENERAL_MOTION else 3):
            v = x[first + k] * (1.0 if k < 3 else 0.1)
            product, here, last = product + v * last_step[first + k], here + v * v, last + last_step[first + k] ** 2
            last_step[first + k] = v
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            i = work.column[q]
            if i >= 0:
                v = x[i] * ws.links.lever[q]
                product, here, last = product + v * last_step[i], here + v * v, last + last_step[i] ** 2
                last_step[i] = v
    if here == 0.0 or last == 0.0:
        return 0.0, 0.0
    return product / math.sqrt(here * last), product / last
