"""Streams of pose and joint samples, resampled at frame times: interpolated over short gaps, held over long ones.

A stream accepts samples in any order and is sampled at frames in order of time. It stores samples after the last frame
and the last good value, so its memory does not grow with the log.

Rules for a frame at t between the good samples a (at or before t) and b (the next one):

- a is at t: the value of a, to the bit;
- b - a <= max_gap: interpolated, v = a + w (b - a) with w = (t - a) / (b - a); rotations by slerp, and angles of continuous
  joints (`JointStream.wraps`) the short way round;
- otherwise, or without a b: the value of a, and the frame is held;
- without an a: the value of b, and the frame is held and *before the first*;
- the frame clock's own stream with only a bad sample at t (`holds_bad_samples`): the value of a, held.

Of samples at the same time the first good one counts. A constant stream (a single sample in the whole log, or static
transforms) has the value of the last sample at or before t, else of the first, and is never held.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.recording.pose_tuples import PoseTuple, interpolate_poses
from geomphys.recording.stamps import NEVER, count_equal

Floats = NDArray[np.float64]

QUATERNION_TOLERANCE = 1e-2
"""A quaternion whose norm differs from 1 by more is a bad sample."""
UNIT_NORM_TOLERANCE = 1e-9
"""A quaternion whose norm differs from 1 by no more is unchanged to the bit; otherwise it is normalised."""
VALUE_LIMIT = 1e9
"""A coordinate or angle beyond this (m or rad) is a bad sample."""


class Gap(NamedTuple):
    """An interval between two good samples of a stream; ns."""

    start: int = 0
    length: int = 0


class StreamValue(NamedTuple):
    """A stream's value at a frame."""

    value: Any
    held: bool
    before_first: bool  # the stream has not begun


def validated_pose(value: PoseTuple) -> PoseTuple | None:
    """The pose with a unit quaternion; None if it is not finite or has no unit quaternion.

    A quaternion within `UNIT_NORM_TOLERANCE` of the norm 1 is returned as it is.
    """
    x, y, z, a, b, c, d = value
    norm = math.sqrt(a * a + b * b + c * c + d * d) if abs(a) + abs(b) + abs(c) + abs(d) < 8 else math.inf
    if not abs(norm - 1) < QUATERNION_TOLERANCE or not abs(x) + abs(y) + abs(z) < VALUE_LIMIT:
        return None
    return value if abs(norm - 1) <= UNIT_NORM_TOLERANCE else (x, y, z, a / norm, b / norm, c / norm, d / norm)


def interpolate_angles(a: Floats, b: Floats, w: Floats | float, wraps: NDArray[np.bool_]) -> Floats:
    """Values between a (w = 0) and b (w = 1), (m,); where `wraps` is set by the short way round the circle.

    There a result counts from the nearer of the two, so that it stays on the side of a cut at half a turn on which that
    one was recorded.
    """
    delta = b - a
    value: Floats = a + w * delta
    wrapped = wraps & (np.abs(delta) > np.pi)
    if wrapped.any():
        shortest = np.remainder(delta + np.pi, 2 * np.pi) - np.pi
        value = np.where(wrapped, np.where(np.less_equal(w, 0.5), a + w * shortest, b - (1 - w) * shortest), value)
    return value


