"""Energy that a step added by rounding is taken off what touched something still."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene.pieces import Box
from geomphys.simulated.energy import note_energies, note_new_energies, take_excess
from tests.simulated.scenes import GRAVITY, Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))


def energies(stage: Stage) -> np.ndarray:
    """Kinetic and potential energy of every body [J], by the textbook."""
    m = stage.motion
    kinetic = 0.5 * m["mass"] * (m["velocity"] ** 2).sum(axis=1)
    kinetic += 0.5 * (m["angular_velocity"] * m["angular_momentum"]).sum(axis=1)
    return kinetic + m["mass"] * GRAVITY * m["position"][:, 2]


def sliding(count: int = 1, **ground: object) -> Stage:
    """Cubes that slide over a floor while they turn, far from each other; their energies are noted."""
    things = [Thing(shape=CUBE, at=(0.5 * k, 0, 0.05), v=(0.3, 0, 0), w=(0, 0, 2.0)) for k in range(count)]
    stage = Stage(Player([*things, floor(**ground)]))
    stage.call(note_energies)
    stage.bodies["touched"][:count] = 1
    return stage


@pytest.mark.parametrize("gain", [1e-9, 1e-3, 0.1])
def test_what_was_gained_on_something_still_is_taken_off(gain: float) -> None:
    stage = sliding()
    before = energies(stage)[0]
    for name in ("velocity", "angular_velocity", "angular_momentum"):
        stage.motion[name][0] *= np.sqrt(1.0 + gain)
    direction = stage.motion["velocity"][0] / np.linalg.norm(stage.motion["velocity"][0])
    assert energies(stage)[0] > before
    stage.call(take_excess)
    assert energies(stage)[0] == pytest.approx(before, rel=1e-13)
    assert stage.motion["velocity"][0] @ direction == pytest.approx(0.3, rel=1e-9)
    assert stage.motion["angular_velocity"][0] == pytest.approx([0, 0, 2.0], rel=1e-9)


def test_what_was_lost_is_not_given_back() -> None:
    stage = sliding()
    stage.motion["velocity"][0] *= 0.5
    stage.call(take_excess)
    assert stage.motion["velocity"][0] == pytest.approx([0.15, 0, 0])


def test_a_body_that_touched_nothing_keeps_what_it_has() -> None:
    stage = sliding(2)
    stage.bodies["touched"][1] = 0
    stage.motion["velocity"][:2] *= 2.0
    stage.call(take_excess)
    assert np.linalg.norm(stage.motion["velocity"][0]) < 0.59
    assert stage.motion["velocity"][1] == pytest.approx([0.6, 0, 0])


def test_islands_do_not_pay_for_each_other() -> None:
    """One cube gained, the other lost as much: the first pays in full."""
    stage = sliding(2)
    before = energies(stage)[:2]
    stage.motion["velocity"][0] *= 1.1
    stage.motion["velocity"][1] *= 0.9
    for cube in range(2):
        stage.mark(cube)
        stage.call(take_excess)
    after = energies(stage)[:2]
    assert after[0] == pytest.approx(before[0], rel=1e-13)
    assert after[1] < before[1]


def test_what_moves_by_itself_may_give_energy() -> None:
    """A floor that a recording moves carries a cube along: that is no rounding."""
    player = Player([Thing(shape=CUBE, at=(0, 0, 0.05), v=(0.3, 0, 0)), floor(moving=True)])
    player.targets = {1: lambda time: (0.5 * time, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0)}
    player.step(1 / 240)
    stage = Stage(player)
    stage.motion["velocity"][1] = (0.5, 0.0, 0.0)  # it moves in this frame too
    stage.call(note_energies)
    stage.bodies["touched"][0] = 1
    stage.motion["velocity"][0] = (0.6, 0.0, 0.0)
    stage.call(take_excess)
    assert stage.motion["velocity"][0] == pytest.approx([0.6, 0, 0])


def test_a_body_the_caller_has_just_placed_begins_with_the_energy_it_has() -> None:
    """It is lifted out of the floor: the height it gains by that is not taken off its motion."""
    stage = sliding()
    stage.bodies["fresh"][0] = 1
    stage.motion["position"][0, 2] += 1e-3
    stage.call(note_new_energies)
    stage.call(take_excess)
    assert stage.motion["velocity"][0] == pytest.approx([0.3, 0, 0], rel=1e-12)
    stage.bodies["fresh"][0] = 0
    stage.motion["position"][0, 2] += 1e-3
    stage.call(note_new_energies)
    stage.call(take_excess)
    assert np.linalg.norm(stage.motion["velocity"][0]) < 0.3


def test_bodies_that_collide_near_a_floor_they_do_not_touch_keep_their_momentum() -> None:
    """The floor is near enough to be listed, and has no contact point."""
    cubes = [Thing(shape=CUBE, at=(x, 0, 0.0505), v=(v, 0, 0)) for x, v in ((0.0, 0.3), (0.1, -0.1))]
    stage = Stage(Player([*cubes, floor()]))
    assert len(stage.pairs) == 3
    stage.call(note_energies)
    stage.bodies["touched"][:2] = 1
    stage.motion["velocity"][:2] *= 1.1
    stage.call(take_excess)
    assert stage.motion["velocity"][:2, 0] == pytest.approx([0.33, -0.11], rel=1e-15)
