"""What an acceleration seen from frame to frame says of the next frame."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.simulated.driven_paths import UNEVEN, extrapolated, is_even


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
