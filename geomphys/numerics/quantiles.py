"""Streaming quantiles in bounded memory: exact up to 16,384 values, within 0.25 % beyond."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

EXACT_CAPACITY = 1 << 14
"""Number of values stored exactly; with more, all are counted in bins."""

MIN_VALUE = 1e-12
"""Smaller values count as zero once values are binned."""

BIN_WIDTH = 0.0025
"""Relative width of a bin, which bounds the relative error."""

_BINS = math.ceil(math.log(1e24) / math.log1p(BIN_WIDTH)) + 1


class Quantiles:
    """Quantiles of a series of finite numbers >= 0.

    The values themselves are stored up to `EXACT_CAPACITY` of them (128 KiB, about what the bins take); from then on they are
    counted in logarithmic bins from 1e-12 to 1e12. A bin that contains an integer is represented by it, so that counts
    are exact. The same values in the same order give the same answers.
    """

    def __init__(self, exact: int = EXACT_CAPACITY) -> None:
        self.count = 0
        self.largest = 0.0
        self.total = 0.0
        self._exact = exact
        self._values = np.empty(min(exact, 1024))
        self._bins: NDArray[np.uint32] | None = None

    def add(self, value: float) -> None:
        """Add a value; raises ValueError for a negative or non-finite one."""
        self.add_all(np.array([value]))

    def add_all(self, values: NDArray[np.float64]) -> None:
        """Add values (n,), in their order; raises ValueError if one is negative or not finite."""
        if not len(values):
            return
        good = np.isfinite(values) & (values >= 0.0)
        if not good.all():
            raise ValueError(f"a series of quantiles takes finite values that are not negative, not {values[~good][0]}")
        count = self.count + len(values)
        if self._bins is None and count > self._exact:
            self._bins = np.zeros(_BINS, dtype=np.uint32)
            self._count_in_bins(self._values[: self.count])
            self._values = np.empty(0)
        if self._bins is not None:
            self._count_in_bins(values)
        else:
            if count > len(self._values):
                self._values = np.resize(self._values, min(max(2 * len(self._values), count), self._exact))
            self._values[self.count : count] = values
        self.count = count
        self.total = float(
            np.add.accumulate(np.concatenate([[self.total], values]))[-1]
        )  # in their order: no other bits
        self.largest = max(self.largest, float(values.max()))

    def _count_in_bins(self, values: NDArray[np.float64]) -> None:
        assert self._bins is not None
        for value in values.tolist():
            self._bins[_bin(value)] += 1

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
        return median(self._values[: self.count])


def median(values: NDArray[np.float64] | Sequence[float]) -> float:
    """Middle of n > 0 numbers, of an even number of them the mean of the two in the middle.

    As `numpy.median`, which at its first call imports the masked arrays of numpy.
    """
    middle = len(values) // 2
    ordered = np.partition(values, [middle - 1, middle])
    return float(ordered[middle] if len(values) % 2 else (ordered[middle - 1] + ordered[middle]) / 2)


def _value(index: int) -> float:
    """Representative value of a bin: an integer if it contains one, else its centre."""
    centre = MIN_VALUE * (1.0 + BIN_WIDTH) ** (index - 0.5)
    integer = float(round(centre))
    return integer if integer > 0.0 and _bin(integer) == index else centre


def _bin(value: float) -> int:
    """Bin of a value: 0 up to `MIN_VALUE`, then one per factor of 1 + `BIN_WIDTH`."""
    if value <= MIN_VALUE:
        return 0
    return min(1 + int(math.log(value / MIN_VALUE) / math.log1p(BIN_WIDTH)), _BINS - 1)
