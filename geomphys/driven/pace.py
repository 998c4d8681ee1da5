"""The pace of an offset: what slides along an obstacle on its way back does so no faster than the recording moves.

The coupling pulls an offset straight back in a time of its own (6). Where an obstacle turns that pull aside, the tree
slides, and the spring would have it whip round a corner within a frame. What of the change of an offset is not the
spring's straight way back is therefore held to what the recorded motion of the step excuses; the tree stops short on
its free way and slides on in the next step. Only what it takes to come free goes beyond that.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes
from geomphys.driven.escape import ALONG, ASKED
from geomphys.driven.overlap import eliminate_overlap
from geomphys.driven.places import Places, place_at, row_of
from geomphys.driven.state import DrivenRoom, DrivenState
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add_scaled, dot, norm, sub
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]

SHARE = 1.8  # times the recorded motion of the step, and
SLACK = 1e-3  # m: by how much an offset may change beside the spring's way back ...
SLACK_SPEED = 0.1  # m/s: ... and in short steps no faster than this
HALVINGS = 16


@kernel
def last_place(state: DrivenState, room: DrivenRoom, roots: Floats, tree: int, i: int) -> float:
    """Coordinate i of the offset from `roots` (T, 7) at which a tree is where it was, or where it has been carried to. [m]"""
    place = state.offset[tree, i] + (state.roots[tree, i] - roots[tree, i])
    return place + room.carried.way[tree, i] if room.places.held[tree] >= ALONG else place


@kernel
def _beside(change: Vec, offset: Vec, back: float) -> float:
    """What of a change of an offset is not its way back, of which a share `back` is excused. [m]"""
    size = norm(offset)
    if size == 0.0:
        return norm(change)
    inward = min(max(-dot(change, offset) / size, 0.0), back * size)
    return norm(add_scaled(change, offset, inward / size))


@kernel
def _motion(scene: Scene, state: DrivenState, p: Places, tree: int) -> float:
    """How far the recording moves the fastest piece of a tree in a step. [m]"""
    farthest = 0.0
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
    for i in range(first, last):
        step = (
            p.base[i, 9] - state.frames[i, 9] + state.offset[tree, 0],
            p.base[i, 10] - state.frames[i, 10] + state.offset[tree, 1],
            p.base[i, 11] - state.frames[i, 11] + state.offset[tree, 2],
        )
        farthest = max(farthest, norm(step))
    return farthest


@kernel
def excused_change(scene: Scene, state: DrivenState, p: Places, tree: int, dt: float) -> tuple[float, float]:
    """(change [m] of the offset that the recorded motion excuses, share of it that the spring takes back) in a step."""
    moved = _motion(scene, state, p, tree)
    rate = math.sqrt(scene.trees.stiffness[tree] / scene.trees.mass[tree])
    back = 1.0 - math.exp(-rate * dt) if rate < math.inf else 1.0
    return SHARE * moved + min(SLACK, SLACK_SPEED * dt), back


@kernel
def is_too_fast(scene: Scene, state: DrivenState, p: Places, dt: float) -> bool:
    """Whether the offset of a driven tree has changed from `state.offset` to `p.current` by more than is excused."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            offset = row_of(state.offset, tree)
            excused, back = excused_change(scene, state, p, tree, dt)
            if _beside(sub(row_of(p.current, tree), offset), offset, back) > excused:
                return True
    return False


@outlined
def slow_down(
    scene: Scene, state: DrivenState, room: DrivenRoom, boxes: Boxes, roots: Floats, dt: float, gap: float, rounds: int,
    axes: Axes, scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """Let trees that were too fast stop short: as far towards `places.current` as is excused, but free.

    Parameters are those of `update_driven`, of a step. Returns (rounds taken, searches for a way out).
    """
    p = room.places
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            for i in range(3):
                room.ahead[tree, i] = p.current[tree, i]
                p.current[tree, i] = last_place(state, room, roots, tree, i)
                p.goal[tree, i] = p.current[tree, i]
            place_at(scene, p.base, p.current, tree, p.frames)
    rounds_taken, _, rescues, _ = eliminate_overlap(
        scene, p, boxes, room.near, False, room.joints.bends, room.problem, gap, rounds, room.rescue, axes, scratch
    )  # fmt: skip
    if p.asked[0] == ASKED:
        return rounds_taken, rescues
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        offset, near, ahead = row_of(state.offset, tree), row_of(p.current, tree), row_of(room.ahead, tree)
        excused, back = excused_change(scene, state, p, tree, dt)
        low, high = 0.0, 1.0
        if _beside(sub(ahead, offset), offset, back) <= excused:
            low = 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            place = add_scaled(near, sub(ahead, near), middle)
            if _beside(sub(place, offset), offset, back) <= excused:
                low = middle
            else:
                high = middle
        for i in range(3):
            p.goal[tree, i] = near[i] + low * (ahead[i] - near[i])
            state.speed[tree, i] *= low
        p.stir[tree, 0] = p.stir[tree, 1] = 0.0
    more, _, again, _ = eliminate_overlap(
        scene, p, boxes, room.near, False, room.joints.bends, room.problem, gap, rounds, room.rescue, axes, scratch
    )  # fmt: skip
    return rounds_taken + more, rescues + again
