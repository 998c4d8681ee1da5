"""Lengths and orientations of the arrows that show contact normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ARROW_SCALE = 4.0
"""Arrow length per depth, m/m."""
MAX_ARROW_LENGTH = 0.15
"""Maximum arrow length, m."""
MIN_ARROW_LENGTH = 0.015
"""Arrow length of a contact of depth 0, m."""


def arrow_lengths(depths: Floats) -> Floats:
    """Length [m] of the arrows of contacts of those depths [m]."""
    return np.minimum(MIN_ARROW_LENGTH + ARROW_SCALE * depths, MAX_ARROW_LENGTH)


def arrow_orientations(directions: Floats) -> Floats:
    """Rotations (n, 4), x y z w, that rotate the x axis to the unit vectors `directions` (n, 3)."""
    orientations = np.empty((len(directions), 4))
    orientations[:, 0] = 0.0
    orientations[:, 1] = -directions[:, 2]
    orientations[:, 2] = directions[:, 1]
    orientations[:, 3] = 1.0 + directions[:, 0]
    reversed_ = orientations[:, 3] < 1e-12  # along -x: rotation by pi about z
    orientations[reversed_] = (0.0, 0.0, 1.0, 0.0)
    orientations /= np.linalg.norm(orientations, axis=1, keepdims=True)
    return orientations
