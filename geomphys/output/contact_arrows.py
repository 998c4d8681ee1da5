"""How contacts are drawn: arrows along the normal that can be seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ARROW_SCALE = 4.0
"""Metres of arrow a metre of depth: a millimetre is drawn as four."""
ARROW_LONGEST = 0.15
"""Length [m] at which arrows end, however deep the overlap."""
ARROW_BASE = 0.015
"""Length of the arrow of a contact without depth [m], so that it is seen too."""


def arrow_lengths(depths: Floats) -> Floats:
    """Length [m] of the arrows of contacts of those depths [m]."""
    return np.minimum(ARROW_BASE + ARROW_SCALE * depths, ARROW_LONGEST)


def arrow_orientations(directions: Floats) -> Floats:
    """Rotations (n, 4), x y z w, that turn the x axis to the unit vectors `directions` (n, 3)."""
    orientations = np.empty((len(directions), 4))
    orientations[:, 0] = 0.0
    orientations[:, 1] = -directions[:, 2]
    orientations[:, 2] = directions[:, 1]
    orientations[:, 3] = 1.0 + directions[:, 0]
    reversed_ = orientations[:, 3] < 1e-12  # along -x: half a turn about z
    orientations[reversed_] = (0.0, 0.0, 1.0, 0.0)
    orientations /= np.linalg.norm(orientations, axis=1, keepdims=True)
    return orientations
