"""At the end of a step bodies are moved out of what they overlap: those of one activation, and not out of driven links."""

from __future__ import annotations

import pytest

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.islands import mark_activation
from geomphys.simulated.overlap_clearing import clear_overlaps, clear_pair_by_pair, deepest_inside
from geomphys.simulated.position_projection import LEFT, TOUCHING
from geomphys.simulated.state import AWAKE, COUPLED
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

CUBE = Box((0.05, 0.05, 0.05))
GAP = 2e-6


def sunk(*depths: float) -> Stage:
    """Cubes beside each other, each that deep in the floor."""
    cubes = [Thing(shape=CUBE, at=(0.5 * i, 0, 0.05 - depth)) for i, depth in enumerate(depths)]
    return Stage(Player([*cubes, floor()], gap=GAP))


@pytest.mark.parametrize("activation", [AWAKE, COUPLED])
def test_only_bodies_of_the_given_activation_are_moved(activation: int) -> None:
    stage = sunk(1e-4, 1e-4)
    stage.bodies["activation"][:2] = activation, AWAKE + COUPLED - activation
    velocity = stage.motion["velocity"][0].copy()
    stage.call(mark_activation, activation)
    stage.call(clear_overlaps, 0.0, TOUCHING * GAP)
    assert 0.0 <= stage.motion["position"][0, 2] - 0.05 <= GAP
    assert stage.motion["position"][1, 2] == 0.05 - 1e-4
    assert (stage.motion["velocity"][0] == velocity).all()
    assert len(stage.contacts) == 0


@pytest.mark.parametrize("share", [TOUCHING, LEFT])
@pytest.mark.parametrize("over", [0.9, 1.1])
def test_what_is_within_the_tolerance_stays_where_it_is(share: float, over: float) -> None:
    depth = over * share * GAP
    stage = sunk(depth)
    stage.call(clear_overlaps, 0.0, share * GAP)
    assert (stage.motion["position"][0, 2] == 0.05 - depth) == (over < 1.0)


def test_a_body_is_not_moved_out_of_a_driven_one() -> None:
    ball, link = Thing(shape=Sphere(0.05), at=(0, 0, 0)), Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0.0999, 0, 0))
    stage = Stage(Player([ball, link], gravity=(0, 0, 0), gap=GAP))
    assert stage.call(deepest_inside, 0.0) < 0.0
    stage.call(clear_overlaps, 0.0, TOUCHING * GAP)
    assert (stage.motion["position"][0] == 0.0).all()


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_a_pair_is_parted_along_its_normal_by_the_ratio_of_masses(ratio: float) -> None:
    deep, tolerance = 1e-4, 1e-6
    balls = [Thing(shape=Sphere(0.05), at=(x, 0, 0), mass=m) for x, m in ((0.0, ratio), (0.1 - deep, 1.0))]
    stage = Stage(Player(balls, gravity=(0, 0, 0), gap=GAP))
    before = stage.motion["position"][:2].copy()
    assert stage.call(clear_pair_by_pair, 0.0, tolerance) == pytest.approx(deep, rel=1e-6)
    moved = stage.motion["position"][:2] - before
    assert ratio * moved[0, 0] == pytest.approx(-moved[1, 0], rel=1e-9)
    assert moved[1, 0] - moved[0, 0] == pytest.approx(deep + tolerance, rel=1e-6)
    assert stage.call(clear_pair_by_pair, 0.0, tolerance) == pytest.approx(-tolerance, abs=1e-9)
