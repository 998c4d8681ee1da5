"""Compiled forward kinematics: from a tree's root pose and angles to the poses of its bodies and pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import Quat, Rot, Vec, add, quat_mul, quat_rotate, rot_from_quat, rot_mul, rotate
from geomphys.scene.arrays import JOINT_FIXED, JOINT_PRISMATIC, Scene

Floats = NDArray[np.float64]

NO_ROTATION = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def joint_origins(scene: Scene) -> Floats:
    """parent_from_joint of every body as pose rows (B, 7), from the frame rows of the scene."""
    rows = scene.bodies.origin
    poses = np.zeros((len(rows), 7))
    poses[:, :3] = rows[:, 9:]
    m = rows[:, :9].reshape(-1, 3, 3)
    # the largest of the four squared components tells which formula divides by a safe number (Shepperd 1978)
    trace = np.trace(m, axis1=1, axis2=2)
    squares = np.stack([m[:, 0, 0], m[:, 1, 1], m[:, 2, 2], trace], axis=1)
    for row, (r, best) in enumerate(zip(m, squares.argmax(axis=1), strict=True)):
        if best == 3:
            q = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1.0 + trace[row]])
        else:
            i, j, k = best, (best + 1) % 3, (best + 2) % 3
            q = np.zeros(4)
            q[i] = 1.0 + r[i, i] - r[j, j] - r[k, k]
            q[j], q[k], q[3] = r[j, i] + r[i, j], r[k, i] + r[i, k], r[k, j] - r[j, k]
        poses[row, 3:] = q / np.linalg.norm(q)
    return poses


@kernel
def position_of(poses: Floats, body: int) -> Vec:
    """Position of a pose row."""
    return (poses[body, 0], poses[body, 1], poses[body, 2])


@kernel
def orientation_of(poses: Floats, body: int) -> Quat:
    """Quaternion of a pose row."""
    return (poses[body, 3], poses[body, 4], poses[body, 5], poses[body, 6])


@kernel
def set_pose(poses: Floats, body: int, p: Vec, q: Quat) -> None:
    """Write a pose row."""
    poses[body, 0], poses[body, 1], poses[body, 2] = p
    poses[body, 3], poses[body, 4], poses[body, 5], poses[body, 6] = q


@kernel
def frame_rotation(frames: Floats, i: int) -> Rot:
    """Rotation of a frame row."""
    return (
        frames[i, 0],
        frames[i, 1],
        frames[i, 2],
        frames[i, 3],
        frames[i, 4],
        frames[i, 5],
        frames[i, 6],
        frames[i, 7],
        frames[i, 8],
    )


@kernel
def frame_position(frames: Floats, i: int) -> Vec:
    """Position of a frame row."""
    return (frames[i, 9], frames[i, 10], frames[i, 11])


@kernel
def set_frame(frames: Floats, i: int, rotation: Rot, position: Vec) -> None:
    """Write a frame row."""
    for k in range(9):
        frames[i, k] = rotation[k]
    frames[i, 9], frames[i, 10], frames[i, 11] = position


@kernel
def joint_value(scene: Scene, body: int, angles: Floats) -> float:
    """Value [rad or m] of the joint above `body`; mimic joints from their masters."""
    dof = scene.bodies.dof[body]
    if dof < 0:
        return float(scene.bodies.offset[body])
    return float(scene.bodies.multiplier[body] * angles[dof] + scene.bodies.offset[body])


@kernel
def pose_child(poses: Floats, body: int, parent: int, origins: Floats, axes: Floats, joint: tuple[int, float]) -> None:
    """Pose of a body from its parent's: poses, origins (B, 7), axes (B, 3), `joint` its kind and its value [rad or m]."""
    kind, value = joint
    p, q = position_of(poses, parent), orientation_of(poses, parent)
    t = quat_rotate(q, position_of(origins, body))
    p = (p[0] + t[0], p[1] + t[1], p[2] + t[2])
    q = quat_mul(q, orientation_of(origins, body))
    if kind != JOINT_FIXED:
        axis = vec_at(axes, body)
        if kind == JOINT_PRISMATIC:
            t = quat_rotate(q, axis)
            p = (p[0] + value * t[0], p[1] + value * t[1], p[2] + value * t[2])
        else:
            s = math.sin(0.5 * value)
            q = quat_mul(q, (axis[0] * s, axis[1] * s, axis[2] * s, math.cos(0.5 * value)))
    set_pose(poses, body, p, q)


@kernel
def pose_body(scene: Scene, origins: Floats, body: int, angles: Floats, poses: Floats) -> None:
    """Pose of one body (not a root) from its parent's and its joint's angle; see `pose_tree`."""
    bodies = scene.bodies
    joint = (bodies.joint[body], joint_value(scene, body, angles))
    pose_child(poses, body, bodies.parent[body], origins, bodies.axis, joint)


@noinline
def pose_tree(scene: Scene, origins: Floats, tree: int, roots: Floats, angles: Floats, poses: Floats) -> None:
    """Forward kinematics of one tree.

    Parameters
    ----------
    scene, origins
        The scene and `joint_origins` of it.
    tree
        Index of the tree.
    roots
        (T, 7) world pose of every tree's root.
    angles
        (Q,) joint values [rad or m].
    poses
        (B, 7) world poses of the bodies; those of `tree` are written. The root's is copied as it is.
    """
    first = scene.trees.body_start[tree]
    copy_pose(roots, tree, poses, first)
    for body in range(first + 1, scene.trees.body_start[tree + 1]):
        pose_body(scene, origins, body, angles, poses)


@kernel
def copy_tree_frames(scene: Scene, tree: int, source: Floats, target: Floats) -> None:
    """Copy the frame rows (P, 12) of the pieces of `tree`."""
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    for i in range(first, scene.bodies.piece_start[scene.trees.body_start[tree + 1]]):
        for k in range(12):
            target[i, k] = source[i, k]


@noinline
def pose_pieces_of_tree(scene: Scene, tree: int, poses: Floats, frames: Floats) -> None:
    """Frame rows (P, 12) world_from_piece of the pieces of `tree`, from body poses (B, 7)."""
    local = scene.pieces.local
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        first, last = scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]
        if first == last:
            continue
        r = rot_from_quat(orientation_of(poses, body))
        for i in range(first, last):
            t, inside = rotate(r, frame_position(local, i)), frame_rotation(local, i)
            rotation = r if inside == NO_ROTATION else rot_mul(r, inside)
            set_frame(frames, i, rotation, add(position_of(poses, body), t))
