"""Arrays of a keypoint fit: the tree's joints, the points on its links, the weights of the objective, and the solver's state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.packed_records import Record

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REST_WEIGHT = 1e-3
"""Weight of the rest posture of a joint that the points determine, relative to one point at the joint's lever."""
UNSHOWN_WEIGHT = 0.1
"""The same of a joint that they do not determine: high enough that noise does not move it."""
SHOWN = 0.05
"""Between these: the weight of the points on a joint, relative to one point at its lever, at which the rest weight is half."""
SMOOTHNESS_WEIGHT = 0.3
"""Weight of the values of the last frame plus its increment."""


class FitModel(NamedTuple):
    """One tree and K points on it. The columns are its Q joint values."""

    # the tree's B bodies, parents first; the root is body 0
    parent: Ints  # (B,)
    kind: Ints  # (B,) JOINT_FIXED, JOINT_REVOLUTE, JOINT_PRISMATIC
    origin: Floats  # (B, 7) parent_from_joint as pose rows
    axis: Floats  # (B, 3)
    column: Ints  # (B,) -1 for a fixed joint
    multiplier: Floats  # (B,)
    offset: Floats  # (B,)
    # the joint values
    lower: Floats  # (Q,)
    upper: Floats  # (Q,)
    rest: Floats  # (Q,) zero, or the nearest value within the limits
    lever: Floats  # (Q,) m, root mean square distance of the points it moves from its axis
    # the points
    body: Ints  # (K,) whose origin it is
    weight: Floats  # (K,)
    shown_by: Ints  # (Q, K) 1 where a point moves with the joint
    fits_root: bool  # whether the root's pose is unknown too


TERM_WEIGHTS = np.dtype(
    [
        ("smoothness", np.float64),  # of the term about `target`
        ("orientation", np.float64),  # m², of the term about `orientation`; 0: there is none
    ]
)
"""Weights of the terms of the objective that may be absent."""


class FitState(NamedTuple):
    """Result of the last frame and workspace of the next."""

    angles: Floats  # (Q,)
    increment: Floats  # (Q,) from the frame before to the last
    root: Floats  # (7,)
    poses: Floats  # (B, 7)
    axes: Floats  # (B, 3) of the joints, world frame
    trial_poses: Floats  # (B, 7)
    trial_root: Floats  # (7,)
    trial_angles: Floats  # (Q,)
    target: Floats  # (Q,) of the smoothness term
    rest_weight: Floats  # (Q,) from `REST_WEIGHT` to `UNSHOWN_WEIGHT`, by what the points of the frame show
    jacobian: Floats  # (3, N) of one point; N = Q + 6: joint values, translation and rotation of the root
    columns: Ints  # (N,) columns of it that are not zero
    hessian: Floats  # (N, N)
    factor: Floats  # (N, N)
    column: Floats  # (N,) of the factor
    gradient: Floats  # (N,)
    step: Floats  # (N,)
    free: Ints  # (N,) 1 for unknowns of this step
    orientation: Floats  # (4,) of the root as the source has it
    weights: Record  # TERM_WEIGHTS
