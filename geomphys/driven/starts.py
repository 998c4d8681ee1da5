"""Free starts of a search: the last posture, the last one carried on by the recording, or along by what moves near it.

Each is tried as it would be at the end of the step; it counts if it is free there and the way to it, from the last posture
and with everything round it moving meanwhile, is certified.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.sweep import update_boxes
from geomphys.driven.advancement import centre_motion, pair_motion, turn_between, way_is_free
from geomphys.driven.constraints import concerns
from geomphys.driven.objective import pivot_of, tree_energy
from geomphys.driven.postures import Posture
from geomphys.driven.state import BENDS, STAYS, DrivenRoom, DrivenState
from geomphys.driven.stepping import copy_moving, find_concerned, measure_motion, place
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import add, add_scaled, norm, quat_conjugate, quat_mul, quat_rotate, quat_unit, slerp, sub
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]

HELD_BACK = 6  # bisections
JUMP = 0.5  # rad or m: an angle recorded to go farther in a step has changed its branch
CARRIED, SHAPED, LAST, ALONG = 0, 1, 2, 3  # kinds of starts; ALONG + i: with the i-th of what moves near it
FREE, TAKEN, UNCERTAIN = 0, 1, 2  # a start, or what stands against it


@outlined
def measure_drift(scene: Scene, room: DrivenRoom, before: Floats, after: Floats) -> None:
    """How far the pieces of what is not driven go from poses `before` (B, 7) to `after`: into `drift`."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == DRIVEN:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            turn = turn_between(before, after, body)
            for i in range(scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]):
                room.work.drift[i] = norm(centre_motion(scene, before, after, i)) + turn * scene.pieces.reach[i]


@kernel
def _farthest(scene: Scene, motion: Floats, tree: int) -> float:
    """The largest motion of a tree's pieces."""
    far = 0.0
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    for i in range(first, scene.bodies.piece_start[scene.trees.body_start[tree + 1]]):
        far = max(far, motion[i])
    return far


@outlined
def look_back(scene: Scene, room: DrivenRoom, posture: Posture) -> float:
    """Near pairs of the trees that yield, placed at `posture`, which they may have met on the way from where the step began.

    Returns the least separation.
    """
    p, work = room.places, room.work
    measure_motion(scene, room, work.before, posture)
    for tree in range(len(work.kind)):
        p.reach[tree, 0] = p.reach[tree, 1] = -math.inf if work.ignored[tree] == 1 else 0.0
        if work.kind[tree] != STAYS:
            p.reach[tree, 0] = p.reach[tree, 1] = _farthest(scene, work.motion, tree)
            update_boxes(scene, p.frames, room.boxes, tree)
        elif work.ignored[tree] == 0 and scene.trees.moving[tree] == 1 and scene.trees.role[tree] != DRIVEN:
            p.reach[tree, 0] = _farthest(scene, work.drift, tree)
    return find_concerned(scene, room, math.inf)


@kernel
def way_of_pair_is_free(scene: Scene, room: DrivenRoom, posture: Posture, k: int) -> bool:
    """Whether the near pair k, apart at `posture`, got there from where the step began without passing through."""
    near, work = room.near, room.work
    a, b, s = near.a[k], near.b[k], near.separation[k]
    if s > _moved(scene, room, a) + _moved(scene, room, b):
        return True
    motion, _ = pair_motion(scene, work.before.poses, posture.poses, a, b)
    if s > motion:
        return True
    return way_is_free(
        scene, work.before.poses, posture.poses, a, b, room.places.moved, room.axes, room.scratch
    )  # fmt: skip


@kernel
def _moved(scene: Scene, room: DrivenRoom, piece: int) -> float:
    """How far a piece has gone since the step began."""
    tree = scene.bodies.tree[scene.pieces.body[piece]]
    if scene.trees.role[tree] != DRIVEN:
        return float(room.work.drift[piece])
    return float(room.work.motion[piece]) if room.work.kind[tree] != STAYS else 0.0


@outlined
def judge(scene: Scene, room: DrivenRoom, posture: Posture) -> tuple[int, float]:
    """(FREE, TAKEN or UNCERTAIN, least separation) of a posture of the trees that yield, whose pieces are placed."""
    least = look_back(scene, room, posture)
    if least < 0.0:
        return TAKEN, least
    for k in range(room.near.filled[0]):
        if concerns(room, k) and not way_of_pair_is_free(scene, room, posture, k):
            return UNCERTAIN, least
    return FREE, least


@kernel
def _keep_pivot(scene: Scene, room: DrivenRoom, posture: Posture, tree: int) -> None:
    """Shift a tree to where its pivot was when the step began."""
    pose_tree(scene, room.origins, tree, posture.roots, posture.angles, posture.poses)
    way = sub(pivot_of(room, room.work.before.poses, tree), pivot_of(room, posture.poses, tree))
    for i in range(3):
        posture.roots[tree, i] += way[i]


