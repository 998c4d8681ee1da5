"""Lag between two streams: the shift at which their changes of speed correlate best, where that is significant and distinct.

Speeds themselves correlate over long times (a hand closes after it has arrived), which says little about clocks. So what is
correlated are the derivatives of the smoothed logarithms of the speeds: starts, stops and impacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MAX_TIME_SHIFT = 0.3
"""s; shifts that are tried."""
RATE = 500.0
"""Hz; speeds are resampled at this rate."""
SMOOTHING = 0.015
"""s; standard deviation of the smoothing."""
INDEPENDENT = 0.03
"""s; samples this far apart count as independent."""
SIGNIFICANT = 6.0
"""Least correlation, in standard deviations of that of independent signals."""
DISTINCT = 2.0
"""By what factor the best shift correlates better than those away from its peak."""
PEAK_WIDTH = 0.06
"""s; how far from the best shift another peak begins."""
BLOCKS = 8
"""Parts of a log of which each in turn is left out: how much the shift changes says how exact it is."""
MAX_ERROR = 0.005
"""s; two standard errors of a shift that is shown, at most."""


class TimeShift(NamedTuple):
    """How much later the second stream is than the first."""

    seconds: float
    correlation: float
    is_shown: bool


def find_time_shift(times: Floats, first: Sequence[Floats], second: Floats) -> TimeShift:
    """Lag of a stream behind another.

    Parameters
    ----------
    times
        (n,) s, increasing.
    first
        Speeds (n,) of the first stream, of any units: linear and angular, say. What correlates better counts more.
    second
        (n,) speed of the second stream.
    """
    if len(times) < 3 or times[-1] - times[0] < 4 * MAX_TIME_SHIFT:
        return TimeShift(0.0, 0.0, False)
    even = np.arange(times[0], times[-1], 1.0 / RATE)
    other = _changes(np.interp(even, times, second))
    signals = [_changes(np.interp(even, times, speed)) for speed in first]
    signals = [s for s in signals if s.any()]
    if not signals or not other.any():
        return TimeShift(0.0, 0.0, False)
    reach = int(MAX_TIME_SHIFT * RATE)
    shifts = np.arange(-reach, reach + 1)
    found = _correlations(signals, other, shifts)
    best = int(found.argmax())
    if not 0 < best < len(shifts) - 1:
        return TimeShift(shifts[best] / RATE, float(found[best]), False)
    away = np.abs(shifts - shifts[best]) > PEAK_WIDTH * RATE
    threshold = SIGNIFICANT / np.sqrt((times[-1] - times[0]) / INDEPENDENT)
    is_shown = found[best] > max(threshold, DISTINCT * found[away].max(initial=0.0))
    shift = _peak(shifts, found)
    if is_shown:
        near = shifts[~away]
        parts = np.array_split(np.arange(len(other)), BLOCKS)
        without = [_peak(near, _correlations([_blank(s, part) for s in signals], other, near)) for part in parts]
        error = np.sqrt((BLOCKS - 1) * np.var(without))  # jackknife (Efron 1982)
        is_shown = bool(2.0 * error <= MAX_ERROR * RATE)
    return TimeShift(float(shift / RATE), float(found[best]), bool(is_shown))


def _correlations(signals: Sequence[Floats], other: Floats, shifts: NDArray[np.int64]) -> Floats:
    """Correlation of signals together with another at each shift: each has the weight of its largest correlation squared."""
    each = np.array([[_correlation(s, other, int(k)) for k in shifts] for s in signals])
    weights = np.maximum(each.max(axis=1), 1e-9) ** 2
    together: Floats = weights @ each / np.linalg.norm(weights)
    return together


def _peak(shifts: NDArray[np.int64], found: Floats) -> float:
    """Shift of the largest value, between samples by a parabola."""
    best = int(found.argmax())
    if not 0 < best < len(shifts) - 1:
        return float(shifts[best])
    low, middle, high = found[best - 1 : best + 2]
    curvature = low - 2.0 * middle + high
    return float(shifts[best] + (0.5 * (low - high) / curvature if curvature < 0 else 0.0))


def _blank(signal: Floats, part: NDArray[np.int64]) -> Floats:
    """A signal with zeros in a part."""
    blank = signal.copy()
    blank[part] = 0.0
    return blank


def _changes(speed: Floats) -> Floats:
    """Derivative of the smoothed logarithm of a speed, of unit variance; zeros for one that is constant."""
    from scipy.ndimage import gaussian_filter1d

    floor = 0.1 * float(np.median(speed)) + 1e-9 * max(float(speed.max(initial=0.0)), 1e-9)
    change = np.diff(gaussian_filter1d(np.log(speed + floor), SMOOTHING * RATE))
    deviation = float(change.std())
    unit: Floats = change / deviation if deviation > 1e-12 else np.zeros_like(change)
    return unit


def _correlation(a: Floats, b: Floats, shift: int) -> float:
    """Mean product of a(t) and b(t + shift) where both are known."""
    x, y = (a[: len(a) - shift], b[shift:]) if shift >= 0 else (a[-shift:], b[: len(b) + shift])
    return float(np.mean(x * y))
