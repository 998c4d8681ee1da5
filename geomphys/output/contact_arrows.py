"""Lengths and orientations of the arrows that show contacts: along normals, by the force or, where none acts, the depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.results import Contacts

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ARROW_SCALE = 4.0
"""Arrow length per depth, m/m."""
FORCE_SCALE = 0.01
"""Arrow length per normal force, m/N."""
MAX_ARROW_LENGTH = 0.15
"""Maximum arrow length, m."""
MIN_ARROW_LENGTH = 0.015
"""Arrow length of a contact of depth 0 on which no force acts, m."""


def arrow_lengths(contacts: Contacts, seconds: Floats) -> Floats:
    """Lengths (k,) [m] of the arrows of contacts, by the mean normal force in their frames of (k,) s; 0: not known."""
    impulses = contacts.normal_impulse
    forces = np.divide(impulses, seconds, out=np.zeros(len(impulses)), where=seconds > 0.0)
    extents = np.where(forces > 0.0, FORCE_SCALE * forces, ARROW_SCALE * contacts.depth)
    return np.minimum(MIN_ARROW_LENGTH + extents, MAX_ARROW_LENGTH)


def frame_durations(times_ns: Ints, before_ns: int | None) -> Floats:
    """Durations (n,) [s] of frames at times (n,), each since the one before; 0 of a recording's first, which has none before."""
    first = times_ns[0] if before_ns is None else before_ns
    return 1e-9 * np.diff(times_ns, prepend=first)


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
