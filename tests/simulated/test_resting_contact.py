"""Contact forces of a step: they carry the weight, and friction stays in its cone."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene.arrays import DRIVEN
from geomphys.scene.pieces import Box
from geomphys.simulated.motion import load_velocities
from geomphys.simulated.resting_contact import SWEEPS, WEIGHT_TIME, set_limits, solve_resting_contact
from tests.simulated.scenes import GRAVITY, Player, Thing, floor
from tests.simulated.stages import Stage

CUBE, GAP = Box((0.05, 0.05, 0.05)), 2e-6


def held(*things: Thing) -> Stage:
    """Things on a floor, with the contact forces of a step."""
    stage = Stage(Player([*things, floor()], gap=GAP))
    stage.call(load_velocities)
    stage.call(solve_resting_contact, 0.0, stage.dt, SWEEPS)
    return stage


def test_a_cube_at_rest_is_carried() -> None:
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + GAP)))
    assert np.abs(stage.motion["acceleration"][0]).max() < 1e-6 * GRAVITY


def test_each_of_a_stack_is_carried() -> None:
    stage = held(*[Thing(shape=CUBE, at=(0, 0, 0.05 + GAP + k * (0.1 + GAP)), mass=m) for k, m in enumerate((1, 3, 2))])
    assert np.abs(stage.motion["acceleration"][:3]).max() < 1e-3 * GRAVITY


def test_what_flies_falls() -> None:
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.2)))
    assert stage.motion["acceleration"][0] == pytest.approx([0, 0, -GRAVITY], rel=1e-12)


@pytest.mark.parametrize(("material", "friction"), [("wood", 0.3), ("human", 0.2), ("metal", 0.1), ("ice", 0.0)])
def test_what_slides_is_slowed_by_friction_times_weight(material: str, friction: float) -> None:
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + GAP), v=(0.6, -0.8, 0), material=material))
    expected = -friction * GRAVITY * np.array([0.6, -0.8, 0.0])
    assert stage.motion["acceleration"][0] == pytest.approx(expected, abs=1e-5 * GRAVITY)


def test_friction_stops_but_does_not_reverse() -> None:
    """Friction could take 12 mm/s off it in a step, and takes the 1 mm/s that it has."""
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + GAP), v=(1e-3, 0, 0)))
    after = stage.motion["velocity"][0, 0] + stage.dt * stage.motion["acceleration"][0, 0]
    assert after == pytest.approx(0.0, abs=1e-6)


def test_what_leaves_is_not_held_back() -> None:
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + GAP), v=(0, 0, 0.5)))
    assert stage.motion["acceleration"][0] == pytest.approx([0, 0, -GRAVITY], rel=1e-9)


def test_what_hovers_within_touching_comes_down_to_the_gap_and_no_farther() -> None:
    above = 5e-6
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + above)))
    fallen = -0.5 * stage.motion["acceleration"][0, 2] * stage.dt**2
    assert fallen == pytest.approx(above - GAP, abs=0.05 * GAP)


def test_friction_beyond_the_cone_is_cut_to_it() -> None:
    """To stop it in the step would take half as much again as friction has."""
    lost = 0.3 * GRAVITY / 240
    stage = held(Thing(shape=CUBE, at=(0, 0, 0.05 + GAP), v=(0, 1.5 * lost, 0)))
    assert stage.dt * stage.motion["acceleration"][0, 1] == pytest.approx(-lost, rel=1e-4)


def test_only_bodies_that_follow_a_path_have_bounded_impulses() -> None:
    """Four times what stops the approach of all that is stacked, and holds it for a while."""
    cubes = [Thing(shape=CUBE, at=(0, 0, 0.05 + GAP + k * (0.1 + GAP)), v=(0, 0, 0.3), mass=1.0 + k) for k in range(2)]
    press = Thing(shape=CUBE, at=(0, 0, 0.25 + 3 * GAP), role=DRIVEN)
    stage = Stage(Player([*cubes, press, floor()], gap=GAP))
    stage.call(load_velocities)
    stage.player.simulation.velocity[2, 2] = -0.2
    stage.call(set_limits)
    pressed = stage.contacts["b"] == 2
    assert pressed.sum() == 4
    expected = 4.0 * 3.0 * (0.5 + WEIGHT_TIME * GRAVITY)
    assert stage.contacts["impulse_limit"][pressed] == pytest.approx(expected, rel=1e-12)
    assert np.isinf(stage.contacts["impulse_limit"][~pressed]).all()
