"""The time of each message (header stamp, log time or publish time), and the watermark up to which frames can be made."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from geomphys.config import TimeSource
from geomphys.errors import LogError
from geomphys.recording.display_names import printable
from geomphys.recording.reader import LogChannel
from geomphys.recording.stamps import NEVER
from geomphys.storage.remote_files import AnyPath

EARLY_CLOCK = 60 * 10**9
"""ns; a zero stamp counts as a time only where the next stamps are below this (a clock that starts near 0)."""
CLOCK_MISMATCH = 10**9
"""ns; a larger offset between stamp and log time means another clock."""
ZERO_STAMP_TOLERANCE = 10**9
"""ns; a later zero stamp counts as a time only within this of the clock's zero by log time."""
WATERMARK_RANK = 3


class MessageTimes:
    """The time of a message by the user's choice; `header` falls back to the log time, with one warning a channel.

    A stamp of zero is what a driver writes that does not know the time, unless the channel's clock counts from zero
    (`zero_stamp_times`). The log time that replaces it is shifted by `offsets`: onto the clock of the channel's other stamps.
    """

    def __init__(self, source: TimeSource, channels: dict[int, LogChannel], path: AnyPath) -> None:
        self.source = source
        self.channels = channels
        self.path = path
        self.zero_stamp_times: dict[int, int | None] = {}  # channel -> log time of its zero stamp that is a time
        self.offsets: dict[int, int] = {}  # channel -> first stamp that is not zero, less its log time; ns
        self.unstamped: set[int] = set()  # channels with messages without a stamp
        self.zero_stamps: dict[int, int] = {}  # channel -> number of zero stamps that are no times

    def fresh_copy(self) -> MessageTimes:
        """A copy for another pass over the log: prescan results are shared, counters are reset."""
        other = MessageTimes(self.source, self.channels, self.path)
        other.zero_stamp_times, other.offsets = self.zero_stamp_times, self.offsets
        return other

    def time_of(self, key: int, stamp: int | None, log_time: int, publish_time: int) -> int:
        """Time of a message of channel `key` in ns.

        Raises LogError where a clock begins so late behind stamps of zero that these are not known to be of another one.
        """
        if self.source == "log":
            return log_time
        if self.source == "publish":
            return publish_time
        if stamp is None:
            self.unstamped.add(key)
            return log_time
        if stamp == 0:
            return self._time_of_zero_stamp(key, log_time)
        if key in self.zero_stamps and key not in self.offsets and abs(stamp - log_time) > CLOCK_MISMATCH:
            raise LogError(
                f"{self.path}: topic {printable(self.channels[key].topic)!r}: {self.zero_stamps[key]} messages are stamped "
                f"zero, then comes the stamp {stamp / 1e9:.3f} s of a clock other than the log's; --time log goes by when "
                "the log received the messages"
            )
        return stamp

    def _time_of_zero_stamp(self, key: int, log_time: int) -> int:
        """Time of a message with a stamp of zero."""
        time = log_time + self.offsets.get(key, 0)
        if key in self.zero_stamp_times:
            if self.zero_stamp_times[key] is None and abs(time) <= ZERO_STAMP_TOLERANCE:
                self.zero_stamp_times[key] = log_time
            if self.zero_stamp_times[key] == log_time:
                return 0
        if log_time:
            self.zero_stamps[key] = self.zero_stamps.get(key, 0) + 1
        return max(0, time)

    def warnings(self) -> list[str]:
        """One line for each channel whose log times replace its stamps."""
        lines = []
        for key in sorted(self.unstamped | set(self.zero_stamps)):
            channel = self.channels[key]
            topic, kind = printable(channel.topic), printable(channel.schema_name)
            if key in self.unstamped:
                lines.append(f"topic {topic}: messages ({kind}) carry no time stamp; their log times are used")
                continue
            shift_text = ""
            if abs(self.offsets.get(key, 0)) > CLOCK_MISMATCH:
                shift_text = f", moved by {self.offsets[key] / 1e9:.3f} s onto the clock of the others"
            lines.append(
                f"topic {topic}: {self.zero_stamps[key]} messages ({kind}) carry the time stamp zero, as before a clock is "
                f"known; their log times are used{shift_text} (--time log goes by log times throughout)"
            )
        return lines


class Watermark:
    """Watermark of the log: the third latest time, robust to single corrupt times."""

    def __init__(self) -> None:
        self.latest: list[int] = []
        self.time = NEVER

    def copy(self) -> Watermark:
        """Another with the same times."""
        other = Watermark()
        other.latest, other.time = self.latest.copy(), self.time
        return other

    def add(self, time: int) -> None:
        """Add the time of a message."""
        if len(self.latest) < WATERMARK_RANK:
            heapq.heappush(self.latest, time)
            if len(self.latest) == WATERMARK_RANK:
                self.time = self.latest[0]
        elif time > self.time:
            heapq.heapreplace(self.latest, time)
            self.time = self.latest[0]

    def add_many(self, times: NDArray[np.int64]) -> None:
        """Add the times of messages (n,)."""
        for time in np.sort(times)[-WATERMARK_RANK:].tolist():
            self.add(time)
