"""Undecoded messages: one, or many in a row as columns."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]


class RawMessage(NamedTuple):
    """An undecoded message; times in ns."""

    key: int  # of its channel
    log_time: int
    publish_time: int
    data: bytes
    sequence: int = 0


@dataclass(frozen=True, slots=True)
class Messages:
    """n undecoded messages in their order; times in ns."""

    keys: Ints  # (n,) of their channels
    log_times: Ints  # (n,)
    publish_times: Sequence[int]  # n, of 64 bits without a sign
    data: Sequence[bytes]  # n
    sequences: Sequence[int]  # n

    @staticmethod
    def of(messages: Iterable[tuple[int, int, int, bytes, int]]) -> Messages:
        """Messages, each with the fields of a `RawMessage`."""
        keys, log_times, *others = list(zip(*messages, strict=True)) or [()] * 5
        return Messages(np.array(keys, np.int64), np.array(log_times, np.int64), *others)

    @staticmethod
    def joined(parts: Sequence[Messages]) -> Messages:
        """The messages of parts, one part after another."""
        if len(parts) == 1:
            return parts[0]
        return Messages(
            np.concatenate([part.keys for part in parts]),
            np.concatenate([part.log_times for part in parts]),
            [time for part in parts for time in part.publish_times],
            [data for part in parts for data in part.data],
            [number for part in parts for number in part.sequences],
        )

    def __len__(self) -> int:
        return len(self.data)

    def __iter__(self) -> Iterator[RawMessage]:
        """One after another."""
        keys, log_times = self.keys.tolist(), self.log_times.tolist()
        return map(RawMessage, keys, log_times, self.publish_times, self.data, self.sequences)

    @property
    def size(self) -> int:
        """Bytes of their data."""
        return sum(map(len, self.data))

    def rows(self, begin: int, end: int) -> Messages:
        """Those of a stretch."""
        rows = slice(begin, end)
        return Messages(
            self.keys[rows], self.log_times[rows], self.publish_times[rows], self.data[rows], self.sequences[rows]
        )

    def in_order_of_time(self) -> Messages:
        """By their log times; those of one time in the order they are in."""
        if (self.log_times[1:] >= self.log_times[:-1]).all():
            return self
        return self._taken(np.argsort(self.log_times, kind="stable"))

    def of_channels(self, keys: Container[int]) -> Messages:
        """Those of some channels."""
        found = dict.fromkeys(self.keys.tolist())
        if all(key in keys for key in found):
            return self
        return self._taken(np.flatnonzero(np.isin(self.keys, [key for key in found if key in keys])))

    def by_channel(self) -> dict[int, Ints]:
        """Positions of the messages of each channel, by its key, in the order in which the channels come."""
        return {key: np.flatnonzero(self.keys == key) for key in dict.fromkeys(self.keys.tolist())}

    def _taken(self, rows: Ints) -> Messages:
        """Those at positions (k,)."""
        publish_times, data, sequences = (
            [column[row] for row in rows.tolist()] for column in (self.publish_times, self.data, self.sequences)
        )
        return Messages(self.keys[rows], self.log_times[rows], publish_times, data, sequences)
