"""Pairs of shapes at poses, what the narrow phase says of them, and what numpy says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from geomphys.collision.manifold import manifold
from geomphys.collision.penetration import make_scratch, separation
from geomphys.collision.support import Shapes
from geomphys.jit.packed_records import pack
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces

Array = NDArray[np.float64]
SCRATCH = pack(make_scratch())


class Answer(NamedTuple):
    s: float
    n: Array
    a: Array
    b: Array


def pose(position: Array | tuple[float, float, float] = (0, 0, 0), turn: Rotation | None = None) -> Array:
    """Pose (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if turn is not None:
        matrix[:3, :3] = turn.as_matrix()
    return matrix


class Pair:
    """Two shapes at poses (4, 4)."""

    def __init__(self, a: Shape, at_a: Array, b: Shape, at_b: Array) -> None:
        self.shapes, self.poses = (a, b), (at_a, at_b)
        self.pieces = build_pieces([PosedShape(a, np.eye(4), 0), PosedShape(b, np.eye(4), 1)])
        self.packed = pack(self.pieces)
        self.frames = np.array([[*t[:3, :3].reshape(9), *t[:3, 3]] for t in (at_a, at_b)])
        self.size = float(self.pieces.reach.sum() + np.linalg.norm(at_a[:3, 3] - at_b[:3, 3]))

    def answer(
        self, first: int = 0, limit: float = np.inf, axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Answer:
        """What `separation` says of the pair, or of the pair the other way round (`first` = 1)."""
        s, n, a, b = separation(self.packed, self.frames, first, 1 - first, limit, axis, SCRATCH)
        return Answer(s, np.array(n), np.array(a), np.array(b))

    def contacts(self, first: int = 0) -> tuple[Answer, Array, Array]:
        """The answer and the points of the manifold on both."""
        answer = self.answer(first)
        a, b = np.zeros((4, 3)), np.zeros((4, 3))
        n, pa, pb = (tuple(map(float, v)) for v in answer[1:])
        args = (Shapes(self.packed, self.frames), first, 1 - first, (answer.s, n, pa, pb), a, b, SCRATCH)
        count = manifold(*args)  # type: ignore[arg-type]
        return answer, a[:count], b[:count]

    def overlap(self, n: Array) -> Array:
        """How far A must move along unit directions n (..., 3) to be clear of B; every one bounds the depth."""
        return self.support(1, n) + self.support(0, -n)

    def support(self, k: int, n: Array) -> Array:
        """Largest n·x over shape k in the world."""
        d = n @ self.poses[k][:3, :3]
        return extent(self.shapes[k], d) + n @ self.poses[k][:3, 3]

    def local(self, k: int, point: Array) -> Array:
        return (point - self.poses[k][:3, 3]) @ self.poses[k][:3, :3]

    def corners(self, k: int) -> Array:
        """Corners of a box or hull in the world."""
        p = self.pieces
        return p.vertices[p.vertex_start[k] : p.vertex_start[k + 1]] @ self.poses[k][:3, :3].T + self.poses[k][:3, 3]


def extent(shape: Shape, d: Array) -> Array:
    """Largest d·x over a shape in its frame, for unit directions (..., 3)."""
    if isinstance(shape, Sphere):
        return np.full(d.shape[:-1], shape.radius)
    if isinstance(shape, Capsule):
        return shape.radius + shape.half_height * np.abs(d[..., 2])
    if isinstance(shape, Cylinder):
        return shape.radius * np.hypot(d[..., 0], d[..., 1]) + shape.half_height * np.abs(d[..., 2])
    if isinstance(shape, Box):
        return np.abs(d) @ np.array(shape.half_extents)
    result: Array = np.max(d @ shape.vertices.T, axis=-1)
    return result


def height(shape: Shape, x: Array) -> float:
    """How far a point of the shape's frame is outside of its surface: below 0 inside, 0 on it."""
    if isinstance(shape, Sphere):
        return float(np.linalg.norm(x) - shape.radius)
    if isinstance(shape, Capsule):
        foot = np.array([0.0, 0.0, np.clip(x[2], -shape.half_height, shape.half_height)])
        return float(np.linalg.norm(x - foot) - shape.radius)
    if isinstance(shape, Cylinder):
        return float(max(np.hypot(x[0], x[1]) - shape.radius, abs(x[2]) - shape.half_height))
    if isinstance(shape, Box):
        return float(np.max(np.abs(x) - shape.half_extents))
    planes = ConvexHull(shape.vertices).equations
    return float(np.max(planes[:, :3] @ x + planes[:, 3]))


def minkowski_depth(pair: Pair) -> float:
    """Depth of two polytopes by the convex hull of all differences of their corners; below 0 if they are apart."""
    differences = (pair.corners(0)[:, None] - pair.corners(1)[None]).reshape(-1, 3)
    return float(-np.max(ConvexHull(differences).equations[:, 3]))


def sphere_points(count: int) -> Array:
    """Unit directions, evenly spread."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)


FAN = sphere_points(2000)


def searched_depth(pair: Pair, starts: int = 8) -> float:
    """Smallest overlap over all directions: a fan of them, the best of which walk downhill in ever shorter steps."""
    values = pair.overlap(FAN)
    best = FAN[np.argsort(values)[:starts]]
    depth = np.sort(values)[:starts]
    step = np.full(starts, 0.05)
    angle = np.arange(8) * np.pi / 4
    for _ in range(2000):  # along the valley between two faces the way down is endless and gains nothing
        if np.all(step <= 1e-8):
            break
        u = np.cross(best, np.where(np.abs(best[:, :1]) < 0.7, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        v = np.cross(best, u)
        ring = np.cos(angle)[None, :, None] * u[:, None] + np.sin(angle)[None, :, None] * v[:, None]
        trial = best[:, None] + step[:, None, None] * ring
        trial /= np.linalg.norm(trial, axis=2, keepdims=True)
        values = pair.overlap(trial)
        k = np.argmin(values, axis=1)
        found = values[np.arange(starts), k]
        better = found < depth * (1 - 1e-13)  # steps on rounding alone would never end
        depth = np.where(better, found, depth)
        best = np.where(better[:, None], trial[np.arange(starts), k], best)
        step = np.where(better, step * 1.5, step * 0.5)
    return float(depth.min())


def check_certificate(pair: Pair, answer: Answer, *, on_surface: float = 1e-9) -> None:
    """What holds for every answer, whoever gave it: extents along the normal, and the two points.

    An overlap is as deep as the normal says; a distance is no longer than the gap between the extents.
    """
    rounding = 1e-14 * pair.size
    assert abs(np.linalg.norm(answer.n) - 1.0) < 1e-12
    gap = -float(pair.overlap(answer.n))
    if answer.s <= 0.0:
        assert abs(gap - answer.s) < rounding
    else:
        assert gap >= answer.s - rounding
    assert np.linalg.norm(answer.a - answer.b - answer.s * answer.n) < 1e-12 * pair.size
    assert abs(height(pair.shapes[0], pair.local(0, answer.a))) < on_surface * pair.size
    assert abs(height(pair.shapes[1], pair.local(1, answer.b))) < on_surface * pair.size


def random_hull(rng: np.random.Generator, count: int, scale: Array | float = 1.0) -> Hull:
    points = rng.normal(size=(count, 3))
    return Hull(points / np.linalg.norm(points, axis=1, keepdims=True) * scale)


def random_turn(rng: np.random.Generator) -> Rotation:
    return Rotation.from_quat(rng.normal(size=4))
