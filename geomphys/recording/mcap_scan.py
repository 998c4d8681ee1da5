"""Scans an MCAP file once: schemas, channels, message counts, positions of chunks, and damage.

Every record is read once, every checksum is verified, and the positions of messages are listed (`Span`), so that later passes
read only those. The scan resumes after damage wherever records can be found again: the error then says how much is intact,
and `recover` replays just that.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import BinaryIO, NamedTuple, cast

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema, Statistics

from geomphys.recording.mcap_records import (
    BODY_LIMIT,
    CHUNK,
    CHUNK_LIMIT,
    DEFINITIONS_LIMIT,
    FOOTER,
    HEAD,
    LAST_OPCODE,
    MAGIC,
    MESSAGE,
    NO_SCHEMA,
    BadRecordError,
    ChunkHeader,
    find_record,
    heads_of_records,
    is_intact_prefix,
    read_body,
    read_chunk_header,
    unpack_chunk,
)

MAX_TRUNCATION_CHECKS = 16
"""Maximum number of chunks beyond the end of the file that are checked for being the truncated last one."""
MAX_RUN_BYTES = 2**20
"""Records outside of chunks are taken together up to this many bytes."""
PRIVATE_OPCODES = 0x80
"""From this one on opcodes belong to applications."""
TIME_LIMIT = 2**62
"""ns; a time stamp above this (the year 2116) is taken for damage, so that times fit 64 bits with a sign."""


class Span(NamedTuple):
    """A chunk, or a run of records outside of chunks, that holds messages."""

    offset: int  # in the file, of the first record's opcode
    length: int  # bytes, opcodes included
    chunk: bool
    usable: int  # chunks: unpacked bytes that hold complete records
    window: tuple[int, int] | None  # chunks that do not fit their checksum: only messages of these log times are used
    channels: frozenset[int]
    first: int  # earliest and latest log time of its messages
    last: int
    verified: bool = True  # whether its bytes were read and checked


class Loss(NamedTuple):
    """A damaged region of a file."""

    offset: int
    bytes_lost: int
    text: str


@dataclass
class ChannelCount:
    """What a scan counts of a channel. Times are log times in ns."""

    messages: int = 0
    first: int = TIME_LIMIT
    last: int = -1
    longest_gap: int | None = None  # ns between messages in order of time; only from message indexes


@dataclass
class FileScan:
    """What a scan found in one file."""

    size: int
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: dict[int, ChannelCount] = field(default_factory=dict)
    spans: list[Span] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    unknown: dict[int, int] = field(
        default_factory=dict
    )  # opcode of a later version of the format -> records passed over
    profile: str = ""
    verified: bool = True  # whether all of the file was read and checked

    @property
    def messages(self) -> int:
        """Messages that can be read."""
        return sum(c.messages for i, c in self.counts.items() if i in self.channels)


def scan_file(file: BinaryIO, size: int) -> FileScan:
    """Scan a file that begins with the magic bytes. Damage is listed, never raised."""
    return _Scanner(file, size).run()


class _SpanContent:
    """Channels and times of the messages of a span."""

    def __init__(self) -> None:
        self.channels: set[int] = set()
        self.first, self.last = TIME_LIMIT, -1

    def add(self, channel: int, first: int, last: int) -> None:
        """Add messages of a channel between two times."""
        self.channels.add(channel)
        self.first, self.last = min(self.first, first), max(self.last, last)

    def summary(self) -> tuple[frozenset[int], int, int]:
        """The last fields of a `Span`."""
        return frozenset(self.channels), self.first, self.last


class _Scanner:
    """State of a scan."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self.file, self.size = file, size
        self.result = FileScan(size)
        self.statistics: Statistics | None = None
        self.run_start = -1  # of the run of messages outside of chunks being read
        self.seen = _SpanContent()
        self.data_crc: tuple[int, int] | None = None  # position and value
        self.definition_bytes = [0, 0]  # bytes of schemas and channels, and of metadata, held in memory
        self.has_footer = False
        self.is_truncated = False
        self.truncation_checks_left = MAX_TRUNCATION_CHECKS

    def run(self) -> FileScan:
        """Read the file to its end."""
        at = len(MAGIC)
        while at < self.size and not self.has_footer:
            self.file.seek(at)
            header = self.file.read(9)
            try:
                if len(header) < 9:
                    raise BadRecordError("the file ends within a record's head")
                opcode, length = HEAD.unpack(header)
                if opcode == 0:
                    raise BadRecordError("no record has the opcode 0")
                end = at + 9 + length
                if end > self.size:
                    raise BadRecordError(
                        f"a record of {length} bytes does not fit into the {self.size - at - 9} that are left"
                    )
                self.record(opcode, at, length)
                at = end
            except BadRecordError as problem:
                at = self.resume_after_damage(at, str(problem))
        self.close_run(at)
        if not self.has_footer and not self.is_truncated:
            self.add_loss(self.size, 0, "the file ends without its closing records: it was not finished")
        self.check_totals()
        return self.result

    def record(self, opcode: int, at: int, length: int) -> None:
        """Process the record at byte `at`, whose body lies within the file. Raises BadRecordError."""
        if opcode == Opcode.MESSAGE:
            self.message(at, length)
            return
        self.close_run(at)
        if opcode == Opcode.CHUNK:
            self.chunk(at, length, at + 9 + length)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.STATISTICS):
            self.definition(opcode, self.body(length))
        elif opcode == Opcode.HEADER:
            body = self.body(length)
            self.result.profile = body[4 : 4 + int.from_bytes(body[:4], "little")].decode("utf-8", "replace")
        elif opcode == Opcode.DATA_END:
            if length < 4:
                raise BadRecordError("the record that ends the data is cut off")
            if crc := int.from_bytes(self.file.read(4), "little"):
                self.data_crc = (at, crc)
        elif opcode == Opcode.FOOTER:
            self.footer(at, length)
        elif opcode > LAST_OPCODE:
            self.pass_over(opcode)

    def pass_over(self, opcode: int) -> None:
        """Count a record of a kind that this version of the format does not have; those of applications are their own affair."""
        if opcode < PRIVATE_OPCODES:
            self.result.unknown[opcode] = self.result.unknown.get(opcode, 0) + 1

    def body(self, length: int) -> bytes:
        """Read the body of a small record. Raises BadRecordError if it is not small."""
        if length > BODY_LIMIT:
            raise BadRecordError(f"a record of {length} bytes is longer than the limit of {BODY_LIMIT}")
        return self.file.read(length)

    def definition(self, opcode: int, body: bytes) -> None:
        """Add a schema, channel, metadata or statistics record. Raises BadRecordError."""
        kind = int(opcode == Opcode.METADATA)  # counted by itself: notes must not cost messages
        if self.definition_bytes[kind] + len(body) > DEFINITIONS_LIMIT:
            what = ("schemas and channels", "metadata")[kind]
            raise BadRecordError(f"{what} take more than the limit of {DEFINITIONS_LIMIT} bytes")
        defined_before = len(self.result.schemas) + len(self.result.channels) + len(self.result.metadata)
        if opcode == Opcode.SCHEMA:
            schema = cast(Schema, read_body(Schema, body))
            if schema.id == NO_SCHEMA:
                return
            known_schema = self.result.schemas.setdefault(schema.id, schema)
            if known_schema != schema:
                raise BadRecordError(f"schema {schema.id} is defined twice, and differently")
        elif opcode == Opcode.CHANNEL:
            channel = cast(Channel, read_body(Channel, body))
            known_channel = self.result.channels.setdefault(channel.id, channel)
            if known_channel != channel:
                raise BadRecordError(f"channel {channel.id} is defined twice, and differently")
        elif opcode == Opcode.METADATA:
            self.result.metadata.append(cast(Metadata, read_body(Metadata, body)))
        elif opcode == Opcode.STATISTICS:
            self.statistics = cast(Statistics, read_body(Statistics, body))
        if len(self.result.schemas) + len(self.result.channels) + len(self.result.metadata) > defined_before:
            self.definition_bytes[kind] += len(body)

    def message(self, at: int, length: int) -> None:
        """Count a message outside of chunks."""
        if not MESSAGE.size <= length <= CHUNK_LIMIT:
            raise BadRecordError(f"a message of {length} bytes cannot be")
        channel, _, log_time, _ = MESSAGE.unpack(self.file.read(MESSAGE.size))
        if log_time > TIME_LIMIT:
            raise BadRecordError(f"a message has the time {log_time}")
        if self.run_start >= 0 and at - self.run_start > MAX_RUN_BYTES:
            self.close_run(at)
        if self.run_start < 0:
            self.run_start, self.seen = at, _SpanContent()
        self.seen.add(channel, log_time, log_time)
        self.count(channel, 1, log_time, log_time)

    def count(self, channel: int, messages: int, first: int, last: int) -> None:
        """Count messages of a channel between two times."""
        c = self.result.counts.get(channel)
        if c is None:
            c = self.result.counts[channel] = ChannelCount()
        c.messages += messages
        c.first, c.last = min(c.first, first), max(c.last, last)

    def close_run(self, at: int) -> None:
        """End the run of messages outside of chunks, if there is one, before `at`."""
        if self.run_start >= 0:
            length = at - self.run_start
            self.result.spans.append(Span(self.run_start, length, False, 0, None, *self.seen.summary()))
            self.run_start = -1

    def chunk(self, at: int, length: int, end: int) -> None:
        """Add a chunk, of which the bytes before `end` are there. Raises BadRecordError if its head is wrong."""
        self.file.seek(at + 9)
        beginning = self.file.read(max(0, min(CHUNK.size + 80, end - at - 9)))
        header = read_chunk_header(beginning, length)
        if header.data_length > CHUNK_LIMIT:
            raise BadRecordError(f"a chunk of {header.data_length} bytes is longer than the limit of {CHUNK_LIMIT}")
        self.file.seek(at + 9 + header.header_length)
        data = self.file.read(max(0, min(header.data_length, end - at - 9 - header.header_length)))
        unpacked, damage = unpack_chunk(header, data)
        window = (header.start_time, header.end_time) if damage and len(data) == header.data_length else None
        usable, seen = self.chunk_records(unpacked, window)
        if seen.channels:
            available = min(9 + length, end - at)
            self.result.spans.append(Span(at, available, True, usable, window, *seen.summary()))
        if damage or usable < len(unpacked):
            self.add_chunk_loss(at, header, len(data), usable, damage or "holds a record that does not fit into it")

    def chunk_records(self, data: bytes, window: tuple[int, int] | None) -> tuple[int, _SpanContent]:
        """Count the messages of an unpacked chunk: (bytes of complete records, channels and times of the messages).

        With a `window`, messages of other log times are taken for damaged and passed over.
        """
        seen = _SpanContent()
        usable = 0
        for heads in heads_of_records(data):
            opcodes, times, lengths = heads.fields["opcode"], heads.fields["log_time"], heads.end - heads.begin
            is_message = opcodes == Opcode.MESSAGE
            wrong = (opcodes == 0) | is_message & ((lengths < MESSAGE.size) | ((window is None) & (times > TIME_LIMIT)))
            good = int(wrong.argmax()) if wrong.any() else len(wrong)
            for row in np.flatnonzero(~is_message[:good]).tolist():
                opcode = int(opcodes[row])
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    try:
                        self.definition(opcode, data[heads.begin[row] : heads.end[row]])
                    except BadRecordError:
                        good = row
                        break
                elif opcode > LAST_OPCODE:
                    self.pass_over(opcode)
            if window is not None:
                is_message &= (window[0] <= times) & (times <= window[1]) & (window[1] <= TIME_LIMIT)
            channels, times = (column[:good][is_message[:good]] for column in (heads.fields["channel"], times))
            for channel in dict.fromkeys(channels.tolist()):
                own = times[channels == channel]
                first, last = int(own.min()), int(own.max())
                seen.add(channel, first, last)
                self.count(channel, len(own), first, last)
            usable = int(heads.end[good - 1]) if good else usable
            if good < len(wrong):
                break
        return usable, seen

    def add_chunk_loss(self, at: int, header: ChunkHeader, available: int, usable: int, damage: str) -> None:
        """Add the loss of a damaged chunk: compressed bytes in proportion to the unusable decompressed ones."""
        share = usable / header.size if 0 < header.size <= CHUNK_LIMIT else 0.0
        lost = max(0, available - round(header.data_length * min(share, 1.0)))
        self.add_loss(at, lost, f"the chunk at byte {at} {damage}")

    def resume_after_damage(self, at: int, text: str) -> int:
        """Handle damage at byte `at`: recover records of a truncated chunk; returns the offset to resume at."""
        self.close_run(at)
        self.file.seek(at)
        header = self.file.read(9)
        next_record = None if self.is_truncated_chunk(at, header) else find_record(self.file, at + 1, self.size)
        end = self.size if next_record is None else next_record
        self.is_truncated = next_record is None
        if len(header) == 9 and header[0] == Opcode.CHUNK:
            losses = len(self.result.losses)
            try:
                self.chunk(at, int.from_bytes(header[1:], "little"), end)
                if len(self.result.losses) == losses:
                    self.add_loss(at, 0, f"at byte {at}: {text}")
                return end
            except BadRecordError as problem:
                text = text if str(problem) == text else f"{text}; {problem}"
        self.add_loss(at, end - at, f"{'cut off ' if self.is_truncated else ''}at byte {at}: {text}")
        return end

    def is_truncated_chunk(self, at: int, header: bytes) -> bool:
        """Whether a chunk begins at `at` that is in order up to the end of the file, where it is cut off."""
        if len(header) < 9 or header[0] != Opcode.CHUNK or self.truncation_checks_left == 0:
            return False
        self.truncation_checks_left -= 1
        length = int.from_bytes(header[1:], "little")
        try:
            chunk = read_chunk_header(self.file.read(CHUNK.size + 80), length)
        except BadRecordError:
            return False
        start = at + 9 + chunk.header_length
        if start + chunk.data_length <= self.size or chunk.data_length > CHUNK_LIMIT:
            return False
        self.file.seek(start)
        return is_intact_prefix(chunk, self.file.read(self.size - start))

    def add_loss(self, at: int, count: int, text: str) -> None:
        """List a loss."""
        self.result.losses.append(Loss(at, count, text))

    def footer(self, at: int, length: int) -> None:
        """Check the footer, the closing magic and the summary's checksum; without a summary there is none to check."""
        if length != FOOTER.size:
            raise BadRecordError("the footer has the wrong length")
        body = self.file.read(FOOTER.size)
        summary_start, _, crc = FOOTER.unpack(body)
        if self.file.read(len(MAGIC)) != MAGIC:
            raise BadRecordError("the file does not end in the closing magic")
        self.has_footer = True
        if at + 9 + FOOTER.size + len(MAGIC) < self.size:
            trailing = self.size - (at + 9 + FOOTER.size + len(MAGIC))
            self.add_loss(self.size - trailing, trailing, f"{trailing} bytes stand behind the end of the log")
        if crc and 0 < summary_start <= at and self.crc32(summary_start, at + 9 + 16) != crc:
            self.add_loss(summary_start, 0, "the summary does not fit its checksum")

    def crc32(self, start: int, end: int) -> int:
        """CRC-32 of bytes of the file."""
        crc = 0
        self.file.seek(start)
        while start < end:
            block = self.file.read(min(2**20, end - start))
            if not block:
                break
            crc = zlib.crc32(block, crc)
            start += len(block)
        return crc

    def check_totals(self) -> None:
        """Check the data section's checksum, the number of messages against the statistics, and unknown channels."""
        result = self.result
        if self.data_crc is not None and self.crc32(0, self.data_crc[0]) != self.data_crc[1]:
            self.add_loss(0, 0, "the data does not fit its checksum")
        orphans = sum(c.messages for i, c in result.counts.items() if i not in result.channels)
        if orphans:
            self.add_loss(0, 0, f"{orphans} messages belong to no channel that is described")
        stated = self.statistics.message_count if self.statistics is not None else 0
        counted = sum(c.messages for c in result.counts.values())
        if stated > counted:
            self.add_loss(
                0, 0, f"of {stated} messages that the file's own statistics count, {stated - counted} are not there"
            )
