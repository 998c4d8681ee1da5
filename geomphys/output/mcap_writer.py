"""Writes MCAP files, many messages at once; the bytes are those of the mcap package's writer with its defaults.

Its records are written by the package's classes, but for messages and attachments, of which there are many. A chunk is packed in
a thread of its own, where a core is free, and written when the next one is complete.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import IO, Any, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.typing import NDArray

from geomphys.output.byte_strings import ByteStrings, side_by_side
from geomphys.recording.mcap_records import MAGIC, MESSAGE_HEAD
from geomphys.storage.overlapped_call import OverlappedCall, can_overlap

Ints = NDArray[np.int64]

CHUNK_BYTES = 1 << 20
"""A chunk ends with the message that makes it larger than this."""

_LENGTH_AFTER = MESSAGE_HEAD.itemsize - 9  # bytes of the head that its length counts
_INDEX_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
_INDEX_HEAD = struct.Struct("<BQHI")
_FOOTER_HEAD = struct.Struct("<BQQQ")
_RECORD_HEAD = struct.Struct("<BQ")  # opcode, length
_ATTACHMENT_TIMES, _ATTACHMENT_EXTENT = struct.Struct("<QQ"), struct.Struct("<QQ")  # logged, created; offset, length
_LENGTH, _CRC = struct.Struct("<Q"), struct.Struct("<I")


class Messages(NamedTuple):
    """k messages in their order."""

    channels: Ints  # (k,)
    sequences: Ints  # (k,) of which 32 bits are written
    log_times: Ints  # (k,) ns
    publish_times: Ints  # (k,) ns
    data: ByteStrings


class McapWriter:
    """Writes a file to a stream. Chunks are compressed with zstd and have indices and checksums."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self._schemas: list[bytes] = []  # records
        self._channels: list[bytes] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[bytes] = []  # records that index them
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}  # channel -> messages
        self._span: tuple[int, int] | None = None  # ns, of the messages
        self._overlaps = can_overlap()
        self._packed: OverlappedCall[tuple[Chunk, dict[int, bytes]]] | None = None  # the chunk that is not written yet
        self._begin_chunk()

    def start(self, profile: str, library: str) -> None:
        """Begin the file."""
        self._stream.write(MAGIC)
        self._write(Header(profile, library))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; returns its number."""
        self._schemas.append(_encoded(Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)))
        self._add_to_chunk(self._schemas[-1])
        return len(self._schemas)

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Add a channel; returns its number."""
        number = len(self._channels) + 1
        self._channels.append(_encoded(Channel(number, topic, message_encoding, dict(metadata or {}), schema_id)))
        self._add_to_chunk(self._channels[-1])
        return number

    def add_message(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Add one message; times in ns."""
        channel, number, log_ns, publish_ns = (
            np.array([value], np.int64) for value in (channel_id, sequence, log_time, publish_time)
        )
        self.add_messages(Messages(channel, number, log_ns, publish_ns, ByteStrings.of([data])))

    def add_messages(self, messages: Messages) -> None:
        """Add messages in their order."""
        count, lengths = len(messages.data), messages.data.length
        heads = np.zeros(count, MESSAGE_HEAD)
        heads["opcode"], heads["length"] = Opcode.MESSAGE, lengths + _LENGTH_AFTER
        heads["channel"], heads["sequence"] = messages.channels, messages.sequences & 0xFFFFFFFF
        heads["log_time"], heads["publish_time"] = messages.log_times, messages.publish_times
        records = side_by_side(ByteStrings.of_rows(heads), messages.data)
        ends, content = records.begin + records.length, records.content.data
        first = 0
        while first < count:
            done = int(ends[first - 1]) if first else 0
            fitting = int(np.searchsorted(ends[first:], done + CHUNK_BYTES - self._size, side="right"))
            stop = min(first + fitting + 1, count)
            starts = np.concatenate([[done], ends[first : stop - 1]]) - done + self._size
            self._indices.append((messages.channels[first:stop], messages.log_times[first:stop], starts))
            self._parts.append(content[done : int(ends[stop - 1])])
            self._size += int(ends[stop - 1]) - done
            self._end_if_full()
            first = stop

    def add_attachment(self, create_time: int, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """Add a file; times in ns."""
        self._write_packed()
        offset = self._stream.tell()
        times, names = _ATTACHMENT_TIMES.pack(log_time, create_time), _prefixed(name) + _prefixed(media_type)
        head = times + names + _LENGTH.pack(len(data))
        length = len(head) + len(data) + _CRC.size
        self._stream.write(_RECORD_HEAD.pack(Opcode.ATTACHMENT, length) + head)
        self._stream.write(data)
        self._stream.write(_CRC.pack(zlib.crc32(data, zlib.crc32(head))))
        entry = _ATTACHMENT_EXTENT.pack(offset, _RECORD_HEAD.size + length) + times + _LENGTH.pack(len(data)) + names
        self._attachments.append(_RECORD_HEAD.pack(Opcode.ATTACHMENT_INDEX, len(entry)) + entry)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Add a record of texts by key."""
        self._write_packed()
        offset = self._stream.tell()
        length = self._write(Metadata(name=name, metadata=data))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def finish(self) -> None:
        """Write what is left and the summary. The stream stays open."""
        self._end_chunk()
        self._write(DataEnd(0))
        start, summary = self._stream.tell(), b""
        offsets: list[SummaryOffset] = []
        for opcode, records in (
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [_encoded(self._statistics())]),
            (Opcode.CHUNK_INDEX, map(_encoded, self._chunks)),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, map(_encoded, self._metadata)),
        ):
            group = b"".join(records)
            offsets.append(
                SummaryOffset(group_opcode=opcode, group_start=start + len(summary), group_length=len(group))
            )
            summary += group
        offset_start = start + len(summary)
        summary += b"".join(map(_encoded, offsets))
        head = _FOOTER_HEAD.pack(Opcode.FOOTER, 8 + 8 + 4, start, offset_start)
        self._stream.write(summary)
        crc = zlib.crc32(head, zlib.crc32(summary))
        self._write(Footer(summary_start=start, summary_offset_start=offset_start, summary_crc=crc))
        self._stream.write(MAGIC)

    def _statistics(self) -> Statistics:
        first, last = self._span or (0, 0)
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )

    def _write(self, record: Any) -> int:
        """Write a record to the stream; returns its length."""
        self._write_packed()
        data = _encoded(record)
        self._stream.write(data)
        return len(data)

    def _begin_chunk(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._size = 0
        self._indices: list[tuple[Ints, Ints, Ints]] = []  # channels, times and offsets of messages

    def _add_to_chunk(self, record: bytes) -> None:
        self._parts.append(record)
        self._size += len(record)
        self._end_if_full()

    def _end_if_full(self) -> None:
        if self._size > CHUNK_BYTES:
            self._end_chunk()

    def _end_chunk(self) -> None:
        """Pack the chunk, if it has messages, and write the one before."""
        if not self._indices:
            return
        channels, times, offsets = map(np.concatenate, zip(*self._indices, strict=True))
        data = self._parts[0] if len(self._parts) == 1 else b"".join(self._parts)
        first, last = int(times.min()), max(0, int(times.max()))
        self._span = (first, last) if self._span is None else (min(first, self._span[0]), max(last, self._span[1]))
        by_channel = np.argsort(channels, kind="stable")
        entries = np.empty(len(channels), _INDEX_ENTRY)
        entries["time"], entries["offset"] = times[by_channel], offsets[by_channel]
        counts = np.bincount(channels)
        ends = np.cumsum(counts)
        indices: dict[int, bytes] = {}
        for channel in dict.fromkeys(channels.tolist()):
            own = entries[ends[channel] - counts[channel] : ends[channel]].tobytes()
            head = _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(own), channel, len(own))
            indices[channel] = head + own
            self._counts[channel] = self._counts.get(channel, 0) + int(counts[channel])
        self._write_packed()
        self._packed = OverlappedCall(lambda: _packed(data, first, last, indices), is_overlapped=self._overlaps)
        self._begin_chunk()

    def _write_packed(self) -> None:
        """Write the chunk that is being packed, if there is one, and its indices."""
        if self._packed is None:
            return
        (chunk, indices), self._packed = self._packed.wait(), None
        start = self._stream.tell()
        record = _encoded(chunk)
        self._stream.write(record)
        at, index_offsets = self._stream.tell(), dict[int, int]()
        for channel, index in indices.items():
            index_offsets[channel] = at
            at += len(index)
        self._stream.write(b"".join(indices.values()))
        self._chunks.append(
            ChunkIndex(
                message_start_time=chunk.message_start_time, message_end_time=chunk.message_end_time,
                chunk_start_offset=start, chunk_length=len(record), message_index_offsets=index_offsets,
                message_index_length=sum(map(len, indices.values())), compression=chunk.compression,
                compressed_size=len(chunk.data), uncompressed_size=chunk.uncompressed_size,
            )
        )  # fmt: skip


def _packed(
    data: bytes | memoryview, first: int, last: int, indices: dict[int, bytes]
) -> tuple[Chunk, dict[int, bytes]]:
    """The record of a chunk of messages from a first to a last time [ns], and what follows it."""
    chunk = Chunk(
        compression="zstd", data=_compressed(data), message_start_time=first, message_end_time=last,
        uncompressed_crc=zlib.crc32(data), uncompressed_size=len(data),
    )  # fmt: skip
    return chunk, indices


_compressors: list[zstandard.ZstdCompressor] = []  # those at work on no chunk; with a new one it takes a fifth longer


def _compressed(data: bytes | memoryview) -> bytes:
    """Data in one frame of zstd."""
    try:
        compressor = _compressors.pop()
    except IndexError:
        compressor = zstandard.ZstdCompressor()
    compressed = compressor.compress(data)
    _compressors.append(compressor)
    return compressed


def _prefixed(text: str) -> bytes:
    """A string of a record, after its length."""
    data = text.encode()
    return len(data).to_bytes(4, "little") + data


def _encoded(record: Any) -> bytes:
    """The bytes of one of the package's records."""
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]  # the package has no annotation there
    return data
