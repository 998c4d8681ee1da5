"""Frames cut into steps: so short that nothing turns or bends through anything between two of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, measure_pair
from geomphys.collision.extent import gap_along
from geomphys.collision.penetration import Scratch
from geomphys.collision.support import shapes_of
from geomphys.driven.places import Places, limit_of
from geomphys.driven.posture import Joints
from geomphys.kernel import kernel, outlined
from geomphys.vec3 import add_scaled, slerp, sub
from geomphys.world.kinematics import orientation_of, pose_tree, position_of, set_pose
from geomphys.world.scene import DRIVEN, SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP_OF_THICKNESS = 0.5  # a pair may turn or bend by this share of its mean thickness in one step,
SAME_SIDE = 1.0  # or by this one, if they stay on the side of each other where they were
MOST_STEPS = 8192  # in a frame


@kernel
def is_recorded(scene: Scene, tree: int) -> bool:
    """Whether the recording moves the tree."""
    return scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED


@outlined
def measure_stir(scene: Scene, joints: Joints, before: Floats, p: Places, stir: Floats) -> None:
    """How far each piece moves with this step, and each tree at most (`p.stir`), in m: a bound over its points.

    The root of a driven tree counts as standing still, as its translation is seen to in any case, but not for links
    that chains bend.
    """
    pieces = scene.pieces
    for tree in range(len(scene.trees.role)):
        p.stir[tree] = 0.0
        if not is_recorded(scene, tree):
            continue
        pull = 0.0
        if scene.trees.role[tree] == DRIVEN:
            for k in range(3):
                pull += (p.goal[tree, k] - p.current[tree, k]) ** 2
            pull = math.sqrt(pull)
        first = scene.bodies.piece_start[scene.trees.body_start[tree]]
        last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
        for i in range(first, last):
            square, distance = 0.0, 0.0
            for k in range(9):
                change = p.frames[i, k] - before[i, k]
                square += change * change
            for k in range(3):
                shift = p.frames[i, 9 + k] - before[i, 9 + k]
                for j in range(3):
                    shift += (p.frames[i, 3 * k + j] - before[i, 3 * k + j]) * pieces.centre[i, j]
                distance += shift * shift
            turn = 2.0 * math.asin(min(1.0, math.sqrt(square / 8.0)))
            stir[i] = math.sqrt(distance) + turn * pieces.reach[i]
            if joints.bends[pieces.body[i]] == 1:
                stir[i] += pull
            p.stir[tree] = max(p.stir[tree], stir[i])


@kernel
def measure_flex(scene: Scene, joints: Joints, before: Floats, after: Floats, flex: Floats) -> None:
    """How far the joints above each body move it against its root, from angles `before` to `after` (Q,): a bound, m."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            parent = scene.bodies.parent[body]
            flex[body] = flex[parent] if parent >= 0 else 0.0
            q = scene.bodies.dof[body]
            if q >= 0:
                change = abs(scene.bodies.multiplier[body] * (after[q] - before[q]))
                flex[body] += change * joints.lever[q]


@kernel
def _kept_its_side(scene: Scene, before: Floats, near: Near, k: int, room: float) -> bool:
    """Whether the pair k was apart, or all but `room` [m], along the normal that parts it now or is about to."""
    n = (near.normal[k, 0], near.normal[k, 1], near.normal[k, 2])
    return gap_along(shapes_of(scene.pieces, before), near.a[k], near.b[k], n) >= -room


@outlined
def steps_needed(
    scene: Scene, p: Places, before: Floats, near: Near, stir: Floats, flex: Floats, gap: float, axes: Axes, scratch: Scratch
) -> int:  # fmt: skip
    """Into how many steps the frame must be cut, from the pairs near where it takes the trees in one (`find_reachable`).

    `before` are the pieces' frames (P, 12) at the end of the last frame. Two pieces that come to be on the side of each
    other on which they were have not passed through each other. More than `MOST_STEPS` are too many.
    """
    steps = 1.0
    for k in range(near.filled[0]):
        a, b = near.a[k], near.b[k]
        change = stir[a] + stir[b]
        if near.tree_a[k] == near.tree_b[k]:
            change = min(change, flex[scene.pieces.body[a]] + flex[scene.pieces.body[b]])
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
