"""Separations with a formula that fits on a line, and the kernels that have one against distance fields and a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.closed_forms import ball_box, ball_cylinder, segments
from geomphys.scene.pieces import Box, Capsule, Cylinder, Sphere
from tests.collision.pairs import Pair, check_certificate, pose

LYING = Rotation.from_euler("y", 90, degrees=True)


def test_balls() -> None:
    answer = Pair(Sphere(0.3), pose((1.0, 2.0, 3.0)), Sphere(0.2), pose((1.0, 2.0, 2.6))).answer()
    assert answer.s == pytest.approx(-0.1)
    assert np.allclose(answer.n, (0, 0, 1))
    assert np.allclose(answer.a, (1, 2, 2.7))
    assert np.allclose(answer.b, (1, 2, 2.8))


def test_balls_with_one_centre_come_out_somehow() -> None:
    pair = Pair(Sphere(0.3), pose(), Sphere(0.2), pose())
    check_certificate(pair, pair.answer())
    assert pair.answer().s == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("centre", "s", "n"),
    [
        ((0.0, 0.0, 2.5), 0.4, (0, 0, 1)),
        ((0.0, 0.0, 2.05), -0.05, (0, 0, 1)),
        ((0.0, 0.0, 1.9), -0.2, (0, 0, 1)),
        ((0.9, 0.1, 0.3), -0.2, (1, 0, 0)),
        ((1.3, 1.9, 0.0), 0.2, (1, 0, 0)),
        ((1.3, 0.0, 2.4), 0.4, (0.6, 0, 0.8)),
    ],
)
def test_ball_and_box(centre: tuple[float, float, float], s: float, n: tuple[float, float, float]) -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.9])
    pair = Pair(Sphere(0.1), pose(turn.apply(centre), turn), Box((1.0, 2.0, 2.0)), pose(turn=turn))
    answer = pair.answer()
    check_certificate(pair, answer)
    assert answer.s == pytest.approx(s, abs=1e-14)
    assert np.allclose(answer.n, turn.apply(n), atol=1e-14)


@pytest.mark.parametrize(
    ("centre", "s", "n"),
    [
        ((0.0, 0.0, 2.5), 0.4, (0, 0, 1)),
        ((0.0, 0.6, 1.9), -0.2, (0, 0, 1)),
        ((0.0, 0.9, 1.0), -0.2, (0, 1, 0)),
        ((0.0, -1.3, 2.4), 0.4, (0, -0.6, 0.8)),
        ((0.0, 0.0, 0.0), -1.1, None),
    ],
)
def test_ball_and_cylinder(centre: tuple[float, float, float], s: float, n: tuple[float, float, float] | None) -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.9])
    pair = Pair(Sphere(0.1), pose(turn.apply(centre), turn), Cylinder(1.0, 2.0), pose(turn=turn))
    answer = pair.answer()
    check_certificate(pair, answer)
    assert answer.s == pytest.approx(s, abs=1e-14)
    if n is not None:
        assert np.allclose(answer.n, turn.apply(n), atol=1e-14)


def test_capsules_that_cross_part_along_the_normal_of_both() -> None:
    a, b = Capsule(0.1, 1.0), Capsule(0.2, 1.0)
    for gap in (0.5, 0.25, 0.1, 1e-9, 0.0, -0.1):
        pair = Pair(a, pose((0, 0, gap), LYING), b, pose(turn=Rotation.from_euler("x", 90, degrees=True)))
        answer = pair.answer()
        check_certificate(pair, answer)
        assert answer.s == pytest.approx(abs(gap) - 0.3, abs=1e-15)
        assert abs(answer.n[2]) == pytest.approx(1.0)


@pytest.mark.parametrize("shift", [0.0, 0.5, 1.9, 2.5])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-7, 1e-4])
def test_capsules_side_by_side(shift: float, angle: float) -> None:
    a, b = Capsule(0.1, 1.0), Capsule(0.2, 1.0)
    pair = Pair(a, pose((0.0, 0.25, shift), Rotation.from_rotvec([0, angle, 0])), b, pose())
    answer = pair.answer()
    check_certificate(pair, answer)
    beyond = max(shift - 2.0, 0.0)
    assert answer.s == pytest.approx(np.hypot(0.25, beyond) - 0.3, abs=2e-3 * angle + 1e-12)


@pytest.mark.parametrize("tilt", [0.0, 1e-6, 0.01, 0.4, 0.9, 1.4, np.pi / 2])
def test_cylinder_on_a_floor(tilt: float) -> None:
    """Its lowest point lies h cos t + r sin t below the centre."""
    low = 0.3 * np.cos(tilt) + 0.2 * np.sin(tilt)
    floor = Box((5.0, 5.0, 1.0))
    for depth in (1e-5, 0.05):
        pair = Pair(
            Cylinder(0.2, 0.3),
            pose((0.7, -0.3, low - depth), Rotation.from_rotvec([0.0, tilt, 0.0])),
            floor,
            pose((0, 0, -1)),
        )
        answer = pair.answer()
        assert answer.s == pytest.approx(-depth, rel=1e-6)
        assert answer.n[2] == pytest.approx(1.0, abs=1e-6)


def unit_vectors(rng: np.random.Generator, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def box_field(p: np.ndarray, half: np.ndarray) -> float:
    """Signed distance of a point from a box."""
    q = np.abs(p) - half
    return float(np.linalg.norm(np.maximum(q, 0.0)) + min(q.max(), 0.0))


def cylinder_field(p: np.ndarray, radius: float, half_height: float) -> float:
    """Signed distance of a point from a cylinder along z."""
    return box_field(np.array([np.hypot(p[0], p[1]), abs(p[2])]), np.array([radius, half_height]))


def nearest_on_segments(p: np.ndarray, u: np.ndarray, h: float, q: np.ndarray, v: np.ndarray, k: float) -> float:
    """Distance of two segments: of points of the first, each with its nearest on the second, by a finer and finer grid."""

    def from_second(x: np.ndarray) -> np.ndarray:
        at = p + np.multiply.outer(x, u)
        y = np.clip((at - q) @ v, -k, k)
        return np.linalg.norm(at - q - np.multiply.outer(y, v), axis=-1)

    low, high = -h, h  # the distance is convex along the first
    for _ in range(20):
        grid = np.linspace(low, high, 9)
        best = int(np.argmin(from_second(grid)))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, 8)]
    return float(from_second(np.array(0.5 * (low + high))))


def test_segments_against_a_search_along_one_of_them() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(300):
        p, q = rng.normal(size=(2, 3)) * 0.5
        u, v = unit_vectors(rng, 2)
        h, k = rng.uniform(0.1, 1.0, 2) * rng.choice([0.0, 1.0], 2, p=[0.2, 0.8])
        r, s = rng.uniform(0.01, 0.2, 2)
        separation, n, a = segments(tuple(p), tuple(u), h, r, tuple(q), tuple(v), k, s)
        distance = nearest_on_segments(p, u, h, q, v, k)
        assert separation == pytest.approx(distance - r - s, abs=1e-9)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        on_a, on_b = np.array(a) + r * np.array(n), np.array(a) - (separation + s) * np.array(n)
        x, y = (on_a - p) @ u, (on_b - q) @ v
        assert np.allclose(on_a, p + np.clip(x, -h, h) * u, atol=1e-9)
        assert np.allclose(on_b, q + np.clip(y, -k, k) * v, atol=1e-9)
        inside += abs(x) < h - 1e-6 and abs(y) < k - 1e-6
    assert 30 < inside < 250  # lines that are closest within both, and ends


def test_segments_that_overlap_along_one_line_part_across_it() -> None:
    for offset in (0.0, 0.3, 0.9):
        s, n, _ = segments((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5, 0.1, (offset, 0.0, 0.0), (-1.0, 0.0, 0.0), 0.5, 0.2)
        assert s == pytest.approx(-0.3, abs=1e-15)
        assert n[0] == pytest.approx(0.0, abs=1e-15)
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("at", [0.0, 0.2, -0.4])
@pytest.mark.parametrize("ball_first", [False, True])
def test_a_ball_on_the_axis_of_a_capsule_leaves_across_it(at: float, ball_first: bool) -> None:
    ball, capsule = ((at, 0.0, 0.0), (0.0, 0.0, 1.0), 0.0, 0.1), ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.5, 0.2)
    s, n, _ = segments(*ball, *capsule) if ball_first else segments(*capsule, *ball)
    assert s == pytest.approx(-0.3, abs=1e-15)
    assert n[0] == pytest.approx(0.0, abs=1e-15)
    assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-15)


def test_ball_and_box_against_the_distance_field() -> None:
    """The normal is the gradient of the field, and the point of the box is on its surface."""
    rng = np.random.default_rng(6)
    half, r = np.array([0.5, 0.3, 0.2]), 0.05
    for c in rng.uniform(-0.8, 0.8, (300, 3)):
        s, n, a = ball_box(tuple(c), r, tuple(half))
        assert s == pytest.approx(box_field(c, half) - r, abs=1e-14)
        gradient = [(box_field(c + e, half) - box_field(c - e, half)) / 2e-7 for e in 1e-7 * np.eye(3)]
        assert np.allclose(n, gradient, atol=1e-6)
        assert box_field(np.array(a) - s * np.array(n), half) == pytest.approx(0.0, abs=1e-14)
        assert np.linalg.norm(np.array(a) - c) == pytest.approx(r, abs=1e-14)


def test_ball_and_cylinder_against_the_distance_field() -> None:
    rng = np.random.default_rng(7)
    radius, half_height, r = 0.3, 0.5, 0.05
    for c in rng.uniform(-0.8, 0.8, (300, 3)):
        s, n, a = ball_cylinder(tuple(c), r, radius, half_height)
        assert s == pytest.approx(cylinder_field(c, radius, half_height) - r, abs=1e-14)
        steps = 1e-7 * np.eye(3)
        field = [[cylinder_field(c + sign * e, radius, half_height) for sign in (1, -1)] for e in steps]
        assert np.allclose(n, np.subtract(*np.transpose(field)) / 2e-7, atol=1e-6)
        assert cylinder_field(np.array(a) - s * np.array(n), radius, half_height) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("inside", [False, True])
def test_a_centre_in_the_middle_leaves_by_the_nearest_face(inside: bool) -> None:
    """There every direction is as good: the thinnest side of the box, and a direction that is not none."""
    s, n, _ = ball_box((0.0, 0.0, 0.0), 0.1, (0.5, 0.2, 0.4) if inside else (0.2, 0.5, 0.4))
    assert s == pytest.approx(-0.3)
    assert np.flatnonzero(n).tolist() == [1 if inside else 0]
    s, n, _ = ball_cylinder((0.0, 0.0, 0.0), 0.1, 0.2, 0.5)
    assert s == pytest.approx(-0.3)
    assert np.linalg.norm(n) == pytest.approx(1.0)
    assert n[2] == 0.0
