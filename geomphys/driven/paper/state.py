"""Constant data of chains, state from frame to frame, and workspace of the published method."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import MOTION_BOUND, Detection, Near, Records
from geomphys.config import Config
from geomphys.driven.postures import Posture, make_posture
from geomphys.driven.state import DrivenWorkspace
from geomphys.scene.arrays import JOINT_FIXED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MANIFOLD = 8  # rows for the points of a contact manifold


class Limbs(NamedTuple):
    """Constant data of the chains of a scene."""

    chain: Ints  # (B,) chain that moves a body: the body is one of its links; -1: none does
    depth: Ints  # (B,) joints of its chain at and above it
    along: Floats  # (B, 3) m, from a body's joint to its far end, body frame; 0 where it has no length
    cone: Ints  # (Q,) reach cone that a joint belongs to, -1: none
    joints: Ints  # (Q,) joints that a degree of freedom moves


DEPTH_SUMS = np.dtype(
    [
        ("weighted", np.float64, 3),  # m²: Σ pd² n
        ("depths", np.float64),  # m: Σ pd
        ("deepest", np.float64),  # m
    ]
)
"""Sums of (1) over the overlaps of two objects."""


class PaperWorkspace(NamedTuple):
    """State, bounds and workspace of the published method. Collision arrays are shared with the machine."""

    gap: float  # m; clearance that a correction adds to the depth
    origins: Floats  # (B, 7) joint origins
    frames: Floats  # (P, 12) world_from_piece of the iterate
    motion_bounds: Records  # (T,) MOTION_BOUND, zero: discrete checks need no margin
    near: Near
    detection: Detection
    limbs: Limbs
    seed: int  # seed of the order of chains
    passes: int  # bound on the passes of a frame
    iterate: Posture  # the iterate
    target: Posture  # driven trees by the coupling alone
    free: Posture  # last free state of each driven tree
    has_free: Ints  # (T,) 1: there is one
    best: Posture  # the iterate of the pass with the least overlap
    joint_rate: Floats  # (Q,) rad/s or m/s, of the offsets of joints from their recorded values
    lower: Floats  # (Q,) limits, widened to recorded values
    upper: Floats  # (Q,)
    cone_limit: Floats  # (R,) rad; least signed angle of a limb in its reach cone: 0, or as recorded
    order: Ints  # (C,) chains in the order of this frame
    rank: Ints  # (C,) their indices in it
    saved: Floats  # (Q,) angles before a change that may be undone
    step: Floats  # (Q,) rad, of the projection into a reach cone
    sums: Records  # (B,) DEPTH_SUMS of the overlaps with an object
    translation: Floats  # (T, 3) m, translation of a tree in a pass
    deepest: Floats  # (T,) m, of the pair of objects that it is for
    cancelled: Ints  # (T,) 1: the normals of a pair of objects cancel
    interpolated: Ints  # (T,) 1: interpolated in the last elimination
    points_a: Floats  # (MANIFOLD, 3)
    points_b: Floats  # (MANIFOLD, 3)


def make_limbs(scene: Scene) -> Limbs:
    """Look up which chain moves which body."""
    bodies, dofs = len(scene.bodies.role), len(scene.dofs.lower)
    chain, depth, along = np.full(bodies, -1), np.zeros(bodies, np.int64), np.zeros((bodies, 3))
    cone, joints = np.full(dofs, -1), np.zeros(dofs, np.int64)
    for q in scene.bodies.dof[(scene.bodies.dof >= 0) & (scene.bodies.joint != JOINT_FIXED)]:
        joints[q] += 1
    for c in np.flatnonzero(scene.trees.chains[scene.chains.tree] == 1):
        count = 0
        for body in scene.chains.bodies[scene.chains.body_start[c] : scene.chains.body_start[c + 1]]:
            q = scene.bodies.dof[body]
            if q >= 0 and scene.bodies.joint[body] != JOINT_FIXED and scene.dofs.chain[q] == c:
                count += 1
            if count:
                chain[body], depth[body], along[body] = c, count, _length_of(scene, int(body))
    for k in range(len(scene.cones.limb)):
        for body in scene.cones.joints[scene.cones.joint_start[k] : scene.cones.joint_start[k + 1]]:
            cone[scene.bodies.dof[body]] = k
    return Limbs(chain, depth, along, cone, joints)


def _length_of(scene: Scene, body: int) -> Floats:
    """Vector [m] from a body's joint to the farthest joint below it, else to the far end of its pieces, body frame."""
    below: Floats = scene.bodies.origin[scene.bodies.parent == body, 9:]
    if len(below):
        distances = np.linalg.norm(below, axis=1)
        if distances.max() > 0.0:
            return np.asarray(below[np.argmax(distances)])
    first, last = scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]
    if first == last:
        return np.zeros(3)
    local = scene.pieces.local[first:last]
    centres = local[:, 9:] + np.einsum("pij,pj->pi", local[:, :9].reshape(-1, 3, 3), scene.pieces.centre[first:last])
    middle = centres.mean(axis=0)
    length = np.linalg.norm(middle)
    if length == 0.0:
        return np.zeros(3)
    direction = middle / length
    return np.asarray(direction * np.max(centres @ direction + scene.pieces.reach[first:last]))


def make_paper_workspace(scene: Scene, shared: DrivenWorkspace, config: Config) -> PaperWorkspace:
    """Workspace of the published method for a scene.

    Parameters
    ----------
    scene
        The scene.
    shared
        Workspace shared with the step: `shared.piece_frames.frames` are the final frames.
    config
        Clearance, seed of the order of chains, bound on the passes of a frame.
    """
    trees, dofs, chains = len(scene.trees.role), len(scene.dofs.lower), len(scene.chains.tree)
    poses = shared.work.iterate.poses
    iterate, target, free, best = (make_posture(scene, poses) for _ in range(4))
    joint_rate, lower, upper, saved, step = (np.zeros(dofs) for _ in range(5))
    has_free, cancelled, interpolated = (np.zeros(trees, np.int64) for _ in range(3))
    return PaperWorkspace(
        gap=config.gap,
        origins=shared.origins,
        frames=shared.piece_frames.frames,
        motion_bounds=np.zeros(trees, MOTION_BOUND),
        near=shared.near,
        detection=shared.detection,
        limbs=make_limbs(scene),
        seed=config.seed & 0x7FFFFFFFFFFFFFFF,
        passes=config.max_iterations,
        iterate=iterate,
        target=target,
        free=free,
        has_free=has_free,
        best=best,
        joint_rate=joint_rate,
        lower=lower,
        upper=upper,
        cone_limit=np.zeros(len(scene.cones.limb)),
        order=np.arange(chains),
        rank=np.arange(chains),
        saved=saved,
        step=step,
        sums=np.zeros(len(scene.bodies.role), DEPTH_SUMS),
        translation=np.zeros((trees, 3)),
        deepest=np.zeros(trees),
        cancelled=cancelled,
        interpolated=interpolated,
        points_a=np.zeros((MANIFOLD, 3)),
        points_b=np.zeros((MANIFOLD, 3)),
    )
