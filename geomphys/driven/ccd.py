"""Cyclic coordinate descent: the joints of a chain, one after the other, bring a point of a link to a goal.

From the link's own joint inwards to the chain's root, the point ee and the goal are projected on the plane of each
joint's axis a through its origin o,

    p' = p - (a·(p - o)) a,                                                               (4)

and the joint turns by the angle between them as seen from o,

    Δθ = acos( unit(ee' - o) · unit(goal' - o) ),                                         (5)

signed by the axis, cut off at its limits. A prismatic joint slides by the part of goal - ee along its axis. A degree of
freedom that several joints on the way share (mimic joints) moves by the least-squares step of all of them, as long as
that brings ee nearer. A joint of a compound one is followed by the smallest change that brings the limb back into its
reach cone. Sweeps go on until ee is at the goal or nothing moves any more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.posture import Joints, lower_bend, upper_bend, world_axis
from geomphys.driven.reach_cones import fit_angles
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    cross,
    dot,
    norm,
    quat_from_rotation_vector,
    quat_rotate,
    scale,
    sub,
)
from geomphys.scene.arrays import JOINT_FIXED, JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import orientation_of, pose_body, position_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STILL = 1e-12  # rad or m: a sweep in which no joint moves farther ends the descent
NO_ARM = 1e-9  # m: a point nearer than this to a joint's axis is not turned by it
LONGEST = 0.5  # rad or m: of a step of shared joints
HALVINGS = 6


class CcdRoom(NamedTuple):
    """Fixed facts on the joints of chains, and scratch; made by `make_ccd_room`."""

    owner: Ints  # (B,) chain of the nearest yielding joint above a body, -1: none
    depth: Ints  # (B,) yielding joints above it
    along: Floats  # (B, 3) m, from the body's joint to its far end, body frame; 0 where it has no length
    cone: Ints  # (Q,) reach cone a joint belongs to, -1: none
    shared: Ints  # (Q,) joints that a degree of freedom moves
    order: Ints  # (C,) chains as they are dealt with
    rank: Ints  # (C,) their places in it
    saved: Floats  # (Q,) offsets before a try
    spare: Floats  # (Q,)
    system: Floats  # (4, 5) linear equations
    points_a: Floats  # (8, 3) of a contact manifold
    points_b: Floats  # (8, 3)


def make_ccd_room(scene: Scene, joints: Joints) -> CcdRoom:
    """Facts and room for a scene."""
    bodies, dofs, chains = len(scene.bodies.role), len(scene.dofs.lower), len(scene.chains.tree)
    owner, depth, along = np.full(bodies, -1), np.zeros(bodies, np.int64), np.zeros((bodies, 3))
    shared, cone = np.zeros(dofs, np.int64), np.full(dofs, -1)
    for body in range(bodies):
        parent, q = scene.bodies.parent[body], scene.bodies.dof[body]
        if parent >= 0:
            owner[body], depth[body] = owner[parent], depth[parent]
        if q >= 0 and scene.bodies.joint[body] != JOINT_FIXED:
            shared[q] += 1
            if joints.yields[q]:
                owner[body], depth[body] = scene.dofs.chain[q], depth[body] + 1
        along[body] = _length_of(scene, body)
    for k in range(len(scene.cones.limb)):
        for body in scene.cones.joints[scene.cones.joint_start[k] : scene.cones.joint_start[k + 1]]:
            cone[scene.bodies.dof[body]] = k
    return CcdRoom(
        owner, depth, along, cone, shared, np.arange(chains), np.arange(chains), np.zeros(dofs), np.zeros(dofs),
        np.zeros((4, 5)), np.zeros((8, 3)), np.zeros((8, 3)),
    )  # fmt: skip


def _length_of(scene: Scene, body: int) -> Floats:
    """Vector [m] from a body's joint to the farthest joint on it, else to the far end of its pieces, body frame."""
    children = np.flatnonzero(scene.bodies.parent == body)
    if len(children):
        places = scene.bodies.origin[children, 9:]
        far: Floats = places[np.argmax(np.linalg.norm(places, axis=1))]
        if np.linalg.norm(far) > NO_ARM:
            return far
    first, last = scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]
    if first == last:
        return np.zeros(3)
    local = scene.pieces.local[first:last]
    centres = local[:, 9:] + np.einsum("pij,pj->pi", local[:, :9].reshape(-1, 3, 3), scene.pieces.centre[first:last])
    middle = centres.mean(axis=0)
    if np.linalg.norm(middle) < NO_ARM:
        return np.zeros(3)
    direction = middle / np.linalg.norm(middle)
    end: Floats = direction * np.max(centres @ direction + scene.pieces.reach[first:last])
    return end


