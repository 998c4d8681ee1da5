"""Which time a message has, and how far the frames may go while messages are still coming in."""

from __future__ import annotations

import heapq

from geomphys.config import TimeSource
from geomphys.errors import LogError
from geomphys.recording.naming import plain
from geomphys.recording.reader import LogChannel
from geomphys.storage.remote_files import AnyPath

NEVER = -(2**62)
EARLY_CLOCK = 60 * 10**9
"""ns; a zero stamp is a time only on a channel whose next stamps are below this: its clock counts from about 0."""
OTHER_CLOCK = 10**9
"""ns; stamps further than this from their log times are of another clock than the log's."""
NEAR_ZERO = 10**9
"""ns; a zero stamp behind others is a time only where the log received it within this of the clock's zero."""
RANKED = 3


class MessageTimes:
    """The time of a message by the user's choice; `header` falls back to the log time, with one warning a channel.

    A stamp of zero is what a driver writes that does not know the time, unless the channel's clock counts from zero
    (`zero_counts`). The log time that stands in for it is moved by `offsets`: onto the clock of the channel's other stamps.
    """

    def __init__(self, source: TimeSource, channels: dict[int, LogChannel], path: AnyPath) -> None:
        self.source = source
        self.channels = channels
        self.path = path
        self.zero_counts: dict[int, int | None] = {}  # channel -> log time of its message at zero, once it came
        self.offsets: dict[int, int] = {}  # channel -> first stamp that is not zero, less its log time; ns
        self.bare: set[int] = set()  # channels of which messages carry no stamp at all
        self.zeros: dict[int, int] = {}  # channel -> messages and transforms with a stamp of zero that is no time

    def anew(self) -> MessageTimes:
        """The same for another pass over the log: what is known of the channels stays, what was met is forgotten."""
        other = MessageTimes(self.source, self.channels, self.path)
        other.zero_counts, other.offsets = self.zero_counts, self.offsets
        return other

    def of(self, key: int, stamp: int | None, log_time: int, publish_time: int) -> int:
        """Time of a message of channel `key` in ns.

        Raises LogError where a clock begins so late behind stamps of zero that these are not known to be of another one.
        """
        if self.source == "log":
            return log_time
        if self.source == "publish":
            return publish_time
        if stamp is None:
            self.bare.add(key)
            return log_time
        if stamp == 0:
            return self._unset(key, log_time)
        if key in self.zeros and key not in self.offsets and abs(stamp - log_time) > OTHER_CLOCK:
            raise LogError(
                f"{self.path}: topic {plain(self.channels[key].topic)!r}: {self.zeros[key]} messages are stamped zero, then "
                f"comes the stamp {stamp / 1e9:.3f} s of a clock other than the log's; --time log goes by when the log "
                "received the messages"
            )
        return stamp

    def _unset(self, key: int, log_time: int) -> int:
        """Time of a message with a stamp of zero."""
        time = log_time + self.offsets.get(key, 0)
        if key in self.zero_counts:
            if self.zero_counts[key] is None and abs(time) <= NEAR_ZERO:
                self.zero_counts[key] = log_time
            if self.zero_counts[key] == log_time:
                return 0
        if log_time:
            self.zeros[key] = self.zeros.get(key, 0) + 1
        return max(0, time)

    def warnings(self) -> list[str]:
        """One line a channel whose log times stand in."""
        lines = []
        for key in sorted(self.bare | set(self.zeros)):
            channel = self.channels[key]
            topic, kind = plain(channel.topic), plain(channel.schema_name)
            if key in self.bare:
                lines.append(f"topic {topic}: messages ({kind}) carry no time stamp; their log times are used")
                continue
            moved = ""
            if abs(self.offsets.get(key, 0)) > OTHER_CLOCK:
                moved = f", moved by {self.offsets[key] / 1e9:.3f} s onto the clock of the others"
            lines.append(
                f"topic {topic}: {self.zeros[key]} messages ({kind}) carry the time stamp zero, as before a clock is "
                f"known; their log times are used{moved} (--time log goes by log times throughout)"
            )
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
