"""Files against those of the mcap package's writer, byte for byte."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from geomphys.output.mcap_writer import CHUNK_SIZE, McapWriter


def written(make: Callable[[BytesIO], Any], fill: Callable[[Any], None]) -> bytes:
    stream = BytesIO()
    writer = make(stream)
    writer.start("profile", "library")
    fill(writer)
    writer.finish()
    return stream.getvalue()


def same(fill: Callable[[Any], None]) -> bytes:
    ours = written(McapWriter, fill)
    assert ours == written(Writer, fill)
    return ours


def attach(writer: Any, time: int) -> None:
    if isinstance(writer, McapWriter):
        writer.add_attachment(time, "a.toml", "text/plain", b"content")
    else:
        writer.add_attachment(0, time, "a.toml", "text/plain", b"content")


def add(writer: Any, messages: list[tuple[int, int, int, bytes]]) -> None:
    if isinstance(writer, McapWriter):
        channels, times, sequences, data = zip(*messages, strict=True)
        writer.add_messages(channels, np.array(times, np.int64), np.array(sequences, np.int64), data)
    else:
        for channel, time, sequence, data in messages:
            writer.add_message(channel, time, data, time, sequence)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(
        st.lists(
            st.tuples(
                st.integers(1, 2),
                st.integers(0, 2**62),
                st.integers(0, 2**32 - 1),
                st.binary(max_size=50) | st.sampled_from([bytes(CHUNK_SIZE // 3), bytes(2 * CHUNK_SIZE)]),
            ),
            min_size=1,
            max_size=8,
        ),
        max_size=4,
    )
)
def test_messages_many_at_once(batches: list[list[tuple[int, int, int, bytes]]]) -> None:
    def fill(writer: Any) -> None:
        schema = writer.register_schema("S", "jsonschema", b"{}")
        writer.register_channel("/a", "json", schema)
        writer.register_channel("/b", "json", 0, {"key": "value"})
        for number, batch in enumerate(batches):
            add(writer, batch)
            if number == 1:
                attach(writer, 7)
        writer.add_metadata("record", {"a": "b"})

    same(fill)


@pytest.mark.parametrize("spare", [-1, 0, 1])
def test_a_chunk_ends_behind_the_message_that_makes_it_too_large(spare: int) -> None:
    def fill(writer: Any) -> None:
        writer.register_channel("/a", "json", 0)
        declared = 9 + 2 + 2 + 4 + 2 + 4 + 4 + 4
        add(writer, [(1, 5, 0, bytes(CHUNK_SIZE - declared - 31 + spare)), (1, 6, 1, b"x"), (1, 4, 2, b"y")])

    same(fill)


def test_single_messages_and_channels_that_come_late() -> None:
    def fill(writer: Any) -> None:
        writer.register_channel("/a", "json", 0)
        writer.add_message(1, 10, b"one", 11, 3)
        writer.register_schema("T", "ros2msg", bytes(CHUNK_SIZE))
        writer.register_channel("/b", "json", 1)
        writer.add_message(2, 9, b"two", 8)

    same(fill)


def test_a_file_without_messages() -> None:
    same(lambda writer: writer.register_channel("/a", "json", 0))
