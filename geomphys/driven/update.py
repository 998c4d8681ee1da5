"""The driven loop of a frame: the coupling pulls, overlaps are eliminated, the offset remembers.

Trees are carried over from the last frame at their place in the world. What turned or bent since then (the hand's
shape, a door on its hinge) may have moved into something: those overlaps are small, and if they are not small against
the thickness of the pieces, the change is made in several steps, so that nothing can come through. Then every tree
goes as near to where the coupling pulls as it can without meeting anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, find_near
from geomphys.collision.gjk import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.coupling import relax
from geomphys.driven.escape import Rescue
from geomphys.driven.least_distance import LeastDistance
from geomphys.driven.overlap import Places, eliminate_overlap, place_at, row_of
from geomphys.kernel import kernel
from geomphys.vec3 import add_scaled, dot, slerp, sub, unit
from geomphys.world.kinematics import orientation_of, place_tree, pose_tree, position_of, set_pose
from geomphys.world.scene import DRIVEN, SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP_OF_THICKNESS = 0.25  # a pair may turn or bend by this share of its mean thickness in one step
MOST_STEPS = 64


class DrivenState(NamedTuple):
    """What the driven loop carries from frame to frame."""

    started: Ints  # (1,) 0 before the first frame
    offset: Floats  # (T, 3) m, of each tree from its recorded pose
    speed: Floats  # (T, 3) m/s, of the offset
    roots: Floats  # (T, 7) recorded root poses of the last frame
    angles: Floats  # (Q,) recorded angles of the last frame
    frames: Floats  # (P, 12) pieces at the end of the last frame


class DrivenRoom(NamedTuple):
    """Scratch of the driven loop."""

    places: Places
    near: Near
    problem: LeastDistance
    rescue: Rescue
    stir: Floats  # (P,) m, how far turning and bending moved each piece
    roots: Floats  # (T, 7) between two frames
    angles: Floats  # (Q,)
    poses: Floats  # (B, 7)
    goal: Floats  # (T, 3) the frame's goals, while a step between has its own


def make_driven_state(scene: Scene) -> DrivenState:
    """The state before the first frame."""
    trees, pieces = len(scene.trees.role), len(scene.pieces.kind)
    return DrivenState(
        np.zeros(1, np.int64), np.zeros((trees, 3)), np.zeros((trees, 3)), np.zeros((trees, 7)),
        np.zeros(len(scene.dofs.lower)), np.zeros((pieces, 12)),
    )  # fmt: skip


@kernel
def begin_frame(scene: Scene, state: DrivenState, places: Places, roots: Floats, dt: float) -> None:
    """Goal and present place of every driven tree, as offsets from the pose recorded now."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        for i in range(3):
            if state.started[0] == 0:
                places.goal[tree, i] = places.current[tree, i] = 0.0
                continue
            places.current[tree, i] = state.offset[tree, i] + (state.roots[tree, i] - roots[tree, i])
            places.goal[tree, i], state.speed[tree, i] = relax(
                state.offset[tree, i],
                state.speed[tree, i],
                scene.trees.mass[tree],
                scene.trees.stiffness[tree],
                scene.trees.damping[tree],
                dt,
            )


@kernel
def _measure_stir(scene: Scene, before: Floats, p: Places, stir: Floats) -> None:
    """How far each piece has moved since the last frame's end, its tree's root standing still: a bound over its points."""
    pieces = scene.pieces
    for tree in range(len(scene.trees.role)):
        p.stir[tree] = 0.0
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == SIMULATED:
            continue
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            square = 0.0
            for k in range(9):
                change = p.frames[i, k] - before[i, k]
                square += change * change
            distance = 0.0
            for k in range(3):
                shift = p.frames[i, 9 + k] - before[i, 9 + k]
                for j in range(3):
                    shift += (p.frames[i, 3 * k + j] - before[i, 3 * k + j]) * pieces.centre[i, j]
                distance += shift * shift
            turn = 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))
            stir[i] = math.sqrt(distance) + turn * pieces.reach[i]
            p.stir[tree] = max(p.stir[tree], stir[i])


@kernel
def _steps_needed(scene: Scene, room: DrivenRoom, boxes: Boxes, gap: float, axes: Axes, scratch: Scratch) -> int:
    """Into how many steps the change of shape must be cut so that no pair can pass through each other."""
    p = room.places
    for tree in range(len(p.reach)):
        p.reach[tree] = p.stir[tree]
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, p.frames, boxes, tree)
    find_near(scene, p.frames, boxes, p.reach, gap, room.near, p.found, axes, scratch)
    steps = 1.0
    for k in range(room.near.count[0]):
        a, b = room.near.a[k], room.near.b[k]
        change = room.stir[a] + room.stir[b]
        thickness = 0.5 * (scene.pieces.thickness[a] + scene.pieces.thickness[b])
        if room.near.separation[k] <= change and change > STEP_OF_THICKNESS * thickness:
            steps = max(steps, math.ceil(change / (STEP_OF_THICKNESS * max(thickness, 1e-5))))
    return int(min(steps, float(MOST_STEPS)))


