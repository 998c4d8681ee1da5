"""Writes MCAP files, many messages at once: laid out to the byte as the writer of the mcap package does by default.

That one appends a message field by field in Python: 8 messages a frame took a tenth of a replay. Records other than messages
and their indexes are the package's.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

Ints = NDArray[np.int64]

CHUNK_SIZE = 1 << 20
"""Bytes; a chunk ends with the message that makes it larger."""

_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),  # of what follows
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_LENGTH_FROM = 9  # the first bytes of a record, which its length does not count
_INDEX_HEAD = struct.Struct("<BQHI")


class McapWriter:
    """Writes one file into a stream: `start`, then everything else, `finish` at the end. It does not close the stream.

    Parameters
    ----------
    stream
        Open for writing, at its start.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._position = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._messages: dict[int, int] = {}  # of each channel
        self._first, self._last = 2**64, 0  # log times
        self._begin_chunk()

    def start(self, profile: str, library: str) -> None:
        """Write the head of the file."""
        self._write(MCAP0_MAGIC + _bytes_of(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; returns its number."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._append(_bytes_of(schema))
        return schema.id

    def register_channel(
        self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str] | None = None
    ) -> int:
        """Declare a channel; returns its number."""
        number = len(self._channels) + 1
        channel = Channel(number, topic, encoding, dict(metadata or {}), schema)
        self._channels.append(channel)
        self._append(_bytes_of(channel))
        return number

    def add_message(self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int = 0) -> None:
        """Write a message; times in ns."""
        log_times, publish_times = np.array([log_time], np.uint64), np.array([publish_time], np.uint64)
        self._add(np.array([channel]), log_times, publish_times, np.array([sequence]), [data])

    def add_messages(self, channels: Sequence[int], times: Ints, sequences: Ints, data: Sequence[bytes]) -> None:
        """Write messages in their order; `times` (n,) [ns] are those of log and publication."""
        self._add(np.array(channels), times, times, sequences, data)

    def add_attachment(self, log_time: int, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment; its time of creation is not recorded."""
        record = _bytes_of(Attachment(0, log_time, name, media_type, data))
        index = AttachmentIndex(
            offset=self._position,
            length=len(record),
            create_time=0,
            log_time=log_time,
            data_size=len(data),
            name=name,
            media_type=media_type,
        )
        self._attachments.append(index)
        self._write(record)

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record."""
        record = _bytes_of(Metadata(name=name, metadata=dict(data)))
        self._metadata.append(MetadataIndex(offset=self._position, length=len(record), name=name))
        self._write(record)

    def finish(self) -> None:
        """Write what is buffered, and the summary."""
        self._end_chunk()
        self._write(_bytes_of(DataEnd(0)))
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._messages,
            chunk_count=len(self._chunks),
            message_count=sum(self._messages.values()),
            message_start_time=self._first if self._messages else 0,
            message_end_time=self._last,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: dict[Opcode, Sequence[McapRecord]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunks,
            Opcode.ATTACHMENT_INDEX: self._attachments,
            Opcode.METADATA_INDEX: self._metadata,
        }
        start, summary, offsets = self._position, b"", b""
        for opcode, records in groups.items():
            group = b"".join(map(_bytes_of, records))
            offsets += _bytes_of(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        footer = Footer(summary_start=start, summary_offset_start=start + len(summary), summary_crc=0)
        summary += offsets
        footer.summary_crc = zlib.crc32(summary + _bytes_of(footer)[:-4])
        self._write(summary + _bytes_of(footer) + MCAP0_MAGIC)

    def _add(
        self,
        channels: NDArray[np.integer],
        log_times: NDArray[np.integer],
        publish_times: NDArray[np.integer],
        sequences: NDArray[np.integer],
        data: Sequence[bytes],
    ) -> None:
        heads = np.empty(len(data), _HEAD)
        heads["opcode"] = Opcode.MESSAGE
        heads["channel"], heads["sequence"] = channels, sequences & 0xFFFFFFFF
        heads["log_time"], heads["publish_time"] = log_times, publish_times
        lengths = np.array([len(part) for part in data], np.int64) + _HEAD.itemsize
        heads["length"] = lengths - _LENGTH_FROM
        begin = 0
        while begin < len(data):
            ends = self._size + np.cumsum(lengths[begin:])
            count = min(int(np.searchsorted(ends, CHUNK_SIZE, side="right")) + 1, len(data) - begin)
            here = slice(begin, begin + count)
            packed = heads[here].tobytes()
            parts = [b""] * (2 * count)
            parts[::2] = [packed[k : k + _HEAD.itemsize] for k in range(0, len(packed), _HEAD.itemsize)]
            parts[1::2] = data[here]
            offsets = np.concatenate([[self._size], ends[: count - 1]])
            self._indexed.append((heads["channel"][here], heads["log_time"][here], offsets))
            self._append(b"".join(parts))
            begin += count

    def _append(self, records: bytes) -> None:
        """Add records to the chunk."""
        self._parts.append(records)
        self._size += len(records)
        if self._size > CHUNK_SIZE:
            self._end_chunk()

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0
        self._indexed: list[tuple[NDArray[np.integer], NDArray[np.integer], Ints]] = []

    def _end_chunk(self) -> None:
        """Write the chunk and the indexes of its messages; without a message it goes on."""
        if not self._indexed:
            return
        channels, times, offsets = (np.concatenate(column) for column in zip(*self._indexed, strict=True))
        content = b"".join(self._parts)
        first, last = int(times.min()), int(times.max())
        chunk = Chunk(
            compression="zstd",
            data=zstandard.compress(content),
            message_start_time=first,
            message_end_time=last,
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        record, indexes = _bytes_of(chunk), b""
        index_offsets: dict[int, int] = {}
        for number in dict.fromkeys(channels.tolist()):
            rows = channels == number
            entries = np.stack([times[rows], offsets[rows].astype(np.uint64)], axis=1).astype("<u8").tobytes()
            index_offsets[number] = self._position + len(record) + len(indexes)
            indexes += _INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), number, len(entries)) + entries
            self._messages[number] = self._messages.get(number, 0) + int(rows.sum())
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(record),
                chunk_start_offset=self._position,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=last,
                message_index_length=len(indexes),
                message_index_offsets=index_offsets,
                message_start_time=first,
                uncompressed_size=len(content),
            )
        )
        self._first, self._last = min(self._first, first), max(self._last, last)
        self._write(record + indexes)
        self._begin_chunk()

    def _write(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
