"""The smallest width of a hull, against the difference body: P - P supports a direction as far as P is wide in it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geomphys.scene import hulls
from geomphys.scene.hulls import polytope
from geomphys.scene.tessellation import cylinder_triangles, sphere_triangles


def width_of_difference_body(points: np.ndarray) -> float:
    """The least offset of a face of P - P."""
    corners = points[ConvexHull(points).vertices]
    differences = (corners[:, None] - corners[None]).reshape(-1, 3)
    return float(np.min(-ConvexHull(differences).equations[:, 3]))


def cloud(random: np.random.Generator, kind: str) -> np.ndarray:
    """Points of a kind of hull."""
    points = random.normal(size=(int(random.choice([4, 5, 7, 12, 40])), 3))
    if kind == "ball":
        return points / np.linalg.norm(points, axis=1, keepdims=True)
    if kind == "flat":
        return points * [1.0, 0.4, 0.03]
    if kind == "needle":
        return points * [1.0, 0.04, 0.03]
    if kind == "grid":
        return np.concatenate([np.round(2 * points) / 2, np.eye(3), -np.eye(3)])
    if kind == "prism":
        rim = points[:, :2] / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        return np.concatenate([np.column_stack([rim, np.full(len(rim), z)]) for z in (0.0, random.uniform(0.1, 3.0))])
    return points


@pytest.mark.parametrize("many", [0, hulls.MAX_EDGES_ALL_PAIRS], ids=["some pairs", "all pairs"])
@pytest.mark.parametrize("kind", ["normal", "ball", "flat", "needle", "grid", "prism"])
def test_the_width_is_that_of_the_difference_body(kind: str, many: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hulls, "MAX_EDGES_ALL_PAIRS", many)
    random = np.random.default_rng(7)
    for _ in range(40):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        points = cloud(random, kind) @ turn.T * random.uniform(0.01, 1.0)
        assert polytope(points).thickness == pytest.approx(width_of_difference_body(points), rel=1e-9)


def test_a_regular_tetrahedron_is_thinnest_between_two_edges() -> None:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    assert polytope(corners).thickness == pytest.approx(2.0)  # its heights are 4 / sqrt(3)


def test_round_hulls_of_many_corners() -> None:
    ball = polytope(sphere_triangles(0.1, 64)[0])  # its narrowest: through the flats of 64 meridians and 32 circles
    assert ball.thickness == pytest.approx(0.2, rel=3e-3)
    assert polytope(cylinder_triangles(0.1, 0.5, 200)[0]).thickness == pytest.approx(0.2 * np.cos(np.pi / 200))


def test_bounds_from_few_corners_leave_the_width_exact(monkeypatch: pytest.MonkeyPatch) -> None:
    points = (
        sphere_triangles(0.1, 24)[0] * [1.0, 0.7, 0.6] @ np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    )
    exact = polytope(points).thickness
    monkeypatch.setattr(hulls, "MAX_EDGES_ALL_PAIRS", 0)
    for count in (4, 30, 100):
        monkeypatch.setattr(hulls, "farthest_in_cells", lambda vertices, count=count: np.arange(count))
        assert polytope(points).thickness == exact
