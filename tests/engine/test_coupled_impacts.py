"""Impacts of a ball on a driven plate by the textbook: real masses, restitution of new contacts, time of the next one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geomphys.engine.coupled_impacts import MIN_SPLIT, load_coupled, next_impact, resolve_impacts
from geomphys.engine.coupled_squeeze import largest_squeeze
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.engine.coupled_stages import GAP, HALF, RADIUS, STEP, Substep, ball_over_plate
from tests.simulated.scenes import GRAVITY, Thing, make_scene

M = 0.4  # kg: of the plate, by its coupling


@pytest.mark.parametrize("mass", [0.05, 0.4, 5.0])
@pytest.mark.parametrize(("material", "restitution"), [("wood", 0.3), ("rubber", 0.5), ("ice", 0.0)])
def test_a_ball_and_a_plate_part_as_two_bodies_of_their_masses(mass: float, material: str, restitution: float) -> None:
    stage = ball_over_plate(GAP, 2.0, mass, material=material).find_contacts()
    assert stage.call(resolve_impacts) == 1
    ball, plate = float(stage.velocity(1)[2]), float(stage.unknown(0)["rate"])
    assert mass * ball + M * plate == pytest.approx(mass * -2.0, rel=1e-9)
    assert ball - plate == pytest.approx(restitution * 2.0, abs=1e-9)
    assert stage.data.coupled.trees["touched"].tolist() == [1, 0]


def test_friction_turns_the_ball_and_takes_the_plate_along() -> None:
    """Momentum across is kept too, and the impulse is in the cone."""
    mass = 0.5
    stage = ball_over_plate(GAP, 2.0, mass, across=3.0).find_contacts()
    stage.call(resolve_impacts)
    ball, plate = stage.velocity(1), [float(stage.unknown(0, axis)["rate"]) for axis in range(3)]
    assert mass * ball[0] + M * plate[0] == pytest.approx(mass * 3.0, rel=1e-9)
    normal, tangential = M * -plate[2], M * plate[0]
    assert tangential == pytest.approx(0.3 * normal, rel=1e-6)  # it slides: all that friction gives
    spin = stage.data.simulated.motion["angular_velocity"][1]
    assert spin[1] == pytest.approx(tangential * (RADIUS + 0.5 * GAP) / (0.4 * mass * RADIUS**2), rel=1e-9)


def test_what_touched_before_does_not_bounce_again() -> None:
    stage = ball_over_plate(GAP, 2.0, material="rubber").find_contacts()
    stage.data.simulated.pairs["touching"] = 1
    stage.call(resolve_impacts)
    assert stage.velocity(1)[2] - float(stage.unknown(0)["rate"]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("clearance", "speed"), [(GAP, 0.02), (2e-3, 2.0), (GAP, -1.0)])
def test_slow_ones_and_those_that_do_not_touch_yet_or_leave_are_no_impacts(clearance: float, speed: float) -> None:
    stage = ball_over_plate(clearance, speed).find_contacts()
    assert len(stage.contacts) == 1
    assert stage.call(resolve_impacts) == 0
    assert stage.velocity(1).tolist() == [0.0, 0.0, -speed]
    assert stage.unknown(0)["rate"] == 0.0
    assert stage.data.coupled.trees["touched"].tolist() == [0, 0]


def test_the_recorded_motion_of_the_plate_counts() -> None:
    """It comes up at 1 m/s to a ball at rest: the same as a ball that falls on it."""
    stage = ball_over_plate(GAP)
    stage.roots[0, 2] = 1.0 * STEP
    stage.begin().find_contacts()
    stage.call(resolve_impacts)
    ball, offset = float(stage.velocity(1)[2]), float(stage.unknown(0)["rate"])
    assert 0.5 * ball + M * offset == pytest.approx(0.0, abs=1e-9)
    assert ball - (1.0 + offset) == pytest.approx(0.3, abs=1e-8)


def test_only_bodies_of_the_group_are_loaded() -> None:
    stage = ball_over_plate(GAP, 2.0)
    velocity = stage.data.simulated.velocity
    velocity[1] = 7.0
    load_coupled(stage.packed.simulated)
    assert velocity[1].tolist() == [0, 0, -2.0, 0, 0, 0]
    stage.data.simulated.bodies["activation"][1] = 1  # not in the group
    velocity[1] = 7.0
    load_coupled(stage.packed.simulated)
    assert velocity[1].tolist() == [7.0] * 6


def time_to(stage: Substep) -> float:
    load_coupled(stage.packed.simulated)
    return float(next_impact(stage.packed.simulated, stage.packed.coupled, stage.dt))


@pytest.mark.parametrize(("clearance", "speed"), [(1e-3, 1.0), (2e-3, 0.6), (3.5e-3, 2.0)])
def test_the_time_of_the_next_impact_is_that_of_the_fall(clearance: float, speed: float) -> None:
    stage = ball_over_plate(clearance, speed).find_contacts()
    t = time_to(stage)
    assert speed * t + 0.5 * GRAVITY * t * t == pytest.approx(clearance - GAP, rel=1e-12)
    assert stage.contacts["mode"].tolist() == [2]


@pytest.mark.parametrize(
    ("clearance", "speed"),
    [(3.9e-3, 0.5), (1e-3, 0.05), (GAP, 2.0), (GAP + 0.5 * MIN_SPLIT, 1.0)],
    ids=["after the step", "slow", "touches", "too soon to split"],
)
def test_without_an_impact_within_the_step_it_is_not_split(clearance: float, speed: float) -> None:
    assert time_to(ball_over_plate(clearance, speed).find_contacts()) == STEP


def test_of_two_balls_that_fall_together_gravity_does_not_bring_the_impact_nearer() -> None:
    clearance, speed = 1e-3, 1.0
    things = [
        Thing(shape=Box((0.2, 0.2, HALF)), role=s.DRIVEN, at=(0, 0, -0.001)),
        Thing(shape=Sphere(RADIUS), at=(0, 0, HALF + RADIUS)),
        Thing(shape=Sphere(RADIUS), at=(0, 0, HALF + 3 * RADIUS + clearance), v=(0, 0, -speed)),
    ]
    stage = Substep(make_scene(things)).begin().find_contacts()
    assert len(stage.contacts) == 2
    assert time_to(stage) == pytest.approx((clearance - GAP) / speed, rel=1e-9)


def test_the_first_of_several_counts() -> None:
    things = [Thing(shape=Box((0.5, 0.2, HALF)), role=s.DRIVEN)]
    for k, clearance in enumerate((2e-3, 1e-3, 3e-3)):
        things.append(Thing(shape=Sphere(RADIUS), at=(0.2 * k - 0.2, 0, HALF + RADIUS + clearance), v=(0, 0, -1.0)))
    stage = Substep(make_scene(things)).begin().find_contacts()
    t = time_to(stage)
    assert t == pytest.approx((math.sqrt(1.0 + 2.0 * GRAVITY * (1e-3 - GAP)) - 1.0) / GRAVITY, rel=1e-9)
    assert np.array_equal(stage.contacts["mode"], [2, 2, 2])


def test_without_squeeze_there_is_none() -> None:
    stage = ball_over_plate(GAP)
    assert largest_squeeze(stage.scene, stage.packed.coupled) == 0.0
