"""The writer of files gives the bytes that the mcap package's writer gives."""

from __future__ import annotations

import io
from itertools import pairwise

import numpy as np
import pytest
from mcap.writer import Writer

from geomphys.output.byte_strings import ByteStrings
from geomphys.output.mcap_writer import CHUNK_BYTES, McapWriter, Messages

COUNT = 700
SIZES = {"small": 40, "chunks of many": 9_000, "chunks of one": CHUNK_BYTES + 5}


def random_messages(size: int) -> Messages:
    """Messages of two channels, some out of order in time, of about `size` bytes each."""
    random = np.random.default_rng(size)
    count = COUNT if size < CHUNK_BYTES else 4
    channels, times = random.integers(1, 3, count), random.integers(5, 10**12, count)
    lengths = random.integers(size // 2, size + 1, count).tolist()
    return Messages(
        channels, np.arange(count) + 2**32 - 5, times, times + 7, ByteStrings.of(random.bytes(n) for n in lengths)
    )


def begin(file: Writer | McapWriter) -> None:
    file.start("", "somebody")
    schema = file.register_schema("a/B", "ros2msg", b"float64 x")
    file.register_channel("/one", "cdr", schema, {"key": "value"})
    file.register_channel("/two", "cdr", schema, {})


def end(file: Writer | McapWriter) -> None:
    file.add_attachment(0, 9, "scene.toml", "text/plain", b"[scene]")
    late = file.register_channel("/late", "json", 0, {})
    file.add_message(late, 3, b"{}", 4, 5)
    file.add_metadata("geomphys", {"complete": "true"})
    file.finish()


def by_package(messages: Messages) -> bytes:
    stream = io.BytesIO()
    file = Writer(stream)
    begin(file)
    rows = zip(*(column.tolist() for column in messages[:4]), messages.data, strict=True)
    for channel, sequence, log_time, publish_time, data in rows:
        file.add_message(channel, log_time, data, publish_time, sequence & 0xFFFFFFFF)
    end(file)
    return stream.getvalue()


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES.keys())
@pytest.mark.parametrize("parts", [1, 3, COUNT])
def test_the_bytes_are_those_of_the_package(size: int, parts: int) -> None:
    messages, stream = random_messages(size), io.BytesIO()
    file = McapWriter(stream)
    begin(file)
    for start, stop in pairwise(np.linspace(0, len(messages.data), parts + 1).astype(int).tolist()):
        file.add_messages(Messages._make(column[start:stop] for column in messages))
    end(file)
    assert stream.getvalue() == by_package(messages)


def test_a_file_without_messages_is_that_of_the_package() -> None:
    ours, theirs = io.BytesIO(), io.BytesIO()
    for file in (McapWriter(ours), Writer(theirs)):
        begin(file)
        file.finish()
    assert ours.getvalue() == theirs.getvalue()
