"""Chains one after the other: descent of the link that overlaps nearest the root, until no link overlaps.

Chains are dealt with in an order that is drawn anew for each frame from a seed. In a chain, link i is the overlapping
link nearest the root, c_ij the k contacts of its overlapping pieces, n_j and pd_j their normals (turned to point out of
what the link is in) and depths. Then

    ee_i = (Σ_j c_ij) / k,                                                                (2)
    goal_i = ee_i ± PD_g,i,     PD_g,i = (Σ_j pd_j² n_j) / (Σ_j pd_j)                     (3), (1)

and `descend` brings ee_i there; a link that lies along a surface is shifted out instead (`shift_link`). Of two links
that both can move, the one whose chain comes first goes half of the way and the other the rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, find_near
from geomphys.collision.manifold import manifold
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes
from geomphys.driven.ccd import CcdRoom, descend, moves, point_in
from geomphys.driven.chain_room import ChainRoom
from geomphys.driven.chains import FREE, STUCK, place_posture
from geomphys.driven.places import Places
from geomphys.driven.posture import Joints
from geomphys.driven.shift import lies_along, shift_link
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add, add_scaled, dot, norm, quat_rotate, scale, sub, unit
from geomphys.scene.arrays import JOINT_FIXED, Scene
from geomphys.scene.kinematics import orientation_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDS = 20  # through all chains
PATIENCE = 3  # rounds without progress before joints of other chains are called in, and before giving up
BETTER = 0.98  # times the overlap that was left: less counts as progress
TURNS = 6  # of one chain in a round
SHARED_ROUNDS = 2  # the first ones, of one turn each: two links that both can move share the way
SWEEPS = 12  # of a descent
CANCELLED = 0.1  # PD_g shorter than this share of the deepest overlap: the normals cancel, that overlap alone counts
FAR = 0.99  # of the way to the goal: a descent that misses more ends the chain's turn

NOTHING, MISSED, ARRIVED = range(3)


@kernel
def next_random(state: int) -> int:
    """The number that splitmix64 makes of a 64-bit state (Steele, Lea, Flood 2014); the next state is one step on."""
    z = np.uint64(state) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int(np.int64((z ^ (z >> np.uint64(31))) >> np.uint64(1)))


@kernel
def draw_order(ccd: CcdRoom, seed: int, frame: int) -> None:
    """Shuffle the chains (Fisher and Yates) by seed and frame into `order`, their places into `rank`."""
    start = next_random(next_random(seed) ^ frame)
    for c in range(len(ccd.order)):
        ccd.order[c] = c
    for c in range(len(ccd.order) - 1, 0, -1):
        other = next_random(start + c) % (c + 1)
        ccd.order[c], ccd.order[other] = ccd.order[other], ccd.order[c]
    for c in range(len(ccd.order)):
        ccd.rank[ccd.order[c]] = c


@kernel
def _yields_to(scene: Scene, joints: Joints, ccd: CcdRoom, body: int, other: int) -> bool:
    """Whether joints can move `body` out of `other`: some yielding joint moves it, and `other` not with it."""
    if ccd.owner[body] < 0:
        return False
    joint = body
    while joint >= 0:
        q = scene.bodies.dof[joint]
        if scene.bodies.joint[joint] != JOINT_FIXED and q >= 0 and joints.yields[q] == 1 and not moves(scene, q, other):
            return True
        joint = scene.bodies.parent[joint]
    return False


@kernel
def _overlapping(near: Near, k: int, gap: float) -> bool:
    return bool(near.separation[k] < 0.5 * gap)


@kernel
def overlap_left(scene: Scene, joints: Joints, ccd: CcdRoom, near: Near, gap: float) -> float:
    """Sum [m] of what the pairs that joints could part and that are nearer than half a gap lack to the whole gap."""
    left = 0.0
    for k in range(near.filled[0]):
        if _overlapping(near, k, gap):
            a, b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
            if _yields_to(scene, joints, ccd, a, b) or _yields_to(scene, joints, ccd, b, a):
                left += gap - near.separation[k]
    return left


@kernel
def _link_to_move(scene: Scene, joints: Joints, ccd: CcdRoom, near: Near, chain: int, gap: float) -> tuple[int, int]:
    """The chain's overlapping link nearest its root and the body it is deepest in; (-1, -1): none."""
    link, obstacle, deepest = -1, -1, math.inf
    for k in range(near.filled[0]):
        if not _overlapping(near, k, gap):
            continue
        a, b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        for side in range(2):
            body, other = (a, b) if side == 0 else (b, a)
            if ccd.owner[body] != chain or not _yields_to(scene, joints, ccd, body, other):
                continue
            nearer = (
                link < 0 or ccd.depth[body] < ccd.depth[link] or (ccd.depth[body] == ccd.depth[link] and body < link)
            )
            if nearer or (body == link and near.separation[k] < deepest):
                link, obstacle, deepest = body, other, near.separation[k]
    return link, obstacle


