"""Distance and penetration of two shapes: the narrow phase for use alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.manifold import manifold
from geomphys.collision.penetration import Scratch, Separation, make_scratch, separation
from geomphys.collision.support import Shapes, core_of, radius_of, shapes_of, support
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import pack
from geomphys.numerics.row_vectors import set_vec_at, vec_at
from geomphys.numerics.vec3 import add_scaled
from geomphys.scene.arrays import Floats, Pieces
from geomphys.scene.pieces import PosedShape, Shape, build_pieces


class PairSeparation(NamedTuple):
    """Separation of two shapes, world frame."""

    separation: float  # m; above 0 the distance, below 0 minus the penetration depth
    normal: Floats  # (3,) unit, out of b into a: moving a by -separation * normal makes an overlap a touch
    point_a: Floats  # (3,) m, on a; point_a - point_b = separation * normal
    point_b: Floats  # (3,) m, on b
    contacts_a: Floats  # (k, 3) m, points of a's side of the contact manifold, k = 1 to 4
    contacts_b: Floats  # (k, 3) m, points of b's side, behind them along the normal


@kernel
def _measure(pieces: Pieces, frames: Floats, scratch: Scratch, on_a: Floats, on_b: Floats) -> tuple[Separation, int]:
    """Separation of the first two pieces, and how many contact points were written to `on_a` and `on_b` (4, 3)."""
    found = separation(pieces, frames, 0, 1, np.inf, (0.0, 0.0, 0.0), scratch)
    return found, manifold(Shapes(pieces, frames), 0, 1, found, on_a, on_b, scratch)


@kernel
def _reach_out(pieces: Pieces, frames: Floats, piece: int, directions: Floats, out: Floats) -> None:
    """The farthest points of a piece in `directions` (n, 3), to the rows of `out`."""
    shapes = shapes_of(pieces, frames)
    core, radius = core_of(shapes, piece), radius_of(shapes, piece)
    for k in range(len(directions)):
        d = vec_at(directions, k)
        set_vec_at(out, k, add_scaled(support(core, d), d, radius))


def outline(pieces: Pieces, piece: int, count: int = 600) -> Floats:
    """Points (n, 3) of a piece's surface [m], piece frame: the farthest in `count` directions (spherical Fibonacci)."""
    k = np.arange(count) + 0.5
    z, angle = 1.0 - 2.0 * k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    around = np.sqrt(1.0 - z * z)
    directions = np.stack([around * np.cos(angle), around * np.sin(angle), z], axis=1)
    points = np.zeros((count, 3))
    _reach_out(pack(pieces), np.zeros((len(pieces.kind), 12)), piece, directions, points)
    return np.unique(points, axis=0)


def query(
    shape_a: Shape, world_from_a: NDArray[np.float64], shape_b: Shape, world_from_b: NDArray[np.float64]
) -> PairSeparation:
    """Signed separation and contact manifold of two shapes at poses (4, 4).

    The separation is exact: the shortest translation that separates two overlapping shapes is -separation * normal, to a
    relative 1e-9 between boxes and hulls, 1e-6 where a cylinder takes part, and to rounding where a formula is known.

    Raises
    ------
    MeshError
        For a hull without volume.
    """
    pieces = build_pieces([PosedShape(shape_a, np.eye(4), 0), PosedShape(shape_b, np.eye(4), 1)])
    frames = np.empty((2, 12))
    for row, pose in zip(frames, (world_from_a, world_from_b), strict=True):
        row[:9] = np.asarray(pose, dtype=np.float64)[:3, :3].reshape(9)
        row[9:] = np.asarray(pose, dtype=np.float64)[:3, 3]
    on_a, on_b = np.zeros((4, 3)), np.zeros((4, 3))
    (s, n, pa, pb), count = _measure(pack(pieces), frames, pack(make_scratch()), on_a, on_b)
    return PairSeparation(s, np.array(n), np.array(pa), np.array(pb), on_a[:count], on_b[:count])
