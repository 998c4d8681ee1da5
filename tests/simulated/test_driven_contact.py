"""Bodies that follow their path push simulated ones, by their velocity and the mass of their coupling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Cylinder, Sphere
from tests.simulated.scenes import FRICTION, Player, Thing, floor

HERE = (0.0, 0.0, 0.0, 1.0)


def hand(x: float, **more: object) -> Thing:
    """A driven slab whose face towards +x is at x + 0.02."""
    return Thing(shape=Box((0.02, 0.3, 0.3)), role=s.DRIVEN, at=(x, 0, 0.2), coupling_mass=0.4, **more)  # type: ignore[arg-type]


def one_frame(player: Player) -> tuple[np.ndarray, np.ndarray]:
    """Run 1/60 s in which what is driven stays where it is: the poses at its end, and the impulses on each body [N s]."""
    player.end[:], player.driven_impulse[:] = player.poses, 0.0
    player.simulate(1 / 60)
    return player.end.copy(), player.driven_impulse.copy()


def test_a_blocked_hand_pushes_the_ball_with_its_wish_and_is_pushed_back() -> None:
    """The hand stands at the ball and wants to go on: a collision of the coupling's mass with the ball, by (9)."""
    player = Player([Thing(shape=Sphere(0.05), mass=0.2), hand(-0.07 - 2e-6)], gravity=(0, 0, 0))
    player.velocity[1, :3] = (0.6, 0, 0)
    end, impulse = one_frame(player)
    j = 1.3 * 0.6 / (1 / 0.2 + 1 / 0.4)
    assert player.velocity[0, 0] == pytest.approx(j / 0.2, rel=1e-12)
    np.testing.assert_allclose(impulse[1], [-j, 0, 0], rtol=0, atol=1e-14)
    assert end[0, 0] == pytest.approx(j / 0.2 / 60, rel=1e-6)


def test_a_hand_that_meets_two_balls_at_once_has_less_left_for_the_second() -> None:
    balls = [Thing(shape=Sphere(0.05), mass=0.2, at=(0, y, 0)) for y in (-0.1, 0.1)]
    player = Player([*balls, hand(-0.07 - 2e-6)], gravity=(0, 0, 0))
    player.velocity[2, :3] = (0.6, 0, 0)
    _, impulse = one_frame(player)
    first = 1.3 * 0.6 / (1 / 0.2 + 1 / 0.4)
    second = 1.3 * (0.6 - first / 0.4) / (1 / 0.2 + 1 / 0.4)
    np.testing.assert_allclose(sorted(player.velocity[:2, 0]), [second / 0.2, first / 0.2], rtol=1e-9)
    assert impulse[2, 0] == pytest.approx(-first - second, rel=1e-9)


def test_links_of_one_hand_that_meet_a_ball_each_share_the_recoil() -> None:
    """Two fingers move together: what one of them loses to its ball the other has no more when it strikes."""
    balls = [Thing(shape=Sphere(0.05), mass=0.2, at=(0, y, 0)) for y in (-0.1, 0.1)]
    links = [
        Thing(shape=Box((0.02, 0.04, 0.3)), role=s.DRIVEN, at=(-0.07 - 2e-6, y, 0), coupling_mass=0.4)
        for y in (-0.1, 0.1)
    ]
    player = Player([*balls, *links], gravity=(0, 0, 0))
    player.simulation.bodies["tree"][3] = player.simulation.bodies["tree"][2]
    player.velocity[2:, :3] = (0.6, 0, 0)
    _, impulse = one_frame(player)
    first = 1.3 * 0.6 / (1 / 0.2 + 1 / 0.4)
    second = 1.3 * (0.6 - first / 0.4) / (1 / 0.2 + 1 / 0.4)
    np.testing.assert_allclose(sorted(player.velocity[:2, 0]), [second / 0.2, first / 0.2], rtol=1e-9)
    np.testing.assert_allclose(impulse[2:, 0], [-first - second, 0.0], rtol=1e-9)


