"""Which time a message has, and how far the frames may go while messages are still coming in."""

from __future__ import annotations

import heapq

from geomphys.config import TimeSource
from geomphys.recording.naming import plain
from geomphys.recording.reader import LogChannel

NEVER = -(2**62)
EARLY_CLOCK = 60 * 10**9
"""ns; a zero stamp is a time only on a channel whose next stamps are below this: its clock counts from about 0."""
RANKED = 3


class MessageTimes:
    """The time of a message by the user's choice; `header` falls back to the log time, with one warning a channel.

    A stamp of zero is what a driver writes that does not know the time, unless the channel's clock counts from zero
    (`zero_counts`).
    """

    def __init__(self, source: TimeSource, channels: dict[int, LogChannel]) -> None:
        self.source = source
        self.channels = channels
        self.zero_counts: set[int] = set()
        self.unstamped: dict[int, str] = {}  # channel -> why its log times are used

    def of(self, key: int, stamp: int | None, log_time: int, publish_time: int) -> int:
        """Time of a message of channel `key` in ns."""
        if self.source == "log":
            return log_time
        if self.source == "publish":
            return publish_time
        if stamp is None:
            if key not in self.unstamped:
                self.unstamped[key] = "carry no time stamp"
            return log_time
        if stamp == 0 and key not in self.zero_counts:
            if log_time and key not in self.unstamped:
                self.unstamped[key] = "carry the time stamp zero"
            return log_time
        return stamp

    def warnings(self) -> list[str]:
        """One line a channel whose log times stand in."""
        lines = []
        for key, why in sorted(self.unstamped.items()):
            channel = self.channels[key]
            some = "messages" if why.endswith("stamp") else "some messages"
            topic, kind = plain(channel.topic), plain(channel.schema_name)
            lines.append(f"topic {topic}: {some} ({kind}) {why}; their log times are used")
        return lines


class Watermark:
    """How far the log has come: the third latest time seen, so that a single corrupt time does not carry it away."""

    def __init__(self) -> None:
        self.latest: list[int] = []
        self.time = NEVER

    def add(self, time: int) -> None:
        """Take in the time of a message."""
        if len(self.latest) < RANKED:
            heapq.heappush(self.latest, time)
            if len(self.latest) == RANKED:
                self.time = self.latest[0]
        elif time > self.time:
            heapq.heapreplace(self.latest, time)
            self.time = self.latest[0]