@kernel
def moves(scene: Scene, q: int, body: int) -> bool:
    """Whether degree of freedom q has a joint at or above `body`."""
    while body >= 0:
        if scene.bodies.dof[body] == q and scene.bodies.joint[body] != JOINT_FIXED:
            return True
        body = scene.bodies.parent[body]
    return False


@kernel
def helps(scene: Scene, joints: Joints, ccd: CcdRoom, joint: int, link: int, still: int, whole: bool) -> bool:
    """Whether the joint above body `joint` may be used to move `link`.

    It must yield, belong to the link's chain (or, with `whole`, to any), and not move body `still` (-1: none) as well.
    """
    q = scene.bodies.dof[joint]
    if scene.bodies.joint[joint] == JOINT_FIXED or q < 0 or joints.yields[q] == 0:
        return False
    return (whole or scene.dofs.chain[q] == ccd.owner[link]) and not moves(scene, q, still)


@kernel
def point_on(poses: Floats, body: int, point: Vec) -> Vec:
    """A point of a body, given in its frame, in the world."""
    return add(position_of(poses, body), quat_rotate(orientation_of(poses, body), point))


@kernel
def point_in(poses: Floats, body: int, point: Vec) -> Vec:
    """A point of the world in a body's frame."""
    x, y, z, w = orientation_of(poses, body)
    return quat_rotate((-x, -y, -z, w), sub(point, position_of(poses, body)))


@kernel
def set_bend(scene: Scene, recorded: Floats, bend: Floats, angles: Floats, q: int, value: float) -> float:
    """Offset of joint q from the recorded value, cut off at its limits; returns by how much it changed."""
    before = bend[q]
    bend[q] = min(max(value, lower_bend(scene, recorded, q)), upper_bend(scene, recorded, q))
    angles[q] = recorded[q] + bend[q] if bend[q] != 0.0 else recorded[q]
    return float(bend[q] - before)


@outlined
def pose_way(scene: Scene, origins: Floats, link: int, angles: Floats, poses: Floats) -> None:
    """Forward kinematics of what stands between the root of the tree and `link`."""
    for body in range(scene.trees.body_start[scene.bodies.tree[link]] + 1, link + 1):
        pose_body(scene, origins, body, angles, poses)


@kernel
def wanted_turn(axis: Vec, origin: Vec, ee: Vec, goal: Vec) -> float:
    """Δθ of (5) after (4), signed by the axis; 0 where either point lies on the axis."""
    e, g = sub(ee, origin), sub(goal, origin)
    e, g = add_scaled(e, axis, -dot(axis, e)), add_scaled(g, axis, -dot(axis, g))
    if norm(e) < NO_ARM or norm(g) < NO_ARM:
        return 0.0
    return math.atan2(dot(axis, cross(e, g)), dot(e, g))


@kernel
def _move_shared(
    scene: Scene, origins: Floats, link: int, q: int, recorded: Floats, bend: Floats, angles: Floats, poses: Floats,
    local: Vec, goal: Vec,
) -> float:  # fmt: skip
    """Move a degree of freedom with several joints above `link` by its least-squares step; returns the change."""
    ee = point_on(poses, link, local)
    effect, body = (0.0, 0.0, 0.0), link
    while body >= 0:
        if scene.bodies.dof[body] == q and scene.bodies.joint[body] != JOINT_FIXED:
            push = world_axis(scene, poses, body)
            if scene.bodies.joint[body] != JOINT_PRISMATIC:
                push = cross(push, sub(ee, position_of(poses, body)))
            effect = add_scaled(effect, push, scene.bodies.multiplier[body])
        body = scene.bodies.parent[body]
    miss, square = sub(goal, ee), dot(effect, effect)
    if square < NO_ARM * NO_ARM:
        return 0.0
    before, step = bend[q], min(max(dot(effect, miss) / square, -LONGEST), LONGEST)
    for _ in range(HALVINGS):
        change = set_bend(scene, recorded, bend, angles, q, before + step)
        pose_way(scene, origins, link, angles, poses)
        if norm(sub(goal, point_on(poses, link, local))) < norm(miss):
            return change
        set_bend(scene, recorded, bend, angles, q, before)
        step *= 0.5
    pose_way(scene, origins, link, angles, poses)
    return 0.0


