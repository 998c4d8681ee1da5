"""Whether the stamps of a log can be what they say: times that start over, jump ahead, or run at another pace.

Stamps are watched stream by stream while the log is read, against each other and against the log times, which go on
when stamps do not. What would mix or stretch the motion is an error, what may be right is a warning; both tell the
topic, the size, and that ``--time log`` goes by the log times. Nothing is said of what the log times bear out: slow topics,
pauses, messages that came late, clocks that do not count from 1970.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from geomphys.errors import LogError
from geomphys.recording.naming import plain
from geomphys.recording.times import NEVER, Watermark
from geomphys.storage.remote_files import AnyPath

REMEDY = "--time log goes by when the log received the messages"
STEADY = 5
"""Messages in a row that show that a jump back is not a message gone astray."""
PACED = 16
"""Messages of a stream from which its pace is told while the log is read; at its end `FEW` do."""
FEW = 4
OTHER_PACE = 100.0
"""Stamps that go this much faster or slower than the log times are in a wrong unit."""
STRETCHED = 10.0
"""Stamps that go this much faster than the log times are warned of."""
SPARSE = 3 * 10**8
"""ns; only messages that are stamped at least this far apart have stamps that go too fast."""
DENSE = 5 * 10**4
"""ns; only messages that are stamped at most this far apart have stamps that go too slowly."""
QUICKEST = 3 * 10**5
"""ns; log times closer than this are those of a program that wrote the log later, and tell no pace."""
SHORTEST = 10**8
"""ns of log time that are too short to tell a pace."""
JUMP = 10**9
"""ns; stamps that jump ahead of the log times by more than this, and stay there, are warned of."""
DRIFT = 5 * 10**8
"""ns by which two topics may drift apart in a log before that is warned of."""
ENDS = 8  # messages at each end of a stream of which the offset is the median
TRACKS = 4096
"""Streams that are watched at most."""


class Step(NamedTuple):
    """Stamps of two messages in a row, and when they came; ns."""

    before: int
    after: int
    log_before: int
    log_time: int

    @property
    def excess(self) -> int:
        """By how much more the stamps went ahead than the log times."""
        return self.after - self.before - (self.log_time - self.log_before)


class StampTrack:
    """The stamps of one stream. All times in ns."""

    def __init__(self) -> None:
        self.count = 0
        self.first: list[tuple[int, int]] = []  # the first stamps and their log times
        self.reached, self.logged = Watermark(), Watermark()  # of the stamps and of the log times
        self.previous = (NEVER, 0)
        self.behind = self.ahead = 0  # messages behind what was reached, and in a row that are not
        self.back: Step | None = None  # where the stamps last went back
        self.leap = Step(0, 0, 0, 0)  # the largest step ahead, and its excess
        self.largest = 0
        self.offsets: deque[int] = deque(maxlen=ENDS)  # stamp less log time, of the last messages
        self.first_offset = 0.0

    def add(self, stamp: int, log_time: int, delay: int) -> bool:
        """Take in a message; True if the stamps have started over: gone back by more than `delay`, and stayed there."""
        before, before_log = self.previous
        self.previous = stamp, log_time
        self.count += 1
        if len(self.first) < 3:
            self.first.append((stamp, log_time))
        self.offsets.append(stamp - log_time)
        if self.count == ENDS:
            self.first_offset = statistics.median(self.offsets)
        if stamp - before - (log_time - before_log) > self.largest and self.count > 1:
            self.leap = Step(before, stamp, before_log, log_time)
            self.largest = self.leap.excess
        if not self.behind and self.reached.time - stamp > delay:
            self.back = Step(before, stamp, before_log, log_time)
        if self.back is not None:
            if stamp < self.back.before:
                self.behind, self.ahead = self.behind + 1, 0
            else:
                self.ahead += 1
                if self.ahead >= STEADY:
                    self.behind, self.back = 0, None
        self.reached.add(stamp)
        self.logged.add(log_time)
        return self.behind >= STEADY

    @property
    def spans(self) -> tuple[int, int]:
        """How far stamps and log times went; the stamps without a single one that is corrupt."""
        stamp, log_time = sorted(self.first)[len(self.first) // 2]
        return self.reached.time - stamp, self.logged.time - log_time

    @property
    def has_pace(self) -> bool:
        """Whether the log times are those of the recording, and long enough to compare the stamps with."""
        _, log_span = self.spans
        return self.count >= FEW and log_span >= max(SHORTEST, QUICKEST * self.count)

    @property
    def is_off_pace(self) -> bool:
        """Whether the stamps are in a wrong unit or jumped to another clock."""
        if not self.has_pace:
            return False
        span, log_span = self.spans
        if span >= OTHER_PACE * log_span:
            return span >= SPARSE * self.count
        return 0 < span <= log_span / OTHER_PACE and span <= DENSE * self.count

    @property
    def stays_ahead(self) -> bool:
        """Whether the largest step ahead was one of the clock: for good, and not borne out by the pace of the others."""
        span, log_span = self.spans
        ahead, paused = self.leap.after - self.leap.before, self.leap.log_time - self.leap.log_before
        rest, log_rest = span - ahead, log_span - paused
        if not self.has_pace or log_rest < SHORTEST or not 0 < rest < STRETCHED * log_rest:
            return False
        return ahead - max(1.0, rest / log_rest) * paused > JUMP

    @property
    def drift(self) -> float:
        """How far the stamps have moved against the log times."""
        return statistics.median(self.offsets) - self.first_offset


class StampWatch:
    """The stamps of all streams that are read."""

    def __init__(self, path: AnyPath, delay: int) -> None:
        """`delay`: ns that a message may come late."""
        self.path, self.delay = path, delay
        self.tracks: dict[tuple[str, str], StampTrack] = {}  # by topic and child frame or first joint
        self.start = NEVER  # log time of the first message

    def add(self, topic: str, part: str, stamp: int, log_time: int) -> None:
        """Take in a message; raises LogError where the stamps start over or cannot be times of this log."""
        if self.start == NEVER:
            self.start = log_time
        key = topic, part
        track = self.tracks.get(key)
        if track is None:
            if len(self.tracks) >= TRACKS:
                return
            track = self.tracks[key] = StampTrack()
        if track.add(stamp, log_time, self.delay):
            raise LogError(self._starts_over(key, track))
        count = track.count
        if count >= PACED and count & (count - 1) == 0 and track.is_off_pace:
            raise LogError(self._off_pace(key, track))

    def finish(self) -> None:
        """Say that the log has ended; raises LogError as `add` does, for streams of few messages."""
        for key, track in self.tracks.items():
            if track.behind > 1 and track.ahead == 0:
                raise LogError(self._starts_over(key, track))
            if track.is_off_pace:
                raise LogError(self._off_pace(key, track))

    def warnings(self, clock: tuple[str, str] | None) -> Iterator[str]:
        """Lines on stamps that may be right: steps ahead, another pace, and drift against the topic of the `clock`."""
        told = set[str]()
        beats = next((t for (topic, part), t in self.tracks.items() if clock in ((topic, part), (topic, ""))), None)
        for key, track in self.tracks.items():
            if key[0] in told or not track.has_pace:
                continue
            span, log_span = track.spans
            drift = track.drift - beats.drift if beats is not None and beats.has_pace else 0.0
            if track.stays_ahead:
                leap = track.leap
                text = (
                    f"its time stamps jump ahead by {leap.excess / 1e9:.3f} s, from {leap.before / 1e9:.3f} to "
                    f"{leap.after / 1e9:.3f} s, {self._since(leap.log_time)}"
                )
            elif span >= STRETCHED * log_span and span >= SPARSE * track.count:
                text = f"its time stamps last {span / 1e9:.3f} s, its log times {log_span / 1e9:.3f} s"
            elif track.count > 2 * ENDS and abs(drift) > DRIFT:
                text = f"its time stamps drift by {drift / 1e9:+.3f} s against those of the frame clock"
            else:
                continue
            told.add(key[0])
            yield f"topic {plain(key[0])}: {text}; {REMEDY}"

    def _starts_over(self, key: tuple[str, str], track: StampTrack) -> str:
        assert track.back is not None
        before, after = track.back.before, track.back.after
        return (
            f"{self._named(key)}: its time stamps start over: they jump back by {(before - after) / 1e9:.3f} s, from "
            f"{before / 1e9:.3f} to {after / 1e9:.3f} s, {self._since(track.back.log_time)}; {REMEDY}"
        )

    def _off_pace(self, key: tuple[str, str], track: StampTrack) -> str:
        span, log_span = track.spans
        leap = track.leap
        if 2 * leap.excess > span:
            return (
                f"{self._named(key)}: its time stamps jump ahead by {leap.excess / 1e9:.3f} s, from "
                f"{leap.before / 1e9:.3f} to {leap.after / 1e9:.3f} s, {self._since(leap.log_time)}; {REMEDY}"
            )
        ratio = span / log_span
        how = f"{ratio:.0f} times as fast as" if ratio > 1 else f"{1 / ratio:.0f} times slower than"
        unit = "milliseconds or microseconds in the field for seconds" if ratio > 1 else "another unit than nanoseconds"
        return (
            f"{self._named(key)}: its time stamps go {how} the log times ({span / 1e9:.6g} s in {log_span / 1e9:.6g} s): "
            f"{unit}? {REMEDY}"
        )

    def _named(self, key: tuple[str, str]) -> str:
        return f"{self.path}: topic {plain(key[0])!r}"

    def _since(self, log_time: int) -> str:
        return f"{(log_time - self.start) / 1e9:.3f} s into the log"