@kernel
def _share(scene: Scene, joints: Joints, ccd: CcdRoom, chain: int, link: int, other: int, count: int) -> float:
    """The part of the way that `link` goes: half if the other's chain comes later in this round, else all."""
    theirs = ccd.owner[other]
    both = theirs >= 0 and theirs != chain and _yields_to(scene, joints, ccd, other, link)
    return 0.5 if both and count < SHARED_ROUNDS and ccd.rank[theirs] > ccd.rank[chain] else 1.0


@outlined
def _contacts_of(
    scene: Scene, joints: Joints, ccd: CcdRoom, near: Near, frames: Floats, poses: Floats, chain: int, link: int,
    count: int, gap: float, scratch: Scratch,
) -> tuple[Vec, Vec, float]:  # fmt: skip
    """End effector (2), PD of (1) and (3) with the gap to keep, and the length [m] of the link its contacts reach over."""
    middle, push, deep, points = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0
    weight, deepest, low, high = 0.0, 0.0, math.inf, -math.inf
    along = (ccd.along[link, 0], ccd.along[link, 1], ccd.along[link, 2])
    along = unit(quat_rotate(orientation_of(poses, link), along))
    for k in range(near.filled[0]):
        a, b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        other = b if a == link else a
        if (
            not _overlapping(near, k, gap)
            or (a != link and b != link)
            or not _yields_to(scene, joints, ccd, link, other)
        ):
            continue
        n = (near.normal[k, 0], near.normal[k, 1], near.normal[k, 2])
        pa, pb = (
            (near.point_a[k, 0], near.point_a[k, 1], near.point_a[k, 2]),
            (near.point_b[k, 0], near.point_b[k, 1], near.point_b[k, 2]),
        )
        found = manifold(
            scene.pieces, frames, near.a[k], near.b[k], near.separation[k], n, pa, pb, ccd.points_a, ccd.points_b, scratch
        )  # fmt: skip
        for i in range(found):
            p = (ccd.points_a[i, 0], ccd.points_a[i, 1], ccd.points_a[i, 2])
            if a != link:
                p = (ccd.points_b[i, 0], ccd.points_b[i, 1], ccd.points_b[i, 2])
            middle = add(middle, p)
            low, high = min(low, dot(p, along)), max(high, dot(p, along))
        points += found
        depth = (gap - near.separation[k]) * _share(scene, joints, ccd, chain, link, other, count)
        out = scale(n, depth if a == link else -depth)
        weight += depth
        push = add_scaled(push, out, depth)
        if depth > deepest:
            deepest, deep = depth, out
    push = scale(push, 1.0 / weight)
    if norm(push) < CANCELLED * deepest:
        push = deep
    return scale(middle, 1.0 / points), push, high - low