@kernel
def _first_of(scene: Scene, link: int, joint: int) -> bool:
    """Whether no joint between `link` and `joint` shares its degree of freedom."""
    body = link
    while body != joint:
        if scene.bodies.dof[body] == scene.bodies.dof[joint] and scene.bodies.joint[body] != JOINT_FIXED:
            return False
        body = scene.bodies.parent[body]
    return True


@outlined
def descend(
    scene: Scene, origins: Floats, joints: Joints, ccd: CcdRoom, link: int, still: int, whole: bool, recorded: Floats,
    bend: Floats, angles: Floats, poses: Floats, local: Vec, goal: Vec, tolerance: float, sweeps: int,
) -> float:  # fmt: skip
    """Bring a point of `link` to `goal` by the joints between the link and its chain's root.

    Parameters
    ----------
    scene, origins, joints, ccd
        The scene, its joints' origins, which of them yield, facts and scratch.
    link
        Body whose joint is the first of a sweep.
    still
        Body of the same tree that the joints used must not move, -1: none.
    whole
        Whether joints of other chains nearer to the root are used as well.
    recorded, bend, angles
        (Q,) rad or m: the recording, the offsets and their sum; the latter two are brought up to date. No joint leaves
        its limits, nor a limb its reach cone; what was recorded beyond gets no farther.
    poses
        (B, 7) poses at `angles`, with the roots as recorded; those up to `link` are brought up to date.
    local, goal
        The point ee in the link's frame, and where it is to go, in the world of `poses`. [m]
    tolerance
        m; nearer than this is at the goal.
    sweeps
        Bound on the sweeps.

    Returns
    -------
    float
        Distance [m] of the point from its goal.
    """
    for _ in range(sweeps):
        ee = point_on(poses, link, local)
        if norm(sub(goal, ee)) <= tolerance:
            break
        farthest, joint = 0.0, link
        while joint >= 0:
            q = scene.bodies.dof[joint]
            if not helps(scene, joints, ccd, joint, link, still, whole):
                joint = scene.bodies.parent[joint]
                continue
            if ccd.shared[q] > 1:
                if _first_of(scene, link, joint):
                    pose_way(scene, origins, link, angles, poses)
                    change = _move_shared(scene, origins, link, q, recorded, bend, angles, poses, local, goal)
                    farthest = max(farthest, abs(change))
                    ee = point_on(poses, link, local)
                joint = scene.bodies.parent[joint]
                continue
            axis, origin = world_axis(scene, poses, joint), position_of(poses, joint)
            ratio = scene.bodies.multiplier[joint]
            if scene.bodies.joint[joint] == JOINT_PRISMATIC:
                wish = dot(axis, sub(goal, ee))
                change = set_bend(scene, recorded, bend, angles, q, bend[q] + wish / ratio)
                ee = add_scaled(ee, axis, change * ratio)
            else:
                wish = wanted_turn(axis, origin, ee, goal)
                change = set_bend(scene, recorded, bend, angles, q, bend[q] + wish / ratio)
                turn = quat_from_rotation_vector(scale(axis, change * ratio))
                ee = add(origin, quat_rotate(turn, sub(ee, origin)))
                if ccd.cone[q] >= 0 and fit_angles(
                    scene, ccd.cone[q], joints.yields, recorded, bend, angles, ccd.spare
                ):
                    pose_way(scene, origins, link, angles, poses)
                    ee = point_on(poses, link, local)
            farthest = max(farthest, abs(change))
            joint = scene.bodies.parent[joint]
        pose_way(scene, origins, link, angles, poses)
        if farthest < STILL:
            break
    return norm(sub(goal, point_on(poses, link, local)))
