"""Frames cut into steps: so short that nothing turns or bends through anything between two of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, measure_pair
from geomphys.collision.extent import gap_along
from geomphys.collision.penetration import Scratch
from geomphys.collision.support import shapes_of
from geomphys.driven.chain_room import is_chained
from geomphys.driven.places import Places, distance, limit_of, row_of
from geomphys.driven.posture import Joints
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add, add_scaled, norm, slerp, sub
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of, set_pose

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP_OF_THICKNESS = 0.5  # a pair may turn or bend by this share of its mean thickness in one step,
SAME_SIDE = 1.0  # or by this one, if they stay on the side of each other where they were
MOST_STEPS = 8192  # in a frame


@kernel
def is_recorded(scene: Scene, tree: int) -> bool:
    """Whether the recording moves the tree."""
    return scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED


class Stir(NamedTuple):
    """How far a step moves things, before anything yields."""

    way: Floats  # (P, 3) m, the centre of each piece
    spin: Floats  # (P,) m, how much farther any other of its points, at most
    flex: Floats  # (B,) m, each body against its root by the joints above it, at most


def make_stir(scene: Scene) -> Stir:
    """Nothing moves."""
    pieces = len(scene.pieces.kind)
    return Stir(np.zeros((pieces, 3)), np.zeros(pieces), np.zeros(len(scene.bodies.tree)))


@kernel
def _measure_flex(scene: Scene, joints: Joints, before: Floats, after: Floats, p: Places, flex: Floats) -> None:
    """How far the joints above each body move it against its root, from angles `before` to `after` (Q,): a bound, m."""
    for tree in range(len(scene.trees.role)):
        p.stir[tree, 1] = 0.0
        if not is_recorded(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            parent = scene.bodies.parent[body]
            flex[body] = flex[parent] if parent >= 0 else 0.0
            q = scene.bodies.dof[body]
            if q >= 0:
                change = abs(scene.bodies.multiplier[body] * (after[q] - before[q]))
                flex[body] += change * joints.lever[q]
            p.stir[tree, 1] = max(p.stir[tree, 1], flex[body])


@outlined
def measure_stir(
    scene: Scene, joints: Joints, before: Floats, angles0: Floats, angles1: Floats, p: Places, stir: Stir
) -> None:
    """How far each piece moves with this step, and each tree at most (`p.stir`, m): a bound over its points.

    `before` are the pieces' frames (P, 12) at the end of the last step; joints go from `angles0` to `angles1` (Q,). The root
    of a driven tree counts as standing still, as its translation is seen to in any case, but in `p.stir` not for links that
    chains bend.
    """
    _measure_flex(scene, joints, angles0, angles1, p, stir.flex)
    pieces = scene.pieces
    for tree in range(len(scene.trees.role)):
        p.stir[tree, 0] = 0.0
        if not is_recorded(scene, tree):
            continue
        bent = 0.0
        pull = distance(p.goal, p.current, tree) if scene.trees.role[tree] == DRIVEN else 0.0
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            square = 0.0
            for k in range(9):
                change = p.frames[i, k] - before[i, k]
                square += change * change
            for k in range(3):
                shift = p.frames[i, 9 + k] - before[i, 9 + k]
                for j in range(3):
                    shift += (p.frames[i, 3 * k + j] - before[i, 3 * k + j]) * pieces.centre[i, j]
                stir.way[i, k] = shift
            turn = 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))
            stir.spin[i] = turn * pieces.reach[i]
            farthest = norm(row_of(stir.way, i)) + stir.spin[i]
            bent = max(bent, farthest)
            if joints.bends[pieces.body[i]] == 1:
                farthest += pull
            p.stir[tree, 0] = max(p.stir[tree, 0], farthest)
        p.stir[tree, 1] = min(p.stir[tree, 1], bent)


@kernel
def _flex_between(scene: Scene, flex: Floats, body_a: int, body_b: int) -> float:
    """How far the joints between two bodies of a tree move one against the other: those above both move neither."""
    a, b = body_a, body_b
    while a != b:  # parents come before their children
        if a > b:
            a = scene.bodies.parent[a]
        else:
            b = scene.bodies.parent[b]
    return float((flex[body_a] - flex[a]) + (flex[body_b] - flex[a]))


@kernel
def _pull_on(scene: Scene, joints: Joints, p: Places, tree: int, body: int) -> Vec:
    """How far the root of a link that chains bend is yet to go; of others the way is seen to, and counts for nothing."""
    if scene.trees.role[tree] != DRIVEN or joints.bends[body] == 0:
        return (0.0, 0.0, 0.0)
    return sub(row_of(p.goal, tree), row_of(p.current, tree))


@kernel
def _change(scene: Scene, joints: Joints, p: Places, near: Near, k: int, stir: Stir) -> float:
    """How far the pieces of the pair k move against each other at most, wherever on their ways the roots are stopped. [m]"""
    a, b, tree_a, tree_b = near.a[k], near.b[k], near.tree_a[k], near.tree_b[k]
    body_a, body_b = scene.pieces.body[a], scene.pieces.body[b]
    way_a, way_b, spin = row_of(stir.way, a), row_of(stir.way, b), stir.spin[a] + stir.spin[b]
    way = sub(way_a, way_b)
    if tree_a == tree_b:
        return min(norm(way) + spin, _flex_between(scene, stir.flex, body_a, body_b))
    if not is_chained(scene, tree_a) and not is_chained(scene, tree_b):  # it goes one way, and is then pushed another
        return norm(way_a) + norm(way_b) + spin
    pull = _pull_on(scene, joints, p, tree_a, body_a)
    there = sub(way, _pull_on(scene, joints, p, tree_b, body_b))
    return max(norm(way), norm(add(way, pull)), norm(there), norm(add(there, pull))) + spin


@kernel
def _kept_its_side(scene: Scene, before: Floats, near: Near, k: int, room: float) -> bool:
    """Whether the pair k was apart, or all but `room` [m], along the normal that parts it now or is about to."""
    return gap_along(shapes_of(scene.pieces, before), near.a[k], near.b[k], row_of(near.normal, k)) >= -room


@outlined
def steps_needed(
    scene: Scene, joints: Joints, p: Places, before: Floats, near: Near, stir: Stir, gap: float, axes: Axes, scratch: Scratch
) -> int:  # fmt: skip
    """Into how many steps the frame must be cut, from the pairs near where it takes the trees in one (`find_reachable`).

    `before` are the pieces' frames (P, 12) at the end of the last frame. Two pieces that come to be on the side of each
    other on which they were have not passed through each other. More than `MOST_STEPS` are too many.
    """
    steps = 1.0
    for k in range(near.filled[0]):
        a, b = near.a[k], near.b[k]
        change = _change(scene, joints, p, near, k, stir)
        thickness = 0.5 * (scene.pieces.thickness[a] + scene.pieces.thickness[b])
        if near.separation[k] > change or change <= STEP_OF_THICKNESS * thickness:
            continue
        short = change <= SAME_SIDE * thickness
        if short and _kept_its_side(scene, before, near, k, STEP_OF_THICKNESS * thickness):
            continue
        if near.exact[k] == 0:
            measure_pair(scene.pieces, p.frames, near, k, limit_of(p, near, k, gap), axes, scratch)
            if near.separation[k] > change or (
                short and _kept_its_side(scene, before, near, k, STEP_OF_THICKNESS * thickness)
            ):
                continue
        steps = max(steps, math.ceil(change / (STEP_OF_THICKNESS * max(thickness, 1e-5))))
    return int(min(steps, 2.0 * MOST_STEPS))


@outlined
def recording_between(
    scene: Scene, origins: Floats, roots0: Floats, angles0: Floats, roots1: Floats, angles1: Floats, w: float,
    roots: Floats, angles: Floats, poses: Floats,
) -> None:  # fmt: skip
    """The recording a share `w` of the way from one moment to another: into `roots` (T, 7), `angles` (Q,) and, by forward
    kinematics, `poses` (B, 7).
    """
    for i in range(len(angles)):
        angles[i] = angles0[i] + w * (angles1[i] - angles0[i])
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        q = slerp(orientation_of(roots0, tree), orientation_of(roots1, tree), w)
        p0, p1 = position_of(roots0, tree), position_of(roots1, tree)
        set_pose(roots, tree, add_scaled(p0, sub(p1, p0), w), q)
        pose_tree(scene, origins, tree, roots, angles, poses)
