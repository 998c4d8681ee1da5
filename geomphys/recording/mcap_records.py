"""Parses MCAP records from untrusted bytes: record iteration, chunk decompression, resynchronisation after damage.

The bytes are untrusted: every length is checked against the available bytes, and
a chunk unpacks to at most `CHUNK_LIMIT` bytes, whatever it claims. Nothing here raises on bad input but
`BadRecordError`, which never leaves the package. Record bodies are read by the `mcap` library.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics
from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
CHUNK_LIMIT = 256 * 2**20
"""Bytes; maximum size of a chunk (compressed or not) and of a message outside of chunks."""
BODY_LIMIT = 16 * 2**20
"""Bytes; maximum size of a schema, channel, metadata or statistics record."""
DEFINITIONS_LIMIT = 128 * 2**20
"""Bytes; maximum total size of schemas and channels, and of metadata: they are held in memory."""
HEAD = struct.Struct("<BQ")  # opcode, length
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
FOOTER = struct.Struct("<QQI")  # summary start, summary offset start, summary crc
CHUNK = struct.Struct("<QQQII")  # start time, end time, unpacked size, crc, length of the compression's name
WINDOW_LIMIT = 128 * 2**20  # zstd's default maximum window of a decoder
NO_SCHEMA = 0
"""Of a channel without a schema; a schema of this number is invalid, and readers pass over it."""
LAST_OPCODE = int(Opcode.DATA_END)
"""Opcodes above it belong to later versions of the format (up to 0x7f) or to applications (from 0x80): readers pass over them."""
BLOCK_SIZE = 64 * 1024
BLOCK_RECORDS = 4096  # records whose heads are read at once
MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
"""What the record of a message begins with."""
RESYNC_RECORDS = 4  # consecutive valid records required to resynchronise, records of unknown opcodes not counted
MAX_UNKNOWN_RECORDS = 16  # of unknown opcodes that are passed over among these


class BadRecordError(Exception):
    """An invalid record, with the reason. Internal to the package."""


class ChunkHeader(NamedTuple):
    """The fields of a chunk record before its data."""

    start_time: int
    end_time: int
    size: int  # unpacked
    crc: int  # of the unpacked data; 0: none
    compression: str
    data_length: int  # packed
    header_length: int  # bytes from the body's start to the data


def walk(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Complete records in `data`: (opcode, body start, body end); ends before the first that is not complete."""
    start, stop = 0, len(data)
    unpack = HEAD.unpack_from
    while start + 9 <= stop:
        opcode, length = unpack(data, start)
        body = start + 9
        start = body + length
        if start > stop:
            return
        yield opcode, body, start


class Heads(NamedTuple):
    """How k records begin."""

    fields: NDArray[np.void]  # (k,) MESSAGE_HEAD; of other records than messages only the opcode is theirs
    begin: NDArray[np.int64]  # (k,) of the bodies
    end: NDArray[np.int64]  # (k,)

    def taken(self, rows: NDArray[np.bool_]) -> Heads:
        """Some of them."""
        return Heads(self.fields[rows], self.begin[rows], self.end[rows])


def heads_of_records(data: bytes, stop: int | None = None) -> Iterator[Heads]:
    """The records that `walk` finds, before a byte `stop`, `BLOCK_RECORDS` at a time."""
    at, stop, length_at = 0, len(data) if stop is None else stop, struct.Struct("<Q").unpack_from
    size = MESSAGE_HEAD.itemsize
    data = data if len(data) >= size else data.ljust(size)
    at_every_byte = np.ndarray(len(data) - size + 1, MESSAGE_HEAD, data, strides=(1,))
    while True:
        starts = [at]
        while len(starts) <= BLOCK_RECORDS and at + 9 <= stop:
            at += 9 + length_at(data, at + 1)[0]
            if at > stop:
                break
            starts.append(at)
        if len(starts) == 1:
            return
        at = starts[-1]
        edges = np.array(starts, np.int64)
        fields = at_every_byte[np.minimum(edges[:-1], len(at_every_byte) - 1)]
        fields["opcode"] = np.frombuffer(data, np.uint8)[edges[:-1]]  # also where no head of a message fits
        yield Heads(fields, edges[:-1] + 9, edges[1:])