@outlined
def _make_start(
    scene: Scene, state: DrivenState, room: DrivenRoom, tree: int, roots: Floats, angles: Floats, kind: int
) -> bool:
    """Write a tree's start of a kind to `Workspace.start`; False if there is none."""
    work, start = room.work, room.work.start
    before, bends = work.before, work.kind[tree] == BENDS
    p, q = position_of(roots, tree), orientation_of(roots, tree)
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        start.angles[j] = angles[j]
        if bends:
            start.angles[j] = work.carried[j] if kind == CARRIED else before.angles[j]
    set_pose(start.roots, tree, p, q)
    if not bends:
        if kind == CARRIED:
            for i in range(3):
                start.roots[tree, i] += before.roots[tree, i] - state.recorded.roots[tree, i]
            return True
        _keep_pivot(scene, room, start, tree)
    elif kind in (CARRIED, SHAPED):
        old = orientation_of(state.recorded.roots, tree)
        turn = quat_mul(q, quat_conjugate(old))
        arm = sub(position_of(before.roots, tree), position_of(state.recorded.roots, tree))
        set_pose(
            start.roots,
            tree,
            add(p, quat_rotate(turn, arm)),
            quat_unit(quat_mul(turn, orientation_of(before.roots, tree))),
        )
    else:
        set_pose(start.roots, tree, position_of(before.roots, tree), orientation_of(before.roots, tree))
    if kind < ALONG:
        return bool(kind != SHAPED or (bends and scene.trees.dof_start[tree + 1] > scene.trees.dof_start[tree]))
    body = work.carriers[kind - ALONG]
    if body < 0:
        return False
    turn = quat_mul(orientation_of(start.poses, body), quat_conjugate(orientation_of(before.poses, body)))
    if bends:
        arm = sub(position_of(start.roots, tree), position_of(before.poses, body))
        at = add(position_of(start.poses, body), quat_rotate(turn, arm))
        set_pose(start.roots, tree, at, quat_unit(quat_mul(turn, orientation_of(start.roots, tree))))
    else:
        pivot = pivot_of(room, before.poses, tree)
        moved = add(position_of(start.poses, body), quat_rotate(turn, sub(pivot, position_of(before.poses, body))))
        for i in range(3):
            start.roots[tree, i] += moved[i] - pivot[i]
    return True


@outlined
def _note_carriers(scene: Scene, room: DrivenRoom) -> None:
    """The nearest bodies that the recording moves, of the near pairs as they were looked for last."""
    near, carriers = room.near, room.work.carriers
    for i in range(len(carriers)):
        carriers[i] = -1
    for i in range(len(carriers)):
        least = math.inf
        for k in range(near.filled[0]):
            if not concerns(room, k) or near.separation[k] >= least:
                continue
            body = scene.pieces.body[near.b[k]]
            if scene.bodies.role[body] == DRIVEN or scene.trees.moving[scene.bodies.tree[body]] == 0:
                continue
            if room.work.drift[near.b[k]] == 0.0:
                continue
            known = False
            for j in range(i):
                known = known or carriers[j] == body
            if not known:
                least, carriers[i] = near.separation[k], body


@kernel
def _cost(scene: Scene, room: DrivenRoom, posture: Posture) -> float:
    """Energy of the trees that yield."""
    energy = 0.0
    for tree in range(len(room.work.kind)):
        if room.work.kind[tree] != STAYS:
            energy += tree_energy(scene, room, posture.poses, tree)
    return energy


@outlined
def choose_start(
    scene: Scene, state: DrivenState, room: DrivenRoom, roots: Floats, angles: Floats
) -> tuple[int, float]:
    """The free and certified start nearest to the targets, into `Workspace.now`: (its kind, -1 if there is none, energy).

    Without one, `Workspace.now` is the start that overlaps least.
    """
    work, best, chosen, shallowest = room.work, math.inf, -1, -math.inf
    for i in range(len(work.carriers)):
        work.carriers[i] = -1
    for kind in range(ALONG + len(work.carriers)):
        some = False
        for tree in range(len(work.kind)):
            if work.kind[tree] != STAYS:
                some = _make_start(scene, state, room, tree, roots, angles, kind) or some
        if not some:
            continue
        for tree in range(len(work.kind)):
            if work.kind[tree] != STAYS:
                place(scene, room, work.start, tree)
        cost = _cost(scene, room, work.start)
        if cost >= best and kind != LAST:
            continue
        verdict, least = judge(scene, room, work.start)
        if kind == LAST:
            _note_carriers(scene, room)
        if verdict == FREE and cost < best:
            best, chosen = cost, kind
            copy_moving(scene, room, work.start, work.now)
        elif chosen < 0 and least > shallowest:
            shallowest = least
            copy_moving(scene, room, work.start, work.now)
    return chosen, best


@kernel
def _blend(scene: Scene, room: DrivenRoom, share: float) -> None:
    """`Workspace.start`: a share of the way from `Workspace.trial` to `Workspace.best`, of the trees that yield."""
    work = room.work
    for tree in range(len(work.kind)):
        if work.kind[tree] == STAYS:
            continue
        p0, p1 = position_of(work.trial.roots, tree), position_of(work.best.roots, tree)
        q = orientation_of(work.trial.roots, tree)
        if q != orientation_of(work.best.roots, tree):
            q = slerp(q, orientation_of(work.best.roots, tree), share)
        set_pose(work.start.roots, tree, add_scaled(p0, sub(p1, p0), share), q)
        for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            work.start.angles[j] = work.trial.angles[j] + share * (work.best.angles[j] - work.trial.angles[j])
        place(scene, room, work.start, tree)


@outlined
def hold_back(scene: Scene, state: DrivenState, room: DrivenRoom, roots: Floats, angles: Floats) -> None:
    """A start that goes along with something, in `Workspace.now`: go along only as far as it takes."""
    work, low, high = room.work, 0.0, 1.0
    copy_moving(scene, room, work.now, work.best)
    for tree in range(len(work.kind)):
        if work.kind[tree] != STAYS:
            _make_start(scene, state, room, tree, roots, angles, LAST)
    copy_moving(scene, room, work.start, work.trial)
    for _ in range(HELD_BACK):
        middle = 0.5 * (low + high)
        _blend(scene, room, middle)
        if judge(scene, room, work.start)[0] == FREE:
            high = middle
            copy_moving(scene, room, work.start, work.now)
        else:
            low = middle