@pytest.mark.parametrize("sliding", [1.0, 3.0])
def test_a_hand_that_grazes_a_ball_rubs_no_more_than_it_strikes(sliding: float) -> None:
    """Friction is that of the impulse; nothing grips the ball once it flies off."""
    player = Player([Thing(shape=Sphere(0.05), mass=0.2), hand(-0.07 - 2e-6)], gravity=(0, 0, 0))
    player.velocity[1, :3] = (0.6, sliding, 0)
    _, impulse = one_frame(player)
    j = 1.3 * 0.6 / (1 / 0.2 + 1 / 0.4)
    np.testing.assert_allclose(player.velocity[0, :3], [j / 0.2, 0.3 * j / 0.2, 0], rtol=1e-9, atol=1e-12)
    assert player.velocity[0, 5] == pytest.approx(-0.3 * j * 0.05 / (0.4 * 0.2 * 0.05**2), rel=1e-4)
    np.testing.assert_allclose(impulse[1], [-j, -0.3 * j, 0], rtol=1e-9, atol=1e-12)


def test_what_touches_a_hand_is_moved_the_clearance_away_that_the_hand_keeps() -> None:
    """The hand must find no overlap in its next frame, or it would be corrected where it is free."""
    player = Player([Thing(shape=Sphere(0.05), mass=0.2), hand(-0.07)], gravity=(0, 0, 0))
    player.step(1 / 60)
    assert player.poses[0, 0] == pytest.approx(player.gap, rel=0.01)
    assert not player.velocity[0].any()


def test_what_a_hand_squeezes_is_not_pushed_into_what_stands_behind_it() -> None:
    """Where there is no room for a ball between a hand and a wall it is the hand that has to give way."""
    wall = Thing(shape=Box((0.02, 0.3, 0.3)), role=s.FIXED, at=(0.07, 0, 0.2))
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 0.05)), floor(), hand(-0.07 + 1e-3), wall])
    for _ in range(3):
        player.step(1 / 60)
        assert player.poses[0, 0] <= 1e-5
        assert player.poses[0, 2] >= 0.05 - 1e-5


def test_what_the_ball_gains_the_hand_loses() -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0.05, 0.02, 0.01), v=(-1, 0.3, 0)), hand(-0.2)], gravity=(0, 0, 0))
    player.targets[1] = lambda t: (-0.2 + 0.5 * t, 0.0, 0.2, *HERE)
    before = player.scene.bodies.mass[0] * player.velocity[0, :3]
    total = np.zeros(3)
    for _ in range(12):
        player.step(1 / 60)
        total += player.driven_impulse[1]
    assert player.impacts > 0
    gained = player.scene.bodies.mass[0] * player.velocity[0, :3] - before
    np.testing.assert_allclose(gained, -total, rtol=0, atol=1e-13)
    assert player.velocity[0, 0] >= 0.5 - 1e-9


@pytest.mark.parametrize("rate", [30, 60, 120])
def test_a_hand_pushes_a_ball_over_the_table(rate: int) -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 0.05)), floor(), hand(-0.12)])
    player.targets[2] = lambda t: (-0.12 + 0.3 * t, 0.0, 0.2, *HERE)
    for _ in range(rate):
        player.step(1 / rate)
        assert player.overlap() < 1e-5
    assert player.poses[0, 0] >= -0.12 + 0.3 + 0.07 - 1e-5
    assert player.velocity[0, 0] >= 0.3 - 1e-6
    assert player.flags == 0


def test_a_squeezed_ball_stays_where_it_was_and_the_hand_is_not_shot_away() -> None:
    wall = Thing(shape=Box((0.02, 0.3, 0.3)), role=s.FIXED, at=(0.08, 0, 0.2))
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 0.05)), floor(), hand(-0.0905), wall])
    player.run(0.1)
    player.velocity[0, :3] = (-0.5, 0, 0)
    # the ball rolls towards a hand that closes the gap but for a little
    player.targets[2] = lambda _: (-0.0605 - 1e-5, 0.0, 0.2, *HERE)
    for _ in range(4):
        player.step(1 / 60)
        assert player.overlap() < 1e-5
        assert np.abs(player.driven_impulse[2]).max() < 10.0
    assert np.abs(player.velocity[0]).max() < 50.0


