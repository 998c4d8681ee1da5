"""Moves the links of chains out, chain by chain: the interpenetrating link nearest the root, until none interpenetrates.

The order of the chains is drawn for each frame from a seed. In a chain, link i is the interpenetrating
link nearest the root, c_ij are the k contacts of its pieces, n_j and pd_j their normals, oriented out of what the
link is in, and depths. Then

    ee_i = (Σ_j c_ij) / k,                                                                (2)
    goal_i = ee_i ± PD_g,i,     PD_g,i = (Σ_j pd_j² n_j) / (Σ_j pd_j)                     (3), (1)

and `descend` brings ee_i there; a link along a surface is translated instead (`translate_link`). Of two links
that both can move, each takes half.
"""

from __future__ import annotations

import math

import numpy as np

from geomphys.collision.detect import find_near
from geomphys.collision.manifold import manifold
from geomphys.collision.support import Shapes
from geomphys.collision.sweep import update_boxes
from geomphys.driven.paper.descent import descend, is_usable
from geomphys.driven.paper.link_translation import lies_along, translate_link
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import Vec, add, add_scaled, dot, norm, quat_conjugate, quat_rotate, scale, sub, unit
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, pose_tree, position_of

STEPS = 6  # steps of one chain in a pass
SHARED_PASSES = 2  # first passes, in which two links that both can move take half each
AT_GOAL = 2e-3  # m: a descent that ends nearer than this and than `NEAR_GOAL` to its goal has converged
NEAR_GOAL = 0.1  # of the distance at its start
CANCELLED = 0.1  # PD_g shorter than this fraction of the deepest overlap: the normals cancel

NOTHING, MISSED, ARRIVED = range(3)


@kernel
def next_random(state: int) -> int:
    """The number that splitmix64 makes of a 64-bit state (Steele, Lea and Flood 2014), without its lowest bit."""
    z = np.uint64(state) * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return int(np.int64((z ^ (z >> np.uint64(31))) >> np.uint64(1)))


@kernel
def draw_order(w: PaperWorkspace, number: int) -> None:
    """Shuffle the chains (Fisher and Yates) by the seed and the number of the frame."""
    state = next_random(next_random(w.seed) ^ number)
    for c in range(len(w.order)):
        w.order[c] = c
    for c in range(len(w.order) - 1, 0, -1):
        other = next_random(state + c) % (c + 1)
        w.order[c], w.order[other] = w.order[other], w.order[c]
    for c in range(len(w.order)):
        w.rank[w.order[c]] = c


@noinline
def update_tree(scene: Scene, w: PaperWorkspace, tree: int) -> None:
    """Pose a driven tree, its pieces and its boxes at the iterate."""
    pose_tree(scene, w.origins, tree, w.iterate.roots, w.iterate.angles, w.iterate.poses)
    pose_pieces_of_tree(scene, tree, w.iterate.poses, w.frames)
    update_boxes(scene, w.frames, w.detection.boxes, tree)


@noinline
def detect(scene: Scene, w: PaperWorkspace) -> float:
    """Discrete collision check of the iterate: fills `near`; returns the sum of all depths [m]."""
    find_near(scene, w.frames, w.motion_bounds, 0.0, math.inf, w.near, w.detection)
    overlap = 0.0
    for k in range(w.near.counts.filled):
        overlap += max(0.0, -w.near.separation[k])
    return overlap


@kernel
def can_move(scene: Scene, w: PaperWorkspace, body: int, other: int) -> bool:
    """Whether a joint of its chain moves `body`, and `other` not with it."""
    if w.limbs.chain[body] < 0:
        return False
    if scene.bodies.tree[body] != scene.bodies.tree[other]:
        return True
    joint = body
    while joint >= 0:
        if is_usable(scene, w, joint, body, other):
            return True
        joint = scene.bodies.parent[joint]
    return False


@kernel
def _find_link(scene: Scene, w: PaperWorkspace, chain: int) -> tuple[int, int]:
    """The chain's interpenetrating link nearest its root and the body that it is deepest in; (-1, -1): none."""
    link, obstacle, deepest = -1, -1, math.inf
    for k in range(w.near.counts.filled):
        s = w.near.separation[k]
        if s >= 0.0:
            continue
        a, b = scene.pieces.body[w.near.a[k]], scene.pieces.body[w.near.b[k]]
        for side in range(2):
            body, other = (a, b) if side == 0 else (b, a)
            if w.limbs.chain[body] != chain or not can_move(scene, w, body, other):
                continue
            nearer = link < 0 or w.limbs.depth[body] < w.limbs.depth[link]
            nearer = nearer or (w.limbs.depth[body] == w.limbs.depth[link] and body < link)
            if nearer or (body == link and s < deepest):
                link, obstacle, deepest = body, other, s
    return link, obstacle


