"""Postures: recorded angles plus the offsets the solver gave the joints of chains, and how contacts depend on them.

Only joints of chains yield (and, where they cannot solve it alone, the root, and then all joints). Their unknowns are
scaled to metres by a *lever*: the
farthest any piece beyond the joint is from its axis, so that the least-distance problem weighs joints by what they
move.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, cross, dot, quat_rotate, sub
from geomphys.scene.arrays import DRIVEN, JOINT_FIXED, JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, position_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROOT_WEIGHT = 4.0  # the root yields this many times less willingly than a joint, per metre moved
SHORTEST_LEVER = 0.01  # m


class Joints(NamedTuple):
    """Fixed facts on the joints of chains."""

    yields: Ints  # (Q,) 1 for the joints of chains
    held: Ints  # (Q,) 1 for all joints of avatars with chains: they can be held where they are
    lever: Floats  # (Q,) m per rad (1 for prismatic joints)
    bends: Ints  # (B,) 1 for bodies that some yielding joint moves
    any: Ints  # (1,) 1 if some avatar is in chains mode, even one without joints


class PostureState(NamedTuple):
    """Offsets of joints from their recorded values, carried from frame to frame."""

    bend: Floats  # (Q,) rad or m
    speed: Floats  # (Q,) of it, per s


def make_joints(scene: Scene, poses: Floats) -> Joints:
    """Which joints yield, and their levers measured in `poses` (B, 7)."""
    dofs, bodies = len(scene.dofs.lower), len(scene.bodies.role)
    in_chains = (scene.trees.chains == 1) & (scene.trees.role == DRIVEN)
    held = in_chains[scene.dofs.tree]
    yields, lever, bends = np.zeros(dofs, np.int64), np.full(dofs, SHORTEST_LEVER), np.zeros(bodies, np.int64)
    for q in range(dofs):
        yields[q] = int(scene.dofs.chain[q] >= 0 and scene.trees.chains[scene.dofs.tree[q]] == 1)
    for body in range(bodies):
        first, last = scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]
        reach = 0.0
        for i in range(first, last):
            offset = scene.pieces.local[i, 9:] + scene.pieces.local[i, :9].reshape(3, 3) @ scene.pieces.centre[i]
            reach = max(reach, float(np.linalg.norm(offset) + scene.pieces.reach[i]))
        joint = body
        while joint >= 0:
            q = scene.bodies.dof[joint]
            if q >= 0 and held[q]:
                bends[body] = max(bends[body], yields[q])
                if scene.bodies.joint[joint] == JOINT_PRISMATIC:
                    lever[q] = 1.0
                elif first < last:
                    lever[q] = max(lever[q], float(np.linalg.norm(poses[body, :3] - poses[joint, :3])) + reach)
            joint = scene.bodies.parent[joint]
    return Joints(yields, held.astype(np.int64), lever, bends, np.array([int(in_chains.any())]))


@kernel
def take_posture(joints: Joints, recorded: Floats, bend: Floats, angles: Floats) -> None:
    """Angles (Q,) = recorded + bend of the avatars with chains; the recorded number itself where it has no offset."""
    for q in range(len(recorded)):
        angles[q] = recorded[q]
        if joints.held[q] == 1 and bend[q] != 0.0:
            angles[q] = recorded[q] + bend[q]


@kernel
def pose_avatars(scene: Scene, origins: Floats, roots: Floats, angles: Floats, offsets: Floats, poses: Floats) -> None:
    """Poses (B, 7) of the avatars in chains mode: forward kinematics of `angles`, translated by their `offsets` (T, 3)."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN or scene.trees.chains[tree] == 0:
            continue
        pose_tree(scene, origins, tree, roots, angles, poses)
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(3):
                if offsets[tree, k] != 0.0:  # -0.0 + 0.0 would be 0.0
                    poses[body, k] += offsets[tree, k]


@kernel
def lower_bend(scene: Scene, recorded: Floats, q: int) -> float:
    """Smallest offset of joint q: to its limit, or none if it was recorded beyond."""
    return min(scene.dofs.lower[q] - recorded[q], 0.0)


@kernel
def upper_bend(scene: Scene, recorded: Floats, q: int) -> float:
    """Largest offset of joint q: to its limit, or none if it was recorded beyond."""
    return max(scene.dofs.upper[q] - recorded[q], 0.0)


@kernel
def world_axis(scene: Scene, poses: Floats, joint: int) -> Vec:
    """Axis of the joint above body `joint`, world frame."""
    axis = (scene.bodies.axis[joint, 0], scene.bodies.axis[joint, 1], scene.bodies.axis[joint, 2])
    return quat_rotate(orientation_of(poses, joint), axis)


@kernel
def joint_effect(scene: Scene, poses: Floats, joint: int, point: Vec, n: Vec) -> float:
    """How fast a point beyond the joint above body `joint` moves along n per unit of the joint's degree of freedom."""
    axis = world_axis(scene, poses, joint)
    if scene.bodies.joint[joint] == JOINT_PRISMATIC:
        return scene.bodies.multiplier[joint] * dot(axis, n)
    return scene.bodies.multiplier[joint] * dot(cross(axis, sub(point, position_of(poses, joint))), n)


@kernel
def add_effects(
    scene: Scene, yields: Ints, lever: Floats, poses: Floats, body: int, point: Vec, n: Vec, sign: float, column: Ints,
    unknowns: int, row: Floats,
) -> int:  # fmt: skip
    """Add to `row` how a point of `body` moves along n with each joint above it that `yields` (Q,), in scaled unknowns.

    `lever` (Q,) [m] scales them. `column` (Q,) numbers the unknowns; joints met for the first time are given the next
    one. Returns their number.
    """
    joint = body
    while joint >= 0:
        q = scene.bodies.dof[joint]
        if scene.bodies.joint[joint] != JOINT_FIXED and q >= 0 and yields[q] == 1:
            if column[q] < 0:
                column[q] = unknowns
                unknowns += 1
            row[column[q]] += sign * joint_effect(scene, poses, joint, point, n) / lever[q]
        joint = scene.bodies.parent[joint]
    return unknowns