def read_body(
    kind: type[Schema] | type[Channel] | type[Metadata] | type[Statistics], body: bytes
) -> Schema | Channel | Metadata | Statistics:
    """Parse a small record's body. Raises BadRecordError."""
    stream = ReadDataStream(io.BytesIO(body))
    try:
        record: Schema | Channel | Metadata | Statistics = kind.read(stream)
    except (McapError, struct.error, UnicodeDecodeError, MemoryError, OverflowError) as problem:
        raise BadRecordError(f"{kind.__name__.lower()} record cannot be read") from problem
    if stream.count > len(body):
        raise BadRecordError(f"{kind.__name__.lower()} record is shorter than its fields")
    return record


def read_chunk_header(body: bytes, length: int) -> ChunkHeader:
    """Parse the header of a chunk whose record body is `length` bytes long; `body` need only hold its beginning.

    Raises BadRecordError where the lengths in it do not add up to `length`.
    """
    if len(body) < CHUNK.size:
        raise BadRecordError("chunk head is cut off")
    start_time, end_time, size, crc, name_length = CHUNK.unpack_from(body, 0)
    at = CHUNK.size + name_length
    if name_length > 64 or len(body) < at + 8:
        raise BadRecordError("chunk head is cut off or its compression has no readable name")
    try:
        compression = body[CHUNK.size : at].decode("ascii")
    except UnicodeDecodeError as problem:
        raise BadRecordError("chunk's compression has no readable name") from problem
    data_length = int.from_bytes(body[at : at + 8], "little")
    if at + 8 + data_length > length:
        raise BadRecordError("chunk's data is longer than its record")
    return ChunkHeader(start_time, end_time, size, crc, compression, data_length, at + 8)


def unpack_chunk(header: ChunkHeader, data: bytes) -> tuple[bytes, str]:
    """Decompress as much of a chunk as possible: (bytes, description of its damage or "").

    `data` may be cut off. At most `head.size` and never more than `CHUNK_LIMIT` bytes come back; a chunk that claims
    more than the limit is not unpacked at all. A wrong checksum is reported, and the bytes are returned all the same.
    """
    if header.size > CHUNK_LIMIT:
        return b"", f"claims to unpack to {header.size} bytes, more than the limit of {CHUNK_LIMIT}"
    if header.compression == "":
        out, damage = data[: header.size], ""
    elif header.compression == "zstd":
        out, damage = _unzstd(data, header.size)
    elif header.compression == "lz4":
        out, damage = _unlz4(data, header.size)
    else:
        return b"", f"is packed with {header.compression!r}; zstd and lz4 can be read"
    if len(data) < header.data_length:
        return out, "is cut off"
    if damage:
        return out, damage
    if len(out) != header.size:
        return out, f"unpacks to {len(out)} bytes instead of {header.size}"
    if header.crc and zlib.crc32(out) != header.crc:
        return out, "does not fit its checksum"
    return out, ""


def is_intact_prefix(header: ChunkHeader, data: bytes) -> bool:
    """Whether `data` is an intact prefix of a chunk's data, truncated at its end.

    A record seen in such data is a part of it, not one that follows damage: packers store as it is what they cannot pack.
    """
    if header.size > CHUNK_LIMIT or len(data) >= header.data_length:
        return False
    if header.compression == "":
        at = 0
        while at + HEAD.size <= len(data):
            opcode, length = HEAD.unpack_from(data, at)
            in_chunks = opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE) or opcode > LAST_OPCODE
            if not in_chunks or at + HEAD.size + length > header.size:
                return False
            at += HEAD.size + length
        return True
    if header.compression not in ("zstd", "lz4"):
        return False
    out, damage = (_unzstd if header.compression == "zstd" else _unlz4)(data, header.size)
    return not damage and len(out) < header.size


