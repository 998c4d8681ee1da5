"""How far a convex piece reaches along a direction: the support function, exact for every kind of piece."""

from __future__ import annotations

from geomphys.collision.support import Shapes, core_of, position_of, radius_of, rotation_of, support
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, dot, neg, rotate_back
from geomphys.scene.arrays import SPHERE


@kernel
def local_extent(shapes: Shapes, piece: int, d: Vec) -> float:
    """Largest d·x over the points x of a piece in its own frame [m]; d is a unit vector."""
    return dot(d, support(core_of(shapes, piece), d)) + radius_of(shapes, piece)


@kernel
def extent(shapes: Shapes, piece: int, n: Vec) -> float:
    """Largest n·x over the points x of a piece where its frame puts it [m]; n is a unit vector, world frame."""
    at = dot(n, position_of(shapes, piece))
    if shapes.pieces.kind[piece] == SPHERE:
        return at + radius_of(shapes, piece)
    return at + local_extent(shapes, piece, rotate_back(rotation_of(shapes, piece), n))


@kernel
def gap_along(shapes: Shapes, a: int, b: int, n: Vec) -> float:
    """How far apart two pieces are along a direction [m]: never more than their distance; `n` is unit, out of b into a."""
    return -extent(shapes, a, neg(n)) - extent(shapes, b, n)
