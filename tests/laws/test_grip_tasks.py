"""Every grip holds every thing through lifting, carrying and turning, where friction and force are enough, and lets it go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.laws.grip_tasks import (
    GRIPPED,
    HELD,
    LIFTED,
    OPENS,
    RESTED,
    STIFFNESS,
    THINGS,
    Outcome,
    grip_task,
    hand_grasp,
)
from tests.laws.hand_grasp import OWN_FRICTION
from tests.laws.replayed import GRAVITY

NEEDED = 1.3  # times the weight: what lifting and carrying take, with some margin


INSIDE = 1e-7  # m: nothing that is gripped is deeper in anything,
STANDING = 1.6e-6  # m: nor what stands untouched: surfaces that overlap by less only touch


def deepest(done: Outcome) -> float:
    """Overlap that is left in any frame [m]."""
    return max(r.metrics.residual_penetration_m for r in done.run.results)


def check(done: Outcome, noise: float = 0.0, slip: float = 1e-3) -> None:
    """Lifted, held without creep, carried and turned without slip, released; never inside."""
    height = done.run.path("thing")[:, 2] - done.height
    slips = done.slips()
    assert height[done.frame(LIFTED) : done.frame(OPENS)].min() > 0.18
    assert done.slip(slips, GRIPPED, OPENS) < (slip if noise == 0.0 else 3e-3)
    if noise == 0.0:
        assert done.slip(slips, RESTED, HELD) / (HELD - RESTED) < 1e-4
    assert height[-1] < 0.1
    (grasp,) = done.grasps
    assert grasp.outcome == "dropped"
    assert grasp.lifted_m > 0.18
    assert grasp.margin > 1.0
    assert deepest(done) < STANDING


def is_enough(what: str, squeeze: float, friction: float) -> bool:
    """Whether friction carries a thing between two sides, or three fingers, that press by K x."""
    mass = float(THINGS[what]["mass"])
    return 2 * friction * STIFFNESS * squeeze > NEEDED * mass * GRAVITY


@pytest.mark.parametrize(("grip", "what"), [("jaws", "cylinder"), ("three", "ball")])
def test_one_grip_of_every_kind(tmp_path: Path, grip: str, what: str) -> None:
    check(grip_task(tmp_path, grip, what, 0.005, 0.8))


@pytest.mark.parametrize("grip", ["three", "chains"])
def test_a_tracker_that_trembles_leaves_nothing_inside(tmp_path: Path, grip: str) -> None:
    assert deepest(grip_task(tmp_path, grip, "cylinder", 0.005, 0.8, noise=3e-4, end=1.5)) < INSIDE


@pytest.mark.parametrize("what", ["ball", "cube", "cylinder"])
def test_the_hand_s_grasps_are_in_balance(tmp_path: Path, what: str) -> None:
    """By the springs of its joints, the hand's forces on a thing balance within narrow cones: it neither pushes nor turns it."""
    grasp = hand_grasp(what, 5.0, tmp_path)
    forces, normals = grasp.forces, np.array([touch.normal for touch in grasp.touches])
    points = np.array([touch.point for touch in grasp.touches])
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.cross(points, forces).sum(axis=0), 0.0, atol=1e-7)
    pressed = (forces * normals).sum(axis=1)
    assert np.all(np.linalg.norm(forces - pressed[:, None] * normals, axis=1) <= OWN_FRICTION * pressed + 1e-9)
    fingers = np.array([touch.digit != "palm" for touch in grasp.touches])
    assert pressed[fingers].max() == pytest.approx(5.0)
    assert pressed[fingers].min() > 0.5


def test_the_hand_presses_as_its_springs_are_set(tmp_path: Path) -> None:
    grasp = hand_grasp("ball", 5.0, tmp_path)
    forces = grip_task(tmp_path, "hand", "ball", 0.005, 0.8, end=GRIPPED + 0.05).force(GRIPPED)
    for finger in ("thumb", "index", "middle", "palm"):
        planned = sum(
            f @ touch.normal for touch, f in zip(grasp.touches, grasp.forces, strict=True) if touch.digit == finger
        )
        assert sum(n for name, n in forces.items() if finger in name) == pytest.approx(planned, rel=0.12)
    assert forces["post"] == pytest.approx(0.1 * GRAVITY, abs=0.1)  # the weight alone


def test_the_shipped_hand_holds_a_ball(tmp_path: Path) -> None:
    check(grip_task(tmp_path, "hand", "ball", 0.005, 0.8), slip=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("squeeze", [0.002, 0.005, 0.01, 0.015])
@pytest.mark.parametrize("friction", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("what", ["cube", "ball", "cylinder"])
def test_the_shipped_hand_holds_all_things(tmp_path: Path, what: str, friction: float, squeeze: float) -> None:
    if not is_enough(what, squeeze, friction):
        pytest.skip("too little friction by the closed form")
    check(grip_task(tmp_path, "hand", what, squeeze, friction))


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30, 120, 240])
@pytest.mark.parametrize("what", ["cube", "ball", "cylinder"])
def test_the_shipped_hand_holds_all_things_at_every_rate(tmp_path: Path, what: str, rate: int) -> None:
    check(grip_task(tmp_path, "hand", what, 0.005, 0.8, rate))


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize("squeeze", [0.002, 0.005, 0.01, 0.015])
@pytest.mark.parametrize("friction", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("what", ["cube", "ball", "cylinder"])
@pytest.mark.parametrize("grip", ["jaws", "three", "chains", "rigid"])
def test_all_grips(tmp_path: Path, grip: str, what: str, friction: float, squeeze: float, rate: int) -> None:
    done = grip_task(tmp_path, grip, what, squeeze, friction, rate)
    if is_enough(what, squeeze, friction):
        check(done)
    forces = done.force(GRIPPED)
    sides = [force for name, force in forces.items() if name != "floor"]
    balanced = grip != "three" or what != "cube"  # one finger against two
    assert sum(sides) > 0.0
    if balanced:
        np.testing.assert_allclose(sides, STIFFNESS * squeeze, rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("what", ["cube", "ball", "cylinder"])
@pytest.mark.parametrize("grip", ["jaws", "three", "chains", "rigid"])
def test_a_tracker_that_trembles_does_not_shake_it_loose(tmp_path: Path, grip: str, what: str) -> None:
    check(grip_task(tmp_path, grip, what, 0.005, 0.8, noise=3e-4), noise=3e-4)
