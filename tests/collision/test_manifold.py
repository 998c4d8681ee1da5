"""Contact manifolds: how many points, where, and how deep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.manifold import SLOP
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Shape, Sphere
from tests.collision.pairs import Pair, height, pose, random_hull, random_turn

TABLE = Box((1.0, 1.0, 0.5))
CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
LYING = Rotation.from_euler("x", 90, degrees=True)
DEPTH = 1e-5


def on_table(shape: Shape, low: float, x: float = 0.1, turn: Rotation | None = None, table: Shape = TABLE) -> Pair:
    """A shape whose lowest point is `low` below its origin, sunk into the table by DEPTH."""
    return Pair(shape, pose((x, 0.2, 0.5 + low - DEPTH), turn), table, pose())


def polygon_area(points: np.ndarray) -> float:
    """Area of the convex hull of points, seen from above."""
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    flat = flat[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))]
    following = np.roll(flat, -1, axis=0)
    return float(0.5 * np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]))


@pytest.mark.parametrize("shape", [Box((0.2, 0.3, 0.1)), Hull(CUBE * (0.2, 0.3, 0.1))], ids=["box", "hull"])
@pytest.mark.parametrize("table", [TABLE, Hull(CUBE * (1.0, 1.0, 0.5))], ids=["box", "hull"])
def test_a_box_stands_on_its_four_corners(shape: Shape, table: Shape) -> None:
    for angle in (0.0, 0.3, 1.0):
        turn = Rotation.from_euler("z", angle)
        pair = on_table(shape, 0.1, turn=turn, table=table)
        for first in (0, 1):
            answer, a, b = pair.contacts(first)
            assert len(a) == 4
            assert np.allclose((a - b) @ answer.n, -DEPTH, atol=1e-12)
            corners = turn.apply([[x, y, -0.1] for x in (-0.2, 0.2) for y in (-0.3, 0.3)]) + pair.poses[0][:3, 3]
            mine = a if first == 0 else b
            assert all(np.min(np.linalg.norm(mine - c, axis=1)) < 1e-9 for c in corners)


def test_a_box_over_the_edge_stands_on_what_is_shared() -> None:
    pair = on_table(Box((0.2, 0.3, 0.1)), 0.1, x=1.05)
    _, a, _ = pair.contacts()
    assert len(a) == 4
    assert polygon_area(a) == pytest.approx(0.15 * 0.6)
    assert a[:, 0].max() == pytest.approx(1.0)


def test_crossed_boxes_share_an_octagon_and_keep_four_of_its_corners() -> None:
    pair = Pair(Box((0.5, 0.5, 0.1)), pose((0, 0, 0.2 - DEPTH), Rotation.from_euler("z", 45, degrees=True)),
                Box((0.5, 0.5, 0.1)), pose())  # fmt: skip
    _, a, _ = pair.contacts()
    assert len(a) == 4
    octagon = 2 * (np.sqrt(2) - 1)
    assert polygon_area(a) > 0.7 * octagon


def test_a_tilted_box_touches_with_what_is_low() -> None:
    for tilt, count in ((1e-6, 4), (0.3, 2)):
        turn = Rotation.from_euler("x", tilt)
        low = 0.1 * np.cos(tilt) + 0.3 * np.sin(tilt)
        answer, a, b = on_table(Box((0.2, 0.3, 0.1)), low, turn=turn).contacts()
        assert len(a) == count
        gaps = (a - b) @ answer.n
        assert gaps.min() == pytest.approx(answer.s, abs=1e-12)
        assert gaps.max() <= answer.s + SLOP


def test_edges_that_cross_and_balls_touch_in_one_point() -> None:
    crossed = Pair(Box((0.1, 0.1, 0.1)), pose((0, 0, np.sqrt(0.08) - DEPTH), Rotation.from_euler("x", 45, degrees=True)),
                   Box((0.1, 0.1, 0.1)), pose(turn=Rotation.from_euler("y", 45, degrees=True)))  # fmt: skip
    assert len(crossed.contacts()[1]) == 1
    for other in (TABLE, Sphere(0.5), Cylinder(0.5, 0.5), Hull(CUBE * 0.5), Capsule(0.5, 0.1)):
        pair = Pair(Sphere(0.1), pose((0.0, 0.0, 0.6)), other, pose())
        answer, a, b = pair.contacts()
        assert len(a) == 1
        assert np.array_equal(a[0], answer.a)
        assert np.array_equal(b[0], answer.b)


@pytest.mark.parametrize("shape", [Capsule(0.1, 0.3), Cylinder(0.1, 0.3)], ids=["capsule", "cylinder"])
def test_what_lies_on_its_side_touches_in_two_points(shape: Shape) -> None:
    for first in (0, 1):
        _, a, b = on_table(shape, 0.1, turn=LYING).contacts(first)
        mine = a if first == 0 else b
        assert sorted(mine[:, 1]) == pytest.approx([-0.1, 0.5])
        assert np.allclose(mine[:, 2], 0.5 - DEPTH)
    _, a, _ = on_table(shape, 0.1, turn=Rotation.from_euler("y", 90, degrees=True), x=0.9).contacts()
    assert sorted(a[:, 0]) == pytest.approx([0.6, 1.0])


@pytest.mark.parametrize("shape", [Capsule(0.1, 0.3), Cylinder(0.1, 0.3)], ids=["capsule", "cylinder"])
def test_what_stands_on_its_end(shape: Shape) -> None:
    low = 0.4 if isinstance(shape, Capsule) else 0.3
    answer, a, b = on_table(shape, low).contacts()
    assert len(a) == (1 if isinstance(shape, Capsule) else 4)
    assert np.allclose((a - b) @ answer.n, -DEPTH, atol=1e-12)
    if isinstance(shape, Cylinder):
        assert np.allclose(np.hypot(a[:, 0] - 0.1, a[:, 1] - 0.2), 0.1)
        assert polygon_area(a) == pytest.approx(2 * 0.1**2)


def test_parallel_capsules_touch_where_they_pass_each_other() -> None:
    a, b = Capsule(0.1, 0.3), Capsule(0.2, 0.3)
    pair = Pair(a, pose((0, 0.1, 0.3 - DEPTH), LYING), b, pose(turn=LYING))
    _, points, _ = pair.contacts()
    assert sorted(points[:, 1]) == pytest.approx([-0.2, 0.3])
    across = Pair(a, pose((0, 0.1, 0.3 - DEPTH), LYING), b, pose(turn=Rotation.from_euler("y", 90, degrees=True)))
    assert len(across.contacts()[1]) == 1


def test_cap_on_cap_touches_inside_both() -> None:
    pair = Pair(Cylinder(0.1, 0.3), pose((0.15, 0, 0.6 - DEPTH)), Cylinder(0.2, 0.3), pose())
    _, a, b = pair.contacts()
    assert len(a) == 4
    assert np.all(np.hypot(a[:, 0] - 0.15, a[:, 1]) <= 0.1 + 1e-12)
    assert np.all(np.hypot(b[:, 0], b[:, 1]) <= 0.2 + 1e-12)


KINDS = [Sphere, Capsule, Box, Cylinder, Hull]


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("second", KINDS)
def test_points_lie_on_both_and_the_deepest_is_as_deep_as_the_pair(first: type, second: type) -> None:
    rng = np.random.default_rng(KINDS.index(first) * 7 + KINDS.index(second))
    make = {
        Sphere: lambda: Sphere(0.2),
        Capsule: lambda: Capsule(0.1, 0.3),
        Box: lambda: Box(tuple(rng.uniform(0.1, 0.4, 3))),
        Cylinder: lambda: Cylinder(0.2, 0.3),
        Hull: lambda: random_hull(rng, 20, rng.uniform(0.1, 0.4, 3)),
    }
    for _ in range(20):
        a, b = make[first](), make[second]()
        turn = random_turn(rng)
        apart = Pair(
            a, pose(rng.normal(size=3) * 3.0, turn if rng.random() < 0.5 else random_turn(rng)), b, pose(turn=turn)
        )
        found = apart.answer()
        depth = rng.choice([1e-6, 1e-4])
        at_b = apart.poses[1].copy()
        at_b[:3, 3] += (found.s + depth) * found.n
        pair = Pair(a, apart.poses[0], b, at_b)
        answer, on_a, on_b = pair.contacts()
        assert 1 <= len(on_a) <= 4
        gaps = (on_a - on_b) @ answer.n
        assert np.allclose(on_a - on_b, gaps[:, None] * answer.n, atol=1e-12)
        assert gaps.min() == pytest.approx(answer.s, abs=1e-6)
        assert gaps.max() <= answer.s + SLOP
        for k, points in ((0, on_a), (1, on_b)):
            assert max(abs(height(pair.shapes[k], pair.local(k, p))) for p in points) < 2e-5
