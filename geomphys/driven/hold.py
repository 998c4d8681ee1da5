"""Trees that are held: the orientation and shape of the last free place, and the way back to the recorded ones.

Translation alone cannot keep a body free that turns, or closes its fingers, where there is no room for that. It keeps
the turn of its last free place then, while it still goes where its coupling pulls. What it is behind by is an offset like
that of its position, and goes back by the same damped spring (6) as soon as there is room.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.coupling import relax_offset
from geomphys.driven.escape import ALONG, LOOSE
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, quat_conjugate, quat_from_rotation_vector, quat_mul, quat_unit, rotation_vector
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


CARRIERS = 4  # pieces at most that carry a tree


class Lag(NamedTuple):
    """By how much trees are behind the turn and the joints of their recording, carried from frame to frame."""

    behind: Ints  # (T,) 1: it is behind; else what follows is zero
    turn: Floats  # (T, 3) rad, rotation vector in the world from the recorded orientation to that of the root
    turn_speed: Floats  # (T, 3) rad/s
    shape: Floats  # (Q,) of each joint from its recorded angle
    shape_speed: Floats  # (Q,)
    roots: Floats  # (T, 7) recorded root poses of the last frame or part of one
    angles: Floats  # (Q,) recorded angles then


class Carried(NamedTuple):
    """How trees are carried by what is round them: scratch of a step."""

    pieces: Ints  # (T, n) that carry it, -1: none,
    weights: Floats  # (T, n) and how much each counts
    way: Floats  # (T, 3) m, how far the tree's root is taken along,
    turned: Floats  # (T, 4) and how it is oriented then


class Wanted(NamedTuple):
    """What trees go for that are behind, and what a step is begun with: scratch."""

    roots: Floats  # (T, 7)
    angles: Floats  # (Q,)
    poses: Floats  # (B, 7)
    speed: Floats  # (T, 3) of offsets when the step began
    bend: Floats  # (Q,) offsets of joints of chains then
    bend_speed: Floats  # (Q,)


def make_lag(trees: int, dofs: int) -> Lag:
    """Nothing is behind."""
    turn, turn_speed = np.zeros((trees, 3)), np.zeros((trees, 3))
    shape, shape_speed, angles = (np.zeros(dofs) for _ in range(3))
    return Lag(np.zeros(trees, np.int64), turn, turn_speed, shape, shape_speed, np.zeros((trees, 7)), angles)


def make_wanted(trees: int, dofs: int, bodies: int) -> Wanted:
    """Room for `Wanted`."""
    angles, bend, bend_speed = (np.zeros(dofs) for _ in range(3))
    return Wanted(np.zeros((trees, 7)), angles, np.zeros((bodies, 7)), np.zeros((trees, 3)), bend, bend_speed)


def make_carried(trees: int) -> Carried:
    """Room for `Carried`."""
    return Carried(
        np.full((trees, CARRIERS), -1), np.zeros((trees, CARRIERS)), np.zeros((trees, 3)), np.zeros((trees, 4))
    )


@kernel
def copy_recording(
    roots: Floats, angles: Floats, poses: Floats, to_roots: Floats, to_angles: Floats, to_poses: Floats
) -> None:
    """Copy root poses (T, 7), angles (Q,) and poses (B, 7)."""
    for tree in range(len(roots)):
        for k in range(7):
            to_roots[tree, k] = roots[tree, k]
    for q in range(len(angles)):
        to_angles[q] = angles[q]
    for body in range(len(poses)):
        for k in range(7):
            to_poses[body, k] = poses[body, k]


@kernel
def _relax_turn(scene: Scene, lag: Lag, tree: int, dt: float) -> Vec:
    """Bring the turn of a tree on by `dt`; returns it."""
    for i in range(3):
        lag.turn[tree, i], lag.turn_speed[tree, i] = relax_offset(
            scene.trees, tree, lag.turn[tree, i], lag.turn_speed[tree, i], dt
        )
    return (lag.turn[tree, 0], lag.turn[tree, 1], lag.turn[tree, 2])


@outlined
def relax_lag(
    scene: Scene, origins: Floats, lag: Lag, wanted: Wanted, roots: Floats, angles: Floats, poses: Floats, dt: float
) -> bool:
    """What trees go for in a frame: the recording `roots`, `angles`, `poses`, less what they are still behind by.

    Written to `wanted`, but only if something is behind; returns whether.
    """
    some = False
    for tree in range(len(lag.behind)):
        some = some or lag.behind[tree] == 1
    if not some:
        return False
    copy_recording(roots, angles, poses, wanted.roots, wanted.angles, wanted.poses)
    trees, some = scene.trees, False
    for tree in range(len(lag.behind)):
        if lag.behind[tree] == 0:
            continue
        turn = _relax_turn(scene, lag, tree, dt)
        behind = turn != (0.0, 0.0, 0.0)
        if behind:
            q = quat_unit(quat_mul(quat_from_rotation_vector(turn), orientation_of(roots, tree)))
            for k in range(4):
                wanted.roots[tree, 3 + k] = q[k]
        for j in range(trees.dof_start[tree], trees.dof_start[tree + 1]):
            lag.shape[j], lag.shape_speed[j] = relax_offset(trees, tree, lag.shape[j], lag.shape_speed[j], dt)
            if lag.shape[j] != 0.0:
                wanted.angles[j] = angles[j] + lag.shape[j]
                behind = True
        lag.behind[tree] = 1 if behind else 0
        if behind:
            pose_tree(scene, origins, tree, wanted.roots, wanted.angles, wanted.poses)
            some = True
    return some


@outlined
def keep_turn(
    scene: Scene, origins: Floats, held: Ints, turned: Floats, last_roots: Floats, last_angles: Floats, roots: Floats,
    angles: Floats, poses: Floats,
) -> None:  # fmt: skip
    """Give trees that are `held` (T,) the orientation and angles of the last step in what a step goes for.

    Those that are carried have the orientation in `turned` (T, 4).
    """
    for tree in range(len(held)):
        if held[tree] == LOOSE:
            continue
        for k in range(4):
            roots[tree, 3 + k] = turned[tree, k] if held[tree] >= ALONG else last_roots[tree, 3 + k]
        for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            angles[j] = last_angles[j]
        pose_tree(scene, origins, tree, roots, angles, poses)


@kernel
def drop_lag(scene: Scene, lag: Lag, tree: int) -> None:
    """The tree is no longer behind."""
    lag.behind[tree] = 0
    for i in range(3):
        lag.turn[tree, i] = lag.turn_speed[tree, i] = 0.0
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        lag.shape[j] = lag.shape_speed[j] = 0.0


@outlined
def remember_lag(
    scene: Scene, lag: Lag, held: Ints, now_roots: Floats, now_angles: Floats, roots: Floats, angles: Floats
) -> None:
    """What trees are behind by at a frame's end: those `held` (T,) are at `now_roots`, `now_angles`, and have no speed."""
    for tree in range(len(held)):
        if scene.trees.moving[tree] == 0 and scene.trees.role[tree] != DRIVEN:
            continue
        for k in range(7):
            lag.roots[tree, k] = roots[tree, k]
        if scene.trees.role[tree] != DRIVEN or held[tree] == LOOSE:
            continue
        turn = rotation_vector(quat_mul(orientation_of(now_roots, tree), quat_conjugate(orientation_of(roots, tree))))
        if orientation_of(now_roots, tree) == orientation_of(roots, tree):
            turn = (0.0, 0.0, 0.0)
        lag.behind[tree] = 0 if turn == (0.0, 0.0, 0.0) else 1
        for i in range(3):
            lag.turn[tree, i], lag.turn_speed[tree, i] = turn[i], 0.0
        for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            lag.shape[j], lag.shape_speed[j] = now_angles[j] - angles[j], 0.0
            if lag.shape[j] != 0.0:
                lag.behind[tree] = 1
    for j in range(len(angles)):
        lag.angles[j] = angles[j]
