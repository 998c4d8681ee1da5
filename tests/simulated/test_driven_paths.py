"""What an acceleration seen from frame to frame says of the next frame, and where bodies with prescribed poses are within it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from geomphys.simulated.driven_paths import UNEVEN, extrapolated, fit_paths, follow_paths, is_even
from tests.simulated.scenes import Player, Thing


@pytest.mark.parametrize(
    ("last", "even"),
    [
        (0.01, True),
        (0.01 * 0.99 * UNEVEN, True),
        (0.01 / (0.99 * UNEVEN), True),
        (0.01 * 1.01 * UNEVEN, False),
        (0.0, False),
    ],
)
def test_frames_of_about_the_same_length_tell_of_an_acceleration(last: float, even: bool) -> None:
    assert is_even(0.01, last) == even


def test_an_even_acceleration_goes_on() -> None:
    assert extrapolated((1.0, -2.0, 3.0), (1.0, -2.0, 3.0)) == pytest.approx((1.0, -2.0, 3.0))


def test_one_that_grows_grows_on_by_half_a_frame() -> None:
    assert extrapolated((1.2, 0.0, 0.0), (1.0, 0.0, 0.0)) == pytest.approx((1.3, 0.0, 0.0))


@pytest.mark.parametrize(
    ("now", "before"),
    [((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))],
)
def test_one_that_turned_round_or_just_began_is_none(now: tuple[float, ...], before: tuple[float, ...]) -> None:
    assert extrapolated(now, before) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("seed", range(5))
def test_it_is_never_more_than_twice_the_smaller_and_never_opposite(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(200):
        now, before = (rng.normal(size=3) * 10.0 ** rng.uniform(-3, 3) for _ in range(2))
        then = np.array(extrapolated(tuple(now.tolist()), tuple(before.tolist())))
        smaller = min(np.linalg.norm(now), np.linalg.norm(before))
        assert np.linalg.norm(then) <= 2.0 * smaller * (1.0 + 1e-12)
        assert then @ now >= 0.0


def test_a_tray_that_is_evenly_accelerated_is_where_it_was_recorded_within_a_frame_too() -> None:
    """Along a line and about an axis: x0 + v t + a t²/2 at all times, of which only those of the frames are known."""
    dt, a, b = 1.0 / 60.0, np.array([2.0, -1.0, 0.5]), np.array([0.0, 0.0, 3.0])

    def at(t: float) -> np.ndarray:
        place = np.array([0.1, 0.2, 0.3]) * t + 0.5 * t * t * a
        return np.array([*place, *Rotation.from_rotvec((0.4 * t + 1.5 * t * t) * b / 3.0).as_quat()])

    tray = Thing(shape=Box((0.3, 0.3, 0.05)), role=s.FIXED, moving=True)
    player = Player([Thing(shape=Box((0.03, 0.03, 0.03)), at=(0.0, 0.0, 5.0)), tray])
    player.targets[1] = at
    for _ in range(4):
        player.step(dt)
    t0, end, found = player.time, player.poses.copy(), player.poses.copy()
    end[1] = at(t0 + dt)
    fit_paths(player.packed, end, dt)
    for part in (0.0, 0.2, 0.5, 1.0):
        follow_paths(player.packed, part * dt, found)
        expected = at(t0 + part * dt)
        assert found[1, :3] == pytest.approx(expected[:3], abs=1e-12)
        assert (Rotation.from_quat(found[1, 3:]) * Rotation.from_quat(expected[3:]).inv()).magnitude() <= 1e-12
        assert found[0].tolist() == player.poses[0].tolist()
