"""The driven loop of a frame: the coupling pulls, overlaps are eliminated, the offset remembers.

Trees are carried over from the last frame at their place in the world. What turned or bent since then (the hand's
shape, a door on its hinge) may have moved into something: those overlaps are small. Where they would not be small
against the thickness of the pieces, the frame is taken in several steps of interpolated recording, so that nothing
can come through. Then every tree goes as near to where the coupling pulls as it can without meeting anything.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, find_near
from geomphys.collision.penetration import Scratch
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
    roots: Floats  # (T, 7) recorded root poses of the last step
    angles: Floats  # (Q,) recorded angles of the last step
    frames: Floats  # (P, 12) pieces at the end of the last step


class DrivenRoom(NamedTuple):
    """Scratch of the driven loop."""

    places: Places
    near: Near
    problem: LeastDistance
    rescue: Rescue
    stir: Floats  # (P,) m, how far turning and bending move each piece
    roots: Floats  # (T, 7) recorded root poses of a step
    angles: Floats  # (Q,)
    poses: Floats  # (B, 7) recorded poses of a step


class Outcome(NamedTuple):
    """What the driven loop did in a frame."""

    rounds: int
    method: int  # as in results.METHODS
    rescues: int  # searches for a way out
    converged: bool


def make_driven_state(scene: Scene) -> DrivenState:
    """The state before the first frame."""
    trees, pieces = len(scene.trees.role), len(scene.pieces.kind)
    return DrivenState(
        np.zeros(1, np.int64), np.zeros((trees, 3)), np.zeros((trees, 3)), np.zeros((trees, 7)),
        np.zeros(len(scene.dofs.lower)), np.zeros((pieces, 12)),
    )  # fmt: skip


@kernel
def is_recorded(scene: Scene, tree: int) -> bool:
    """Whether the recording moves the tree."""
    return scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED


@kernel
def _pull(scene: Scene, state: DrivenState, places: Places, roots: Floats, dt: float) -> None:
    """Goal (the coupling's) and present place of every driven tree, as offsets from the pose recorded now."""
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
def _place_trees(scene: Scene, poses: Floats, p: Places, boxes: Boxes) -> None:
    """All trees the recording moves at `poses` (B, 7), driven ones shifted to `current`."""
    for tree in range(len(scene.trees.role)):
        if is_recorded(scene, tree):
            place_tree(scene, tree, poses, p.base)
            place_at(scene, p.base, p.current, tree, p.frames)
            place_at(scene, p.base, p.current, tree, p.moved)
            update_boxes(scene, p.frames, boxes, tree)


@kernel
def _measure_stir(scene: Scene, before: Floats, p: Places, stir: Floats) -> None:
    """How far each piece has moved since the last step's end, its tree's root standing still: a bound over its points."""
    pieces = scene.pieces
    for tree in range(len(scene.trees.role)):
        p.stir[tree] = 0.0
        if not is_recorded(scene, tree):
            continue
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            square, distance = 0.0, 0.0
            for k in range(9):
                change = p.frames[i, k] - before[i, k]
                square += change * change
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
    """Into how many steps the frame must be cut so that no pair can turn or bend through each other."""
    p = room.places
    widest = 0.0
    for tree in range(len(p.reach)):
        p.reach[tree] = p.stir[tree]
        widest = max(widest, p.stir[tree])
    if widest == 0.0:
        return 1
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
def _record_between(
    scene: Scene, origins: Floats, state: DrivenState, room: DrivenRoom, roots: Floats, angles: Floats, w: float
) -> None:
    """The recording a share `w` of the way from the last step to this frame, into `room`."""
    for i in range(len(angles)):
        room.angles[i] = state.angles[i] + w * (angles[i] - state.angles[i])
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        q = slerp(orientation_of(state.roots, tree), orientation_of(roots, tree), w)
        p0, p1 = position_of(state.roots, tree), position_of(roots, tree)
        set_pose(room.roots, tree, add_scaled(p0, sub(p1, p0), w), q)
        pose_tree(scene, origins, tree, room.roots, room.angles, room.poses)


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
def _remember(scene: Scene, state: DrivenState, p: Places, roots: Floats, angles: Floats) -> None:
    """What the next step starts from."""
    state.started[0] = 1
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for k in range(7):
            state.roots[tree, k] = roots[tree, k]
        for i in range(3):
            state.offset[tree, i] = p.current[tree, i]
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            for k in range(12):
                state.frames[i, k] = p.frames[i, k]
    for i in range(len(angles)):
        state.angles[i] = angles[i]


@kernel
def _advance(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, poses: Floats, dt: float,
    gap: float, rounds: int, axes: Axes, scratch: Scratch,
) -> Outcome:  # fmt: skip
    """One step: trees placed at `poses` and carried over; they go as near to their goals as they can."""
    p = room.places
    _pull(scene, state, p, roots, dt)
    _place_trees(scene, poses, p, boxes)
    if state.started[0] == 1:
        _measure_stir(scene, state.frames, p, room.stir)
    count, method, rescues, converged = eliminate_overlap(
        scene, p, boxes, room.near, room.problem, gap, rounds, room.rescue, axes, scratch
    )  # fmt: skip
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            _brake(state, p, tree)
    _remember(scene, state, p, roots, angles)
    return Outcome(count, method, rescues, converged)


@kernel
def update_driven(
    scene: Scene, origins: Floats, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats,
    recorded: Floats, dt: float, gap: float, rounds: int, axes: Axes, scratch: Scratch,
) -> Outcome:  # fmt: skip
    """Couple the driven trees to this frame's recording and eliminate their overlaps.

    Parameters
    ----------
    scene, origins
        The scene and its joints' origins.
    state, room, boxes
        Carried state (brought up to date), scratch (`room.places.frames` holds the final frames), boxes.
    roots, angles, recorded
        (T, 7), (Q,), (B, 7): the recording of this frame and its forward kinematics.
    dt
        s since the last frame.
    gap, rounds
        Clearance kept [m]; bound on the rounds of a step.
    axes, scratch
        For the narrow phase.
    """
    p = room.places
    steps = 1
    if state.started[0] == 1:
        _pull(scene, state, p, roots, 0.0)
        _place_trees(scene, recorded, p, boxes)
        _measure_stir(scene, state.frames, p, room.stir)
        steps = _steps_needed(scene, room, boxes, gap, axes, scratch)
    count, method, rescues, converged = 0, 0, 0, True
    for step in range(steps):
        if step == steps - 1:
            done = _advance(scene, state, room, boxes, roots, angles, recorded, dt / steps, gap, rounds, axes, scratch)
        else:
            _record_between(scene, origins, state, room, roots, angles, 1.0 / (steps - step))
            done = _advance(
                scene, state, room, boxes, room.roots, room.angles, room.poses, dt / steps, gap, rounds, axes, scratch
            )  # fmt: skip
        count, rescues = count + done.rounds, rescues + done.rescues
        method, converged = max(method, done.method), converged and done.converged
    return Outcome(count, method, rescues, converged)
