"""Chains yield: the posture nearest to the recorded one in which no link overlaps.

The joints of chains are moved until every pair that was ever met is `gap` apart: the pairs' separations are taken to
first order in the joint angles (`rows`), and the nearest posture to the goal that satisfies all of them at once is
found (`least_distance`); the pairs are then measured anew there. This is a sequence of quadratic programs, and it
converges fast as the first one is solved from a free posture. Joint limits and reach cones are rows of the same
problem, so that no joint is ever moved beyond them.
Joints of chains, and those that links of one avatar call in, are tried first. If they cannot do it within their
limits, the chains descend one after the other (`chain_loop`) to a free posture, and the nearest is sought from there;
then the root yields too, and at last all joints of the avatar. What none of this frees is held (`hold_posture`).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, find_near
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.chain_room import ChainRoom, is_chained
from geomphys.driven.least_distance import SOLVED, LeastDistance, solve_least_distance
from geomphys.driven.places import Places, place_at, row_of
from geomphys.driven.posture import ROOT_WEIGHT, Joints, take_posture
from geomphys.driven.reach_cones import fit_angles
from geomphys.driven.rows import (
    add_bounds,
    add_cones,
    add_pairs,
    call_in_joints,
    cones_hold,
    take_measures,
    unknown_now,
)
from geomphys.jit.kernel import kernel, outlined
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import place_tree, pose_tree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PASSES = 24  # of measuring and solving
STALLED = 0.7  # times the move of the pass before: a longer one is followed by smaller shares of the way
LEAST_SHARE = 0.125
SETTLED = 1e-6  # m: a pass that moves nothing farther ends the search
LONGEST = 0.5  # m of scaled unknowns: a solution farther from the goal is none
HALVINGS = 10  # of the way from a held posture towards the goal

FREE = 0
STUCK = 1

CHAINS, WITH_ROOT, EVERYTHING = range(3)  # what yields


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
def _may_part(scene: Scene, joints: Joints, body_a: int, body_b: int, with_root: bool) -> bool:
    """Whether the search sees to a pair of bodies: links of one avatar, or links that its joints or root can move away."""
    tree_a, tree_b = scene.bodies.tree[body_a], scene.bodies.tree[body_b]
    if not is_chained(scene, tree_a) and not is_chained(scene, tree_b):
        return False
    return with_root or tree_a == tree_b or joints.bends[body_a] == 1 or joints.bends[body_b] == 1


@kernel
def _meet(scene: Scene, joints: Joints, near: Near, room: ChainRoom, gap: float, with_root: bool) -> float:
    """Add the pairs nearer than half a gap to those met; returns the smallest separation of pairs that can yield.

    What `near` has measured of the pairs met is kept.
    """
    smallest = math.inf
    for k in range(near.filled[0]):
        met = 0
        while met < room.filled[0] and (room.a[met] != near.a[k] or room.b[met] != near.b[k]):
            met += 1
        body_a, body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        if near.separation[k] < 0.5 * gap and _may_part(scene, joints, body_a, body_b, with_root):
            smallest = min(smallest, near.separation[k])
            if met == room.filled[0] and met < len(room.a):
                room.a[met], room.b[met], room.spots[met] = near.a[k], near.b[k], 0
                room.filled[0] += 1
        if met < room.filled[0]:
            n, pa, pb = row_of(near.normal, k), row_of(near.point_a, k), row_of(near.point_b, k)
            take_measures(room, met, near.separation[k], n, pa, pb)
    return smallest


@outlined
def _solve(
    room: ChainRoom, p: Places, offsets: Floats, problem: LeastDistance, unknowns: int, rows: int, share: float
) -> tuple[bool, float]:
    """Go a `share` of the way to the nearest posture to the goal within the rows and the bounds.

    `trial` and `offsets` are brought there. Returns whether there is such a posture and how far [m] an unknown moved.
    """
    for _ in range(unknowns + 1):
        for j in range(unknowns):
            q = room.joint_of[j]
            if q >= 0:
                problem.x[j] = room.goal[q] * room.lever[q]
            else:
                problem.x[j] = p.current[(-1 - q) // 3, (-1 - q) % 3] * ROOT_WEIGHT
        status, _ = solve_least_distance(problem, unknowns, rows, 1e-10)
        if status != SOLVED:
            return False, 0.0
        more = add_bounds(room, problem, unknowns, rows)
        if more == rows:
            break
        rows = more
    longest = 0.0
    for j in range(unknowns):
        now = unknown_now(room, offsets, j)
        if share < 1.0:
            problem.x[j] = now + share * (problem.x[j] - now)
        longest = max(longest, abs(problem.x[j] - now))
    if longest > LONGEST:
        return False, longest
    for q in range(len(room.trial)):
        room.trial[q] = room.goal[q]
    for j in range(unknowns):
        q = room.joint_of[j]
        if q >= 0:
            room.trial[q] = min(max(problem.x[j] / room.lever[q], room.low[q]), room.high[q])
        else:
            offsets[(-1 - q) // 3, (-1 - q) % 3] = problem.x[j] / ROOT_WEIGHT
    return True, longest


@outlined
def bend_chains(
    scene: Scene, origins: Floats, joints: Joints, room: ChainRoom, p: Places, boxes: Boxes, near: Near,
    problem: LeastDistance, roots: Floats, recorded: Floats, gap: float, what: int, axes: Axes, scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """Bend the joints of all chains until no link that they move overlaps.

    Parameters
    ----------
    scene, origins, joints
        The scene, its joints' origins, which of them yield.
    room
        `goal` and `current` offsets (Q,) and bounds of the offsets on entry; `trial` is the answer, as is `angles`.
    p, boxes
        Where the trees are: `current` (T, 3) root offsets; if the roots yield too their answer is in `trial`. `base` and
        `frames` are left at the answer.
    near, problem
        Room.
    roots, recorded
        (T, 7) and (Q,): the recording.
    gap
        m; clearance kept.
    what
        What yields: CHAINS, WITH_ROOT as well, or EVERYTHING.
    axes, scratch
        For the narrow phase.

    Returns
    -------
    tuple
        (FREE or STUCK, passes taken). If stuck, the answer is the last posture tried.
    """
    with_root = what != CHAINS
    _begin(scene, room.goal, room, p)
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
    find_near(scene, p.frames, boxes, p.reach, gap, math.inf, near, p.found, axes, scratch)
    if _meet(scene, joints, near, room, gap, with_root) == math.inf:
        return FREE, 1
    for i in range(room.filled[0]):
        room.measured[i] = 0
    for q in range(len(room.trial)):
        room.trial[q] = room.current[q]
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
    share, last = 1.0, math.inf
    for count in range(PASSES):
        call_in_joints(scene, joints, room, p, p.trial, problem, what == EVERYTHING, axes, scratch)
        unknowns, rows, possible = add_pairs(scene, room, p.trial, problem, gap, with_root, count > 1)
        if not possible:
            return STUCK, count + 1
        rows = add_cones(scene, room, recorded, p.trial, problem, unknowns, rows)
        solved, moved = _solve(room, p, p.trial, problem, unknowns, rows, share)
        if not solved:
            return STUCK, count + 1
        place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
        find_near(scene, p.frames, boxes, p.reach, gap, math.inf, near, p.found, axes, scratch)
        smallest = _meet(scene, joints, near, room, gap, with_root)
        settled = moved < SETTLED or (count >= 6 and smallest == math.inf) or count >= 10
        if smallest >= 0.0 and settled and cones_hold(scene, recorded, room.angles):
            return FREE, count + 2
        if count > 4 and moved > STALLED * last:  # to and fro between two points of a pair, say
            share = max(0.5 * share, LEAST_SHARE)
        last = moved
    return STUCK, PASSES


@kernel
def _begin(scene: Scene, bend: Floats, room: ChainRoom, p: Places) -> None:
    """Try offsets `bend` (Q,) with the roots where they are; no pair has been met."""
    for tree in range(len(p.reach)):
        p.reach[tree, 0] = p.reach[tree, 1] = 0.0
        for i in range(3):
            p.trial[tree, i] = p.current[tree, i]
    for q in range(len(bend)):
        room.trial[q] = bend[q]
    room.filled[0] = 0


@outlined
def fit_to_cones(scene: Scene, joints: Joints, room: ChainRoom, recorded: Floats, bend: Floats) -> None:
    """Turn limbs of avatars with chains whose joints have an offset `bend` (Q,) back into their reach cones."""
    for cone in range(len(scene.cones.limb)):
        first, last = scene.cones.joint_start[cone], scene.cones.joint_start[cone + 1]
        bent = False
        for place in range(first, last):
            q = scene.bodies.dof[scene.cones.joints[place]]
            bent = bent or (joints.held[q] == 1 and bend[q] != 0.0)
        if bent:
            take_posture(joints, recorded, bend, room.angles)
            fit_angles(scene, cone, joints.held, recorded, bend, room.angles, room.spare)


@kernel
def _is_free(
    scene: Scene, origins: Floats, joints: Joints, room: ChainRoom, p: Places, boxes: Boxes, near: Near, roots: Floats,
    recorded: Floats, gap: float, axes: Axes, scratch: Scratch,
) -> bool:  # fmt: skip
    """Place the posture being tried; whether no link overlaps and no limb is out of its cone."""
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
    find_near(scene, p.frames, boxes, p.reach, gap, math.inf, near, p.found, axes, scratch)
    for k in range(near.filled[0]):
        body_a, body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        if near.separation[k] < 0.0 and _may_part(scene, joints, body_a, body_b, False):
            return False
    return cones_hold(scene, recorded, room.angles)


@outlined
def hold_posture(
    scene: Scene, origins: Floats, joints: Joints, room: ChainRoom, p: Places, boxes: Boxes, near: Near, roots: Floats,
    recorded: Floats, last: Floats, gap: float, axes: Axes, scratch: Scratch,
) -> None:  # fmt: skip
    """The posture nearest to the goal on the straight way, in joint space, from the last free posture to it.

    Parameters are those of `bend_chains`; `last` (Q,) are the angles of the last free posture. Its angles are held but
    for those that were recorded beyond their limits and have come nearer since: a joint is not to be farther out than
    it was recorded. If that leaves an overlap they are held all the same. The answer is in `room.trial`.
    """
    _begin(scene, room.current, room, p)
    if not _is_free(
        scene, origins, joints, room, p, boxes, near, roots, recorded, gap, axes, scratch
    ):  # fmt: skip
        for q in range(len(last)):
            if joints.held[q] == 1:
                room.current[q] = last[q] - recorded[q]
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        for q in range(len(last)):
            room.trial[q] = room.current[q] + middle * (room.goal[q] - room.current[q])
        if _is_free(scene, origins, joints, room, p, boxes, near, roots, recorded, gap, axes, scratch):
            low = middle
        else:
            high = middle
    for q in range(len(last)):
        room.trial[q] = room.current[q] + low * (room.goal[q] - room.current[q])
    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
