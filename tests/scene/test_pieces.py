"""Arrays of convex pieces: corners, edges, faces, inner points, smallest widths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from geomphys.errors import MeshError
from geomphys.scene.arrays import BOX, CAPSULE, CYLINDER, HULL, SPHERE, Pieces
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
TETRAHEDRON = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
TURN = Rotation.from_rotvec([0.4, -0.7, 1.1])
GRID = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 6)] * 3), axis=-1).reshape(-1, 3)


def alone(shape: Shape) -> Pieces:
    return build_pieces([PosedShape(shape, np.eye(4), 0)])


def ball(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def widths(points: np.ndarray, count: int = 100_000) -> np.ndarray:
    """Extents of points along random directions."""
    return np.ptp(points @ ball(count, 1).T, axis=0)


SOLIDS = {
    "box": Box((0.1, 0.2, 0.3)),
    "cube": Hull(CUBE),
    "tetrahedron": Hull(TETRAHEDRON),
    "ball of 300": Hull(ball(300)),
    "grid": Hull(TURN.apply(GRID)),
    "plate": Hull(TURN.apply(CUBE * (1.0, 1.0, 1e-4))),
    "needle of 10 m": Hull(TURN.apply(CUBE * (5.0, 1e-3, 1e-3)) + 7.0),
    "1 mm": Hull(TURN.apply(CUBE * 5e-4) + 3.0),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_faces_close_around_the_solid(name: str) -> None:
    """Loops turn counter-clockwise in their planes, each edge is walked once each way, and V - E + F = 2."""
    p = alone(SOLIDS[name])
    size = np.ptp(p.vertices, axis=0).max()
    walked, used = set(), set()
    for f in range(len(p.planes)):
        loop = p.loops[p.loop_start[f] : p.loop_start[f + 1]]
        n, corners = p.planes[f, :3], p.vertices[loop] - p.centre[0]
        assert np.max(p.vertices @ n) <= p.planes[f, 3] + 1e-15
        assert np.min(p.vertices[loop] @ n) >= p.planes[f, 3] - 5e-6 * size
        area = np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0)
        assert area @ n > 0.99 * np.linalg.norm(area)
        for u, v in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True):
            assert (u, v) not in walked
            walked.add((u, v))
        used.update(loop.tolist())
    assert walked == {(v, u) for u, v in walked}
    assert len(used) - len(walked) // 2 + len(p.planes) == 2


@pytest.mark.parametrize("name", SOLIDS)
def test_neighbours_are_mutual_and_hold_the_edges_of_all_faces(name: str) -> None:
    p = alone(SOLIDS[name])
    joined = {
        (i, int(j))
        for i in range(len(p.vertices))
        for j in p.neighbours[p.neighbour_start[i] : p.neighbour_start[i + 1]]
    }
    assert len(joined) == len(p.neighbours)
    assert joined == {(j, i) for i, j in joined}
    for f in range(len(p.planes)):
        loop = p.loops[p.loop_start[f] : p.loop_start[f + 1]].tolist()
        assert all((u, v) in joined for u, v in zip(loop, loop[1:] + loop[:1], strict=True))


def test_coplanar_triangles_are_one_face() -> None:
    assert len(alone(Hull(TURN.apply(GRID))).planes) == 6
    assert len(alone(Hull(TURN.apply(GRID))).vertices) == 8
    single = TURN.apply(CUBE * (0.3, 0.2, 0.1)).astype(np.float32).astype(float)
    assert len(alone(Hull(single)).planes) == 6
    ring = np.arange(32) * np.pi / 16
    prism = alone(Hull(TURN.apply([[np.cos(t), np.sin(t), z] for t in ring for z in (0.0, 1.0)])))
    assert sorted(np.diff(prism.loop_start)) == [4] * 32 + [32] * 2


def test_faces_that_are_no_plane_stay_apart() -> None:
    """Facets of a fine tessellation are not merged: their planes are what they were."""
    p = alone(Hull(ball(1000)))
    assert len(p.planes) > 1950
    assert len(alone(Hull(CUBE * (1.0, 1.0, 1e-6))).planes) == 6


@pytest.mark.parametrize(
    ("shape", "thickness"),
    [
        (Sphere(0.3), 0.6),
        (Capsule(0.3, 1.0), 0.6),
        (Cylinder(0.3, 0.1), 0.2),
        (Cylinder(0.3, 1.0), 0.6),
        (Box((0.3, 0.2, 0.1)), 0.2),
        (Hull(TURN.apply(CUBE * (0.3, 0.2, 0.1))), 0.2),
        (Hull(TURN.apply(CUBE * (0.3, 0.2, 1e-5))), 2e-5),
        (Hull(TURN.apply(TETRAHEDRON)), 2.0),  # between opposite edges, not at a face
        (Hull(TURN.apply(np.vstack([np.eye(3), -np.eye(3)]))), 2 / np.sqrt(3)),
    ],
)
def test_thickness_in_closed_form(shape: Shape, thickness: float) -> None:
    assert alone(shape).thickness[0] == pytest.approx(thickness, rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_thickness_is_the_smallest_of_all_widths(seed: int) -> None:
    points = ball(12, seed) * np.random.default_rng(seed).uniform(0.2, 1.0, 3)
    thickness = float(alone(Hull(points)).thickness[0])
    found = widths(points).min()
    assert thickness <= found <= 1.02 * thickness


def test_inner_point_and_reach() -> None:
    points = TURN.apply(CUBE * (0.3, 0.2, 0.1)) + np.array([1.0, 2.0, 3.0])
    p = alone(Hull(points))
    assert np.allclose(p.centre[0], (1, 2, 3), atol=1e-14)
    assert p.reach[0] == pytest.approx(np.linalg.norm((0.3, 0.2, 0.1)))
    cut = points[:7]
    hull = ConvexHull(cut)
    inner = cut[hull.simplices].mean(axis=1) - cut.mean(axis=0)
    volumes = np.abs(np.linalg.det(cut[hull.simplices] - cut.mean(axis=0)))
    centroid = cut.mean(axis=0) + 0.75 * (volumes[:, None] * inner).sum(axis=0) / volumes.sum()
    assert np.allclose(alone(Hull(cut)).centre[0], centroid, atol=1e-13)
    assert alone(Capsule(0.1, 0.4)).reach[0] == 0.5
    assert alone(Cylinder(0.3, 0.4)).reach[0] == 0.5


def test_layout_of_many() -> None:
    local = np.eye(4)
    local[:3, 3] = (1, 2, 3)
    local[:3, :3] = TURN.as_matrix()
    shapes = [Sphere(0.1), Capsule(0.2, 0.3), Box((1, 2, 3)), Cylinder(0.4, 0.5), Hull(TETRAHEDRON), Hull(TETRAHEDRON)]
    p = build_pieces([PosedShape(s, local, k // 2) for k, s in enumerate(shapes)])
    assert p.kind.tolist() == [SPHERE, CAPSULE, BOX, CYLINDER, HULL, HULL]
    assert p.body.tolist() == [0, 0, 1, 1, 2, 2]
    assert p.size.tolist() == [[0.1, 0, 0], [0.2, 0.3, 0], [1, 2, 3], [0.4, 0.5, 0], [1, 1, 1], [1, 1, 1]]
    assert p.vertex_start.tolist() == [0, 0, 0, 8, 8, 12, 16]
    assert p.face_start.tolist() == [0, 0, 0, 6, 6, 10, 14]
    assert np.array_equal(p.vertices[8:12], p.vertices[12:16])
    assert np.array_equal(p.local[3], [*TURN.as_matrix().reshape(9), 1, 2, 3])
    for array in p:
        assert array.flags.c_contiguous
        assert array.dtype in (np.float64, np.int64, np.int32)
    empty = build_pieces([])
    assert empty.vertices.shape == (0, 3)
    assert empty.vertex_start.tolist() == [0]


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (CUBE * (1.0, 1.0, 0.0), "flat"),
        (TURN.apply(CUBE * (1.0, 1.0, 1e-12)), "flat"),
        (np.zeros((5, 3)), "one point"),
        (CUBE[:3], "at least four"),
        (CUBE * [1.0, np.nan, 1.0], "NaN"),
    ],
)
def test_hulls_without_volume_are_refused(points: np.ndarray, says: str) -> None:
    with pytest.raises(MeshError, match=says):
        alone(Hull(points))


def test_lengths_are_checked() -> None:
    for make in (
        lambda: Sphere(0.0),
        lambda: Capsule(0.1, -1.0),
        lambda: Cylinder(0.1, 0.0),
        lambda: Box((1, 1, np.nan)),
    ):
        with pytest.raises(MeshError, match="length above zero"):
            make()
