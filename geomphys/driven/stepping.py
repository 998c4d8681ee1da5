"""Steps of a search: where the iterate and the trial are, how far pieces go between them, and how far they may."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near, measure_near, pair_bound
from geomphys.collision.extent import gap_along
from geomphys.collision.support import shapes_of
from geomphys.collision.sweep import update_boxes
from geomphys.driven.advancement import centre_motion, passing_depth, turn_between
from geomphys.driven.constraints import concerns
from geomphys.driven.objective import link_centre, pivot_of
from geomphys.driven.postures import Posture, copy_tree, vec_of
from geomphys.driven.state import BENDS, STAYS, DrivenRoom
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import (
    add,
    dot,
    norm,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    scale,
    sub,
)
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import orientation_of, place_tree, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

SHALLOW = 2e-4  # m: iterates may overlap by this, if it is no more than what may be passed
TURNED_BACK = -0.3  # cosine


@kernel
def place(scene: Scene, room: DrivenRoom, posture: Posture, tree: int) -> None:
    """Pose a tree, and its pieces."""
    pose_tree(scene, room.origins, tree, posture.roots, posture.angles, posture.poses)
    place_tree(scene, tree, posture.poses, room.places.frames)


@outlined
def place_moving(scene: Scene, room: DrivenRoom, posture: Posture) -> None:
    """Place the trees that yield."""
    for tree in range(len(room.work.kind)):
        if room.work.kind[tree] != STAYS:
            place(scene, room, posture, tree)


@outlined
def copy_moving(scene: Scene, room: DrivenRoom, source: Posture, target: Posture) -> None:
    """Copy the trees that yield."""
    for tree in range(len(room.work.kind)):
        if room.work.kind[tree] != STAYS:
            copy_tree(scene, source, tree, target)


@kernel
def place_frames(scene: Scene, room: DrivenRoom, posture: Posture) -> None:
    """Place the pieces of the trees that yield, whose poses are known."""
    for tree in range(len(room.work.kind)):
        if room.work.kind[tree] != STAYS:
            place_tree(scene, tree, posture.poses, room.places.frames)


@kernel
def find_concerned(scene: Scene, room: DrivenRoom, enough: float) -> float:
    """Near pairs within the reach of their trees; returns the least separation that concerns.

    Pairs that are seen to be `enough` [m] apart are not measured: theirs is a lower bound.
    """
    p = room.places
    find_near(scene, p.frames, room.boxes, p.reach, 0.0, enough, room.near, p.found, room.axes, room.scratch)
    least = math.inf
    for k in range(room.near.filled[0]):
        if concerns(room, k):
            least = min(least, room.near.separation[k])
    return least


@outlined
def look(scene: Scene, room: DrivenRoom, reach: float, enough: float) -> float:
    """Near pairs of the trees that yield, within `reach` [m] of each; returns the least separation found.

    Pairs that are seen to be `enough` [m] apart are not measured.
    """
    p = room.places
    for tree in range(len(room.work.kind)):
        p.reach[tree, 0] = p.reach[tree, 1] = -math.inf if room.work.ignored[tree] == 1 else 0.0
        if room.work.kind[tree] != STAYS:
            p.reach[tree, 0] = p.reach[tree, 1] = reach
            update_boxes(scene, p.frames, room.boxes, tree)
    return find_concerned(scene, room, enough)


@outlined
def look_again(scene: Scene, room: DrivenRoom, limit: float, enough: float) -> float:
    """Bring the near pairs up to date after the step that `measure_motion` was called for; returns the least separation.

    A separation, and the gap along a direction, shrinks by no more than both pieces go. Only pairs that may have come nearer
    than `enough` [m] are looked at, and measured within `limit` [m].
    """
    near, motion, least = room.near, room.work.motion, math.inf
    for k in range(near.filled[0]):
        if not concerns(room, k):
            continue
        a, b = near.a[k], near.b[k]
        s = near.separation[k] - (motion[a] + motion[b])
        near.exact[k] = 0
        if s < enough:
            s, n = pair_bound(scene.pieces, room.places.frames, a, b, room.axes)
            for i in range(3):
                near.normal[k, i] = n[i]
        near.separation[k] = s
        if s < enough:
            s = measure_near(scene.pieces, room.places.frames, k, limit, near, room.axes, room.scratch)
        least = min(least, s)
    return least


@outlined
def measure_motion(scene: Scene, room: DrivenRoom, before: Posture, after: Posture) -> float:
    """How far each piece of the trees that yield goes from one posture to another; returns the farthest [m]."""
    farthest = 0.0
    for tree in range(len(room.work.kind)):
        if room.work.kind[tree] == STAYS:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            turn = turn_between(before.poses, after.poses, body)
            for i in range(scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]):
                far = norm(centre_motion(scene, before.poses, after.poses, i)) + turn * scene.pieces.reach[i]
                room.work.motion[i] = far
                farthest = max(farthest, far)
    return farthest


@kernel
def apply_solution(scene: Scene, room: DrivenRoom, share: float) -> None:
    """The trial: a share of the solution away from the iterate."""
    x, work = room.problem.x, room.work
    now, trial = work.now, work.trial
    for tree in range(len(work.kind)):
        if work.kind[tree] == STAYS:
            continue
        first = work.first[tree]
        p, q = position_of(now.roots, tree), orientation_of(now.roots, tree)
        if work.kind[tree] == BENDS:
            turn = quat_from_rotation_vector((share * x[first + 3], share * x[first + 4], share * x[first + 5]))
            pivot = pivot_of(room, now.poses, tree)
            p = add(pivot, quat_rotate(turn, sub(p, pivot)))
            q = quat_unit(quat_mul(turn, q))
            for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                i = work.column[j]
                trial.angles[j] = now.angles[j] + (share * x[i] if i >= 0 else 0.0)
        else:
            for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                trial.angles[j] = now.angles[j]
        p = (p[0] + share * x[first], p[1] + share * x[first + 1], p[2] + share * x[first + 2])
        set_pose(trial.roots, tree, p, q)
        pose_tree(scene, room.origins, tree, trial.roots, trial.angles, trial.poses)


@outlined
def step_to_trial(scene: Scene, room: DrivenRoom) -> float:
    """Take the whole solution, whatever is in the way; returns how far a piece goes at most [m]."""
    apply_solution(scene, room, 1.0)
    return measure_motion(scene, room, room.work.now, room.work.trial)


@kernel
def allowed_depth(scene: Scene, a: int, b: int) -> float:
    """How deep [m] an iterate may leave two pieces in each other."""
    return min(SHALLOW, 0.5 * passing_depth(scene, a, b))


@outlined
def gap_on_its_side(scene: Scene, room: DrivenRoom, k: int, motion: float) -> float:
    """Gap [m] at the trial along the direction that parts the near pair k at the iterate; the pair goes `motion` [m].

    Above minus the depth that may be passed, that direction parts the pair all the way; -inf where the way turns too much
    to tell.
    """
    a, b, work = room.near.a[k], room.near.b[k], room.work
    body_a, body_b = scene.pieces.body[a], scene.pieces.body[b]
    turn = turn_between(work.now.poses, work.trial.poses, body_a) + turn_between(
        work.now.poses, work.trial.poses, body_b
    )
    if turn * motion > passing_depth(scene, a, b):
        return -math.inf
    return gap_along(shapes_of(scene.pieces, room.places.frames), a, b, vec_of(room.near.normal, k))


@kernel
def off_the_way(room: DrivenRoom, poses: Floats, body: int) -> float:
    """How far [m] a link's centre is from the straight way that the coupling alone takes it."""
    c, a, b = link_centre(room, poses, body), vec_of(room.work.anchor, body), vec_of(room.work.target, body)
    way, off = sub(b, a), sub(c, a)
    square = dot(way, way)
    share = min(max(dot(off, way) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return norm(sub(off, scale(way, share)))


@kernel
def _share_within(before: float, after: float, most: float) -> float:
    """The share of a step after which a distance, convex along it, is `most`, or as it was; 1: it stays below."""
    if after <= most or after <= before + 1e-9:
        return 1.0
    return max(most - before, 0.0) / (after - before)


@kernel
def pace_left(scene: Scene, room: DrivenRoom, tethered: bool) -> float:
    """The share of the step after which some link is as far off its way as it may be in a frame; 1: none."""
    share, work = 1.0, room.work
    for tree in range(len(work.kind)):
        pace = work.pace[tree]
        if work.kind[tree] == STAYS or pace == math.inf:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            before, after = off_the_way(room, work.now.poses, body), off_the_way(room, work.trial.poses, body)
            share = min(share, _share_within(before, after, pace))
            if tethered:
                start = link_centre(room, work.start.poses, body)
                before = norm(sub(link_centre(room, work.now.poses, body), start))
                after = norm(sub(link_centre(room, work.trial.poses, body), start))
                share = min(share, _share_within(before, after, pace))
    return share


@kernel
def turns_back(scene: Scene, room: DrivenRoom, share: float) -> bool:
    """Whether the step goes against the last one; remembers it."""
    x, went, work = room.problem.x, room.problem.went, room.work
    both, here, last = 0.0, 0.0, 0.0
    for tree in range(len(work.kind)):
        if work.kind[tree] == STAYS:
            continue
        first = work.first[tree]
        for k in range(6 if work.kind[tree] == BENDS else 3):
            v = share * x[first + k] * (1.0 if k < 3 else 0.1)
            both, here, last = both + v * went[first + k], here + v * v, last + went[first + k] ** 2
            went[first + k] = v
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            i = work.column[q]
            if i >= 0:
                v = share * x[i] * room.links.lever[q]
                both, here, last = both + v * went[i], here + v * v, last + went[i] ** 2
                went[i] = v
    return bool(both < TURNED_BACK * math.sqrt(here * last))