class PoseStream:
    """Poses over time. Times are ns; `max_gap` ns."""

    def __init__(self, max_gap: int, *, constant: bool = False, holds_bad_samples: bool = False) -> None:
        self.max_gap, self.constant, self.holds_bad_samples = max_gap, constant, holds_bad_samples
        self.times: list[int] = []  # ahead of the last frame
        self.values: list[PoseTuple | None] = []  # None: a bad sample
        self.last_time = NEVER  # of the last good sample at or before the last frame
        self.last: PoseTuple | None = None
        self.bad_time = NEVER  # of the last bad sample at or before the last frame
        self.first: PoseTuple | None = None  # value before the first sample, if known
        self.frame_time = NEVER
        self.bad = self.duplicates = self.gaps = self.held_frames = 0
        self.longest_gap = Gap()
        self.first_sample_time = NEVER  # time of the first good sample passed

    def add(self, time: int, value: PoseTuple) -> None:
        """Add a sample of any time."""
        good = validated_pose(value)
        if good is None:
            self.bad += 1
        if time <= self.frame_time:
            if time == self.last_time:
                self.duplicates += 1
            elif good is not None and time > self.last_time:
                self._move_past(time, good)
            return
        times = self.times
        at = len(times) if not times or time > times[-1] else bisect_left(times, time)
        if at < len(times) and times[at] == time:
            self.duplicates += 1
            if self.values[at] is None:
                self.values[at] = good
            return
        times.insert(at, time)
        self.values.insert(at, good)

    def goes_on(self, time: int) -> bool:
        """Whether its first value is known, and a sample of that time [ns] is its latest."""
        begins = self.last is not None or (bool(self.values) and self.values[0] is not None)
        return begins and time > (self.times[-1] if self.times else self.frame_time)

    def extend(self, times: list[int], values: list[PoseTuple]) -> None:
        """Add samples of increasing times, for the first of which it `goes_on`; all good."""
        self.times += times
        self.values += values

    def samples_at(self, times: Sequence[int]) -> int:
        """How many of the next frames, at times [ns], are each at the time of the next sample, a good one."""
        return count_equal(times, self.times, (value is not None for value in self.values))

    def take(self, count: int) -> list[PoseTuple]:
        """The values at so many frames, which `samples_at` counted."""
        values = [value for value in self.values[:count] if value is not None]
        self.advance(self.times[count - 1])
        return values

    def _move_past(self, time: int, value: PoseTuple | None) -> None:
        """Move past a sample."""
        if value is None:
            self.bad_time = time
            return
        if self.last is not None:
            gap = time - self.last_time
            if gap > self.longest_gap.length:
                self.longest_gap = Gap(self.last_time, gap)
            self.gaps += gap > self.max_gap
        else:
            self.first_sample_time = time
        self.last_time, self.last = time, value

    def advance(self, time: int) -> None:
        """Discard samples up to a time [ns]; no earlier frame may be asked for afterwards."""
        self.frame_time = time
        passed = 0
        for when in self.times:
            if when > time:
                break
            self._move_past(when, self.values[passed])
            passed += 1
        if passed:
            del self.times[:passed], self.values[:passed]

    def at(self, time: int) -> StreamValue:
        """Value at a frame time [ns]; times must not decrease. The value is None if there is no good sample."""
        self.advance(time)
        sampled = self._sample(time)
        self.held_frames += sampled.held
        return sampled

    def _sample(self, time: int) -> StreamValue:
        if self.last_time == time:
            return StreamValue(self.last, False, False)
        if self.last is None:
            upcoming = next((v for v in self.values if v is not None), None)
            value = self.first if upcoming is None else upcoming
            return StreamValue(value, not self.constant, not self.constant)
        if self.constant:
            return StreamValue(self.last, False, False)
        if self.holds_bad_samples and self.bad_time == time:
            return StreamValue(self.last, True, False)
        for when, value in zip(self.times, self.values, strict=True):
            gap = when - self.last_time
            if gap > self.max_gap:
                break
            if value is not None:
                return StreamValue(interpolate_poses(self.last, value, (time - self.last_time) / gap), False, False)
        return StreamValue(self.last, True, False)


