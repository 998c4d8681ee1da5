"""Monitors the time stamps of each stream against the log times: restarts, jumps, wrong units, drift.

Stamps of each stream are compared with each other and with the log times while the log is read. Errors that would mix or
stretch the motion raise LogError, plausible anomalies give warnings; both name the topic, the size and the remedy
(``--time log``). What the log times confirm is not reported: slow topics, pauses, late messages, clocks not counting from 1970.
"""

from __future__ import annotations

import copy
import statistics
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import LogError
from geomphys.recording.display_names import printable
from geomphys.recording.message_times import Watermark
from geomphys.recording.stamps import NEVER
from geomphys.storage.remote_files import AnyPath

Ints = NDArray[np.int64]

REMEDY = "--time log goes by when the log received the messages"
CONFIRMING_MESSAGES = 5
"""Consecutive messages that confirm a jump back, as opposed to a single wrong stamp."""
RATE_COUNTS = tuple(1 << k for k in range(4, 63))
"""Numbers of messages of a stream at which its rate is judged while reading; at the end of the log from `MIN_FINAL_MESSAGES`."""
MIN_FINAL_MESSAGES = 4
WRONG_UNIT_RATIO = 100.0
"""Ratio of stamp and log time spans from which stamps are in a wrong unit."""
WARNED_RATIO = 10.0
"""Ratio of stamp and log time spans that gives a warning."""
MIN_FAST_STEP = 3 * 10**8
"""ns; least mean step of stamps that are too fast."""
MAX_SLOW_STEP = 5 * 10**4
"""ns; largest mean step of stamps that are too slow."""
MIN_LOG_STEP = 3 * 10**5
"""ns; log times closer than this on average are of a log written after the fact and give no rate."""
MIN_LOG_SPAN = 10**8
"""ns; least span of log times for a rate."""
WARNED_JUMP = 10**9
"""ns; a permanent jump ahead of the log times by more gives a warning."""
WARNED_DRIFT = 5 * 10**8
"""ns; drift between two topics that gives a warning."""
OFFSET_WINDOW = 8  # messages at each end of a stream of which the offset is the median
MAX_TRACKS = 4096
"""Maximum number of monitored streams."""


class StampStep(NamedTuple):
    """Stamps and log times of two consecutive messages; ns."""

    before: int
    after: int
    log_before: int
    log_time: int

    @property
    def excess(self) -> int:
        """Step of the stamps less that of the log times, ns."""
        return self.after - self.before - (self.log_time - self.log_before)


