"""Reads some messages ahead, to take them together."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator

from geomphys.recording.raw_messages import Messages

BATCH_MESSAGES = 256
FIRST_MESSAGES = 32
"""Of the first batch, whose messages are taken one by one."""


def batches(runs: Iterable[Messages], keys: Container[int]) -> Iterator[Messages]:
    """The messages of runs in their order, many at a time, of those channels that `keys` has when they are asked for."""
    parts, count, most = list[Messages](), 0, FIRST_MESSAGES
    for run in runs:
        begin = 0
        while begin < len(run):
            end = begin + most - count
            parts.append(run.rows(begin, end).of_channels(keys))
            begin, count = end, count + len(parts[-1])
            if count >= most:
                yield Messages.joined(parts)
                parts, count, most = [], 0, BATCH_MESSAGES
    if count:
        yield Messages.joined(parts)