class JointStream:
    """Values of m joints over time, each a stream of its own that may be missing from a sample (NaN).

    `bad` samples are those that the log has as NaN or beyond `VALUE_LIMIT`; a joint that is not in a message is only
    missing. Times are ns; `max_gap` ns.
    """

    def __init__(
        self,
        joints: int,
        max_gap: int,
        *,
        constant: bool = False,
        holds_bad_samples: bool = False,
        wraps: NDArray[np.bool_] | None = None,
    ) -> None:
        """`wraps` (m,): continuous joints, whose angles [rad] are interpolated the short way round the circle."""
        self.max_gap, self.holds_bad_samples = max_gap, holds_bad_samples
        self.constant = np.full(joints, constant)
        self.wraps = np.zeros(joints, dtype=bool) if wraps is None else wraps
        self.times: list[int] = []  # ahead of the last frame
        self.rows: list[Floats] = []  # (m,) NaN where missing
        self.full: list[bool] = []
        self.bad_masks: list[NDArray[np.bool_] | None] = []  # (m,) bad samples of the log
        self.last_time = np.full(joints, NEVER, dtype=np.int64)
        self.last = np.zeros(joints)
        self.first = np.full(joints, np.nan)
        self.row_time = NEVER  # of the last row passed, and whether it was full
        self.row_full = False
        self.row_bad: NDArray[np.bool_] | None = None
        self.frame_time = NEVER
        self.held_frames = np.zeros(joints, dtype=np.int64)
        self.gaps = np.zeros(joints, dtype=np.int64)
        self.longest_gap = np.zeros(joints, dtype=np.int64)
        self.longest_gap_start = np.zeros(joints, dtype=np.int64)  # time at which that gap begins
        self.first_sample_time = np.full(joints, NEVER, dtype=np.int64)  # of the first good sample passed
        self.bad_samples = np.zeros(joints, dtype=np.int64)
        self.duplicates = 0
        self._least_longest_gap = 0  # no joint's longest gap is shorter

    def add(self, time: int, row: Floats, bad: NDArray[np.bool_] | None = None, *, full: bool = False) -> None:
        """Add a sample of any time: `row` (m,) with NaN where a joint is missing, `bad` (m,) where it is bad.

        `full`: it is known that no joint is missing.
        """
        if bad is not None:
            self.bad_samples += bad
        if time <= self.frame_time:
            self._add_late(time, row)
            return
        times = self.times
        at = len(times) if not times or time > times[-1] else bisect_left(times, time)
        if at < len(times) and times[at] == time:
            self._merge(at, row, bad)
            return
        times.insert(at, time)
        self.rows.insert(at, row)
        self.full.insert(at, full or not bool(np.isnan(row).any()))
        self.bad_masks.insert(at, bad)

    def goes_on(self, time: int) -> bool:
        """Whether the first values of all joints are known, and a sample of that time [ns] is its latest."""
        begins = self.full[0] if self.times else self.row_full
        return begins and time > (self.times[-1] if self.times else self.frame_time)

    def extend(self, times: list[int], rows: Floats) -> None:
        """Add samples (n, m) in which no joint is missing, of increasing times, for the first of which it `goes_on`."""
        self.times += times
        self.rows.extend(rows)
        self.full += [True] * len(times)
        self.bad_masks += [None] * len(times)

    def samples_at(self, times: Sequence[int]) -> int:
        """How many of the next frames, at times [ns], are each at the time of the next sample, in which no joint is missing."""
        return count_equal(times, self.times, self.full)

    def take(self, count: int) -> Floats:
        """The values (count, m) at so many frames, which `samples_at` counted."""
        rows = np.array(self.rows[:count])
        self.advance(self.times[count - 1])
        return rows

    def _merge(self, at: int, row: Floats, bad: NDArray[np.bool_] | None) -> None:
        """Merge a second sample of the same time: it only fills joints that the first lacks."""
        old = self.rows[at]
        missing = np.isnan(old)
        present = ~np.isnan(row)
        if not (missing & present).any() or (~missing & present).any():
            self.duplicates += 1
        merged = np.where(missing, row, old)
        self.rows[at] = merged
        self.full[at] = not bool(np.isnan(merged).any())
        both = [b for b in (self.bad_masks[at], bad) if b is not None]
        if both:
            self.bad_masks[at] = np.logical_or.reduce(both) & np.isnan(merged)

    def _add_late(self, time: int, row: Floats) -> None:
        """Add a sample from before the last frame: it can only become the last good value."""
        present = ~np.isnan(row)
        newer = present & (time > self.last_time)
        if (present & (time == self.last_time)).any():
            self.duplicates += 1
        if newer.any():
            self.last = np.where(newer, row, self.last)
            self.last_time[newer] = time
            self.first_sample_time[newer & (self.first_sample_time == NEVER)] = time
            self.row_full = False

    def _move_past(self, k: int) -> None:
        """Make row k the last sample."""
        time, row = self.times[k], self.rows[k]
        if self.full[k]:
            if self.row_full:
                gap = time - self.row_time
                if gap > self.max_gap:
                    self.gaps += 1
                if gap > self._least_longest_gap:
                    longer = gap > self.longest_gap
                    self.longest_gap[longer], self.longest_gap_start[longer] = gap, self.row_time
                    self._least_longest_gap = gap
            else:
                self._count_gaps(time, np.ones(len(row), dtype=bool))
            self.last = row
            self.last_time.fill(time)
        else:
            present = ~np.isnan(row)
            self._count_gaps(time, present)
            self.last = np.where(present, row, self.last)
            self.last_time[present] = time
        self.row_time, self.row_full, self.row_bad = time, self.full[k], self.bad_masks[k]

    def _count_gaps(self, time: int, present: NDArray[np.bool_]) -> None:
        started = self.last_time != NEVER
        self.first_sample_time[present & ~started] = time
        gap = np.where(present & started, time - self.last_time, 0)
        self.gaps += gap > self.max_gap
        longer = gap > self.longest_gap
        self.longest_gap[longer], self.longest_gap_start[longer] = gap[longer], self.last_time[longer]

    def advance(self, time: int) -> None:
        """Discard samples up to a time [ns]; no earlier frame may be asked for afterwards."""
        self.frame_time = time
        passed = 0
        for when in self.times:
            if when > time:
                break
            self._move_past(passed)
            passed += 1
        if passed:
            del self.times[:passed], self.rows[:passed], self.full[:passed], self.bad_masks[:passed]

    def at(self, time: int) -> StreamValue:
        """Values (m,) at a frame time [ns], read-only; times must not decrease.

        NaN for a joint of which nothing is known at all.
        """
        self.advance(time)
        if self.row_full:
            if self.row_time == time:
                return StreamValue(self.last, False, False)
            if self.times and self.full[0]:
                gap = self.times[0] - self.row_time
                if gap <= self.max_gap:
                    w = (time - self.row_time) / gap
                    return StreamValue(interpolate_angles(self.last, self.rows[0], w, self.wraps), False, False)
        return self._sample_each_joint(time)

    def _sample_each_joint(self, time: int) -> StreamValue:
        """Values (m,) where a joint is missing from a sample, or a gap is too long."""
        started = self.last_time != NEVER
        value = np.where(started, self.last, self._first_values(started))
        undecided = started & (self.last_time != time) & ~self.constant
        if self.holds_bad_samples and self.row_time == time and self.row_bad is not None:
            frozen = undecided & self.row_bad
        else:
            frozen = np.zeros_like(undecided)
        waiting = undecided & ~frozen
        for when, row in zip(self.times, self.rows, strict=True):
            if not waiting.any():
                break
            gap = when - self.last_time
            waiting &= gap <= self.max_gap
            found = waiting & ~np.isnan(row)
            if found.any():
                w = (time - self.last_time[found]) / gap[found]
                value[found] = interpolate_angles(self.last[found], row[found], w, self.wraps[found])
                waiting &= ~found
                undecided &= ~found
        before_first = ~started & ~self.constant
        held = undecided | before_first
        self.held_frames += held
        return StreamValue(value, bool(held.any()), bool(before_first.any()))

    def _first_values(self, started: NDArray[np.bool_]) -> Floats:
        """Values of joints before their first sample: the next samples, else `first`."""
        if started.all():
            return self.last
        value = np.full(len(started), np.nan)
        for row in self.rows:
            value = np.where(np.isnan(value), row, value)
            if not np.isnan(value[~started]).any():
                break
        return np.where(np.isnan(value), self.first, value)
