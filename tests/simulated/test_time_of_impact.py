"""When two pieces first are a distance apart, against formulas."""

from __future__ import annotations

import math

import pytest

from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.motion import load_velocities
from geomphys.simulated.resting_contact import SWEEPS, hold
from geomphys.simulated.time_of_impact import first_touch
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

DT, GAP = 1 / 60, 2e-6


def approaching(height: float, speed: float, spin: float = 0.0) -> Stage:
    """A ball or, if it rotates, a cube that flies towards the floor without gravity."""
    shape = Box((0.05, 0.05, 0.05)) if spin else Sphere(0.05)
    thing = Thing(shape=shape, at=(0, 0, height + 0.05), v=(0.3, 0, -speed), w=(0, spin, 0))
    stage = Stage(Player([thing, floor()], gravity=(0, 0, 0), gap=GAP), DT)
    stage.call(load_velocities)
    stage.call(hold, 0.0, DT, SWEEPS)  # plans the motion of the span
    return stage


@pytest.mark.parametrize("target", [0.0, GAP, 1e-3, -1e-3])
@pytest.mark.parametrize("height", [0.002, 0.012])
def test_a_ball_is_a_distance_away_when_the_formula_says(height: float, target: float) -> None:
    stage = approaching(height, 1.0)
    slack = 1e-7
    found = stage.call(first_touch, 0, 0.0, DT, target, slack)
    assert found == pytest.approx(height - target, abs=1.01 * slack)


def test_what_does_not_come_so_near_in_the_span_never_does() -> None:
    stage = approaching(0.012, 1.0)
    assert stage.call(first_touch, 0, 0.0, 0.011, 0.0, 1e-7) == math.inf
    assert stage.call(first_touch, 0, 0.0, DT, 0.0, 1e-7) < math.inf


def test_what_is_as_near_already_is_at_once() -> None:
    assert approaching(0.002, 1.0).call(first_touch, 0, 0.0, DT, 0.01, 1e-7) == 0.0


@pytest.mark.parametrize("spin", [20.0, -60.0])
def test_a_cube_that_rotates_arrives_with_its_corner(spin: float) -> None:
    """The lowest corner is at height + h - h (cos φ + |sin φ|) - v t above the floor, φ = spin t."""
    height, speed, slack = 0.012, 0.5, 1e-7
    found = approaching(height, speed, spin).call(first_touch, 0, 0.0, DT, 0.0, slack)
    assert isinstance(found, float)
    assert found < DT
    angle = spin * found
    left = height + 0.05 - 0.05 * (math.cos(angle) + abs(math.sin(angle))) - speed * found
    assert 0.0 <= left + slack < 20 * slack


def test_a_corner_that_dips_in_and_out_within_the_span_is_not_missed() -> None:
    """The cube makes a quarter of a rotation: it is as high at the end as at the start, and 6 mm too low in the middle."""
    found = approaching(0.015, 0.0, 0.5 * math.pi / DT).call(first_touch, 0, 0.0, DT, 0.0, 1e-7)
    assert isinstance(found, float)
    angle = 0.5 * math.pi * found / DT
    assert angle < 0.25 * math.pi
    assert 0.065 - 0.05 * (math.cos(angle) + math.sin(angle)) == pytest.approx(0.0, abs=2e-6)