def _unzstd(data: bytes, size: int) -> tuple[bytes, str]:
    """Decompress zstd up to `size` bytes; on failure, as much as precedes the damage."""
    decompressor = zstandard.ZstdDecompressor(max_window_size=WINDOW_LIMIT)
    try:
        with decompressor.stream_reader(data, read_across_frames=True) as stream:
            out = stream.read(size + 1) if size else b""
        return (out, "") if len(out) <= size else (out[:size], f"unpacks to more than the {size} bytes it claims")
    except (zstandard.ZstdError, MemoryError):
        blocks: list[bytes] = []
        try:
            with decompressor.stream_reader(data, read_across_frames=True) as stream:
                while len(blocks) * BLOCK_SIZE < size and (block := stream.read(BLOCK_SIZE)):
                    blocks.append(block)
        except (zstandard.ZstdError, MemoryError):
            pass  # reported below with the bytes decompressed so far
        return b"".join(blocks)[:size], "cannot be unpacked to its end"


def _unlz4(data: bytes, size: int) -> tuple[bytes, str]:
    """Decompress an lz4 frame up to `size` bytes; on failure, as much as precedes the damage."""
    blocks: list[bytes] = []
    remaining = size + 1
    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        for start in range(0, len(data), BLOCK_SIZE):
            block = decompressor.decompress(data[start : start + BLOCK_SIZE], max_length=remaining)
            blocks.append(block)
            remaining -= len(block)
            while remaining > 0 and not decompressor.needs_input and not decompressor.eof:
                block = decompressor.decompress(b"", max_length=remaining)
                if not block:
                    break
                blocks.append(block)
                remaining -= len(block)
            if remaining <= 0:
                return b"".join(blocks)[:size], f"unpacks to more than the {size} bytes it claims"
            if decompressor.eof:
                break
    except (RuntimeError, MemoryError, EOFError):
        return b"".join(blocks)[:size], "cannot be unpacked to its end"
    out = b"".join(blocks)
    short = decompressor.eof and len(out) < size
    return out, f"unpacks to {len(out)} bytes instead of {size}" if short else ""


_CANDIDATE = re.compile(rb"[\x01-\x0f](?=[\s\S]{4}\x00{4})")


def find_record(file: BinaryIO, start: int, size: int) -> int | None:
    """Offset of the next valid record at or after `start`: a chunk with consistent lengths, or `RESYNC_RECORDS` records in a row.

    Reads the file once, in growing blocks. None if nothing is found before its end.
    """
    block_size, overlap = 4096, 8
    while start < size:
        file.seek(start)
        block = file.read(block_size + overlap)
        for match in _CANDIDATE.finditer(block):
            at = match.start()
            next_record = at + 9 + int.from_bytes(block[at + 1 : at + 9], "little")
            if next_record < len(block) and block[next_record] == 0:
                continue
            if at < block_size and _starts_record_sequence(file, start + at, size):
                return start + at
        start += block_size
        block_size = min(2 * block_size, 4 * 2**20)
    return None


def _starts_record_sequence(file: BinaryIO, at: int, size: int) -> bool:
    """Whether `RESYNC_RECORDS` records in order, or fewer up to the closing magic, begin here."""
    known = 0
    for _ in range(RESYNC_RECORDS + MAX_UNKNOWN_RECORDS):
        if known == RESYNC_RECORDS:
            return True
        file.seek(at)
        header = file.read(9 + CHUNK.size + 80)
        if at + len(MAGIC) == size and header.startswith(MAGIC):
            return True
        if len(header) < 9:
            return False
        opcode, length = HEAD.unpack_from(header, 0)
        if opcode == 0 or at + 9 + length > size:
            return False
        known += opcode <= LAST_OPCODE
        body = header[9:]
        if opcode == Opcode.CHUNK:
            try:
                chunk = read_chunk_header(body, length)
            except BadRecordError:
                return False
            return chunk.header_length + chunk.data_length == length and chunk.compression in ("", "zstd", "lz4")
        if opcode == Opcode.MESSAGE_INDEX and (length < 6 + int.from_bytes(body[2:6], "little")):
            return False
        if opcode == Opcode.MESSAGE and length < MESSAGE.size:
            return False
        if opcode == Opcode.FOOTER and length != FOOTER.size:
            return False
        at += 9 + length
    return known == RESYNC_RECORDS
