"""Chains yield: the posture nearest to the recorded one in which no link overlaps.

The joints of chains are moved until every pair that was ever met is `gap` apart: each pair's separation is taken to
first order in the joint angles,

    s + n·(J_a - J_b) Δq >= gap,

with n the pair's normal and J how its two points move with the joints (a revolute joint moves a point p by a × (p - o)
per radian), and the nearest posture to the goal that satisfies all of them at once is found (`least_distance`); the
pairs are then measured anew there. This is a sequence of quadratic programs, and it converges fast as the first one is
solved from a free posture. Joint limits are rows of the same problem, so that no joint is ever moved beyond them.
Joints of chains alone are tried first. If they cannot do it within their limits, the root yields too, and if that does
not help (a thigh that a bent back comes down upon), all joints of the avatar.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, find_near, pair_separation
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.least_distance import SOLVED, LeastDistance, solve_least_distance
from geomphys.driven.overlap import Places, place_at
from geomphys.driven.posture import ROOT_WEIGHT, Joints, add_effects, lower_bend, take_posture, upper_bend
from geomphys.kernel import kernel, outlined
from geomphys.vec3 import Vec
from geomphys.world.kinematics import place_tree, pose_tree
from geomphys.world.scene import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PASSES = 14  # of measuring and solving
SETTLED = 1e-6  # m: a pass that moves nothing farther ends the search
LOOK = 0.02  # m: a pair that is farther apart than this needs no row
WEAK = 1e-3  # a row shorter than this cannot be met by the joints
LONGEST = 0.5  # m of scaled unknowns: a solution farther from the goal is none

FREE = 0
STUCK = 1


class ChainRoom(NamedTuple):
    """Scratch of the search; T trees, Q joints, n pairs."""

    goal: Floats  # (Q,) offsets the coupling asks for
    current: Floats  # (Q,) offsets at the start
    trial: Floats  # (Q,) offsets being tried
    angles: Floats  # (Q,) recorded + trial
    poses: Floats  # (B, 7) forward kinematics of `angles`, roots as recorded
    column: Ints  # (Q,) unknown of each joint, -1: none
    root_column: Ints  # (T,) first of the root's three unknowns, -1: none
    joint_of: Ints  # (unknowns,) joint of an unknown, or -1 - (3 tree + axis)
    filled: Ints  # (1,) pairs met so far
    a: Ints  # (n,) their pieces
    b: Ints  # (n,)


def make_chain_room(scene: Scene, unknowns: int, pairs: int) -> ChainRoom:
    """Room for a scene."""
    dofs, trees, bodies = len(scene.dofs.lower), len(scene.trees.role), len(scene.bodies.role)
    goal, current, trial, angles = (np.zeros(dofs) for _ in range(4))
    return ChainRoom(
        goal, current, trial, angles, np.zeros((bodies, 7)), np.full(dofs, -1), np.full(trees, -1),
        np.zeros(unknowns, np.int64), np.zeros(1, np.int64), np.zeros(pairs, np.int64), np.zeros(pairs, np.int64),
    )  # fmt: skip


@kernel
def is_chained(scene: Scene, tree: int) -> bool:
    """Whether the tree is an avatar in chains mode."""
    return scene.trees.role[tree] == DRIVEN and scene.trees.chains[tree] == 1


@outlined
def place_posture(
    scene: Scene, origins: Floats, joints: Joints, roots: Floats, recorded: Floats, bend: Floats, offsets: Floats,
    room: ChainRoom, p: Places, boxes: Boxes,
) -> None:  # fmt: skip
    """Place all avatars in chains mode: joints at recorded + bend, roots at recorded + `offsets` (T, 3)."""
    take_posture(joints, recorded, bend, room.angles)
    for tree in range(len(scene.trees.role)):
        if is_chained(scene, tree):
            pose_tree(scene, origins, tree, roots, room.angles, room.poses)
            place_tree(scene, tree, room.poses, p.base)
            place_at(scene, p.base, offsets, tree, p.frames)
            update_boxes(scene, p.frames, boxes, tree)


@kernel
def _meet(scene: Scene, joints: Joints, near: Near, room: ChainRoom, gap: float, with_root: bool) -> float:
    """Add the pairs nearer than half a gap to those met; returns the smallest separation of pairs that can yield."""
    smallest = math.inf
    for k in range(near.filled[0]):
        if near.separation[k] >= 0.5 * gap:
            continue
        body_a, body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        if not with_root and joints.bends[body_a] == 0 and joints.bends[body_b] == 0:
            continue
        if not is_chained(scene, near.tree_a[k]) and not is_chained(scene, near.tree_b[k]):
            continue
        smallest = min(smallest, near.separation[k])
        known = False
        for i in range(room.filled[0]):
            known = known or (room.a[i] == near.a[k] and room.b[i] == near.b[k])
        if not known and room.filled[0] < len(room.a):
            room.a[room.filled[0]], room.b[room.filled[0]] = near.a[k], near.b[k]
            room.filled[0] += 1
    return smallest


@kernel
def _add_side(
    scene: Scene, joints: Joints, yields: Ints, room: ChainRoom, offsets: Floats, body: int, point: Vec, n: Vec, sign: float,
    with_root: bool, unknowns: int, row: Floats,
) -> int:  # fmt: skip
    """One body's part of a row; returns the number of unknowns."""
    tree = scene.bodies.tree[body]
    if not is_chained(scene, tree):
        return unknowns
    before = unknowns
    # the poses have the roots as recorded: points are brought there
    at = (point[0] - offsets[tree, 0], point[1] - offsets[tree, 1], point[2] - offsets[tree, 2])
    unknowns = add_effects(scene, joints, yields, room.poses, body, at, n, sign, room.column, unknowns, row)
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        if room.column[q] >= before:
            room.joint_of[room.column[q]] = q
    if with_root:
        if room.root_column[tree] < 0:
            room.root_column[tree] = unknowns
            for i in range(3):
                room.joint_of[unknowns + i] = -1 - (3 * tree + i)
            unknowns += 3
        for i in range(3):
            row[room.root_column[tree] + i] += sign * n[i] / ROOT_WEIGHT
    return unknowns


