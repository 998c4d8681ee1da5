"""Every grip holds every thing through lifting, carrying and turning, where friction and force are enough, and lets it go."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.results import FLAG_SWEEP_BOUND
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
)
from tests.laws.replayed import GRAVITY

NEEDED = 1.3  # times the weight: what lifting and carrying take, with some margin


INSIDE = 1e-7  # m: nothing that is gripped is deeper in anything,
STANDING = 1.6e-6  # m: nor what stands untouched: surfaces that overlap by less only touch
HAND_SLIP = 1.5e-3  # m: of the shipped hand, most of it when what stood on a post hangs in the fingers


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


def test_the_shipped_hand_holds_a_ball(tmp_path: Path) -> None:
    check(grip_task(tmp_path, "hand", "ball", 0.005, 0.8), slip=HAND_SLIP)


def test_what_many_contacts_press_hard_neither_slips_nor_creeps(tmp_path: Path) -> None:
    """Forces of ten points on a light cube settle slowly: left unsettled it crept by 0.3 mm/s, below the limit of friction."""
    done = grip_task(tmp_path, "hand", "cube", 0.015, 1.0, end=4.5)
    slips = done.slips()
    assert done.slip(slips, GRIPPED, 4.5) < 5e-5
    assert done.slip(slips, RESTED, 4.5) < 5e-6
    unsettled = sum(1 for r in done.run.results if r.metrics.flags & FLAG_SWEEP_BOUND)
    assert unsettled < 0.05 * len(done.run.results)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize("what", ["cube", "ball", "cylinder"])
def test_the_shipped_hand_holds_all_things(tmp_path: Path, what: str, rate: int) -> None:
    check(grip_task(tmp_path, "hand", what, 0.005, 0.8, rate), slip=HAND_SLIP)


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
