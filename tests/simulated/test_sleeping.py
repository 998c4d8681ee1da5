"""What is at rest sleeps, and wakes when something near it moves."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.engine.frame_buffer import CONTACT
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from geomphys.simulated.frame_contacts import write_touches
from geomphys.simulated.sleeping import REST_TIME, SLOW_SPEED, note_rest, wake
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))


def resting(*more: Thing) -> Stage:
    """Two cubes on each other and one apart, at rest for long enough to sleep."""
    cubes = [Thing(shape=CUBE, at=at) for at in ((0, 0, 0.05), (0, 0, 0.150002), (0.6, 0, 0.05))]
    stage = Stage(Player([*cubes, floor(), *more]))
    stage.motion["quiet_time"][:3] = REST_TIME
    return stage


def test_an_island_sleeps_when_all_of_it_has_rested() -> None:
    stage = resting()
    assert not stage.call(wake, True)
    assert not stage.bodies["activation"][:3].any()


@pytest.mark.parametrize(("restless", "awake"), [(0, [1, 1, 0]), (1, [1, 1, 0]), (2, [0, 0, 1])])
def test_one_that_has_not_keeps_its_island_awake(restless: int, awake: list[int]) -> None:
    stage = resting()
    stage.motion["quiet_time"][restless] = 0.99 * REST_TIME
    assert stage.call(wake, True)
    assert stage.bodies["activation"][:3].tolist() == awake


def test_what_falls_asleep_has_no_motion_left() -> None:
    stage = resting()
    for name in ("velocity", "angular_velocity", "angular_momentum"):
        stage.motion[name][:3] = 1e-9
    stage.motion["quiet_time"][2] = 0.0
    stage.call(wake, True)
    for name in ("velocity", "angular_velocity", "angular_momentum"):
        assert not stage.motion[name][:2].any()
        assert stage.motion[name][2].all()


def test_in_the_course_of_a_frame_nothing_falls_asleep() -> None:
    stage = resting()
    assert stage.bodies["activation"][:3].all()
    assert stage.call(wake, False)
    assert stage.bodies["activation"][:3].all()


@pytest.mark.parametrize(
    ("speed", "touched", "awake", "counts"),
    [(0.5, 1, 1, True), (0.5, 0, 0, True), (0.5, 0, 1, False), (2.0, 1, 1, False)],
    ids=["supported", "asleep", "in free flight", "fast"],
)
def test_time_of_slow_motion_counts_while_a_body_is_supported(
    speed: float, touched: int, awake: int, counts: bool
) -> None:
    """The top of a throw is slow too, and nothing may fall asleep there."""
    stage = resting()
    m = stage.motion[0]
    m["velocity"], m["slow_time"], m["slow_from"] = (speed * SLOW_SPEED, 0.0, 0.0), 1.0, speed * SLOW_SPEED
    stage.bodies["touched"][0], stage.bodies["activation"][0] = touched, awake
    stage.call(note_rest, 0, np.zeros(6))
    assert m["slow_time"] == pytest.approx(1.0 + stage.dt if counts else 0.0, rel=1e-12)


def test_a_driven_body_that_moves_wakes_what_is_near_it() -> None:
    hand = Thing(shape=CUBE, at=(0, 0.100005, 0.05), role=s.DRIVEN)
    stage = resting(hand)
    assert not stage.call(wake, True)
    stage.player.simulation.motion["velocity"][4, 1] = -0.1
    assert stage.call(wake, True)
    assert stage.bodies["activation"][:3].tolist() == [1, 1, 0]


def test_a_sleeping_body_goes_on_to_press_with_its_weight() -> None:
    """Its contacts carry m g dt in every frame it sleeps."""
    player = Player([Thing(shape=CUBE, at=(0, 0, 0.05)), floor()])
    player.run(1.0)
    assert player.simulation.bodies["activation"][0] == 0
    before = player.poses.copy()
    player.step(1 / 60)
    assert np.array_equal(player.poses, before)
    contacts = np.zeros(16, CONTACT)
    count = write_touches(player.packed, player.poses, contacts, 0)
    weight = player.scene.bodies.mass[0] * 9.81
    assert contacts["normal_impulse"][:count].sum() * 60 == pytest.approx(weight, rel=1e-6)