def test_an_overlap_at_the_start_is_resolved_without_energy() -> None:
    player = Player([Thing(shape=Sphere(0.05), at=(0, 0, 0.05)), floor(), hand(-0.06)])
    assert player.overlap() == pytest.approx(0.01)
    player.step(1 / 60)
    assert player.overlap() == 0.0
    assert np.linalg.norm(player.velocity[0, :3]) < 0.1


def test_a_moving_panel_of_the_scene_pushes_with_its_own_velocity() -> None:
    panel = Thing(shape=Box((0.02, 0.3, 0.3)), role=s.FIXED, moving=True, at=(-0.12, 0, 0.25))
    player = Player([Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0, 0.05), mass=50.0), floor(), panel])
    player.targets[2] = lambda t: (-0.12 + 0.3 * t, 0.0, 0.25, *HERE)
    for _ in range(60):
        player.step(1 / 60)
        assert player.overlap() < 1e-5
    assert player.poses[0, 0] == pytest.approx(-0.12 + 0.3 + 0.07, abs=1e-4)
    assert player.velocity[0, 0] == pytest.approx(0.3, abs=1e-4)
    assert not player.driven_impulse.any()


def test_a_box_rides_a_lift() -> None:
    lift = Thing(shape=Box((0.3, 0.3, 0.05)), role=s.FIXED, moving=True, at=(0, 0, -0.05))
    player = Player([Thing(shape=Box((0.03, 0.03, 0.03)), at=(0.1, 0, 0.03)), lift])
    player.targets[1] = lambda t: (0, 0, -0.05 + 0.1 * (1 - np.cos(3 * t)), *HERE)
    for _ in range(120):
        player.step(1 / 60)
        assert player.poses[0, 2] - player.poses[1, 2] == pytest.approx(0.08, abs=1e-5)


def test_a_box_turns_with_a_turntable_until_friction_fails() -> None:
    for rate, holds in ((2.0, True), (9.0, False)):
        table = Thing(shape=Cylinder(0.5, 0.05), role=s.FIXED, moving=True, at=(0, 0, -0.05))
        box = Thing(shape=Box((0.03, 0.03, 0.03)), at=(0.2, 0, 0.03), v=(0, 0.2 * rate, 0), w=(0, 0, rate))
        player = Player([box, table])
        player.targets[1] = lambda t, rate=rate: (0, 0, -0.05, *Rotation.from_rotvec([0, 0, rate * t]).as_quat())
        player.run(0.3)
        assert (0.2 * rate**2 < FRICTION[0, 0] * 9.81) == holds
        assert (abs(np.hypot(*player.poses[0, :2]) - 0.2) < 1e-3) == holds


@pytest.mark.parametrize(("squeeze", "holds"), [(0.5, True), (0.02, False)])
def test_two_driven_slabs_hold_a_ball_by_friction_if_they_press_enough(squeeze: float, holds: bool) -> None:
    """Each presses with its mass times the speed it wants, a frame; friction on both sides against the weight."""
    weight, rate = 0.2 * 9.81, 60
    assert (2 * 0.2 * 0.4 * squeeze * rate > weight) == holds
    slabs = [
        Thing(shape=Box((0.02, 0.3, 0.3)), role=s.DRIVEN, at=(x, 0, 0), material="human") for x in (-0.070002, 0.070002)
    ]
    player = Player([Thing(shape=Sphere(0.05), mass=0.2, material="human"), *slabs])
    for _ in range(30):
        player.end[:] = player.poses
        player.velocity[1:, :] = 0.0
        player.velocity[1, 0], player.velocity[2, 0] = squeeze, -squeeze
        player.simulate(1 / rate)
        player.poses[:] = player.end
    assert (player.poses[0, 2] > -0.01) == holds
    assert abs(player.poses[0, 0]) < 1e-4
