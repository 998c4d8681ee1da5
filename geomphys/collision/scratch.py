"""Memory of the narrow phase, allocated once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from geomphys.jit.addresses import address
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Floats, Ints

MAX_CORNERS = 2048
"""Of the expanding polytope."""
MAX_FACES = 8192
MAX_POLYGON = 256
"""Corners of a clipped face."""


class Scratch(NamedTuple):
    """Memory for `separation` and `manifold`; holds nothing between two calls. One per thread."""

    floats: Floats
    ints: Ints


class Room(NamedTuple):
    """Where things are in it, by address."""

    simplex: int  # floats (4, 6): points of M and the points of A they come from
    points: int  # floats (MAX_CORNERS, 6): the same for the polytope's corners
    planes: int  # floats (MAX_FACES, 4): unit normal and distance of the polytope's faces
    polygons: int  # floats (6, MAX_POLYGON, 3)
    faces: int  # ints (MAX_FACES, 8): three corners, counter-clockwise; what is across edges 0, 1, 2; state; unused
    queue: int  # ints (MAX_FACES,): heap of faces, the nearest first
    stack: int  # ints (3 MAX_FACES,): edges still to visit


def make_scratch() -> Scratch:
    """Memory for `separation` and `manifold`."""
    floats = 24 + 6 * MAX_CORNERS + 4 * MAX_FACES + 18 * MAX_POLYGON
    return Scratch(floats=np.zeros(floats), ints=np.zeros(12 * MAX_FACES, dtype=np.int64))


@kernel
def room_of(scratch: Scratch) -> Room:
    """Addresses inside the scratch memory; valid for as long as it is."""
    floats, ints = address(scratch.floats), address(scratch.ints)
    points = floats + 8 * 24
    planes = points + 8 * 6 * MAX_CORNERS
    return Room(
        floats,
        points,
        planes,
        planes + 8 * 4 * MAX_FACES,
        ints,
        ints + 8 * 8 * MAX_FACES,
        ints + 8 * 9 * MAX_FACES,
    )
