"""Sets up a keypoint fit: the model of a tree with points on its links, and the state before the first frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.keypoints.fit import pose_links
from geomphys.keypoints.fit_model import REST_WEIGHT, TERM_WEIGHTS, FitModel, FitState
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import joint_origins

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_LEVER = 0.01
"""m; of joints that move no point."""
MAX_LEVER = 0.05
"""m; of all others, that of a finger: noise is the same on long limbs, so their angles have less."""
PROBE_POSTURES = 6
"""Postures at which it is measured which joints move which points."""
RIGID = 1e-6
"""m; a distance that changes by more is not rigid."""
ROOT_POINTS = 3
"""Fewest points that determine the pose of the root."""
ROOT_EXTENT = 0.005
"""m; root mean square distance of these points from a line, at least."""
MOVED = 1e-6
"""m per rad; a point that moves less is not moved by a joint."""


def make_model(scene: Scene, tree: int, bodies: Ints, weights: Floats, *, fits_root: bool) -> FitModel:
    """Model of a tree.

    Parameters
    ----------
    scene, tree
        The scene, and the index of the tree in it.
    bodies
        (K,) body of each point, counted from the tree's first.
    weights
        (K,) weight of each point in the objective.
    fits_root
        Whether the pose of the root is unknown.
    """
    first, last = scene.trees.body_start[tree], scene.trees.body_start[tree + 1]
    start, end = scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]
    rows, columns = slice(first, last), slice(start, end)
    dof = scene.bodies.dof[rows]
    lower, upper = scene.dofs.lower[columns].copy(), scene.dofs.upper[columns].copy()
    model = FitModel(
        parent=scene.bodies.parent[rows] - first,
        kind=scene.bodies.joint[rows].copy(),
        origin=np.ascontiguousarray(joint_origins(scene)[rows]),
        axis=np.ascontiguousarray(scene.bodies.axis[rows]),
        column=np.where(dof >= 0, dof - start, -1),
        multiplier=scene.bodies.multiplier[rows].copy(),
        offset=scene.bodies.offset[rows].copy(),
        lower=lower,
        upper=upper,
        rest=np.clip(0.0, lower, upper),
        lever=np.full(end - start, MIN_LEVER),
        body=np.asarray(bodies, dtype=np.int64),
        weight=np.asarray(weights, dtype=np.float64),
        shown_by=np.zeros((end - start, len(bodies)), dtype=np.int64),
        fits_root=fits_root,
    )
    return _with_levers(model)


def make_state(model: FitModel) -> FitState:
    """State before the first frame: at rest."""
    bodies, unknowns = len(model.parent), len(model.rest) + 6
    return FitState(
        angles=model.rest.copy(),
        increment=np.zeros(len(model.rest)),
        root=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        poses=np.zeros((bodies, 7)),
        axes=np.zeros((bodies, 3)),
        trial_poses=np.zeros((bodies, 7)),
        trial_root=np.zeros(7),
        trial_angles=np.zeros(len(model.rest)),
        target=np.zeros(len(model.rest)),
        rest_weight=np.full(len(model.rest), REST_WEIGHT),
        jacobian=np.zeros((3, unknowns)),
        columns=np.zeros(unknowns, dtype=np.int64),
        hessian=np.zeros((unknowns, unknowns)),
        factor=np.zeros((unknowns, unknowns)),
        column=np.zeros(unknowns),
        gradient=np.zeros(unknowns),
        step=np.zeros(unknowns),
        free=np.zeros(unknowns, dtype=np.int64),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
        weights=np.zeros((), TERM_WEIGHTS),
    )


def probe_postures(model: FitModel) -> Floats:
    """(n, Q) postures spread over the limits, the same ones each time."""
    low = np.where(np.isfinite(model.lower), model.lower, model.rest - 1.0)
    high = np.where(np.isfinite(model.upper), model.upper, model.rest + 1.0)
    fractions = np.mod(np.outer(np.arange(1, PROBE_POSTURES + 1), np.arange(1, len(low) + 1)) * np.sqrt(2.0), 1.0)
    postures: Floats = low + fractions * (high - low)
    return postures


def _with_levers(model: FitModel) -> FitModel:
    """The model with `lever` and `shown_by`, measured by small changes of the joint values in several postures."""
    root, poses = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.zeros((len(model.parent), 7))
    change = 1e-4

    def points(angles: Floats) -> Floats:
        pose_links(model, root, angles, poses)
        return poses[model.body, :3].copy()

    shown, levers = np.zeros_like(model.shown_by), np.zeros(len(model.rest))
    for posture in (model.rest, *probe_postures(model)):
        for q in range(len(model.rest)):
            below, above = posture.copy(), posture.copy()
            below[q] -= change
            above[q] += change
            motion = np.linalg.norm(points(above) - points(below), axis=1) / (2 * change)
            shown[q] |= motion > MOVED
            if motion.any():
                levers[q] = max(
                    levers[q], np.sqrt(np.mean(motion[motion > MOVED] ** 2)) if (motion > MOVED).any() else 0
                )
    return model._replace(shown_by=shown, lever=np.clip(levers, MIN_LEVER, MAX_LEVER))


def point_distances(model: FitModel) -> Floats:
    """(n, K, K) m, distances of all pairs of points in the posture at rest and in `probe_postures`."""
    root, poses = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), np.zeros((len(model.parent), 7))
    distances = []
    for posture in (model.rest, *probe_postures(model)):
        pose_links(model, root, posture, poses)
        points = poses[model.body, :3]
        distances.append(np.linalg.norm(points[:, None] - points[None], axis=2))
    return np.array(distances)


def rigid_points(model: FitModel) -> NDArray[np.bool_]:
    """(K, K) whether no joint changes the distance of two points."""
    rigid: NDArray[np.bool_] = np.ptp(point_distances(model), axis=0) < RIGID
    return rigid


def spans_plane(points: Floats) -> bool:
    """Whether points (n, 3) m are enough and not in a line, so that they determine the pose of their body."""
    if len(points) < ROOT_POINTS:
        return False
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    return bool(extent[1] > ROOT_EXTENT)


def nearest_rotation(own: Floats, other: Floats) -> tuple[Floats, float]:
    """Rotation (3, 3) that brings points (n, 3), about their mean, nearest to others, about theirs (Kabsch 1976).

    Also the standard deviation [m] of the remaining errors of coordinates, a scaling removed too.
    """
    own, other = own - own.mean(axis=0), other - other.mean(axis=0)
    u, s, vt = np.linalg.svd(own.T @ other)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0])
    rotation = (u @ flip @ vt).T
    scale = float((s * np.diag(flip)).sum() / (own**2).sum())
    left = float(np.sum((other - scale * own @ rotation.T) ** 2)) / max(3 * len(own) - 7, 1)
    return rotation, float(np.sqrt(left))
