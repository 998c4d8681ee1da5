"""The inequalities a posture must satisfy, to first order: pairs stay apart, limbs in their cones, joints in their limits.

A pair's separation s changes with the joints as

    s + n·(J_a - J_b) Δq >= gap,

with n its normal and J how its two points move with the joints (a revolute joint moves a point p by a × (p - o) per
radian). The unknowns are the joints that yield, scaled to metres by their levers, and the roots' translations.

Joints of chains yield. Two links of one avatar whose chains can hardly part them (a thigh that a bent back comes down
upon: the hip joint is all but in the contact) call in the joints between them that belong to no chain. The weaker the
chains' hold on the pair, the lighter those yield: without a step from nothing on.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, pair_separation
from geomphys.collision.penetration import Scratch
from geomphys.driven.least_distance import LeastDistance
from geomphys.driven.overlap import Places
from geomphys.driven.posture import ROOT_WEIGHT, Joints, add_effects, lower_bend, upper_bend
from geomphys.driven.reach_cones import cone_angle, cone_bound, cone_row
from geomphys.kernel import kernel, outlined
from geomphys.vec3 import Vec
from geomphys.world.scene import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOOK = 0.02  # m: a pair that is farther apart than this needs no row
WEAK = 1e-3  # a row shorter than this cannot be met by the joints
HOLD = 0.4  # m of clearance per m of scaled motion: chains with less on a pair call in other joints
HEAVIEST = 1e3  # a joint called in that is this many times less willing than one of a chain does not yield
CONE_MARGIN = 1e-7  # rad that a limb is kept inside its cone's bound


class ChainRoom(NamedTuple):
    """Scratch of the search for a posture; T trees, Q joints, n pairs."""

    goal: Floats  # (Q,) offsets the coupling asks for
    current: Floats  # (Q,) offsets at the start
    trial: Floats  # (Q,) offsets being tried
    angles: Floats  # (Q,) recorded + trial
    spare: Floats  # (Q,)
    poses: Floats  # (B, 7) forward kinematics of `angles`, roots as recorded
    yields: Ints  # (Q,) 1 for joints that are unknowns where a pair depends on them
    lever: Floats  # (Q,) m per rad, their scale
    column: Ints  # (Q,) unknown of each joint, -1: none
    root_column: Ints  # (T,) first of the root's three unknowns, -1: none
    joint_of: Ints  # (unknowns,) joint of an unknown, or -1 - (3 tree + axis)
    filled: Ints  # (1,) pairs met so far
    a: Ints  # (n,) their pieces
    b: Ints  # (n,)
    hold: Floats  # (n,) m of clearance per m of scaled motion of chains; only of links of one tree
    separation: Floats  # (n,) m, of the pairs as measured last
    normal: Floats  # (n, 3)
    point_a: Floats  # (n, 3) m
    point_b: Floats  # (n, 3) m


def make_chain_room(scene: Scene, unknowns: int, pairs: int) -> ChainRoom:
    """Room for a scene."""
    dofs, trees, bodies = len(scene.dofs.lower), len(scene.trees.role), len(scene.bodies.role)
    goal, current, trial, angles, spare = (np.zeros(dofs) for _ in range(5))
    normal, point_a, point_b = (np.zeros((pairs, 3)) for _ in range(3))
    return ChainRoom(
        goal, current, trial, angles, spare, np.zeros((bodies, 7)), np.zeros(dofs, np.int64), np.zeros(dofs),
        np.full(dofs, -1), np.full(trees, -1), np.zeros(unknowns, np.int64), np.zeros(1, np.int64),
        np.zeros(pairs, np.int64), np.zeros(pairs, np.int64), np.zeros(pairs), np.zeros(pairs), normal, point_a, point_b,
    )  # fmt: skip


@kernel
def is_chained(scene: Scene, tree: int) -> bool:
    """Whether the tree is an avatar in chains mode."""
    return scene.trees.role[tree] == DRIVEN and scene.trees.chains[tree] == 1


@kernel
def let_yield(joints: Joints, room: ChainRoom, everything: bool) -> None:
    """Joints of chains yield, or all, each as willingly as its lever says."""
    for q in range(len(room.yields)):
        room.yields[q] = joints.held[q] if everything else joints.yields[q]
        room.lever[q] = joints.lever[q]


@kernel
def _vec(rows: Floats, i: int) -> Vec:
    return (rows[i, 0], rows[i, 1], rows[i, 2])


@kernel
def _measure(scene: Scene, p: Places, room: ChainRoom, axes: Axes, scratch: Scratch) -> None:
    """Separation, normal and points of all pairs met, in `p.frames`."""
    for i in range(room.filled[0]):
        s, n, pa, pb = pair_separation(scene.pieces, p.frames, room.a[i], room.b[i], LOOK, axes, scratch)
        room.separation[i] = s
        for k in range(3):
            room.normal[i, k], room.point_a[i, k], room.point_b[i, k] = n[k], pa[k], pb[k]


@kernel
def _hold(scene: Scene, room: ChainRoom, offsets: Floats, i: int, problem: LeastDistance) -> float:
    """How far the joints that yield part the pair i per metre of their scaled motion; both are links of one tree."""
    row, unknowns = problem.rows[0], 0
    for q in range(len(room.column)):
        room.column[q] = -1
    for j in range(len(row)):
        row[j] = 0.0
    for side in range(2):
        body = scene.pieces.body[room.a[i] if side == 0 else room.b[i]]
        point, tree = _vec(room.point_a if side == 0 else room.point_b, i), scene.bodies.tree[body]
        at = (point[0] - offsets[tree, 0], point[1] - offsets[tree, 1], point[2] - offsets[tree, 2])
        unknowns = add_effects(
            scene, room.yields, room.lever, room.poses, body, at, _vec(room.normal, i), 1.0 - 2.0 * side, room.column,
            unknowns, row,
        )  # fmt: skip
    square = 0.0
    for j in range(unknowns):
        square += row[j] * row[j]
    return math.sqrt(square)


@kernel
def _call_in(scene: Scene, joints: Joints, room: ChainRoom, body: int, other: int, weight: float) -> None:
    """Joints above `body` that do not move `other` too yield, `weight` times less willingly than their lever says, or as
    willingly as some other pair has them.
    """
    joint = body
    while joint >= 0:
        q, above = scene.bodies.dof[joint], other
        while above >= 0 and above != joint:
            above = scene.bodies.parent[above]
        if above == joint:
            return
        if q >= 0 and joints.held[q] == 1 and joints.yields[q] == 0:
            lever = weight * joints.lever[q]
            if room.yields[q] == 0 or lever < room.lever[q]:
                room.yields[q], room.lever[q] = 1, lever
        joint = scene.bodies.parent[joint]


@outlined
def call_in_joints(
    scene: Scene, joints: Joints, room: ChainRoom, p: Places, offsets: Floats, problem: LeastDistance, everything: bool,
    axes: Axes, scratch: Scratch,
) -> None:  # fmt: skip
    """Measure the pairs met, and let the joints of chains yield and those between links that chains hardly hold; or all."""
    _measure(scene, p, room, axes, scratch)
    let_yield(joints, room, everything)
    if everything:
        return
    for i in range(room.filled[0]):
        a, b = scene.pieces.body[room.a[i]], scene.pieces.body[room.b[i]]
        if scene.bodies.tree[a] == scene.bodies.tree[b]:
            room.hold[i] = _hold(scene, room, offsets, i, problem)
    for i in range(room.filled[0]):
        a, b = scene.pieces.body[room.a[i]], scene.pieces.body[room.b[i]]
        if scene.bodies.tree[a] == scene.bodies.tree[b]:
            weak = 1.0 - (room.hold[i] / HOLD) ** 2
            if weak * HEAVIEST > 1.0:
                _call_in(scene, joints, room, a, b, 1.0 / weak)
                _call_in(scene, joints, room, b, a, 1.0 / weak)


@kernel
def _add_side(
    scene: Scene, room: ChainRoom, offsets: Floats, body: int, point: Vec, n: Vec, sign: float, with_root: bool,
    unknowns: int, row: Floats,
) -> int:  # fmt: skip
    """One body's part of a pair's row; returns the number of unknowns."""
    tree = scene.bodies.tree[body]
    if not is_chained(scene, tree):
        return unknowns
    before = unknowns
    # the poses have the roots as recorded: points are brought there
    at = (point[0] - offsets[tree, 0], point[1] - offsets[tree, 1], point[2] - offsets[tree, 2])
    unknowns = add_effects(
        scene, room.yields, room.lever, room.poses, body, at, n, sign, room.column, unknowns, row
    )  # fmt: skip
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
def unknown_now(room: ChainRoom, offsets: Floats, j: int) -> float:
    """Scaled value of unknown j in the posture being tried."""
    q = room.joint_of[j]
    if q >= 0:
        return room.trial[q] * room.lever[q]
    return offsets[(-1 - q) // 3, (-1 - q) % 3] * ROOT_WEIGHT


@kernel
def _finish_row(
    room: ChainRoom, offsets: Floats, problem: LeastDistance, row: int, unknowns: int, lacks: float
) -> bool:
    """Make `row` one of unit length that asks for a change by `lacks`; False if no unknown has a hold on it."""
    values = problem.rows[row]
    square, bound = 0.0, lacks
    for j in range(unknowns):
        square += values[j] * values[j]
        bound += values[j] * unknown_now(room, offsets, j)
    length = math.sqrt(square)
    if length < WEAK:
        return False
    for j in range(unknowns):
        values[j] /= length
    problem.bounds[row] = bound / length
    return True


@outlined
def add_pairs(
    scene: Scene, room: ChainRoom, offsets: Floats, problem: LeastDistance, gap: float, with_root: bool
) -> tuple[int, int, bool]:
    """Rows of all pairs met, as measured: (unknowns, rows, whether each can be met)."""
    for q in range(len(room.column)):
        room.column[q] = -1
    for tree in range(len(room.root_column)):
        room.root_column[tree] = -1
    unknowns, rows, possible = 0, 0, True
    for i in range(room.filled[0]):
        if rows == len(problem.bounds):
            return unknowns, rows, False
        s, n = room.separation[i], _vec(room.normal, i)
        if s > LOOK:
            continue
        row = problem.rows[rows]
        for j in range(len(row)):
            row[j] = 0.0
        body_a, body_b = scene.pieces.body[room.a[i]], scene.pieces.body[room.b[i]]
        unknowns = _add_side(
            scene, room, offsets, body_a, _vec(room.point_a, i), n, 1.0, with_root, unknowns, row
        )  # fmt: skip
        unknowns = _add_side(
            scene, room, offsets, body_b, _vec(room.point_b, i), n, -1.0, with_root, unknowns, row
        )  # fmt: skip
        if _finish_row(room, offsets, problem, rows, unknowns, gap - s):
            rows += 1
        else:
            possible = possible and s >= 0.0
    return unknowns, rows, possible


@kernel
def _is_unknown(scene: Scene, room: ChainRoom, cone: int) -> bool:
    """Whether a joint of the cone is an unknown."""
    for place in range(scene.cones.joint_start[cone], scene.cones.joint_start[cone + 1]):
        if room.column[scene.bodies.dof[scene.cones.joints[place]]] >= 0:
            return True
    return False


@outlined
def add_cones(
    scene: Scene, room: ChainRoom, recorded: Floats, offsets: Floats, problem: LeastDistance, unknowns: int, rows: int
) -> int:
    """Rows that keep the limbs of compound joints in their reach cones; returns the number of rows."""
    for cone in range(len(scene.cones.limb)):
        if rows == len(problem.bounds) or not _is_unknown(scene, room, cone):
            continue
        row = problem.rows[rows]
        for j in range(len(row)):
            row[j] = 0.0
        g = cone_row(scene, room.lever, cone, room.angles, room.column, row)
        if _finish_row(room, offsets, problem, rows, unknowns, cone_bound(scene, cone, recorded) + CONE_MARGIN - g):
            rows += 1
    return rows


@kernel
def cones_hold(scene: Scene, recorded: Floats, angles: Floats) -> bool:
    """Whether all limbs of avatars with chains are in their cones at `angles`, or no farther out than recorded."""
    for cone in range(len(scene.cones.limb)):
        if is_chained(scene, scene.bodies.tree[scene.cones.joints[scene.cones.joint_start[cone]]]) and cone_angle(
            scene, cone, angles
        ) < cone_bound(scene, cone, recorded):
            return False
    return True


@kernel
def add_limits(
    scene: Scene, room: ChainRoom, recorded: Floats, problem: LeastDistance, unknowns: int, rows: int
) -> int:
    """Rows for the joints that the solution in `problem.x` moves beyond their limits; returns the number of rows."""
    for j in range(unknowns):
        q = room.joint_of[j]
        if q < 0:
            continue
        lower, upper = lower_bend(scene, recorded, q), upper_bend(scene, recorded, q)
        bend = problem.x[j] / room.lever[q]
        sign, bound = 0.0, 0.0
        if bend < lower - 1e-12:
            sign, bound = 1.0, lower
        elif bend > upper + 1e-12:
            sign, bound = -1.0, -upper
        if sign != 0.0 and rows < len(problem.bounds):
            for i in range(unknowns):
                problem.rows[rows, i] = 0.0
            problem.rows[rows, j] = sign
            problem.bounds[rows] = bound * room.lever[q]
            rows += 1
    return rows
