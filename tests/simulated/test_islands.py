"""Which bodies an encounter concerns."""

from __future__ import annotations

import numpy as np

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.islands import mark_connected
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))


def test_all_that_touch_each_other_are_concerned_and_nothing_else() -> None:
    """Three cubes on each other, a ball above them, and a cube beside them on the same floor."""
    stack = [Thing(shape=CUBE, at=(0, 0, 0.05 + k * 0.1000020)) for k in range(3)]
    ball = Thing(shape=Sphere(0.05), at=(0, 0, 0.3511), v=(0, 0, -1))
    beside = Thing(shape=CUBE, at=(0.5, 0, 0.05))
    stage = Stage(Player([*stack, ball, beside, floor()]))
    stage.call(mark_connected, stage.pair(2, 3), 0.0)
    assert stage.bodies["changed"][:5].tolist() == [1, 1, 1, 1, 0]


def test_a_floor_that_two_stand_on_connects_them_not() -> None:
    stage = Stage(Player([Thing(shape=CUBE, at=(x, 0, 0.05)) for x in (0.0, 0.3)] + [floor()]))
    stage.call(mark_connected, stage.pair(0, 2), 0.0)
    assert stage.bodies["changed"][:2].tolist() == [1, 0]


def test_who_only_passes_near_is_not_concerned() -> None:
    """The second ball may reach the first within the step, but does not touch it now."""
    balls = [Thing(shape=Sphere(0.05), at=(x, 0, 0.0502), v=(v, 0, 0)) for x, v in ((0.0, 0.0), (0.101, -0.1))]
    stage = Stage(Player([*balls, floor()]))
    assert {tuple(sorted(pair)) for pair in stage.pairs["body"].tolist()} >= {(0, 1), (0, 2)}
    stage.call(mark_connected, stage.pair(0, 2), 0.0)
    assert stage.bodies["changed"][:2].tolist() == [1, 0]
    stage.call(mark_connected, stage.pair(0, 1), 0.0)
    assert stage.bodies["changed"][:2].tolist() == [1, 1]


def test_one_whose_points_are_not_laid_out_yet_is_concerned_if_it_is_near_enough_for_them() -> None:
    """The ball rests on the cube, but their pair has no contact points at this moment."""
    stage = Stage(Player([Thing(shape=CUBE, at=(0, 0, 0.05)), Thing(shape=Sphere(0.05), at=(0, 0, 0.1501)), floor()]))
    stage.pairs["point_count"][stage.pair(0, 1)] = 0
    stage.call(mark_connected, stage.pair(0, 2), 0.0)
    assert stage.bodies["changed"][:2].tolist() == [1, 1]


def test_a_body_that_sleeps_is_not_woken_by_a_neighbour_that_met_something() -> None:
    stage = Stage(Player([Thing(shape=CUBE, at=(0, 0, 0.05 + k * 0.1000020)) for k in range(2)] + [floor()]))
    stage.bodies["activation"][1] = 0
    stage.call(mark_connected, stage.pair(0, 2), 0.0)
    assert stage.bodies["changed"][:2].tolist() == [1, 0]


def test_bodies_that_may_touch_bear_one_label() -> None:
    things = [Thing(shape=CUBE, at=at) for at in ((0, 0, 0.05), (0, 0, 0.150002), (0.6, 0, 0.05), (0.700002, 0, 0.05))]
    things.append(Thing(shape=CUBE, at=(1.3, 0, 0.05), role=s.SIMULATED))
    islands = Stage(Player([*things, floor()])).bodies["island"][:5]
    assert islands[0] == islands[1]
    assert islands[2] == islands[3]
    assert len(np.unique(islands)) == 3
