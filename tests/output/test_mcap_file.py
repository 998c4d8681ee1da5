"""The chunked writer against the readers and the writer of the mcap package."""

from __future__ import annotations

import io

import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from geomphys.output import mcap_writer
from geomphys.output.mcap_writer import McapWriter

MESSAGES = [(1 + i % 2, 1000 + 7 * i % 13, f"message {i}".encode() * (i % 5)) for i in range(200)]


def written() -> bytes:
    stream = io.BytesIO()
    file = McapWriter(stream, "a test")
    schema = file.add_schema("S", "jsonschema", b"{}")
    channels = [file.add_channel("/a", "json", schema), file.add_channel("/b", "json", 0, {"k": "v"})]
    for number, (channel, time, data) in enumerate(MESSAGES):
        file.add_message(channels[channel - 1], time, data, sequence=number)
        if number == 100:
            file.add_attachment("x.txt", "text/plain", b"attached", 5)
    file.add_metadata("m", {"a": "b"})
    file.finish()
    return stream.getvalue()


@pytest.fixture(params=[1 << 20, 500, 1])
def data(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bytes:
    monkeypatch.setattr(mcap_writer, "CHUNK_SIZE", request.param)
    return written()


def test_every_message_is_read_back_by_index_and_in_sequence(data: bytes) -> None:
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    rows = [(c.topic, m.log_time, m.publish_time, m.sequence, m.data) for _, c, m in reader.iter_messages()]
    expected = [(("/a", "/b")[c - 1], t, t, n, d) for n, (c, t, d) in enumerate(MESSAGES)]
    assert sorted(rows) == sorted(expected)
    assert [row[1] for row in rows] == sorted(row[1] for row in rows), "in the order of time"
    records = list(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    assert sum(type(record).__name__ == "Message" for record in records) == len(MESSAGES)


def test_summary_is_that_of_the_package(data: bytes) -> None:
    stream = io.BytesIO()
    other = Writer(stream, compression=CompressionType.ZSTD)
    other.start(library="a test")
    schema = other.register_schema("S", "jsonschema", b"{}")
    channels = [other.register_channel("/a", "json", schema), other.register_channel("/b", "json", 0, {"k": "v"})]
    for number, (channel, time, message) in enumerate(MESSAGES):
        other.add_message(channels[channel - 1], time, message, time, number)
    other.add_attachment(0, 5, "x.txt", "text/plain", b"attached")
    other.add_metadata("m", {"a": "b"})
    other.finish()
    mine, theirs = (make_reader(io.BytesIO(d)).get_summary() for d in (data, stream.getvalue()))
    assert mine is not None
    assert theirs is not None
    assert mine.statistics is not None
    assert theirs.statistics is not None
    mine.statistics.chunk_count = theirs.statistics.chunk_count  # depends on when attachments come
    assert mine.statistics == theirs.statistics
    assert (mine.schemas, mine.channels) == (theirs.schemas, theirs.channels)


def test_attachments_and_metadata_are_found(data: bytes) -> None:
    reader = make_reader(io.BytesIO(data))
    (attachment,) = reader.iter_attachments()
    assert (attachment.name, attachment.data, attachment.log_time) == ("x.txt", b"attached", 5)
    (metadata,) = reader.iter_metadata()
    assert (metadata.name, metadata.metadata) == ("m", {"a": "b"})


def test_a_file_without_messages_is_one() -> None:
    stream = io.BytesIO()
    file = McapWriter(stream, "a test")
    file.add_channel("/a", "json", 0)
    file.finish()
    summary = make_reader(io.BytesIO(stream.getvalue())).get_summary()
    assert summary is not None
    assert [c.topic for c in summary.channels.values()] == ["/a"]
    assert list(make_reader(io.BytesIO(stream.getvalue())).iter_messages()) == []


def test_equal_calls_give_equal_bytes() -> None:
    assert written() == written()