@kernel
def _shape_between(
    scene: Scene, origins: Floats, state: DrivenState, room: DrivenRoom, roots: Floats, angles: Floats, w: float
) -> None:
    """Place all moving trees a share `w` of the way from the last frame's recording to this one's, driven roots at their
    place in the world."""
    p = room.places
    for i in range(len(angles)):
        room.angles[i] = state.angles[i] + w * (angles[i] - state.angles[i])
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == SIMULATED:
            continue
        q = slerp(orientation_of(state.roots, tree), orientation_of(roots, tree), w)
        p0, p1 = position_of(state.roots, tree), position_of(roots, tree)
        place = add_scaled(p0, sub(p1, p0), w)
        set_pose(room.roots, tree, place, q)
        pose_tree(scene, origins, tree, room.roots, room.angles, room.poses)
        place_tree(scene, tree, room.poses, p.base)
        for i in range(3):  # current is kept as an offset from the pose recorded in this frame
            p.trial[tree, i] = p.current[tree, i] + (roots[tree, i] - place[i])
        if scene.trees.role[tree] != DRIVEN:
            for i in range(3):
                p.trial[tree, i] = 0.0
        place_at(scene, p.base, p.trial, tree, p.frames)
        place_at(scene, p.base, p.trial, tree, p.moved)


@kernel
def _place_recorded(scene: Scene, poses: Floats, p: Places) -> None:
    """All moving trees as recorded, driven ones shifted to `current`."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0 or scene.trees.role[tree] == SIMULATED:
            continue
        place_tree(scene, tree, poses, p.base)
        place_at(scene, p.base, p.current, tree, p.frames)
        place_at(scene, p.base, p.current, tree, p.moved)


@kernel
def _brake(state: DrivenState, p: Places, tree: int) -> None:
    """After a contact the offset has no speed left against what it met."""
    push = sub(row_of(p.current, tree), row_of(p.goal, tree))
    if push == (0.0, 0.0, 0.0):
        return
    push = unit(push)
    against = dot(row_of(state.speed, tree), push)
    if against < 0.0:
        for i in range(3):
            state.speed[tree, i] -= against * push[i]


@kernel
def update_driven(
    scene: Scene, origins: Floats, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats,
    recorded: Floats, gap: float, rounds: int, axes: Axes, scratch: Scratch,
) -> tuple[int, int, int, bool]:  # fmt: skip
    """Eliminate the overlaps of this frame; `begin_frame` has set goals and places.

    Parameters
    ----------
    scene, origins
        The scene and its joints' origins.
    state, room, boxes
        Carried state (offset, speed and frames are brought up to date), scratch, boxes.
    roots, angles, recorded
        (T, 7), (Q,), (B, 7): the recording of this frame.
    gap, rounds
        Clearance kept [m]; bound on the rounds.
    axes, scratch
        For the narrow phase.

    Returns
    -------
    tuple
        (rounds, method, searches for a way out, converged), as `eliminate_overlap`.
    """
    p = room.places
    rounds_taken, method, rescues, converged = 0, 0, 0, True
    _place_recorded(scene, recorded, p)
    for tree in range(len(p.stir)):
        p.stir[tree] = 0.0
    if state.started[0] == 1:
        _measure_stir(scene, state.frames, p, room.stir)
        steps = _steps_needed(scene, room, boxes, gap, axes, scratch)
        for step in range(1, steps):
            w = step / steps
            _shape_between(scene, origins, state, room, roots, angles, w)
            for tree in range(len(scene.trees.role)):
                if scene.trees.role[tree] == DRIVEN:
                    for i in range(3):
                        room.goal[tree, i] = p.goal[tree, i]
                        p.current[tree, i] = p.trial[tree, i]
                        p.goal[tree, i] = p.trial[tree, i]
                elif scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED:
                    update_boxes(scene, p.frames, boxes, tree)
            n, m, r, ok = eliminate_overlap(
                scene, p, boxes, room.near, room.problem, gap, rounds, room.rescue, axes, scratch
            )  # fmt: skip
            rounds_taken, method, rescues, converged = rounds_taken + n, max(method, m), rescues + r, converged and ok
            for tree in range(len(scene.trees.role)):
                if scene.trees.role[tree] == DRIVEN:
                    for i in range(3):
                        place = state.roots[tree, i] + w * (roots[tree, i] - state.roots[tree, i])
                        p.current[tree, i] += place - roots[tree, i]
                        p.goal[tree, i] = room.goal[tree, i]
        if steps > 1:
            _place_recorded(scene, recorded, p)
            for tree in range(len(scene.trees.role)):
                if scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED:
                    update_boxes(scene, p.frames, boxes, tree)
    n, m, r, ok = eliminate_overlap(scene, p, boxes, room.near, room.problem, gap, rounds, room.rescue, axes, scratch)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            _brake(state, p, tree)
            for i in range(3):
                state.offset[tree, i] = p.current[tree, i]
    return rounds_taken + n, max(method, m), rescues + r, converged and ok


@kernel
def end_frame(scene: Scene, state: DrivenState, places: Places, roots: Floats, angles: Floats) -> None:
    """Remember what the next frame starts from."""
    state.started[0] = 1
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0:
            continue
        for k in range(7):
            state.roots[tree, k] = roots[tree, k]
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            for k in range(12):
                state.frames[i, k] = places.frames[i, k]
    for i in range(len(angles)):
        state.angles[i] = angles[i]
