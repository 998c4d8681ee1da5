"""Trees that are carried: what wedges them turns, and takes them along.

A tree that keeps the orientation of its last free place in the world (`hold.py`) still has no room where what is round
it turns, like a box round what is in it. It then goes along with what it would be in: with the mean rigid motion of those
pieces in the step. Where they all move as one, the tree stands to them as it did, and is as free of them as it was.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.driven.escape import ALONG, CARRIED, is_mover
from geomphys.driven.hold import Carried
from geomphys.driven.places import Places, row_of
from geomphys.driven.state import DrivenRoom, DrivenState
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    norm,
    quat_from_rotation_vector,
    quat_mul,
    quat_unit,
    rot_transposed_mul,
    rotate,
    rotate_back,
    scale,
    sub,
)
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import frame_rotation, orientation_of, place_tree, position_of

Floats = NDArray[np.float64]


@kernel
def motion_of(before: Floats, after: Floats, i: int, point: Vec) -> tuple[Vec, Vec]:
    """How piece i moved from its frame in `before` to that in `after` (P, 12): its turn as a rotation vector, world frame,
    and how far it took `point` along [m].
    """
    r0, r1 = frame_rotation(before, i), frame_rotation(after, i)
    arm = sub(point, (before[i, 9], before[i, 10], before[i, 11]))
    there = add(rotate(r1, rotate_back(r0, arm)), (after[i, 9], after[i, 10], after[i, 11]))
    m = rot_transposed_mul(r0, r1)  # the turn as piece i sees it
    axis = (0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1]))
    sine = norm(axis)
    if sine == 0.0:
        return (0.0, 0.0, 0.0), sub(there, point)
    angle = math.atan2(sine, 0.5 * (m[0] + m[4] + m[8] - 1.0))
    return rotate(r0, scale(axis, angle / sine)), sub(there, point)


@kernel
def _note(carried: Carried, tree: int, piece: int, depth: float) -> None:
    """Put a piece that the tree is `depth` [m] in among its carriers, in their order; the last may drop out."""
    place, count = 0, carried.pieces.shape[1]
    while place < count and carried.weights[tree, place] >= depth:
        place += 1
    for i in range(count - 1, place, -1):
        carried.pieces[tree, i], carried.weights[tree, i] = carried.pieces[tree, i - 1], carried.weights[tree, i - 1]
    if place < count:
        carried.pieces[tree, place], carried.weights[tree, place] = piece, depth


@outlined
def note_carriers(scene: Scene, p: Places, near: Near, carried: Carried) -> None:
    """Note what the trees overlap that are to be carried now (`Places.held`): the pieces that carry them, deepest first.

    Trees of a group go as one. `near` has the pairs that overlap.
    """
    for tree in range(len(p.held)):
        if p.held[tree] != CARRIED:
            continue
        for i in range(carried.pieces.shape[1]):
            carried.pieces[tree, i], carried.weights[tree, i] = -1, 0.0
        for k in range(near.filled[0]):
            together = p.group[near.tree_a[k]] == p.group[tree]
            if together and near.separation[k] < 0.0 and is_mover(scene, near.tree_b[k]):
                _note(carried, tree, near.b[k], -near.separation[k])


@outlined
def carry_along(scene: Scene, state: DrivenState, room: DrivenRoom, poses: Floats) -> None:
    """Where a step takes the trees that are carried, by the mean motion of their carriers: `Carried.way` and `.turned`.

    `poses` (B, 7) are the recorded ones at the step's end.
    """
    p, carried = room.places, room.carried
    for tree in range(len(p.held)):
        if p.held[tree] < ALONG:
            continue
        place = add(position_of(state.roots, tree), row_of(state.offset, tree))
        weight, turn, way = 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(carried.pieces.shape[1]):
            piece, share = carried.pieces[tree, i], carried.weights[tree, i]
            if piece < 0:
                continue
            place_tree(scene, scene.bodies.tree[scene.pieces.body[piece]], poses, p.base)
            turned, moved = motion_of(state.frames, p.base, piece, place)
            weight += share
            turn, way = add_scaled(turn, turned, share), add_scaled(way, moved, share)
        q = quat_from_rotation_vector(scale(turn, 1.0 / weight))
        q = quat_unit(quat_mul(q, orientation_of(state.roots, tree)))
        for i in range(3):
            carried.way[tree, i] = way[i] / weight
        for i in range(4):
            carried.turned[tree, i] = q[i]
