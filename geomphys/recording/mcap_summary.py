"""Opens an MCAP file behind a URL by its summary section, without reading its chunks.

Only the footer, the summary and the message indexes behind the chunks are read. They are used as far as they agree
with each other; where they do not, or anything is missing, the log is scanned instead (`mcap_scan.py`). The chunks themselves
are not read; they are checked when they are.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import BinaryIO, cast

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Metadata, MetadataIndex, Schema, Statistics

from geomphys.recording.mcap_records import (
    BODY_LIMIT,
    CHUNK_LIMIT,
    FOOTER,
    HEAD,
    MAGIC,
    NO_SCHEMA,
    BadRecordError,
    read_body,
    walk,
)
from geomphys.recording.mcap_scan import TIME_LIMIT, ChannelCount, FileScan, Span

SUMMARY_LIMIT = 64 * 2**20
"""Bytes; a log with a longer summary is scanned."""
INDEX_BATCH = 64
"""Chunks whose message indexes are requested together."""
TAIL = 9 + FOOTER.size + len(MAGIC)
_INDEX_ENTRY = struct.Struct("<QQ")  # log time, offset in the chunk

Ranges = Callable[[Sequence[tuple[int, int]]], list[bytes]]
"""Gives parts of the file, each from a first byte to before a last one."""


def scan_summary(stream: BinaryIO, size: int, ranges: Ranges) -> FileScan | None:
    """Scan result from the summary of a log that begins with the magic bytes; None if it is missing or inconsistent.

    Raises OSError if the file cannot be read.
    """
    try:
        return _Summary(stream, size).read(ranges)
    except (BadRecordError, McapError, struct.error, UnicodeDecodeError, ValueError, KeyError, MemoryError):
        return None


class _Summary:
    """State of the reading of a summary."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self.stream, self.size = stream, size
        self.result = FileScan(size, verified=False)
        self.chunks: list[ChunkIndex] = []
        self.metadata: list[MetadataIndex] = []
        self.statistics: Statistics | None = None

    def read(self, ranges: Ranges) -> FileScan:
        """Read the summary. Raises BadRecordError and the parsers' errors where it is inconsistent."""
        self.stream.seek(len(MAGIC))
        opcode, length = HEAD.unpack(self.stream.read(HEAD.size))
        _require(opcode == Opcode.HEADER and length <= BODY_LIMIT, "the file does not begin with a header")
        body = self.stream.read(length)
        self.result.profile = body[4 : 4 + int.from_bytes(body[:4], "little")].decode("utf-8", "replace")
        self._records()
        self._chunks(ranges)
        for location in self.metadata:
            self.stream.seek(location.offset)
            opcode, length = HEAD.unpack(self.stream.read(HEAD.size))
            _require(opcode == Opcode.METADATA and length <= BODY_LIMIT, "an index points elsewhere")
            self.result.metadata.append(cast(Metadata, read_body(Metadata, self.stream.read(length))))
        return self.result

    def _records(self) -> None:
        """Add the records of the summary."""
        _require(self.size > len(MAGIC) + TAIL, "the file is too short")
        self.stream.seek(self.size - TAIL)
        tail = self.stream.read(TAIL)
        opcode, length = HEAD.unpack_from(tail, 0)
        start, _, crc = FOOTER.unpack_from(tail, HEAD.size)
        _require(opcode == Opcode.FOOTER and length == FOOTER.size and tail.endswith(MAGIC), "there is no footer")
        end = self.size - TAIL
        _require(len(MAGIC) < start < end and end - start <= SUMMARY_LIMIT, "there is no summary of usable length")
        self.stream.seek(start)
        data = self.stream.read(end - start)
        _require(not crc or zlib.crc32(tail[: HEAD.size + 16], zlib.crc32(data)) == crc, "the checksum does not fit")
        at = 0
        for kind, begin, at in walk(data):
            self._take(kind, data[begin:at])
        _require(at == len(data), "the last record is cut off")

    def _take(self, kind: int, body: bytes) -> None:
        """Add a record."""
        if kind == Opcode.SCHEMA:
            schema = cast(Schema, read_body(Schema, body))
            if schema.id != NO_SCHEMA:
                self.result.schemas[schema.id] = schema
        elif kind == Opcode.CHANNEL:
            channel = cast(Channel, read_body(Channel, body))
            self.result.channels[channel.id] = channel
        elif kind == Opcode.STATISTICS:
            self.statistics = cast(Statistics, read_body(Statistics, body))
        elif kind == Opcode.CHUNK_INDEX:
            self.chunks.append(ChunkIndex.read(ReadDataStream(io.BytesIO(body))))
        elif kind == Opcode.METADATA_INDEX:
            self.metadata.append(MetadataIndex.read(ReadDataStream(io.BytesIO(body))))

    def _chunks(self, ranges: Ranges) -> None:
        """Turn chunk indexes and message indexes into spans and counts."""
        statistics_record, result = self.statistics, self.result
        if statistics_record is None:
            raise BadRecordError("there are no statistics")
        _require(statistics_record.chunk_count == len(self.chunks), "chunks are missing in the index")
        _require(statistics_record.metadata_count == len(self.metadata), "metadata is missing in the index")
        self.chunks.sort(key=lambda chunk: chunk.chunk_start_offset)
        indexes = [(c.chunk_start_offset + c.chunk_length, c.message_index_length) for c in self.chunks]
        for (start, length), chunk in zip(indexes, self.chunks, strict=True):
            _require(max(chunk.uncompressed_size, chunk.chunk_length, length) <= CHUNK_LIMIT, "a chunk is too large")
            _require(chunk.chunk_start_offset > 0 and start + length <= self.size, "an index points elsewhere")
        for at in range(0, len(indexes), INDEX_BATCH):
            parts = [(start, start + length) for start, length in indexes[at : at + INDEX_BATCH]]
            for chunk, data in zip(self.chunks[at : at + INDEX_BATCH], ranges(parts), strict=True):
                seen, first, last = self._message_index(data)
                _require(seen == set(chunk.message_index_offsets), "a message index is missing")
                if seen:
                    location = (chunk.chunk_start_offset, chunk.chunk_length, True, chunk.uncompressed_size)
                    result.spans.append(Span(*location, None, frozenset(seen), first, last, verified=False))
        counts = {channel: count.messages for channel, count in result.counts.items()}
        _require(sum(counts.values()) == statistics_record.message_count, "messages are missing in the index")
        _require(
            {c: n for c, n in statistics_record.channel_message_counts.items() if n} == counts,
            "the statistics do not fit",
        )
        _require(set(counts) <= set(result.channels), "a channel is missing")
        _require({c.schema_id for c in result.channels.values()} - {0} <= set(result.schemas), "a schema is missing")

    def _message_index(self, data: bytes) -> tuple[set[int], int, int]:
        """Channels, earliest and latest log time of the messages of a chunk, which are counted."""
        seen: set[int] = set()
        earliest, latest, at = TIME_LIMIT, -1, 0
        for kind, begin, at in walk(data):
            _require(kind == Opcode.MESSAGE_INDEX and at - begin >= 6, "no message index")
            channel, length = struct.unpack_from("<HI", data, begin)
            _require(length <= at - begin - 6 and length % 16 == 0, "a message index is cut off")
            times = sorted(time for time, _ in _INDEX_ENTRY.iter_unpack(data[begin + 6 : begin + 6 + length]))
            if not times:
                continue
            _require(times[-1] <= TIME_LIMIT, "a time is out of range")
            seen.add(channel)
            count = self.result.counts.setdefault(channel, ChannelCount(longest_gap=0))
            steps = [b - a for a, b in pairwise([count.last, *times] if count.messages else times)]
            count.longest_gap = max(count.longest_gap or 0, *steps, 0)
            count.messages += len(times)
            count.first, count.last = min(count.first, times[0]), max(count.last, times[-1])
            earliest, latest = min(earliest, times[0]), max(latest, times[-1])
        _require(at == len(data), "a message index is cut off")
        return seen, earliest, latest


def _require(condition: bool, message: str) -> None:
    """Raise BadRecordError unless a condition holds."""
    if not condition:
        raise BadRecordError(message)
