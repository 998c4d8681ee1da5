"""Frame clocks: frame times at the messages of a topic, or at a fixed rate between its first and last message."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from typing import Protocol

from geomphys.errors import LogError
from geomphys.recording.stamps import NEVER

RATE_FRAMES_LIMIT = 10_000_000
"""Frames that a fixed rate may put between two messages of the clock; more is a corrupt time."""


class FrameClock(Protocol):
    """Takes the times of the clock's messages, gives the times of frames."""

    def add(self, time: int) -> bool:
        """Add the time [ns] of a clock message; False if a later frame was already given, so that it makes no frame."""

    def until(self, limit: int) -> Iterator[int]:
        """Times of the frames up to `limit` [ns], in order, that were not given before."""


class TopicClock:
    """A frame at each distinct time of the clock's messages."""

    def __init__(self) -> None:
        self.pending: list[int] = []
        self.last = NEVER

    def add(self, time: int) -> bool:
        """Add the time [ns] of a clock message; False if a later frame was already given, so that it makes no frame."""
        if time <= self.last:
            return time == self.last
        insort(self.pending, time)
        return True

    def until(self, limit: int) -> Iterator[int]:
        """Times of the frames up to `limit` [ns], in order, that were not given before."""
        while self.pending and self.pending[0] <= limit:
            count = next((i for i, t in enumerate(self.pending) if t > limit), len(self.pending))
            due = self.pending[:count]
            del self.pending[:count]
            for time in due:
                if time > self.last:
                    self.last = time
                    yield time


class RateClock:
    """Frames at t0 + k / rate, from the first time of the clock's messages to their last."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.clock_times = TopicClock()
        self.first: int | None = None
        self.count = 0

    def add(self, time: int) -> bool:
        """Add the time [ns] of a clock message; False if a later frame was already given."""
        return self.clock_times.add(time)

    def until(self, limit: int) -> Iterator[int]:
        """Times of the frames up to `limit` [ns], in order, that were not given before.

        Raises LogError if two times of the clock are so far apart that the frames between could not be counted.
        """
        for clock_time in self.clock_times.until(limit):
            if self.first is None:
                self.first = clock_time
            if (clock_time - self.first) * self.rate / 1e9 - self.count > RATE_FRAMES_LIMIT:
                raise LogError(
                    f"the frame clock jumps by {(clock_time - self._time(self.count)) / 1e9:.0f} s at {clock_time} ns, "
                    f"too far for {self.rate:g} frames a second; leave --rate out, or try --time log"
                )
            while (time := self._time(self.count)) <= clock_time:
                self.count += 1
                yield time

    def _time(self, k: int) -> int:
        """Time of frame k."""
        assert self.first is not None
        return self.first + round(k * 1e9 / self.rate)
