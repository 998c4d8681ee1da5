"""Convex shapes, and their conversion to the flat arrays of the collision kernels.

Shapes are defined in their own frame: spheres, boxes, capsules and cylinders are centred at the origin, the last two
along z. Vertices, edges, faces, interior point and smallest width of a hull are computed once.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Floats, Ints, Pieces
from geomphys.scene.direction_cells import CELLS, farthest_in_cells
from geomphys.scene.hulls import Polytope, polytope


def _require_positive(shape_name: str, **lengths: float) -> None:
    for name, value in lengths.items():
        if not (math.isfinite(value) and value > 0.0):
            raise MeshError(f"{shape_name}: {name} = {value} is not a length above zero")


HILL_CLIMB_MIN_VERTICES = 24
"""Support points of hulls with more vertices are found by hill climbing, of smaller ones by linear search (measured)."""


class Row(NamedTuple):
    """Entries of one piece in the arrays."""

    kind: int
    size: tuple[float, float, float]
    centre: tuple[float, float, float]
    reach: float
    thickness: float
    polytope: Polytope
    cells: Ints | None = None


def _box_polytope() -> Polytope:
    """The cube from -1 to 1: corner i has +1 in x, y, z where bit 0, 1, 2 of i is set."""
    corners = np.array([[1.0 if i >> k & 1 else -1.0 for k in range(3)] for i in range(8)])
    neighbours = np.array([i ^ 1 << k for i in range(8) for k in range(3)])
    planes, loops = np.zeros((6, 4)), []
    for k in range(3):
        u, v = 1 << (k + 1) % 3, 1 << (k + 2) % 3
        for side in (0, 1):
            planes[2 * k + side, k] = 1.0 if side else -1.0
            around = [0, u, u | v, v] if side else [0, v, u | v, u]
            loops.append([c | side << k for c in around])
    planes[:, 3] = 1.0
    return Polytope(
        vertices=corners,
        neighbour_count=np.full(8, 3),
        neighbours=neighbours,
        planes=planes,
        loop_count=np.full(6, 4),
        loops=np.array(loops).reshape(-1),
        centre=np.zeros(3),
        thickness=2.0,
    )


_UNIT_CUBE = _box_polytope()
_NO_POLYTOPE = Polytope(
    vertices=np.zeros((0, 3)),
    neighbour_count=np.zeros(0, dtype=np.int64),
    neighbours=np.zeros(0, dtype=np.int64),
    planes=np.zeros((0, 4)),
    loop_count=np.zeros(0, dtype=np.int64),
    loops=np.zeros(0, dtype=np.int64),
    centre=np.zeros(3),
    thickness=0.0,
)
_ORIGIN = (0.0, 0.0, 0.0)


class Shape(ABC):
    """A convex shape in its own frame."""

    @abstractmethod
    def row(self) -> Row:
        """Its entries in the arrays."""


@dataclass(frozen=True)
class Sphere(Shape):
    """A ball about the origin; `radius` > 0 in m."""

    radius: float

    def __post_init__(self) -> None:
        """Raise MeshError if the radius is not a length above zero."""
        _require_positive("sphere", radius=self.radius)

    def row(self) -> Row:
        """Its entries in the arrays."""
        r = float(self.radius)
        return Row(SPHERE, (r, 0.0, 0.0), _ORIGIN, r, 2.0 * r, _NO_POLYTOPE)


@dataclass(frozen=True)
class Capsule(Shape):
    """All points within `radius` of the segment from -half_height to +half_height along z [m]; half_height may be 0."""

    radius: float
    half_height: float

    def __post_init__(self) -> None:
        """Raise MeshError if a length is out of its range."""
        _require_positive("capsule", radius=self.radius)
        if self.half_height != 0.0:
            _require_positive("capsule", half_height=self.half_height)

    def row(self) -> Row:
        """Its entries in the arrays."""
        r, h = float(self.radius), float(self.half_height)
        return Row(CAPSULE, (r, h, 0.0), _ORIGIN, r + h, 2.0 * r, _NO_POLYTOPE)


@dataclass(frozen=True)
class Box(Shape):
    """A box about the origin with half edge lengths `half_extents` [m] along x, y, z."""

    half_extents: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Raise MeshError if a length is out of its range."""
        x, y, z = self.half_extents
        _require_positive("box", x=x, y=y, z=z)

    def row(self) -> Row:
        """Its entries in the arrays."""
        x, y, z = (float(v) for v in self.half_extents)
        half = np.array((x, y, z))
        planes = _UNIT_CUBE.planes.copy()
        planes[:, 3] = np.repeat(half, 2)
        solid = _UNIT_CUBE._replace(vertices=_UNIT_CUBE.vertices * half, planes=planes)
        return Row(BOX, (x, y, z), _ORIGIN, math.sqrt(x * x + y * y + z * z), 2.0 * min(x, y, z), solid)