@kernel
def _unknown_now(joints: Joints, room: ChainRoom, offsets: Floats, j: int) -> float:
    """Scaled value of unknown j in the posture being tried."""
    q = room.joint_of[j]
    if q >= 0:
        return room.trial[q] * joints.lever[q]
    return offsets[(-1 - q) // 3, (-1 - q) % 3] * ROOT_WEIGHT


@outlined
def _rows(
    scene: Scene, joints: Joints, yields: Ints, room: ChainRoom, p: Places, offsets: Floats, problem: LeastDistance, gap: float,
    with_root: bool, axes: Axes, scratch: Scratch,
) -> tuple[int, int, bool]:  # fmt: skip
    """Rows of all pairs met, measured at the posture being tried: (unknowns, rows, whether each can be met)."""
    for q in range(len(room.column)):
        room.column[q] = -1
    for tree in range(len(room.root_column)):
        room.root_column[tree] = -1
    unknowns, rows, possible = 0, 0, True
    for i in range(room.filled[0]):
        if rows == len(problem.bounds):
            return unknowns, rows, False
        a, b = room.a[i], room.b[i]
        s, n, pa, pb = pair_separation(scene.pieces, p.frames, a, b, LOOK, axes, scratch)
        if s > LOOK:
            continue
        row = problem.rows[rows]
        for j in range(len(row)):
            row[j] = 0.0
        unknowns = _add_side(
            scene, joints, yields, room, offsets, scene.pieces.body[a], pa, n, 1.0, with_root, unknowns, row
        )  # fmt: skip
        unknowns = _add_side(
            scene, joints, yields, room, offsets, scene.pieces.body[b], pb, n, -1.0, with_root, unknowns, row
        )  # fmt: skip
        square = 0.0
        for j in range(unknowns):
            square += row[j] * row[j]
        length = math.sqrt(square)
        if length < WEAK:
            possible = possible and s >= 0.0
            continue
        bound = gap - s
        for j in range(unknowns):
            bound += row[j] * _unknown_now(joints, room, offsets, j)
        for j in range(unknowns):
            row[j] /= length
        problem.bounds[rows] = bound / length
        rows += 1
    return unknowns, rows, possible


@kernel
def _add_limits(
    scene: Scene, joints: Joints, room: ChainRoom, recorded: Floats, problem: LeastDistance, unknowns: int, rows: int
) -> int:
    """Rows for the joints that the solution in `problem.x` moves beyond their limits; returns the number of rows."""
    for j in range(unknowns):
        q = room.joint_of[j]
        if q < 0:
            continue
        lower, upper = lower_bend(scene, recorded, q), upper_bend(scene, recorded, q)
        bend = problem.x[j] / joints.lever[q]
        sign = 0.0
        if bend < lower - 1e-12:
            sign, bound = 1.0, lower
        elif bend > upper + 1e-12:
            sign, bound = -1.0, -upper
        if sign != 0.0 and rows < len(problem.bounds):
            for i in range(unknowns):
                problem.rows[rows, i] = 0.0
            problem.rows[rows, j] = sign
            problem.bounds[rows] = bound * joints.lever[q]
            rows += 1
    return rows


@outlined
def _solve(
    scene: Scene, joints: Joints, room: ChainRoom, p: Places, recorded: Floats, offsets: Floats, problem: LeastDistance,
    unknowns: int, rows: int,
) -> tuple[bool, float]:  # fmt: skip
    """The nearest posture to the goal within the rows and the joints' limits, into `trial` and `offsets`.

    Returns whether there is one and how far [m] an unknown moved.
    """
    for _ in range(unknowns + 1):
        for j in range(unknowns):
            q = room.joint_of[j]
            if q >= 0:
                problem.x[j] = room.goal[q] * joints.lever[q]
            else:
                problem.x[j] = p.current[(-1 - q) // 3, (-1 - q) % 3] * ROOT_WEIGHT
        status, _ = solve_least_distance(problem, unknowns, rows, 1e-10)
        if status != SOLVED:
            return False, 0.0
        more = _add_limits(scene, joints, room, recorded, problem, unknowns, rows)
        if more == rows:
            break
        rows = more
    longest = 0.0
    for j in range(unknowns):
        longest = max(longest, abs(problem.x[j] - _unknown_now(joints, room, offsets, j)))
    if longest > LONGEST:
        return False, longest
    for q in range(len(room.trial)):
        room.trial[q] = room.goal[q]
    for j in range(unknowns):
        q = room.joint_of[j]
        if q >= 0:
            bend = problem.x[j] / joints.lever[q]
            room.trial[q] = min(max(bend, lower_bend(scene, recorded, q)), upper_bend(scene, recorded, q))
        else:
            offsets[(-1 - q) // 3, (-1 - q) % 3] = problem.x[j] / ROOT_WEIGHT
    return True, longest


@outlined
def bend_chains(
    scene: Scene, origins: Floats, joints: Joints, room: ChainRoom, p: Places, boxes: Boxes, near: Near,
    problem: LeastDistance, roots: Floats, recorded: Floats, gap: float, yields: Ints, with_root: bool, axes: Axes,
    scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """Bend the joints of all chains until no link that they move overlaps.

    Parameters
    ----------
    scene, origins, joints
        The scene, its joints' origins, which of them yield.
    room
        `goal` and `current` offsets (Q,) on entry; `trial` is the answer, as is `angles`.
    p, boxes
        Where the trees are: `current` (T, 3) root offsets; with `with_root` the roots' answer is in `trial`. `base` and
        `frames` are left at the answer.
    near, problem
        Room.
    roots, recorded
        (T, 7) and (Q,): the recording.
    gap
        m; clearance kept.
    yields
        (Q,) 1 for the joints that yield: those of chains, or all.
    with_root
        Whether the roots yield too.
    axes, scratch
        For the narrow phase.

    Returns
    -------
    tuple
        (FREE or STUCK, passes taken). If stuck, the answer is the last posture tried.
    """
    for tree in range(len(p.reach)):
        p.reach[tree] = 0.0
        for i in range(3):
            p.trial[tree, i] = p.current[tree, i]
    for q in range(len(room.trial)):
        room.trial[q] = room.goal[q]
    room.filled[0] = 0
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
    find_near(scene, p.frames, boxes, p.reach, gap, near, p.found, axes, scratch)
    if _meet(scene, joints, near, room, gap, with_root) == math.inf:
        return FREE, 1
    for q in range(len(room.trial)):
        room.trial[q] = room.current[q]
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
    for count in range(PASSES):
        unknowns, rows, possible = _rows(
            scene, joints, yields, room, p, p.trial, problem, gap, with_root, axes, scratch
        )  # fmt: skip
        if not possible:
            return STUCK, count + 1
        solved, moved = _solve(scene, joints, room, p, recorded, p.trial, problem, unknowns, rows)
        if not solved:
            return STUCK, count + 1
        place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
        find_near(scene, p.frames, boxes, p.reach, gap, near, p.found, axes, scratch)
        smallest = _meet(scene, joints, near, room, gap, with_root)
        if smallest >= 0.0 and (moved < SETTLED or (count >= 6 and smallest == math.inf) or count >= 10):
            return FREE, count + 2
    return STUCK, PASSES
