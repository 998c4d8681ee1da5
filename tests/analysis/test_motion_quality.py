"""Measures of sequences, on motions whose answers are known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geomphys.analysis.motion_quality import DEFAULT_REACH_M, MotionFigures, MotionQuality

RATE_HZ = 100.0


def poses(x: np.ndarray) -> np.ndarray:
    """(n, 1, 7) of one link that goes along x and does not rotate."""
    rows = np.zeros((len(x), 1, 7))
    rows[:, 0, 0], rows[:, 0, 6] = x, 1.0
    return rows


def times(count: int) -> np.ndarray:
    return 10**18 + np.arange(count) * round(1e9 / RATE_HZ)


def figures_of(
    recorded: np.ndarray, corrected: np.ndarray, piece: int | None = None, **more: np.ndarray
) -> MotionFigures:
    quality, t = MotionQuality(np.zeros(recorded.shape[1], np.int64)), times(len(recorded))
    for k in range(0, len(t), piece or len(t)):
        rows = slice(k, k + (piece or len(t)))
        quality.add(t[rows], recorded[rows], corrected[rows], **{name: values[rows] for name, values in more.items()})
    return quality.figures()


def test_a_step_of_the_offset_is_a_spike_and_a_step_of_the_recording_is_none() -> None:
    x = np.zeros(40)
    jumped = x + 0.004 * (np.arange(40) >= 20)
    found = figures_of(poses(x), poses(jumped))
    assert (found.spikes, found.spike_row) == (1, 20)
    assert found.spike_max_m == pytest.approx(0.004)
    assert figures_of(poses(jumped), poses(jumped)).spikes == 0
    assert figures_of(poses(x), poses(0.7 * jumped)).spikes == 0  # below 3 mm
    moving = 0.0015 * np.arange(40)  # 1.5 mm a frame: 4 mm are less than three times that
    assert figures_of(poses(moving), poses(moving + jumped)).spikes == 0


def test_a_rotation_about_the_origin_of_a_link_is_seen() -> None:
    recorded = poses(np.zeros(8))
    turned = recorded.copy()
    turned[4:, 0, 5:] = math.sin(0.25), math.cos(0.25)  # 0.5 rad about z
    found = figures_of(recorded, turned)
    assert found.spikes == 1
    assert found.spike_max_m == pytest.approx(2 * DEFAULT_REACH_M * math.sin(0.25))


def test_jerk_of_a_scaled_motion_is_in_the_ratio_of_its_scale() -> None:
    t = np.arange(200) / RATE_HZ
    x = 0.1 * np.sin(3.0 * t)
    found = figures_of(poses(x), poses(1.7 * x), recorded_angles=x[:, None], corrected_angles=0.3 * x[:, None])
    assert found.jerk_rms_ratio == pytest.approx(1.7, rel=1e-4)  # times are whole ns, positions have rounding
    assert found.jerk_p99_ratio == pytest.approx(1.7, rel=1e-4)
    assert found.joint_jerk_rms_ratio == pytest.approx(0.3, rel=1e-4)
    assert found.joint_jerk_p99_ratio == pytest.approx(0.3, rel=1e-4)


def test_frames_without_a_correction_do_not_count() -> None:
    t = np.arange(400) / RATE_HZ
    x = np.where(t < 2.0, 5.0, 0.1) * np.sin(3.0 * t)
    corrected = np.where(t < 2.1, x, 0.2 * np.sin(3.0 * t))  # only after the lively half
    found = figures_of(poses(x[205:]), poses(corrected[205:]))
    assert figures_of(poses(x), poses(corrected)).jerk_rms_ratio == pytest.approx(found.jerk_rms_ratio, rel=1e-9)
    assert figures_of(poses(x), poses(x)).jerk_rms_ratio is None


def test_pieces_of_any_length_give_the_same() -> None:
    rng = np.random.default_rng(4)
    recorded, corrected = (poses(np.cumsum(rng.normal(0.0, s, 100))) for s in (0.001, 0.003))
    depths, angles = rng.uniform(0.0, 0.004, 100), rng.normal(0.0, 1.0, (100, 3))
    more = {"depths": depths, "recorded_angles": angles, "corrected_angles": 2.0 * angles}
    whole = figures_of(recorded, corrected, **more)
    assert whole.spikes > 3
    assert whole.deep_share == np.count_nonzero(depths > 2e-3) / 100
    for piece in (1, 2, 7, 99):
        found = figures_of(recorded, corrected, piece, **more)
        for name, value in vars(whole).items():
            assert getattr(found, name) == pytest.approx(value, rel=1e-12), name


def test_each_tree_is_judged_by_its_own_motion() -> None:
    still, fast = poses(np.zeros(10)), poses(0.01 * np.arange(10))
    recorded = np.concatenate([still, fast], axis=1)
    corrected = recorded.copy()
    corrected[5:, 0, 0] += 0.004
    quality = MotionQuality(np.array([0, 1]))
    quality.add(times(10), recorded, corrected)
    assert quality.figures().spikes == 1
    quality = MotionQuality(np.array([0, 0]))
    quality.add(times(10), recorded, corrected)
    assert quality.figures().spikes == 0
