"""A curve over many frames in few points: mean and largest of bins of equally many frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CAPACITY = 6000
"""Maximum number of points of a curve; each is the maximum (of times the mean) over its frames."""


class BinnedCurve:
    """A curve in at most `capacity` bins, an even number, of equally many frames: the first frame, mean and largest of each."""

    def __init__(self, capacity: int = CAPACITY) -> None:
        self.stride = 1
        self._capacity = capacity
        self._last_count = 0
        self._frames: list[int] = []
        self._sums: list[float] = []
        self._maxima: list[float] = []

    def add(self, frame: int, value: float) -> None:
        """Take the value of the next frame, and its number."""
        if self._sums and self._last_count < self.stride:
            self._last_count += 1
            self._sums[-1] += value
            self._maxima[-1] = max(self._maxima[-1], value)
            return
        if len(self._sums) == self._capacity:
            self._frames = self._frames[::2]
            self._sums = [a + b for a, b in zip(self._sums[::2], self._sums[1::2], strict=True)]
            self._maxima = [max(a, b) for a, b in zip(self._maxima[::2], self._maxima[1::2], strict=True)]
            self.stride *= 2
        self._frames.append(frame)
        self._sums.append(value)
        self._maxima.append(value)
        self._last_count = 1

    def frames(self) -> Ints:
        """(n,) number of the first frame of each bin."""
        return np.array(self._frames, np.int64)

    def maxima(self) -> tuple[Ints, Floats]:
        """First frame (n,) and largest value (n,) of each bin."""
        return self.frames(), self.maximum()

    def mean(self) -> Floats:
        """(n,) mean of each bin."""
        counts = np.full(len(self._sums), self.stride)
        counts[-1] = self._last_count
        means: Floats = np.array(self._sums) / counts
        return means

    def maximum(self) -> Floats:
        """(n,) largest of each bin."""
        return np.array(self._maxima)
