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

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, pair_separation
from geomphys.collision.penetration import Scratch
from geomphys.driven.ccd import point_in, point_on
from geomphys.driven.chain_room import PAST, ChainRoom, is_chained
from geomphys.driven.least_distance import LeastDistance
from geomphys.driven.places import Places, row_of
from geomphys.driven.posture import ROOT_WEIGHT, Joints, add_effects
from geomphys.driven.reach_cones import cone_angle, cone_bound, cone_row
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add, dot, norm, sub
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOOK = 0.02  # m: a pair that is farther apart than this needs no row
WEAK = 1e-3  # a row shorter than this cannot be met by the joints
HOLD = 0.4  # m of clearance per m of scaled motion: chains with less on a pair call in other joints
HEAVIEST = 1e3  # a joint called in that is this many times less willing than one of a chain does not yield
SPOT = 1e-3  # m: nearer than this is the same spot
CONE_MARGIN = 1e-7  # rad that a limb is kept inside its cone's bound


@kernel
def let_yield(joints: Joints, room: ChainRoom, everything: bool) -> None:
    """Joints of chains yield, or all, each as willingly as its lever says."""
    for q in range(len(room.yields)):
        room.yields[q] = joints.held[q] if everything else joints.yields[q]
        room.lever[q] = joints.lever[q]


@kernel
def _on_link(scene: Scene, room: ChainRoom, offsets: Floats, body: int, point: Vec) -> Vec:
    """A point of the world in the frame of a link of an avatar with chains; the point itself on other bodies."""
    tree = scene.bodies.tree[body]
    if not is_chained(scene, tree):
        return point
    return point_in(room.poses, body, sub(point, row_of(offsets, tree)))


@kernel
def _in_world(scene: Scene, room: ChainRoom, offsets: Floats, body: int, point: Vec) -> Vec:
    """Where a point of `_on_link` is now."""
    tree = scene.bodies.tree[body]
    if not is_chained(scene, tree):
        return point
    return add(point_on(room.poses, body, point), row_of(offsets, tree))


@kernel
def _set(rows: Floats, i: int, v: Vec) -> None:
    rows[i, 0], rows[i, 1], rows[i, 2] = v


@kernel
def _remember(scene: Scene, room: ChainRoom, offsets: Floats, i: int) -> None:
    """Keep where the pair i is nearest now, in place of what was kept of the same spot, else of the oldest."""
    a = _on_link(scene, room, offsets, scene.pieces.body[room.a[i]], row_of(room.point_a, i))
    b = _on_link(scene, room, offsets, scene.pieces.body[room.b[i]], row_of(room.point_b, i))
    kept = min(room.spots[i], PAST)
    place = room.spots[i] % PAST
    for m in range(kept):
        k = PAST * i + m
        if norm(sub(row_of(room.past_a, k), a)) < SPOT and norm(sub(row_of(room.past_b, k), b)) < SPOT:
            place = m
            break
    else:
        room.spots[i] += 1
    room.newest[i] = place
    k = PAST * i + place
    _set(room.past_normal, k, row_of(room.normal, i))
    _set(room.past_a, k, a)
    _set(room.past_b, k, b)


@kernel
def take_measures(room: ChainRoom, i: int, s: float, n: Vec, pa: Vec, pb: Vec) -> None:
    """Separation, normal and points of the pair i, in place of the last ones."""
    room.separation[i], room.measured[i] = s, 1
    _set(room.normal, i, n)
    _set(room.point_a, i, pa)
    _set(room.point_b, i, pb)


