"""Quantiles of a long series in bounded memory: exact for sixteen thousand values, within 0.25 % beyond."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

EXACT = 1 << 14
"""Values kept as they are; what comes after them goes into bins."""

SMALLEST = 1e-12
"""Values up to this count as zero once values are binned."""

WIDTH = 0.0025
"""Ratio by which a bin's edges differ: it bounds the relative error."""

_BINS = math.ceil(math.log(1e24) / math.log1p(WIDTH)) + 1


class Quantiles:
    """A series of finite numbers >= 0, of which quantiles are asked.

    The values themselves are kept up to `EXACT` of them (128 KiB, about what the bins take); from then on they are
    counted in logarithmic bins from 1e-12 to 1e12. A bin that holds a whole number stands for that, so that counts come
    out exact. The same values in the same order give the same answers.
    """

    def __init__(self, exact: int = EXACT) -> None:
        self.count = 0
        self.largest = 0.0
        self.total = 0.0
        self._exact = exact
        self._values = np.empty(min(exact, 1024))
        self._bins: NDArray[np.uint32] | None = None

    def add(self, value: float) -> None:
        """Count one more value; raises ValueError for a negative or non-finite one."""
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"a series of quantiles takes finite values that are not negative, not {value}")
        if self._bins is not None:
            self._bins[_bin(value)] += 1
        elif self.count == self._exact:
            self._bins = np.zeros(_BINS, dtype=np.uint32)
            for kept in self._values[: self.count]:
                self._bins[_bin(float(kept))] += 1
            self._values = np.empty(0)
            self._bins[_bin(value)] += 1
        else:
            if self.count == len(self._values):
                self._values = np.resize(self._values, min(2 * self.count, self._exact))
            self._values[self.count] = value
        self.count += 1
        self.total += value
        self.largest = max(self.largest, value)

    def quantile(self, fraction: float) -> float:
        """Return the smallest value that a `fraction` (0 to 1) of the values does not exceed; 0 of an empty series."""
        if self.count == 0:
            return 0.0
        rank = max(math.ceil(fraction * self.count), 1) - 1
        if self._bins is None:
            return float(np.partition(self._values[: self.count], rank)[rank])
        index = int(np.searchsorted(np.cumsum(self._bins), rank, side="right"))
        return 0.0 if index == 0 else min(_value(index), self.largest)

    def median(self) -> float:
        """Return the middle value; of an even number the mean of the two in the middle (the lower one once binned)."""
        if self._bins is not None or self.count == 0:
            return self.quantile(0.5)
        return float(np.median(self._values[: self.count]))


def _value(index: int) -> float:
    """What stands for the values of a bin: a whole number if one lies in it, else its middle."""
    middle = SMALLEST * (1.0 + WIDTH) ** (index - 0.5)
    whole = float(round(middle))
    return whole if whole > 0.0 and _bin(whole) == index else middle


def _bin(value: float) -> int:
    """Bin of a value: 0 up to `SMALLEST`, then one per factor of 1 + `WIDTH`."""
    if value <= SMALLEST:
        return 0
    return min(1 + int(math.log(value / SMALLEST) / math.log1p(WIDTH)), _BINS - 1)
