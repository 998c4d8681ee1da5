"""Postures of driven trees: roots, angles and the poses of links; Jacobians of points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import Vec, add, cross, dot, quat_rotate, sub
from geomphys.scene.arrays import JOINT_PRISMATIC, SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, position_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Posture(NamedTuple):
    """Poses of everything: T trees, Q angles, B bodies."""

    roots: Floats  # (T, 7)
    angles: Floats  # (Q,)
    poses: Floats  # (B, 7)


def make_posture(scene: Scene, poses: Floats) -> Posture:
    """Everything at rest, at `poses` (B, 7)."""
    return Posture(scene.trees.rest.copy(), np.zeros(len(scene.dofs.lower)), poses.copy())


@kernel
def is_recorded(scene: Scene, tree: int) -> bool:
    """Whether the recording moves the tree."""
    return scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED


@kernel
def copy_tree(scene: Scene, source: Posture, tree: int, target: Posture) -> None:
    """Copy a tree's part of a posture."""
    copy_pose(source.roots, tree, target.roots, tree)
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        target.angles[q] = source.angles[q]
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        copy_pose(source.poses, body, target.poses, body)


@kernel
def point_of(poses: Floats, body: int, inside: Vec) -> Vec:
    """A point of a body in the world."""
    return add(position_of(poses, body), quat_rotate(orientation_of(poses, body), inside))


@kernel
def world_axis(scene: Scene, poses: Floats, joint: int) -> Vec:
    """Axis of the joint above body `joint`, world frame."""
    axis = vec_at(scene.bodies.axis, joint)
    return quat_rotate(orientation_of(poses, joint), axis)


@kernel
def joint_jacobian(scene: Scene, poses: Floats, joint: int, point: Vec, n: Vec) -> float:
    """Velocity along n of a point below the joint above body `joint`, per unit rate of the joint's degree of freedom."""
    axis = world_axis(scene, poses, joint)
    if scene.bodies.joint[joint] == JOINT_PRISMATIC:
        return scene.bodies.multiplier[joint] * dot(axis, n)
    return scene.bodies.multiplier[joint] * dot(cross(axis, sub(point, position_of(poses, joint))), n)