@kernel
def _measure(scene: Scene, p: Places, room: ChainRoom, offsets: Floats, axes: Axes, scratch: Scratch) -> None:
    """Separation, normal and points of all pairs met, in `p.frames`."""
    for i in range(room.filled[0]):
        if room.measured[i] == 0:
            s, n, pa, pb = pair_separation(scene.pieces, p.frames, room.a[i], room.b[i], LOOK, axes, scratch)
            take_measures(room, i, s, n, pa, pb)
        room.measured[i] = 0
        if room.separation[i] <= LOOK:
            _remember(scene, room, offsets, i)


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
        point, tree = row_of(room.point_a if side == 0 else room.point_b, i), scene.bodies.tree[body]
        at = (point[0] - offsets[tree, 0], point[1] - offsets[tree, 1], point[2] - offsets[tree, 2])
        unknowns = add_effects(
            scene, room.yields, room.lever, room.poses, body, at, row_of(room.normal, i), 1.0 - 2.0 * side, room.column,
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
    _measure(scene, p, room, offsets, axes, scratch)
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


@kernel
def _add_pair(
    scene: Scene, room: ChainRoom, offsets: Floats, problem: LeastDistance, i: int, n: Vec, pa: Vec, pb: Vec, lacks: float,
    with_root: bool, unknowns: int, rows: int,
) -> tuple[int, int]:  # fmt: skip
    """A row for the pair i and one of its normals and pairs of points: (unknowns, rows; as before if none has a hold on it)."""
    row = problem.rows[rows]
    for j in range(len(row)):
        row[j] = 0.0
    body_a, body_b = scene.pieces.body[room.a[i]], scene.pieces.body[room.b[i]]
    unknowns = _add_side(scene, room, offsets, body_a, pa, n, 1.0, with_root, unknowns, row)
    unknowns = _add_side(scene, room, offsets, body_b, pb, n, -1.0, with_root, unknowns, row)
    met = _finish_row(room, offsets, problem, rows, unknowns, lacks)
    return unknowns, rows + 1 if met else rows


@kernel
def _add_past(
    scene: Scene, room: ChainRoom, offsets: Floats, problem: LeastDistance, i: int, gap: float, with_root: bool,
    unknowns: int, rows: int,
) -> tuple[int, int]:  # fmt: skip
    """Rows for where the pair i was nearest in the passes before: a face on another is else nearest at its corners in turn."""
    for m in range(min(room.spots[i], PAST)):
        if m == room.newest[i] or rows == len(problem.bounds):
            continue
        k = PAST * i + m
        pa = _in_world(scene, room, offsets, scene.pieces.body[room.a[i]], row_of(room.past_a, k))
        pb = _in_world(scene, room, offsets, scene.pieces.body[room.b[i]], row_of(room.past_b, k))
        n = row_of(room.past_normal, k)
        s = dot(n, sub(pa, pb))
        if s >= room.separation[i] - 0.5 * gap:  # else the surface is round, and its normal no longer there
            unknowns, rows = _add_pair(
                scene, room, offsets, problem, i, n, pa, pb, gap - s, with_root, unknowns, rows
            )  # fmt: skip
    return unknowns, rows


@outlined
def add_pairs(
    scene: Scene, room: ChainRoom, offsets: Floats, problem: LeastDistance, gap: float, with_root: bool, past: bool
) -> tuple[int, int, bool]:
    """Rows of all pairs met, as measured now and, with `past`, in passes before: (unknowns, rows, whether each can be met)."""
    for q in range(len(room.column)):
        room.column[q] = -1
    for tree in range(len(room.root_column)):
        room.root_column[tree] = -1
    unknowns, rows, possible = 0, 0, True
    for i in range(room.filled[0]):
        if rows == len(problem.bounds):
            return unknowns, rows, False
        s, n = room.separation[i], row_of(room.normal, i)
        if s > LOOK:
            continue
        before = rows
        unknowns, rows = _add_pair(
            scene, room, offsets, problem, i, n, row_of(room.point_a, i), row_of(room.point_b, i), gap - s, with_root, unknowns,
            rows,
        )  # fmt: skip
        possible = possible and (rows > before or s >= 0.0)
        if past:
            unknowns, rows = _add_past(scene, room, offsets, problem, i, gap, with_root, unknowns, rows)
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
def add_bounds(room: ChainRoom, problem: LeastDistance, unknowns: int, rows: int) -> int:
    """Rows for the unknowns that the solution in `problem.x` moves beyond their bounds; returns the number of rows."""
    for j in range(unknowns):
        q = room.joint_of[j]
        if q >= 0:
            scale, lower, upper = room.lever[q], room.low[q], room.high[q]
        else:
            tree, i = (-1 - q) // 3, (-1 - q) % 3
            scale, lower, upper = ROOT_WEIGHT, room.root_low[tree, i], room.root_high[tree, i]
        offset = problem.x[j] / scale
        sign, bound = 0.0, 0.0
        if offset < lower - 1e-12:
            sign, bound = 1.0, lower
        elif offset > upper + 1e-12:
            sign, bound = -1.0, -upper
        if sign != 0.0 and rows < len(problem.bounds):
            for i in range(unknowns):
                problem.rows[rows, i] = 0.0
            problem.rows[rows, j] = sign
            problem.bounds[rows] = bound * scale
            rows += 1
    return rows
