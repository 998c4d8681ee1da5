"""Farthest points, and where pieces stand in the world."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.support import core_of, pose_pieces, shapes_of, support
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import Floats, Pieces
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces
from tests.collision.pairs import extent, pose, random_hull

RNG = np.random.default_rng(3)
RING = np.arange(300) * 2 * np.pi / 300
SHAPES: list[Shape] = [
    Box((0.1, 0.2, 0.3)),
    Cylinder(0.2, 0.4),
    random_hull(RNG, 12),
    random_hull(RNG, 250),
    Hull(np.array([[np.cos(t), np.sin(t), z] for t in RING for z in (0.0, 0.1)])),
    Hull(np.stack(np.meshgrid(*[np.linspace(0, 1, 6)] * 3), axis=-1).reshape(-1, 3)),
    random_hull(RNG, 400, np.array([1.0, 1.0, 1e-5])),
]


@kernel
def supports(pieces: Pieces, frames: Floats, directions: Floats, points: Floats) -> None:
    """Farthest points of piece 0."""
    core = core_of(shapes_of(pieces, frames), 0)
    for k in range(len(directions)):
        point = support(core, (directions[k, 0], directions[k, 1], directions[k, 2]))
        for i in range(3):
            points[k, i] = point[i]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_no_point_lies_farther(shape: Shape) -> None:
    pieces = build_pieces([PosedShape(shape, np.eye(4), 0)])
    directions = np.random.default_rng(0).normal(size=(2000, 3))
    directions = np.vstack([directions, np.eye(3), -np.eye(3), pieces.planes[:, :3]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.zeros_like(directions)
    supports(pack(pieces), np.zeros((1, 12)), directions, points)
    reached = np.einsum("ij,ij->i", directions, points)
    assert np.allclose(reached, extent(shape, directions), rtol=0, atol=1e-14)


def test_balls_and_capsules_are_seen_as_their_cores() -> None:
    directions = np.array([[0.6, 0.0, 0.8], [0.6, 0.0, -0.8]])
    points = np.zeros((2, 3))
    supports(build_pieces([PosedShape(Sphere(2.0), np.eye(4), 0)]), np.zeros((1, 12)), directions, points)
    assert np.array_equal(points, np.zeros((2, 3)))
    supports(build_pieces([PosedShape(Capsule(2.0, 3.0), np.eye(4), 0)]), np.zeros((1, 12)), directions, points)
    assert np.array_equal(points, [[0, 0, 3], [0, 0, -3]])


def test_pieces_stand_where_their_bodies_put_them() -> None:
    rng = np.random.default_rng(1)
    locals_ = [pose(rng.normal(size=3), Rotation.from_quat(rng.normal(size=4))) for _ in range(4)]
    pieces = build_pieces([PosedShape(Sphere(1.0), t, k // 2) for k, t in enumerate(locals_)])
    turns = [Rotation.from_quat(rng.normal(size=4)) for _ in range(2)]
    places = rng.normal(size=(2, 3))
    poses = np.hstack([places, [r.as_quat() for r in turns]])
    frames = np.zeros((4, 12))
    pose_pieces(pieces, poses, frames)
    for k, local in enumerate(locals_):
        expected = pose(places[k // 2], turns[k // 2]) @ local
        assert np.allclose(frames[k], [*expected[:3, :3].reshape(9), *expected[:3, 3]], rtol=0, atol=1e-15)