@kernel
def _fraction_of_depth(scene: Scene, w: PaperWorkspace, link: int, other: int, count: int) -> float:
    """The part of PD that `link` takes: half if the other link's chain comes later in this pass, else the rest."""
    chain, others = w.limbs.chain[link], w.limbs.chain[other]
    both = others >= 0 and others != chain and can_move(scene, w, other, link)
    return 0.5 if both and count < SHARED_PASSES and w.rank[others] > w.rank[chain] else 1.0


@noinline
def contacts_of(scene: Scene, w: PaperWorkspace, link: int, count: int) -> tuple[Vec, Vec, float]:
    """End effector (2) [m], PD_g (1) [m] of a link, the clearance included, and the length [m] its contacts extend over.

    Where normals cancel, PD of the deepest pair of pieces is taken.
    """
    near = w.near
    middle, pd, deep, points = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0
    weight, deepest, low, high = 0.0, 0.0, math.inf, -math.inf
    along = unit(quat_rotate(orientation_of(w.iterate.poses, link), vec_at(w.limbs.along, link)))
    for k in range(near.counts.filled):
        s, a, b = near.separation[k], scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        other = b if a == link else a
        if s >= 0.0 or (a != link and b != link) or not can_move(scene, w, link, other):
            continue
        n, pa, pb = vec_at(near.normal, k), vec_at(near.point_a, k), vec_at(near.point_b, k)
        found = manifold(
            Shapes(scene.pieces, w.frames), near.a[k], near.b[k], (s, n, pa, pb), w.points_a, w.points_b, w.detection.scratch
        )  # fmt: skip
        for i in range(found):
            p = vec_at(w.points_a, i) if a == link else vec_at(w.points_b, i)
            middle = add(middle, p)
            low, high = min(low, dot(p, along)), max(high, dot(p, along))
        points += found
        depth = (w.gap - s) * _fraction_of_depth(scene, w, link, other, count)
        out = scale(n, depth if a == link else -depth)
        weight += depth
        pd = add_scaled(pd, out, depth)
        if depth > deepest:
            deepest, deep = depth, out
    pd = scale(pd, 1.0 / weight)
    if norm(pd) < CANCELLED * deepest:
        pd = deep
    return scale(middle, 1.0 / points), pd, high - low


@noinline
def step_chain(scene: Scene, w: PaperWorkspace, chain: int, count: int) -> int:
    """Move the chain's interpenetrating link nearest its root by PD_g in pass `count`: NOTHING, MISSED or ARRIVED."""
    link, obstacle = _find_link(scene, w, chain)
    if link < 0:
        return NOTHING
    anchor = obstacle if scene.bodies.tree[obstacle] == scene.bodies.tree[link] else -1
    ee, pd, extent = contacts_of(scene, w, link, count)
    distance, n = norm(pd), unit(pd)
    if lies_along(w, link, n, extent) and translate_link(scene, w, link, anchor, n, distance):
        return ARRIVED
    q = quat_conjugate(orientation_of(w.iterate.poses, link))
    local = quat_rotate(q, sub(ee, position_of(w.iterate.poses, link)))
    tolerance = min(AT_GOAL, NEAR_GOAL * distance)
    missed = descend(scene, w, link, anchor, local, add(ee, pd), tolerance)
    return ARRIVED if missed <= tolerance else MISSED


@noinline
def move_chains(scene: Scene, w: PaperWorkspace, count: int) -> float:
    """Pass `count` over all chains; returns the sum of the remaining depths [m]."""
    overlap = detect(scene, w)
    for c in range(len(w.order)):
        tree = scene.chains.tree[w.order[c]]
        for _ in range(STEPS):
            done = step_chain(scene, w, w.order[c], count)
            if done == NOTHING:
                break
            update_tree(scene, w, tree)
            overlap = detect(scene, w)
            if done == MISSED:
                break
    return overlap
