"""Separations with a formula that fits on a line."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
