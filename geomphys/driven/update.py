"""The driven loop of a frame: the coupling pulls, overlaps are eliminated, the offset remembers.

Trees are carried over from the last frame at their place in the world, joints of chains at their angle. What else
turned or bent since then (the hand's shape, a door on its hinge) may have moved into something: those overlaps are
small, as a frame is cut into steps where they would not be small against the thickness of the pieces. Then every tree
goes as near to where the coupling pulls as it can without meeting anything: first the roots, for the links that no
chain moves; then the chains, for theirs; then the roots again, for what the chains could not solve. A tree whose turn or shape
leaves no free place is held (`hold.py`), and the step done again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.carry import carry_along, note_carriers
from geomphys.driven.chain_room import is_chained
from geomphys.driven.chain_step import brake_joints, pull_joints, yield_chains
from geomphys.driven.chains import place_posture
from geomphys.driven.coupling import relax_offset
from geomphys.driven.escape import ALONG, ASKED, LOOSE
from geomphys.driven.hold import copy_recording, keep_turn, relax_lag, remember_lag
from geomphys.driven.overlap import INTERPOLATED, eliminate_overlap, find_reachable
from geomphys.driven.pace import is_too_fast, last_place, slow_down
from geomphys.driven.places import Places, place_at, row_of
from geomphys.driven.state import DrivenRoom, DrivenState
from geomphys.driven.steps import MOST_STEPS, is_recorded, measure_stir, recording_between, steps_needed
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import dot, norm, sub, unit
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import place_tree

Floats = NDArray[np.float64]

DRIFT = 1.2  # times its recorded motion, and
DRIFT_SLACK = 8e-4  # m: how far a tree steps aside in a step
STEPS_OF_A_WEDGE = 8  # into which a frame is cut where a tree is wedged


class Outcome(NamedTuple):
    """What the driven loop did in a frame."""

    rounds: int
    method: int  # as in results.METHODS
    rescues: int  # searches for a way out, and postures held
    converged: bool


@kernel
def _pull(scene: Scene, state: DrivenState, room: DrivenRoom, roots: Floats, dt: float) -> None:
    """Goal (the coupling's) and present place of every driven tree, as offsets from the pose recorded now."""
    p, trees = room.places, scene.trees
    for tree in range(len(trees.role)):
        if trees.role[tree] != DRIVEN:
            continue
        for i in range(3):
            if state.started[0] == 0:
                p.goal[tree, i] = p.current[tree, i] = 0.0
                continue
            p.current[tree, i] = last_place(state, room, roots, tree, i)
            p.goal[tree, i], state.speed[tree, i] = relax_offset(
                trees, tree, state.offset[tree, i], state.speed[tree, i], dt
            )


@outlined
def _place_trees(scene: Scene, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, poses: Floats) -> None:
    """All trees the recording moves, driven ones at their present root and, if chained, at the posture they are pulled to."""
    p = room.places
    for tree in range(len(scene.trees.role)):
        if is_recorded(scene, tree) and not is_chained(scene, tree):
            place_tree(scene, tree, poses, p.base)
            place_at(scene, p.base, p.current, tree, p.frames)
            place_at(scene, p.base, p.current, tree, p.moved)
            update_boxes(scene, p.frames, boxes, tree)
    if room.joints.any[0] == 1:
        place_posture(
            scene, room.origins, room.joints, roots, angles, room.chains.goal, p.current, room.chains, p, boxes
        )  # fmt: skip


@kernel
def _drift(scene: Scene, state: DrivenState, p: Places, roots: Floats) -> None:
    """A tree that is to step aside is pulled there, by what its recorded motion excuses."""
    for tree in range(len(scene.trees.role)):
        aside = row_of(state.drift, tree)
        if aside == (0.0, 0.0, 0.0):
            continue
        moved = norm(sub(row_of(roots, tree), row_of(state.roots, tree)))
        far = DRIFT * (moved + p.stir[tree, 0]) + DRIFT_SLACK
        for i in range(3):
            p.goal[tree, i] = state.offset[tree, i] + far * aside[i]
            state.speed[tree, i] = 0.0


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
    state.steps[0] += 1
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
def _keep_speeds(scene: Scene, state: DrivenState, room: DrivenRoom, keep: bool) -> None:
    """Keep the speeds of all offsets, or go back to those that were kept: what followed is done again, in another way."""
    wanted, posture = room.wanted, state.posture
    for tree in range(len(state.speed)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        for i in range(3):
            if keep:
                wanted.speed[tree, i] = state.speed[tree, i]
            else:
                state.speed[tree, i] = wanted.speed[tree, i]
    for q in range(len(posture.speed)):
        if keep:
            wanted.bend[q], wanted.bend_speed[q] = posture.bend[q], posture.speed[q]
        else:
            posture.bend[q], posture.speed[q] = wanted.bend[q], wanted.bend_speed[q]


@kernel
def _any_carried(p: Places) -> bool:
    """Whether some tree is to be carried."""
    found = False
    for tree in range(len(p.held)):
        found = found or p.held[tree] >= ALONG
    return found


@outlined
def _begin_step(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, poses: Floats, dt: float,
    gap: float, axes: Axes, scratch: Scratch,
) -> None:  # fmt: skip
    """Goals of a step, trees placed at `poses` and carried over, and the pairs they may meet on the way."""
    p = room.places
    _pull(scene, state, room, roots, dt)
    pull_joints(scene, state, room, angles, dt)
    _place_trees(scene, room, boxes, roots, angles, poses)
    if state.started[0] == 1:
        measure_stir(scene, room.joints, state.frames, room.before, room.after, p, room.stir)
        _drift(scene, state, p, roots)
    find_reachable(scene, p, boxes, room.near, True, gap, axes, scratch)


@outlined
def _end_step(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, dt: float, gap: float,
    rounds: int, axes: Axes, scratch: Scratch,
) -> Outcome:  # fmt: skip
    """The trees go as near to their goals as they can. If some are to be held (`Places.asked`) nothing is remembered."""
    p, chained = room.places, room.joints.any[0] == 1
    count, method, rescues, converged = eliminate_overlap(
        scene, p, boxes, room.near, True, room.joints.bends, room.problem, gap, rounds, room.rescue, axes, scratch
    )  # fmt: skip
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            _brake(state, p, tree)
    if p.asked[0] != ASKED and state.started[0] == 1 and is_too_fast(scene, state, p, dt):
        more, searches = slow_down(scene, state, room, boxes, roots, dt, gap, rounds, axes, scratch)
        count, rescues = count + more, rescues + searches
    if p.asked[0] == ASKED:
        return Outcome(count, method, rescues, converged)
    if chained:
        passes, how, free = yield_chains(scene, state, room, boxes, roots, angles, dt, gap, axes, scratch)
        count, method = count + passes, max(method, how)
        rescues += 1 if how == INTERPOLATED else 0
        brake_joints(state, room)
        if not free:
            for tree in range(len(scene.trees.role)):
                for i in range(3):
                    p.goal[tree, i] = p.current[tree, i]
            more, how, searches, ok = eliminate_overlap(
                scene, p, boxes, room.near, False, room.nothing, room.problem, gap, rounds, room.rescue, axes, scratch
            )  # fmt: skip
            count, method, rescues, converged = count + more, max(method, how), rescues + searches, converged and ok
            if p.asked[0] == ASKED:
                return Outcome(count, method, rescues, converged)
    _remember(scene, state, p, roots, angles)
    return Outcome(count, method, rescues, converged)


@outlined
def update_driven(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, angles: Floats, recorded: Floats,
    dt: float, gap: float, rounds: int, axes: Axes, scratch: Scratch,
) -> Outcome:  # fmt: skip
    """Couple the driven trees to this frame's recording and eliminate their overlaps.

    Parameters
    ----------
    scene
        The scene.
    state, room, boxes
        Carried state (brought up to date), scratch (`room.places.frames` holds the final frames, `room.chains` the final
        posture), boxes.
    roots, angles, recorded
        (T, 7), (Q,), (B, 7): the recording of this frame and its forward kinematics.
    dt
        s since the last frame.
    gap, rounds
        Clearance kept [m]; bound on the rounds of a step.
    axes, scratch
        For the narrow phase.
    """
    p, steps, trees = room.places, 1, len(scene.trees.role)
    for tree in range(trees):
        p.held[tree], p.behind[tree] = LOOSE, state.lag.behind[tree]
    p.begun[0] = p.asked[0] = state.started[0]
    p.escapes[0] = p.passing[0] = 0
    to_roots, to_angles, to_poses = roots, angles, recorded
    if relax_lag(scene, room.origins, state.lag, room.wanted, roots, angles, recorded, dt):
        to_roots, to_angles, to_poses = room.wanted.roots, room.wanted.angles, room.wanted.poses
    room.share[0] = 1.0
    _keep_speeds(scene, state, room, True)
    _begin_step(scene, state, room, boxes, to_roots, to_angles, to_poses, dt, gap, axes, scratch)
    if state.started[0] == 1:
        steps = steps_needed(scene, room.joints, p, state.frames, room.near, room.stir, gap, axes, scratch)
    count, method, rescues, converged = 0, 0, 0, steps <= MOST_STEPS
    if steps == 1:
        done = _end_step(scene, state, room, boxes, to_roots, to_angles, dt, gap, rounds, axes, scratch)
        if p.asked[0] != ASKED:
            remember_lag(scene, state.lag, p.held, state.roots, state.angles, roots, angles)
            return done
        count, method, rescues, steps = done.rounds, done.method, done.rescues, STEPS_OF_A_WEDGE
        p.asked[0] = 1
        for tree in range(trees):
            p.held[tree] = LOOSE
    _keep_speeds(scene, state, room, False)
    steps = min(steps, MOST_STEPS)
    room.share[0], part, left = 1.0 / steps, dt / steps, steps
    while left > 0:
        for tree in range(trees):
            p.held[tree] = min(p.held[tree], ALONG)
        parts, p.passing[0] = 1, 1 if left > 1 else 0
        for again in range(2 * trees + 1):
            recording_between(
                scene, room.origins, state.roots, state.angles, to_roots, to_angles, 1.0 / left, room.roots, room.angles,
                room.poses,
            )  # fmt: skip
            if left == 1:
                copy_recording(to_roots, to_angles, to_poses, room.roots, room.angles, room.poses)
            carried = _any_carried(p)
            if carried:
                carry_along(scene, state, room, room.poses)
            keep_turn(
                scene, room.origins, p.held, room.carried.turned, state.roots, state.angles, room.roots, room.angles, room.poses
            )  # fmt: skip
            _keep_speeds(scene, state, room, again == 0)
            r, q, poses = room.roots, room.angles, room.poses
            _begin_step(scene, state, room, boxes, r, q, poses, part, gap, axes, scratch)
            if carried:
                parts = steps_needed(scene, room.joints, p, state.frames, room.near, room.stir, gap, axes, scratch)
                if parts > 1 and left * parts <= MOST_STEPS:
                    break
                parts = 1
            done = _end_step(scene, state, room, boxes, r, q, part, gap, rounds, axes, scratch)
            count, rescues = count + done.rounds, rescues + done.rescues
            method, converged = max(method, done.method), converged and done.converged
            if p.hasty[0] == 1 and rescues > 0:
                return Outcome(count, method, rescues, False)
            if p.asked[0] != ASKED:
                break
            p.asked[0] = 1
            note_carriers(scene, p, room.near, room.carried)
        if parts > 1:  # what carries moves too far for one step
            _keep_speeds(scene, state, room, False)
            room.share[0], part, left = room.share[0] / parts, part / parts, left * parts
        else:
            left -= 1
    remember_lag(scene, state.lag, p.held, state.roots, state.angles, roots, angles)
    return Outcome(count, method, rescues, converged)


@outlined
def give_way(
    scene: Scene,
    state: DrivenState,
    room: DrivenRoom,
    boxes: Boxes,
    gap: float,
    rounds: int,
    axes: Axes,
    scratch: Scratch,
) -> int:
    """Move driven trees out of what has come into them since `update_driven`, as little as it takes.

    Parameters are those of `update_driven`. Returns the rounds taken.
    """
    p = room.places
    p.asked[0] = 0
    for tree in range(len(scene.trees.role)):
        p.stir[tree, 0] = p.stir[tree, 1] = 0.0
        for i in range(3):
            p.goal[tree, i] = p.current[tree, i]
    taken, _, _, _ = eliminate_overlap(
        scene, p, boxes, room.near, False, room.nothing, room.problem, gap, rounds, room.rescue, axes, scratch
    )  # fmt: skip
    _remember(scene, state, p, state.roots, state.angles)
    return taken
