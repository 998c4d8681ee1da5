"""Surfaces that overlap are moved apart, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.position_projection import any_short, project_positions
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))
GAP = 2e-6


@pytest.mark.parametrize("deep", [1e-5, 1e-4])
def test_what_overlaps_the_floor_is_lifted_out_of_it_with_the_velocity_it_had(deep: float) -> None:
    thing = Thing(shape=CUBE, at=(0, 0, 0.05 - deep), v=(0.1, 0, -0.2), w=(0, 0, 1.0))
    stage = Stage(Player([thing, floor()], gap=GAP))
    velocity = stage.motion["velocity"][0].copy()
    spin = stage.motion["angular_velocity"][0].copy()
    assert stage.call(any_short, 0.0)
    least = stage.call(project_positions, 0.0)
    assert 0.0 <= stage.motion["position"][0, 2] - 0.05 <= GAP
    assert stage.motion["position"][0, :2] == pytest.approx([0, 0], abs=1e-9)
    assert stage.build_contacts() == pytest.approx(least, abs=0.1 * GAP)
    assert not stage.call(any_short, 0.0)
    assert np.array_equal(stage.motion["velocity"][0], velocity)
    assert stage.motion["angular_velocity"][0] == pytest.approx(spin, abs=1e-9)


@pytest.mark.parametrize("above", [0.0, 0.5 * GAP, GAP, 1e-4])
def test_what_only_touches_stays_where_it_is(above: float) -> None:
    stage = Stage(Player([Thing(shape=CUBE, at=(0, 0, 0.05 + above)), floor()], gap=GAP))
    assert not stage.call(any_short, 0.0)
    before = stage.motion["position"][0].copy()
    stage.call(project_positions, 0.0)
    assert np.abs(stage.motion["position"][0] - before).max() <= 1e-12


@pytest.mark.parametrize("ratio", [1.0, 3.0, 10.0])
def test_the_lighter_of_two_is_moved_more_by_the_ratio_of_masses(ratio: float) -> None:
    deep = 1e-4
    balls = [Thing(shape=Sphere(0.05), at=(x, 0, 0), mass=m) for x, m in ((0.0, ratio), (0.1 - deep, 1.0))]
    stage = Stage(Player(balls, gravity=(0, 0, 0), gap=GAP))
    before = stage.motion["position"][:2].copy()
    stage.call(project_positions, 0.0)
    moved = stage.motion["position"][:2] - before
    assert ratio * moved[0, 0] == pytest.approx(-moved[1, 0], rel=1e-9)
    assert deep <= moved[1, 0] - moved[0, 0] <= deep + GAP


def test_where_there_is_no_room_the_overlap_is_shared() -> None:
    """A cube between two walls that are 0.2 mm too near: it ends in the middle and is not driven to and fro."""
    walls = [Thing(shape=CUBE, role=s.FIXED, at=(x, 0, 0)) for x in (-0.0999, 0.0999)]
    player = Player([Thing(shape=CUBE, at=(3e-5, 0, 0)), *walls], gravity=(0, 0, 0), gap=GAP)
    stage = Stage(player)
    for _ in range(5):
        stage.call(project_positions, 0.0)
        stage.build_contacts()
    assert abs(stage.motion["position"][0, 0]) < 2e-5
    before = stage.motion["position"][0].copy()
    stage.call(project_positions, 0.0)
    assert np.array_equal(stage.motion["position"][0], before)
    assert stage.contacts["clearance"] == pytest.approx(-1e-4, abs=2e-5)


def test_bodies_that_have_not_changed_are_left_alone() -> None:
    things = [Thing(shape=CUBE, at=(x, 0, 0.05 - 1e-4)) for x in (0.0, 0.5)]
    stage = Stage(Player([*things, floor()], gap=GAP))
    stage.mark(0)
    stage.build_contacts()
    stage.call(project_positions, 0.0)
    assert stage.motion["position"][0, 2] >= 0.05
    assert stage.motion["position"][1, 2] == 0.05 - 1e-4
