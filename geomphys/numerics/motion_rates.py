"""Speeds and jerks of bodies by divided differences, frame by frame or many frames at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MAX_STEP_S = 0.2
"""s; no speed or jerk is computed across longer gaps between frames."""

ORDER = 3  # of the highest derivative


class MotionMeter:
    """Speeds and jerks of points by Newton's divided differences over the last frames.

    A derivative of order n is n! times the divided difference of the last n + 1 positions, which need not be evenly spaced
    in time.
    """

    def __init__(self) -> None:
        self._times = np.zeros(0, np.int64)
        self._positions = np.zeros((0, 0, 0, 3))

    def add(self, times: Ints, positions: Floats) -> tuple[Floats, Floats]:
        """Add n frames.

        Parameters
        ----------
        times
            (n,) ns.
        positions
            (n, k, b, 3) m: k kinds of positions of b bodies. A change of k or b discards the history.

        Returns
        -------
        tuple
            (speeds (n, k) [m/s], jerks (n, k) [m/s³]), the maximum over the bodies; NaN where there are too few frames
            without a gap (or no bodies).
        """
        if self._positions.shape[1:] != positions.shape[1:]:
            self._times, self._positions = times[:0], positions[:0]
        history = len(self._times)
        times, positions = np.concatenate([self._times, times]), np.concatenate([self._positions, positions])
        self._times, self._positions = times[-ORDER:], positions[-ORDER:]
        steps = np.diff(times, prepend=times[:1]) * 1e-9
        valid = (steps > 0.0) & (steps <= MAX_STEP_S)
        speeds, gap_free = np.full(positions.shape[:2], np.nan), valid
        jerks, differences, factor = speeds.copy(), positions, 1.0
        for order in range(1, ORDER + 1):
            span = (times[order:] - times[:-order]) * 1e-9
            with np.errstate(divide="ignore", invalid="ignore"):  # equal times: no derivative
                differences = np.diff(differences, axis=0)
                differences /= span[:, None, None, None]
            factor *= order
            found = speeds if order == 1 else jerks
            if order in (1, ORDER) and positions.shape[2]:
                rows = np.flatnonzero(gap_free[order:])
                vectors = differences if len(rows) == len(differences) else differences[rows]
                found[rows + order] = factor * np.sqrt(np.einsum("nkbj,nkbj->nkb", vectors, vectors).max(axis=2))
            gap_free = gap_free & np.concatenate([[False] * order, valid[:-order]]) if len(times) > order else gap_free
        return speeds[history:], jerks[history:]


def third_derivatives(times: Ints, values: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Third derivatives by divided differences of four rows each.

    Parameters
    ----------
    times
        (n,) ns, n >= 4.
    values
        (n, ...)

    Returns
    -------
    tuple
        (n - 3, ...) derivatives per s³ at the last of each four rows, and (n - 3,) whether there is no gap among them
        (no step backwards, of zero, or of more than `MAX_STEP_S`); across one the derivative is void.
    """
    steps = np.diff(times) * 1e-9
    valid = (steps > 0.0) & (steps <= MAX_STEP_S)
    differences, factor = np.asarray(values, np.float64), 1.0
    for order in range(1, ORDER + 1):
        span = (times[order:] - times[:-order]) * 1e-9
        span = np.where(span > 0.0, span, 1.0).reshape(-1, *[1] * (differences.ndim - 1))
        differences = np.diff(differences, axis=0) / span
        factor *= order
    return factor * differences, valid[2:] & valid[1:-1] & valid[:-2]