@outlined
def _yield_once(
    scene: Scene, origins: Floats, joints: Joints, ccd: CcdRoom, room: ChainRoom, p: Places, near: Near, recorded: Floats,
    chain: int, count: int, whole: bool, gap: float, scratch: Scratch,
) -> int:  # fmt: skip
    """Move the chain's innermost overlapping link out by PD_g; returns NOTHING, MISSED or ARRIVED."""
    link, obstacle = _link_to_move(scene, joints, ccd, near, chain, gap)
    if link < 0:
        return NOTHING
    ee, push, spread = _contacts_of(scene, joints, ccd, near, p.frames, room.poses, chain, link, count, gap, scratch)
    tree = scene.bodies.tree[link]
    still = obstacle if scene.bodies.tree[obstacle] == tree else -1
    far, n = norm(push), unit(push)
    if lies_along(ccd, room.poses, link, n, spread) and shift_link(
        scene, origins, joints, ccd, link, still, recorded, room.trial, room.angles, room.poses, n, far
    ):
        return ARRIVED
    # the poses have the roots as recorded: points are brought there
    ee = sub(ee, (p.trial[tree, 0], p.trial[tree, 1], p.trial[tree, 2]))
    local = point_in(room.poses, link, ee)
    missed = descend(
        scene, origins, joints, ccd, link, still, whole, recorded, room.trial, room.angles, room.poses, local,
        add(ee, push), 0.1 * gap, SWEEPS,
    )  # fmt: skip
    return MISSED if missed > FAR * far else ARRIVED


@outlined
def free_chains(
    scene: Scene, origins: Floats, joints: Joints, ccd: CcdRoom, room: ChainRoom, p: Places, boxes: Boxes, near: Near,
    roots: Floats, recorded: Floats, start: Floats, gap: float, seed: int, frame: int, axes: Axes, scratch: Scratch,
) -> tuple[int, int]:  # fmt: skip
    """Bend the joints of all chains by cyclic coordinate descent until no link that they move overlaps.

    Parameters
    ----------
    scene, origins, joints, ccd
        The scene, its joints' origins, which of them yield, facts and scratch.
    room
        `trial` is the answer, as is `angles`.
    p, boxes
        Where the trees are: `current` (T, 3) root offsets. `base` and `frames` are left at the answer.
    near
        Room.
    roots, recorded
        (T, 7) and (Q,): the recording.
    start
        (Q,) offsets to begin with, within their bounds: those the coupling asks for (`room.goal`), or where the joints are
        (`room.current`).
    gap
        m; clearance kept.
    seed, frame
        Of the order of the chains: 64-bit numbers.
    axes, scratch
        For the narrow phase.

    Returns
    -------
    tuple
        (FREE or STUCK, rounds taken). If stuck, the answer is the last posture tried.
    """
    draw_order(ccd, seed, frame)
    for tree in range(len(p.reach)):
        p.reach[tree, 0] = p.reach[tree, 1] = 0.0
        for i in range(3):
            p.trial[tree, i] = p.current[tree, i]
    for q in range(len(start)):
        room.trial[q] = start[q]
    whole, least, patience = False, math.inf, PATIENCE
    for count in range(ROUNDS + 1):
        place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
        find_near(scene, p.frames, boxes, p.reach, gap, math.inf, near, p.found, axes, scratch)
        left = overlap_left(scene, joints, ccd, near, gap)
        if left == 0.0:
            return FREE, count + 1
        patience = PATIENCE if left < BETTER * least else patience - 1
        least = min(least, left)
        if count == ROUNDS or (whole and patience == 0):
            break
        if patience == 0:
            whole, patience = True, PATIENCE
        for c in range(len(ccd.order)):
            for _ in range(TURNS if count >= SHARED_ROUNDS else 1):
                went = _yield_once(
                    scene, origins, joints, ccd, room, p, near, recorded, ccd.order[c], count, whole, gap, scratch
                )  # fmt: skip
                if went != NOTHING:
                    place_posture(scene, origins, joints, roots, recorded, room.trial, p.trial, room, p, boxes)
                    find_near(scene, p.frames, boxes, p.reach, gap, math.inf, near, p.found, axes, scratch)
                if went != ARRIVED:
                    break
    return STUCK, count + 1
