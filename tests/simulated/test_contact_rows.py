"""The table of contact points: what is dropped from it, what is added up before, and what does not fit."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.results import FLAG_TABLE_FULL
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.allocation import Capacity
from geomphys.simulated.contact_points import add_contacts
from geomphys.simulated.impulse_accumulation import drop_contacts
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))


def balls(count: int) -> Stage:
    """Balls on a floor, one contact point each."""
    return Stage(Player([*(Thing(shape=Sphere(0.05), at=(0.2 * k, 0, 0.05)) for k in range(count)), floor()]))


@pytest.mark.parametrize("changed", [(0,), (1,), (0, 2), (3,), (), (0, 1, 2, 3)])
def test_forces_on_changed_bodies_are_summed_once_until_contacts_are_dropped(changed: tuple[int, ...]) -> None:
    stage = balls(4)
    since, until = 1e-3, 3e-3
    assert stage.contacts["a"].tolist() == [0, 1, 2, 3]
    slots, pairs = stage.player.simulation.slots, stage.contacts["pair"].copy()
    for k, pair in enumerate(pairs):
        point = slots[pair, 0]
        point["since"], point["normal"] = since, (0.0, 0.0, 1.0)
        point["normal_force"], point["friction_force"] = 10.0 + k, (0.0, k, 0.0)
        point["normal_impulse"], point["friction_impulse"] = 1.0, (0.0, 0.0, 0.0)
    stage.mark(*changed)
    for _ in range(2):
        stage.call(drop_contacts, until)
        assert len(stage.contacts) == 0
        for k, pair in enumerate(pairs):
            elapsed = until - since if k in changed else 0.0
            assert slots[pair, 0]["normal_impulse"] == pytest.approx(1.0 + elapsed * (10.0 + k), rel=1e-12)
            assert slots[pair, 0]["normal_impulses"][2] == pytest.approx(elapsed * (10.0 + k), rel=1e-12)
            assert slots[pair, 0]["friction_impulse"][1] == pytest.approx(elapsed * k, rel=1e-12)


def cubes(points: int) -> Player:
    """Two cubes that lie on a floor, four contact points each, in a table of so many."""
    player = Player([Thing(shape=CUBE, at=(0.3 * k, 0, 0.05)) for k in range(2)] + [floor()])
    player.set_up(Capacity(points=points))
    return player


@pytest.mark.parametrize(("points", "laid", "lost"), [(8, 8, 0), (7, 4, 1), (4, 4, 1)])
def test_points_of_a_pair_that_do_not_fit_are_counted_and_none_of_them_is_laid_out(
    points: int, laid: int, lost: int
) -> None:
    stage = Stage(cubes(points))
    assert len(stage.contacts) == laid
    assert stage.player.simulation.counts["lost"] == lost
    assert len(set(stage.contacts["a"])) == laid // 4


@pytest.mark.parametrize(("points", "flag"), [(8, 0), (7, FLAG_TABLE_FULL)])
def test_a_frame_without_capacity_for_its_points_leaves_bodies_where_they_are_and_says_so(
    points: int, flag: int
) -> None:
    player = Player([Thing(shape=CUBE, at=(0, 0, 0.05 + 0.1000005 * k)) for k in range(2)] + [floor()])
    player.set_up(Capacity(points=points))
    before = player.poses.copy()
    player.velocity[0, 0] = 0.1
    player.step(1 / 60)
    assert player.flags == flag
    assert np.array_equal(player.poses, before) == bool(flag)


def test_impulses_of_points_that_are_gone_go_to_those_that_are_there() -> None:
    """Of four points of a cube two are found where they were; what all have passed on in the frame stays the same."""
    stage = Stage(cubes(8))
    slots = stage.player.simulation.slots[0]
    for m in range(4):
        slots[m]["normal_impulse"], slots[m]["friction_impulse"] = 1.0 + m, (0.1 * m, -1.0, 0.0)
        slots[m]["normal_impulses"] = (0.0, 0.0, 1.0 + m)
    slots["local"][2:] += 0.02
    stage.player.simulation.counts["contacts"] = 0
    stage.call(add_contacts, 0, 0.0)
    assert slots["used"].tolist() == [1, 1, 1, 1]
    assert slots["normal_impulse"].sum() == pytest.approx(10.0, rel=1e-15)
    assert slots["friction_impulse"].sum(axis=0) == pytest.approx([0.6, -4.0, 0.0], rel=1e-15)
    assert slots["normal_impulses"].sum(axis=0) == pytest.approx([0.0, 0.0, 10.0], rel=1e-15)
