"""Accumulates differences over frames: largest, root mean square, first and worst frame, curves and peaks.

Memory grows with the number of measured parts, not with the number of frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NONE = -1


@dataclass(frozen=True, kw_only=True)
class Measure:
    """The difference of one part over the frames in which both outputs have it, in the unit of the containing field."""

    max: float
    rms: float
    first_frame: int | None
    """First frame, as `a` counts, in which it is above the tolerance; None: in no frame."""
    worst_frame: int | None
    """Frame of `max`; None if there is no difference."""
    frames: int
    """Frames above the tolerance."""


class DifferenceTable:
    """Accumulates differences >= 0 of named parts, frame by frame."""

    def __init__(self, tolerance: float) -> None:
        self.tolerance = tolerance
        self._rows: dict[str, int] = {}
        self._counts: Ints = np.zeros(0, np.int64)
        self._over: Ints = np.zeros(0, np.int64)
        self._first: Ints = np.zeros(0, np.int64)
        self._worst: Ints = np.zeros(0, np.int64)
        self._largest: Floats = np.zeros(0)
        self._squares: Floats = np.zeros(0)

    def rows(self, names: Sequence[str]) -> Ints:
        """Rows of named parts, to pass to `add`; new names get new rows."""
        new = [name for name in names if name not in self._rows]
        if not new:
            return np.array([self._rows[name] for name in names], np.int64)
        for name in new:
            self._rows[name] = len(self._rows)
        added = len(new)
        self._counts = np.append(self._counts, np.zeros(added, np.int64))
        self._over = np.append(self._over, np.zeros(added, np.int64))
        self._first = np.append(self._first, np.full(added, NONE))
        self._worst = np.append(self._worst, np.full(added, NONE))
        self._largest = np.append(self._largest, np.zeros(added))
        self._squares = np.append(self._squares, np.zeros(added))
        return np.array([self._rows[name] for name in names], np.int64)

    def add(self, rows: Ints, values: Floats, frame: int) -> bool:
        """Take the differences (n,) of a frame; returns whether one is above the tolerance."""
        self._counts[rows] += 1
        if not values.any():
            return False
        self._squares[rows] += values * values
        larger = values > self._largest[rows]
        self._largest[rows[larger]] = values[larger]
        self._worst[rows[larger]] = frame
        over = rows[values > self.tolerance]
        self._over[over] += 1
        self._first[over[self._first[over] == NONE]] = frame
        return len(over) > 0

    def has(self, name: str) -> bool:
        """Whether a difference of that name was added."""
        return name in self._rows and bool(self._counts[self._rows[name]])

    def each(self) -> dict[str, Measure]:
        """Name -> its difference, in the order in which names came."""
        return {name: self._measure(np.array([row])) for name, row in self._rows.items()}

    def overall(self) -> Measure:
        """All parts together; `frames` is the largest over the parts."""
        return self._measure(np.arange(len(self._rows)))

    def _measure(self, rows: Ints) -> Measure:
        if len(rows) == 0:
            return Measure(max=0.0, rms=0.0, first_frame=None, worst_frame=None, frames=0)
        largest = int(rows[np.argmax(self._largest[rows])])
        first_frames = self._first[rows][self._first[rows] != NONE]
        count = int(self._counts[rows].sum())
        return Measure(
            max=float(self._largest[largest]),
            rms=math.sqrt(float(self._squares[rows].sum()) / count) if count else 0.0,
            first_frame=int(first_frames.min()) if len(first_frames) else None,
            worst_frame=int(self._worst[largest]) if self._worst[largest] != NONE else None,
            frames=int(self._over[rows].max()),
        )


class Peak(NamedTuple):
    """A frame with a large difference, and its stored payload."""

    value: float
    frame: int
    time_ns: int
    payload: Any


class Peaks:
    """The frames of the largest values, separated in time."""

    def __init__(self, count: int, min_distance_ns: int) -> None:
        self._count = count
        self._min_distance_ns = min_distance_ns
        self._peaks: list[Peak] = []

    def would_keep(self, value: float, time_ns: int) -> bool:
        """Whether a frame would be kept; check before making an expensive payload."""
        neighbour = self._close_to(time_ns)
        if neighbour is not None:
            return value > self._peaks[neighbour].value
        return value > 0.0 and (len(self._peaks) < self._count or value > min(self._peaks).value)

    def add(self, peak: Peak) -> None:
        """Keep a frame that `would_keep` approved, replacing a smaller one if the table is full."""
        neighbour = self._close_to(peak.time_ns)
        if neighbour is not None:
            self._peaks[neighbour] = peak
        elif len(self._peaks) < self._count:
            self._peaks.append(peak)
        else:
            smallest = min(range(self._count), key=lambda k: self._peaks[k].value)
            self._peaks[smallest] = peak

    def sorted_peaks(self) -> list[Peak]:
        """The frames kept, largest value first."""
        return sorted(self._peaks, key=lambda peak: (-peak.value, peak.frame))

    def _close_to(self, time_ns: int) -> int | None:
        for k, peak in enumerate(self._peaks):
            if abs(peak.time_ns - time_ns) < self._min_distance_ns:
                return k
        return None
