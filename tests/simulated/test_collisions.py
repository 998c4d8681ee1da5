"""The collisions of a moment: which there are, and what resolving them leaves."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.collisions import EARLY, resolve
from geomphys.simulated.impulse_accumulation import commit
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

RADIUS, GAP = 0.05, 2e-6


def falling(speed: float, material: str = "wood", across: float = 0.0) -> Stage:
    """A ball that is about to hit the floor."""
    ball = Thing(shape=Sphere(RADIUS), at=(0, 0, RADIUS + GAP), v=(across, 0, -speed), material=material)
    return Stage(Player([ball, floor()], gap=GAP))


@pytest.mark.parametrize(("material", "restitution"), [("wood", 0.3), ("metal", 0.2), ("rubber", 0.5), ("ice", 0.0)])
def test_a_fast_approach_leaves_with_the_pairs_restitution(material: str, restitution: float) -> None:
    stage = falling(2.0, material)
    assert stage.call(resolve, 0.0, 10) == (1, False)
    assert stage.motion["velocity"][0] == pytest.approx([0, 0, 2.0 * restitution], abs=1e-9)


def test_a_slow_one_is_stopped_and_is_no_collision() -> None:
    stage = falling(0.01)
    assert stage.call(resolve, 0.0, 10) == (0, False)
    assert stage.motion["velocity"][0] == pytest.approx([0, 0, 0], abs=1e-9)


def test_beyond_the_bound_nothing_bounces_and_it_is_reported() -> None:
    stage = falling(2.0, "rubber")
    assert stage.call(resolve, 0.0, 0) == (0, True)
    assert stage.motion["velocity"][0, 2] == pytest.approx(0.0, abs=1e-9)


def test_what_separates_is_left_alone() -> None:
    stage = falling(-0.5)
    assert stage.call(resolve, 0.0, 10) == (0, False)
    assert stage.motion["velocity"][0] == pytest.approx([0, 0, 0.5], abs=1e-15)


@pytest.mark.parametrize("across", [0.1, 3.0])
def test_friction_is_within_the_cone_and_never_reverses_the_sliding(across: float) -> None:
    """A solid ball: all sliding is stopped by 2/7 of m v, if μ j allows that."""
    stage = falling(1.0, "wood", across)
    stage.call(resolve, 0.0, 10)
    lost = min(0.3 * 1.3 * 1.0, across * 2.0 / 7.0)
    assert stage.motion["velocity"][0] == pytest.approx([across - lost, 0, 0.3], abs=2e-6)
    contact = stage.motion["velocity"][0, 0] - RADIUS * stage.motion["angular_velocity"][0, 1]
    assert contact >= -1e-9


@pytest.mark.parametrize(("count", "together"), [(7, True), (2, False)])
def test_what_is_about_to_touch_collides_at_once_in_a_heap(count: int, together: bool) -> None:
    """Boxes above a floor, the first of which has arrived; the others would within half of `EARLY`."""
    speed, size = 1.0, 0.02
    boxes = [
        Thing(
            shape=Box((size, size, size)),
            at=(0.1 * k, 0, size + GAP + (0.5 * EARLY * speed if k else 0)),
            v=(0, 0, -speed),
        )
        for k in range(count)
    ]
    stage = Stage(Player([*boxes, floor()], gap=GAP))
    done, _ = stage.call(resolve, 0.0, 20)
    assert done == (count if together else 1)
    after = np.where(np.arange(count) < done, 0.3 * speed, -speed)
    assert stage.motion["velocity"][:count, 2] == pytest.approx(after, abs=1e-9)


def test_momentum_goes_from_one_to_the_other() -> None:
    balls = [Thing(shape=Sphere(RADIUS), at=(0, 0, 0), v=(1, 0, 0), mass=3.0)]
    balls.append(Thing(shape=Sphere(RADIUS), at=(2 * RADIUS + GAP, 0, 0), v=(-1, 0, 0), mass=1.0))
    stage = Stage(Player(balls, gravity=(0, 0, 0), gap=GAP))
    assert stage.call(resolve, 0.0, 10) == (1, False)
    a, b = stage.motion["velocity"][:2, 0]
    assert 3.0 * a + b == pytest.approx(2.0, rel=1e-12)
    assert b - a == pytest.approx(0.3 * 2.0, rel=1e-12)


def test_the_next_of_a_row_is_struck_at_the_same_moment() -> None:
    """Equal balls that touch: the motion goes through to the last, one collision after the other."""
    balls = [Thing(shape=Sphere(RADIUS), at=((2 * RADIUS + GAP) * k, 0, 0), material="rubber") for k in range(3)]
    stage = Stage(Player(balls, gravity=(0, 0, 0), gap=GAP))
    stage.motion["velocity"][0] = (1.0, 0.0, 0.0)
    done, full = stage.call(resolve, 0.0, 50)  # type: ignore[misc]
    assert done >= 2
    assert not full
    speeds = stage.motion["velocity"][:3, 0]
    assert speeds.sum() == pytest.approx(1.0, rel=1e-12)
    assert speeds[2] > 0.85
    assert (np.diff(speeds) > -1e-9).all()


def test_points_that_land_together_share_the_impulse() -> None:
    """A cube that lands flat does not begin to rotate."""
    stage = Stage(Player([Thing(shape=Box((0.05,) * 3), at=(0, 0, 0.05 + GAP), v=(0, 0, -1)), floor()], gap=GAP))
    assert len(stage.contacts["clearance"]) == 4
    stage.call(resolve, 0.0, 10)
    assert stage.motion["velocity"][0] == pytest.approx([0, 0, 0.3], abs=1e-9)
    assert stage.motion["angular_velocity"][0] == pytest.approx([0, 0, 0], abs=1e-9)


def test_impulses_are_handed_over_once() -> None:
    stage = falling(2.0)
    stage.call(resolve, 0.0, 10)
    before = stage.motion["velocity"][0].copy()
    stage.call(commit)
    assert np.array_equal(stage.motion["velocity"][0], before)
