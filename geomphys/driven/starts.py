"""Free starts of a search: the last posture, moved as the recording moved, or moved along with a body near it.

Each is posed as at the end of the step; it is valid if it is free there and the path to it, from the last posture and with
the surroundings moving too, is certified (`reachability`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.objective import pivot_of, tree_cost
from geomphys.driven.postures import Posture
from geomphys.driven.reachability import FREE, find_reference_body, judge, measure_swept_pairs
from geomphys.driven.state import GENERAL_MOTION, LOCKED, DrivenState, DrivenWorkspace
from geomphys.driven.stepping import copy_unlocked, pose_unlocked_links, pose_unlocked_pieces
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.vec3 import (
    Quat,
    Vec,
    add,
    quat_conjugate,
    quat_mul,
    quat_rotate,
    quat_unit,
    sub,
)
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

CLEARLY = 10.0  # times: a start with so much less cost than the last posture is taken at once
JUMP = 0.5  # rad or m: an angle recorded to change more in a step has changed its branch

# kinds of starts; ALONG: along with the nearest body that the recording moves
EXTRAPOLATED, LAST_SHAPE, LAST, ALONG = 0, 1, 2, 3


@kernel
def wrapped(ws: DrivenWorkspace, q: int, value: float) -> float:
    """A joint's offset or change, modulo 2π if it is periodic."""
    if ws.links.periodic[q] == 1:
        value -= 2.0 * math.pi * math.floor(value / (2.0 * math.pi) + 0.5)
    return value


@kernel
def unwrapped_change(ws: DrivenWorkspace, q: int, change: float) -> float:
    """A joint's change in a step, modulo 2π if it is periodic; 0 if it jumped."""
    change = wrapped(ws, q, change)
    return 0.0 if abs(change) > JUMP else change


@kernel
def _keep_pivot(scene: Scene, ws: DrivenWorkspace, posture: Posture, tree: int) -> None:
    """Translate a tree so that its pivot is where it was at the start of the step."""
    pose_tree(scene, ws.origins, tree, posture.roots, posture.angles, posture.poses)
    path = sub(pivot_of(ws, ws.work.before.poses, tree), pivot_of(ws, posture.poses, tree))
    for i in range(3):
        posture.roots[tree, i] += path[i]


@kernel
def moved_as_recorded(state: DrivenState, ws: DrivenWorkspace, tree: int, roots: Floats) -> tuple[Vec, Quat]:
    """The root's pose at the start of the step, moved as the recording moved it: (position, orientation)."""
    p, q, old = position_of(roots, tree), orientation_of(roots, tree), state.recorded.roots
    rotation = quat_mul(q, quat_conjugate(orientation_of(old, tree)))
    arm = sub(position_of(ws.work.before.roots, tree), position_of(old, tree))
    orientation = quat_unit(quat_mul(rotation, orientation_of(ws.work.before.roots, tree)))
    return add(p, quat_rotate(rotation, arm)), orientation


@noinline
def _make_start(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, roots: Floats, angles: Floats, kind: int
) -> bool:
    """Write a tree's start of a kind to `SearchWorkspace.start`; False if there is none."""
    work, start = ws.work, ws.work.start
    before, general_motion = work.before, work.mobility[tree] == GENERAL_MOTION
    p, q = position_of(roots, tree), orientation_of(roots, tree)
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        start.angles[j] = angles[j]
        if general_motion:
            start.angles[j] = work.extrapolated[j] if kind == EXTRAPOLATED else before.angles[j]
    set_pose(start.roots, tree, p, q)
    if not general_motion:
        if kind == EXTRAPOLATED:
            for i in range(3):
                start.roots[tree, i] += before.roots[tree, i] - state.recorded.roots[tree, i]
            return True
        _keep_pivot(scene, ws, start, tree)
    elif kind in (EXTRAPOLATED, LAST_SHAPE):
        p, q = moved_as_recorded(state, ws, tree, roots)
        set_pose(start.roots, tree, p, q)
    else:
        set_pose(start.roots, tree, position_of(before.roots, tree), orientation_of(before.roots, tree))
    if kind != ALONG:
        return bool(
            kind != LAST_SHAPE or (general_motion and scene.trees.dof_start[tree + 1] > scene.trees.dof_start[tree])
        )
    body = work.counts.reference_body
    if body < 0:
        return False
    rotation = quat_mul(orientation_of(start.poses, body), quat_conjugate(orientation_of(before.poses, body)))
    if general_motion:
        arm = sub(position_of(start.roots, tree), position_of(before.poses, body))
        at = add(position_of(start.poses, body), quat_rotate(rotation, arm))
        set_pose(start.roots, tree, at, quat_unit(quat_mul(rotation, orientation_of(start.roots, tree))))
    else:
        pivot = pivot_of(ws, before.poses, tree)
        moved = add(position_of(start.poses, body), quat_rotate(rotation, sub(pivot, position_of(before.poses, body))))
        for i in range(3):
            start.roots[tree, i] += moved[i] - pivot[i]
    return True


@kernel
def _cost(scene: Scene, ws: DrivenWorkspace, posture: Posture) -> float:
    """Objective of the trees being solved."""
    cost = 0.0
    for tree in range(len(ws.work.mobility)):
        if ws.work.mobility[tree] != LOCKED:
            cost += tree_cost(scene, ws, posture.poses, tree)
    return cost


@kernel
def _pose_start(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, kind: int
) -> bool:
    """Pose the links of the starts of one kind of the trees being solved; False if there are none."""
    work, some = ws.work, False
    for tree in range(len(work.mobility)):
        if work.mobility[tree] != LOCKED:
            some = _make_start(scene, state, ws, tree, roots, angles, kind) or some
    if some:
        pose_unlocked_links(scene, ws, work.start)
    return some


@noinline
def choose_start(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> bool:
    """The free and certified start nearest to the targets, into `SearchWorkspace.iterate`; whether there is one."""
    work, best, cost_of_last = ws.work, math.inf, math.inf
    work.counts.reference_body = -1
    for i in range(ALONG + 2):
        kind = i if i <= ALONG else LAST  # judged at the end: mostly that along with a body is better
        if i > ALONG and cost_of_last >= best:
            break
        if not _pose_start(scene, state, ws, roots, angles, kind):
            continue
        cost = _cost(scene, ws, work.start)
        if i == LAST:
            if cost > CLEARLY * best:  # nor is that along with a body much better then
                break
            cost_of_last = cost
            pose_unlocked_pieces(scene, ws, work.start)
            work.counts.reference_body = find_reference_body(scene, ws, work.start)
        elif cost < best:
            pose_unlocked_pieces(scene, ws, work.start)
            if judge(scene, ws, work.start) == FREE:
                best = cost
                copy_unlocked(scene, ws, work.start, work.iterate)
    return best < math.inf


@noinline
def choose_shallowest(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> None:
    """The start of least overlap, into `SearchWorkspace.iterate`; `choose_start` must have been called before."""
    shallowest = -math.inf
    for kind in range(ALONG + 1):
        if not _pose_start(scene, state, ws, roots, angles, kind):
            continue
        pose_unlocked_pieces(scene, ws, ws.work.start)
        least = measure_swept_pairs(scene, ws, ws.work.start)
        if least > shallowest:
            shallowest = least
            copy_unlocked(scene, ws, ws.work.start, ws.work.iterate)