@dataclass(frozen=True)
class Cylinder(Shape):
    """A solid cylinder about the origin along z: `radius` and `half_height` in m."""

    radius: float
    half_height: float

    def __post_init__(self) -> None:
        """Raise MeshError if a length is out of its range."""
        _require_positive("cylinder", radius=self.radius, half_height=self.half_height)

    def row(self) -> Row:
        """Its entries in the arrays."""
        r, h = float(self.radius), float(self.half_height)
        return Row(CYLINDER, (r, h, 0.0), _ORIGIN, math.hypot(r, h), 2.0 * min(r, h), _NO_POLYTOPE)


@dataclass(frozen=True, eq=False)
class Hull(Shape):
    """The convex hull of points (n, 3) in m; interior points are allowed."""

    vertices: NDArray[np.float64]

    @cached_property
    def polytope(self) -> Polytope:
        """Its vertices, edges and faces; MeshError if it is flat."""
        return polytope(np.ascontiguousarray(self.vertices, dtype=np.float64))

    def row(self) -> Row:
        """Its entries in the arrays."""
        solid = self.polytope
        reach = float(np.max(np.linalg.norm(solid.vertices - solid.centre, axis=1)))
        centre = (float(solid.centre[0]), float(solid.centre[1]), float(solid.centre[2]))
        large = len(solid.vertices) > HILL_CLIMB_MIN_VERTICES
        cells = farthest_in_cells(solid.vertices - solid.centre) if large else None
        x, y, z = (0.5 * np.ptp(solid.vertices, axis=0)).tolist()
        return Row(HULL, (x, y, z), centre, reach, solid.thickness, solid, cells)


@dataclass(frozen=True, eq=False)
class PosedShape:
    """A shape as a piece of a body: `local` (4, 4) is body_from_piece, `body` the body's index."""

    shape: Shape
    local: NDArray[np.float64]
    body: int


def _start_offsets(counts: Sequence[int] | Ints) -> Ints:
    return np.concatenate(([0], np.cumsum(np.asarray(counts, dtype=np.int64)))).astype(np.int64)


def _stacked(parts: Sequence[NDArray[np.float64]], columns: int) -> Floats:
    return np.ascontiguousarray(np.concatenate([np.zeros((0, columns)), *parts]), dtype=np.float64)


def _joined(parts: Sequence[NDArray[np.int64]]) -> Ints:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts]).astype(np.int64)


def build_pieces(shapes: Sequence[PosedShape]) -> Pieces:
    """Arrays of the pieces, in the order given.

    Hulls of the same points are computed once. The neighbours of a hull's vertex are those of a triangulation of its
    surface, so hill climbing ends at the support point in any direction; coplanar triangles form one face.

    Raises
    ------
    MeshError
        For a hull that is flat, has fewer than four corners or holds NaN; for lengths that are not above zero.
    """
    hulls: dict[bytes, Row] = {}
    rows = []
    for posed in shapes:
        key = np.asarray(posed.shape.vertices, dtype=np.float64).tobytes() if isinstance(posed.shape, Hull) else b""
        row = hulls.get(key) or posed.shape.row()
        if key:
            hulls[key] = row
        rows.append(row)
    solids = [r.polytope for r in rows]
    has_cells = np.array([r.cells is not None for r in rows], dtype=bool)
    local = np.empty((len(shapes), 12))
    for k, p in enumerate(shapes):
        local[k, :9] = p.local[:3, :3].reshape(9)
        local[k, 9:] = p.local[:3, 3]
    centre = np.array([r.centre for r in rows], dtype=np.float64).reshape(-1, 3)
    return Pieces(
        kind=np.array([r.kind for r in rows], dtype=np.int64),
        size=np.array([r.size for r in rows], dtype=np.float64).reshape(-1, 3),
        body=np.array([p.body for p in shapes], dtype=np.int64),
        local=local,
        centre=centre,
        body_centre=np.einsum("pij,pj->pi", local[:, :9].reshape(-1, 3, 3), centre) + local[:, 9:],
        reach=np.array([r.reach for r in rows], dtype=np.float64),
        thickness=np.array([r.thickness for r in rows], dtype=np.float64),
        vertex_start=_start_offsets([len(s.vertices) for s in solids]),
        vertices=_stacked([s.vertices for s in solids], 3),
        neighbour_start=_start_offsets(_joined([s.neighbour_count for s in solids])).astype(np.int32),
        neighbours=_joined([s.neighbours for s in solids]).astype(np.int32),
        cell_start=np.where(has_cells, CELLS * (np.cumsum(has_cells) - 1), -1).astype(np.int64),
        cells=_joined([r.cells for r in rows if r.cells is not None]).astype(np.int32),
        face_start=_start_offsets([len(s.planes) for s in solids]),
        planes=_stacked([s.planes for s in solids], 4),
        loop_start=_start_offsets(_joined([s.loop_count for s in solids])),
        loops=_joined([s.loops for s in solids]),
    )
