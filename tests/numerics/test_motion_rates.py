"""Speeds and jerks: exact for cubics on uneven times, the same in one go and frame by frame, none across gaps."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.numerics.motion_rates import MAX_STEP_S, MotionMeter

TIMES = np.cumsum([5, 10, 12, 9, 30, 10, 11]) * 1_000_000 + 10**18


def cubic(t: np.ndarray) -> np.ndarray:
    """(n, 1, 2, 3) places of two bodies, the first with jerk (6, 12, 0)."""
    t = (t - TIMES[0]) * 1e-9
    first = np.stack([t**3 - 2 * t, 2 * t**3 + t**2, 0 * t + 4], axis=-1)
    return np.stack([first, 0.5 * first], axis=1)[:, None]


def test_the_jerk_of_a_cubic_is_exact_at_uneven_times():
    speeds, jerks = MotionMeter().add(TIMES, cubic(TIMES))
    assert np.isnan(speeds[0]).all()
    assert np.isnan(jerks[:3]).all()
    assert jerks[3:, 0] == pytest.approx(np.hypot(6, 12), rel=1e-6)
    dt = np.diff(TIMES) * 1e-9
    assert speeds[1:, 0] == pytest.approx(np.linalg.norm(np.diff(cubic(TIMES)[:, 0, 0], axis=0), axis=1) / dt)


def test_frame_by_frame_is_the_same_as_in_one_go():
    whole, meter = MotionMeter().add(TIMES, cubic(TIMES)), MotionMeter()
    parts = [meter.add(TIMES[k : k + 1], cubic(TIMES[k : k + 1])) for k in range(len(TIMES))]
    for kind in range(2):
        assert np.array_equal(np.concatenate([p[kind] for p in parts]), whole[kind], equal_nan=True)


@pytest.mark.parametrize("step", [0, -5_000_000, round(1.01e9 * MAX_STEP_S)])
def test_no_derivative_is_taken_across_a_gap(step):
    times = TIMES.copy()
    times[4:] += step - (TIMES[4] - TIMES[3])
    speeds, jerks = MotionMeter().add(times, cubic(TIMES))
    assert np.isnan(speeds[:, 0]).tolist() == [True, False, False, False, True, False, False]
    assert np.isnan(jerks[:, 0]).tolist() == [True, True, True, False, True, True, True]


def test_other_bodies_begin_anew():
    meter = MotionMeter()
    meter.add(TIMES[:4], cubic(TIMES[:4]))
    assert np.isnan(meter.add(TIMES[4:5], cubic(TIMES[4:5])[:, :, :1])[0]).all()
