"""Reads some messages ahead, to take them together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice

from geomphys.recording.reader import RawMessage

BATCH_MESSAGES = 256
FIRST_MESSAGES = 32
"""Of the first batch, whose messages are taken one by one; others are read as many at a time."""
BATCH_BYTES = 1 << 20
"""A batch that is larger ends."""


def batches(messages: Iterable[RawMessage]) -> Iterator[list[RawMessage]]:
    """The messages in their order, many at a time."""
    unread, most = iter(messages), FIRST_MESSAGES
    while True:
        batch, size = list[RawMessage](), 0
        while len(batch) < most and size <= BATCH_BYTES and (part := [*islice(unread, FIRST_MESSAGES)]):
            batch += part
            size += sum([len(message.data) for message in part])
        if not batch:
            return
        yield batch
        most = BATCH_MESSAGES
