"""Free starts of a search: the last posture, moved as the recording moved, or moved along with a body near it.

Each is posed as at the end of the step; it is valid if it is free there and the path to it, from the last posture and with
the surroundings moving too, is certified (`reachability`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.objective import pivot_of, tree_energy
from geomphys.driven.postures import Posture
from geomphys.driven.reachability import FREE, judge, measure_swept_pairs, note_reference_bodies
from geomphys.driven.state import ARTICULATED, LOCKED, DrivenState, DrivenWorkspace
from geomphys.driven.stepping import copy_moving, pose_with_pieces, pose_yielding
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import add, add_scaled, quat_conjugate, quat_mul, quat_rotate, quat_unit, slerp, sub
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

HELD_BACK = 6  # bisections
JUMP = 0.5  # rad or m: an angle recorded to change more in a step has changed its branch
EXTRAPOLATED, SHAPED, LAST, ALONG = 0, 1, 2, 3  # kinds of starts; ALONG + i: along with the i-th moving body near it


@kernel
def steady_change(ws: DrivenWorkspace, q: int, change: float) -> float:
    """A joint's change in a step, modulo 2π if it is periodic; 0 if it jumped."""
    if ws.links.rounds[q] == 1:
        change -= 2.0 * math.pi * math.floor(change / (2.0 * math.pi) + 0.5)
    return 0.0 if abs(change) > JUMP else change


@kernel
def _keep_pivot(scene: Scene, ws: DrivenWorkspace, posture: Posture, tree: int) -> None:
    """Translate a tree so that its pivot is where it was at the start of the step."""
    pose_tree(scene, ws.origins, tree, posture.roots, posture.angles, posture.poses)
    path = sub(pivot_of(ws, ws.work.before.poses, tree), pivot_of(ws, posture.poses, tree))
    for i in range(3):
        posture.roots[tree, i] += path[i]


@outlined
def _make_start(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, roots: Floats, angles: Floats, kind: int
) -> bool:
    """Write a tree's start of a kind to `SearchWorkspace.start`; False if there is none."""
    work, start = ws.work, ws.work.start
    before, articulated = work.before, work.kind[tree] == ARTICULATED
    p, q = position_of(roots, tree), orientation_of(roots, tree)
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        start.angles[j] = angles[j]
        if articulated:
            start.angles[j] = work.extrapolated[j] if kind == EXTRAPOLATED else before.angles[j]
    set_pose(start.roots, tree, p, q)
    if not articulated:
        if kind == EXTRAPOLATED:
            for i in range(3):
                start.roots[tree, i] += before.roots[tree, i] - state.recorded.roots[tree, i]
            return True
        _keep_pivot(scene, ws, start, tree)
    elif kind in (EXTRAPOLATED, SHAPED):
        old = orientation_of(state.recorded.roots, tree)
        rotation = quat_mul(q, quat_conjugate(old))
        arm = sub(position_of(before.roots, tree), position_of(state.recorded.roots, tree))
        set_pose(
            start.roots,
            tree,
            add(p, quat_rotate(rotation, arm)),
            quat_unit(quat_mul(rotation, orientation_of(before.roots, tree))),
        )
    else:
        set_pose(start.roots, tree, position_of(before.roots, tree), orientation_of(before.roots, tree))
    if kind < ALONG:
        return bool(kind != SHAPED or (articulated and scene.trees.dof_start[tree + 1] > scene.trees.dof_start[tree]))
    body = work.reference_bodies[kind - ALONG]
    if body < 0:
        return False
    rotation = quat_mul(orientation_of(start.poses, body), quat_conjugate(orientation_of(before.poses, body)))
    if articulated:
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
    energy = 0.0
    for tree in range(len(ws.work.kind)):
        if ws.work.kind[tree] != LOCKED:
            energy += tree_energy(scene, ws, posture.poses, tree)
    return energy


@kernel
def _pose_start(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, kind: int
) -> bool:
    """Pose the starts of one kind of the trees being solved; False if there are none."""
    work, some = ws.work, False
    for tree in range(len(work.kind)):
        if work.kind[tree] != LOCKED:
            some = _make_start(scene, state, ws, tree, roots, angles, kind) or some
    if some:
        pose_yielding(scene, ws, work.start)
    return some


@outlined
def choose_start(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> int:
    """The free and certified start nearest to the targets, into `SearchWorkspace.now`; returns its kind, -1 if there is none."""
    work, best, chosen = ws.work, math.inf, -1
    for i in range(len(work.reference_bodies)):
        work.reference_bodies[i] = -1
    for kind in range(ALONG + len(work.reference_bodies)):
        if not _pose_start(scene, state, ws, roots, angles, kind):
            continue
        cost = _cost(scene, ws, work.start)
        if cost >= best and kind != LAST:
            continue
        verdict = judge(scene, ws, work.start)
        if kind == LAST:
            note_reference_bodies(scene, ws)
        if verdict == FREE and cost < best:
            best, chosen = cost, kind
            copy_moving(scene, ws, work.start, work.now)
    return chosen


@outlined
def choose_shallowest(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> None:
    """The start of least overlap, into `SearchWorkspace.now`; `choose_start` must have been called before."""
    shallowest = -math.inf
    for kind in range(ALONG + len(ws.work.reference_bodies)):
        if not _pose_start(scene, state, ws, roots, angles, kind):
            continue
        least = measure_swept_pairs(scene, ws, ws.work.start)
        if least > shallowest:
            shallowest = least
            copy_moving(scene, ws, ws.work.start, ws.work.now)


@kernel
def _blend(scene: Scene, ws: DrivenWorkspace, share: float) -> None:
    """Interpolate `SearchWorkspace.start` between `.trial` (share 0) and `.best` (share 1)."""
    work = ws.work
    for tree in range(len(work.kind)):
        if work.kind[tree] == LOCKED:
            continue
        p0, p1 = position_of(work.trial.roots, tree), position_of(work.best.roots, tree)
        q = orientation_of(work.trial.roots, tree)
        if q != orientation_of(work.best.roots, tree):
            q = slerp(q, orientation_of(work.best.roots, tree), share)
        set_pose(work.start.roots, tree, add_scaled(p0, sub(p1, p0), share), q)
        for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            work.start.angles[j] = work.trial.angles[j] + share * (work.best.angles[j] - work.trial.angles[j])
        pose_with_pieces(scene, ws, work.start, tree)


@outlined
def shorten_start(scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats) -> None:
    """Shorten a start that moves along with a body, in `SearchWorkspace.now`, to the least motion that is free."""
    work, low, high = ws.work, 0.0, 1.0
    copy_moving(scene, ws, work.now, work.best)
    for tree in range(len(work.kind)):
        if work.kind[tree] != LOCKED:
            _make_start(scene, state, ws, tree, roots, angles, LAST)
    copy_moving(scene, ws, work.start, work.trial)
    for _ in range(HELD_BACK):
        middle = 0.5 * (low + high)
        _blend(scene, ws, middle)
        if judge(scene, ws, work.start) == FREE:
            high = middle
            copy_moving(scene, ws, work.start, work.now)
        else:
            low = middle