class StampTrack:
    """The stamps of one stream. All times in ns."""

    def __init__(self) -> None:
        self.count = 0
        self.first: list[tuple[int, int]] = []  # the first stamps and their log times
        self.max_stamp, self.max_log_time = Watermark(), Watermark()  # of the stamps and of the log times
        self.previous = (NEVER, 0)
        self.messages_late = self.messages_ahead = 0  # messages before the largest stamp; in a row after it
        self.backward_jump: StampStep | None = None  # where the stamps last went back
        self.largest_jump = StampStep(0, 0, 0, 0)  # the largest step ahead, and its excess
        self.max_excess = 0
        self.offsets: deque[int] = deque(maxlen=OFFSET_WINDOW)  # stamp less log time, of the last messages
        self.first_offset = 0.0

    def add(self, stamp: int, log_time: int, delay: int) -> bool:
        """Add a message; True if the stamps have restarted: gone back by more than `delay` permanently."""
        before, before_log = self.previous
        self.previous = stamp, log_time
        self.count += 1
        if len(self.first) < 3:
            self.first.append((stamp, log_time))
        self.offsets.append(stamp - log_time)
        if self.count == OFFSET_WINDOW:
            self.first_offset = statistics.median(self.offsets)
        if stamp - before - (log_time - before_log) > self.max_excess and self.count > 1:
            self.largest_jump = StampStep(before, stamp, before_log, log_time)
            self.max_excess = self.largest_jump.excess
        if not self.messages_late and self.max_stamp.time - stamp > delay:
            self.backward_jump = StampStep(before, stamp, before_log, log_time)
        if self.backward_jump is not None:
            if stamp < self.backward_jump.before:
                self.messages_late, self.messages_ahead = self.messages_late + 1, 0
            else:
                self.messages_ahead += 1
                if self.messages_ahead >= CONFIRMING_MESSAGES:
                    self.messages_late, self.backward_jump = 0, None
        self.max_stamp.add(stamp)
        self.max_log_time.add(log_time)
        return self.messages_late >= CONFIRMING_MESSAGES

    def is_steady(self, stamps: Ints, log_times: Ints) -> bool:
        """Whether messages (n,) go on as those before: their stamps only increase, and pass the checks of their rate."""
        return (
            self.count >= OFFSET_WINDOW
            and not self.messages_late
            and self.backward_jump is None
            and bool(stamps[0] > max(self.max_stamp.latest))
            and bool((np.diff(stamps) > 0).all())
            and not any(
                self._with_steady(stamps[:k], log_times[:k]).has_wrong_rate
                for k in (count - self.count for count in RATE_COUNTS)
                if 0 < k <= len(stamps)
            )
        )

    def _with_steady(self, stamps: Ints, log_times: Ints) -> StampTrack:
        """A track as this one would be with such messages."""
        other = copy.copy(self)
        other.offsets = self.offsets.copy()
        other.max_stamp = self.max_stamp.copy()
        other.max_log_time = self.max_log_time.copy()
        other.add_steady(stamps, log_times)
        return other

    def add_steady(self, stamps: Ints, log_times: Ints) -> None:
        """Add messages for which `is_steady` is true."""
        ends = np.concatenate([[self.previous], np.stack([stamps, log_times], axis=1)])
        steps = np.diff(ends, axis=0)
        excess = steps[:, 0] - steps[:, 1]
        k = int(excess.argmax())
        if excess[k] > self.max_excess:
            (before, log_before), (after, log_time) = ends[k : k + 2].tolist()
            self.largest_jump, self.max_excess = StampStep(before, after, log_before, log_time), int(excess[k])
        self.previous = int(stamps[-1]), int(log_times[-1])
        self.count += len(stamps)
        self.offsets.extend((stamps - log_times)[-OFFSET_WINDOW:].tolist())
        self.max_stamp.add_many(stamps)
        self.max_log_time.add_many(log_times)

    @property
    def spans(self) -> tuple[int, int]:
        """Spans of stamps and log times, ns; robust to a single corrupt stamp."""
        stamp, log_time = sorted(self.first)[len(self.first) // 2]
        return self.max_stamp.time - stamp, self.max_log_time.time - log_time

    @property
    def has_rate(self) -> bool:
        """Whether the log times were set live, over a span long enough to compare rates."""
        _, log_span = self.spans
        return self.count >= MIN_FINAL_MESSAGES and log_span >= max(MIN_LOG_SPAN, MIN_LOG_STEP * self.count)

    @property
    def has_wrong_rate(self) -> bool:
        """Whether the stamps are in a wrong unit or jumped to another clock."""
        if not self.has_rate:
            return False
        span, log_span = self.spans
        if span >= WRONG_UNIT_RATIO * log_span:
            return span >= MIN_FAST_STEP * self.count
        return 0 < span <= log_span / WRONG_UNIT_RATIO and span <= MAX_SLOW_STEP * self.count

    @property
    def is_clock_jump(self) -> bool:
        """Whether the largest step ahead is a clock jump: permanent, and not explained by the rate of the other steps."""
        span, log_span = self.spans
        messages_ahead, log_step = (
            self.largest_jump.after - self.largest_jump.before,
            self.largest_jump.log_time - self.largest_jump.log_before,
        )
        stamp_rest, log_rest = span - messages_ahead, log_span - log_step
        if not self.has_rate or log_rest < MIN_LOG_SPAN or not 0 < stamp_rest < WARNED_RATIO * log_rest:
            return False
        return messages_ahead - max(1.0, stamp_rest / log_rest) * log_step > WARNED_JUMP

    @property
    def drift(self) -> float:
        """Change of the offset between stamps and log times, ns."""
        return statistics.median(self.offsets) - self.first_offset


class StampMonitor:
    """Monitors the stamps of all streams."""

    def __init__(self, path: AnyPath, delay: int) -> None:
        """`delay`: ns that a message may come late."""
        self.path, self.delay = path, delay
        self.tracks: dict[tuple[str, str], StampTrack] = {}  # by topic and child frame or first joint
        self.start = NEVER  # log time of the first message

    def add(self, topic: str, part: str, stamp: int, log_time: int) -> None:
        """Add a message; raises LogError where the stamps start over or cannot be times of this log."""
        if self.start == NEVER:
            self.start = log_time
        key = topic, part
        track = self.tracks.get(key)
        if track is None:
            if len(self.tracks) >= MAX_TRACKS:
                return
            track = self.tracks[key] = StampTrack()
        if track.add(stamp, log_time, self.delay):
            raise LogError(self._restart_message(key, track))
        if track.count in RATE_COUNTS and track.has_wrong_rate:
            raise LogError(self._wrong_rate_message(key, track))

    def finish(self) -> None:
        """Check streams of few messages at the end of the log; raises LogError as `add` does."""
        for key, track in self.tracks.items():
            if track.messages_late > 1 and track.messages_ahead == 0:
                raise LogError(self._restart_message(key, track))
            if track.has_wrong_rate:
                raise LogError(self._wrong_rate_message(key, track))

    def warnings(self, clock: tuple[str, str] | None) -> Iterator[str]:
        """Warnings on plausible stamps: steps ahead, another rate, drift against the topic of the `clock`."""
        reported = set[str]()
        clock_track = next(
            (t for (topic, part), t in self.tracks.items() if clock in ((topic, part), (topic, ""))), None
        )
        for key, track in self.tracks.items():
            if key[0] in reported or not track.has_rate:
                continue
            span, log_span = track.spans
            drift = track.drift - clock_track.drift if clock_track is not None and clock_track.has_rate else 0.0
            if track.is_clock_jump:
                largest_jump = track.largest_jump
                text = (
                    f"its time stamps jump ahead by {largest_jump.excess / 1e9:.3f} s, from {largest_jump.before / 1e9:.3f} to "
                    f"{largest_jump.after / 1e9:.3f} s, {self._log_position(largest_jump.log_time)}"
                )
            elif span >= WARNED_RATIO * log_span and span >= MIN_FAST_STEP * track.count:
                text = f"its time stamps last {span / 1e9:.3f} s, its log times {log_span / 1e9:.3f} s"
            elif track.count > 2 * OFFSET_WINDOW and abs(drift) > WARNED_DRIFT:
                text = f"its time stamps drift by {drift / 1e9:+.3f} s against those of the frame clock"
            else:
                continue
            reported.add(key[0])
            yield f"topic {printable(key[0])}: {text}; {REMEDY}"

    def _restart_message(self, key: tuple[str, str], track: StampTrack) -> str:
        assert track.backward_jump is not None
        before, after = track.backward_jump.before, track.backward_jump.after
        return (
            f"{self._prefix(key)}: its time stamps start over: they jump back by {(before - after) / 1e9:.3f} s, from "
            f"{before / 1e9:.3f} to {after / 1e9:.3f} s, {self._log_position(track.backward_jump.log_time)}; {REMEDY}"
        )

    def _wrong_rate_message(self, key: tuple[str, str], track: StampTrack) -> str:
        span, log_span = track.spans
        largest_jump = track.largest_jump
        if 2 * largest_jump.excess > span:
            return (
                f"{self._prefix(key)}: its time stamps jump ahead by {largest_jump.excess / 1e9:.3f} s, from "
                f"{largest_jump.before / 1e9:.3f} to {largest_jump.after / 1e9:.3f} s, "
                f"{self._log_position(largest_jump.log_time)}; {REMEDY}"
            )
        ratio = span / log_span
        ratio_text = f"{ratio:.0f} times as fast as" if ratio > 1 else f"{1 / ratio:.0f} times slower than"
        unit = "milliseconds or microseconds in the field for seconds" if ratio > 1 else "another unit than nanoseconds"
        return (
            f"{self._prefix(key)}: its time stamps go {ratio_text} the log times ({span / 1e9:.6g} s in {log_span / 1e9:.6g} s): "
            f"{unit}? {REMEDY}"
        )

    def _prefix(self, key: tuple[str, str]) -> str:
        return f"{self.path}: topic {printable(key[0])!r}"

    def _log_position(self, log_time: int) -> str:
        return f"{(log_time - self.start) / 1e9:.3f} s into the log"
