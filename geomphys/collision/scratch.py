"""Workspace of the narrow phase, allocated once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.packed_records import Record
from geomphys.scene.arrays import Floats, Ints

MAX_CORNERS = 2048
"""Of the expanding polytope."""
MAX_FACES = 8192
MAX_POLYGON = 256
"""Corners of a clipped face."""

CORNER = np.dtype([("difference", np.float64, 3), ("on_a", np.float64, 3)])
"""A point of the Minkowski difference, and the point of A it comes from [m]."""

SIMPLEX = np.dtype(
    [
        ("count", np.int64),  # corners; 0: there is none
        ("on_a", np.float64, (4, 3)),  # m, the points of A that they come from, in its frame
        ("on_b", np.float64, (4, 3)),  # m, those of B, in its frame
    ]
)
"""Where the descent for a pair has ended, in the order in which `penetration.separate` takes its pieces."""

FACE = np.dtype(
    [
        ("corner", np.int64, 3),  # counter-clockwise seen from outside
        ("across", np.int64, 3),  # 3 f + e for edge e of face f: the adjacent edges across edges 0, 1, 2
        ("state", np.int64),
        ("normal", np.float64, 3),  # unit, outward
        ("distance", np.float64),  # m, of its plane from the origin
    ]
)
"""A face of the expanding polytope."""

Corners = NDArray[np.void]
"""Records of `CORNER`."""
FaceRecords = NDArray[np.void]
"""Records of `FACE`."""


class Scratch(NamedTuple):
    """Workspace of `separation` and `manifold`, without state between two calls. One per thread."""

    simplex: Record  # SIMPLEX, of a pair without one of its own
    corners: Corners  # (MAX_CORNERS,) of the polytope
    faces: FaceRecords  # (MAX_FACES,) of the polytope
    queue: Ints  # (MAX_FACES,) heap of faces, the nearest first
    stack: Ints  # (3 MAX_FACES,) edges still to visit
    polygons: Floats  # (6, MAX_POLYGON, 3) m
    on_a: Floats  # (4, 3) m, points of a contact manifold
    on_b: Floats  # (4, 3) m


def make_scratch() -> Scratch:
    """Workspace of `separation` and `manifold`."""
    return Scratch(
        simplex=np.zeros((), SIMPLEX),
        corners=np.zeros(MAX_CORNERS, CORNER),
        faces=np.zeros(MAX_FACES, FACE),
        queue=np.zeros(MAX_FACES, np.int64),
        stack=np.zeros(3 * MAX_FACES, np.int64),
        polygons=np.zeros((6, MAX_POLYGON, 3)),
        on_a=np.zeros((4, 3)),
        on_b=np.zeros((4, 3)),
    )
