"""Reads a log: its channels, its damage, and its messages in order of log time.

A log is scanned once when it is opened (`mcap_scan.py`), so that damage is known before anything is computed. Messages are
then streamed in order of log time, with one chunk in memory, or as many as overlap in time. Channels of the same topic, and of
different parts of a bag, are kept apart.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Container, Iterator, Set
from contextlib import contextmanager
from dataclasses import dataclass
from heapq import heappop, heappush, heapreplace
from types import TracebackType
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode

from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.bag import log_files
from geomphys.recording.foreign_formats import MAGIC_BYTES, describe_foreign_format
from geomphys.recording.mcap_records import (
    CHUNK,
    CHUNK_LIMIT,
    HEAD,
    MAGIC,
    MESSAGE,
    BadRecordError,
    heads_of_records,
    read_chunk_header,
    unpack_chunk,
)
from geomphys.recording.mcap_scan import TIME_LIMIT, FileScan, Span, scan_file
from geomphys.recording.mcap_summary import scan_summary
from geomphys.recording.raw_messages import Messages, RawMessage
from geomphys.storage.remote_files import AnyPath, RemotePath, as_path, is_remote

PENDING_LIMIT = 256 * 2**20
"""Bytes of messages that are held to bring them into the order of their times."""
_SpanKey = tuple[int, Span, frozenset[int]]  # number of the file, span, channels
MAX_LISTED_DAMAGE = 3  # losses listed one by one in a message
MAX_LISTED_OPCODES = 4


@dataclass(frozen=True)
class LogChannel:
    """A channel of a log. `key` tells it from the channels of the same topic and of other parts of a bag."""

    key: int
    topic: str
    schema_name: str  # "" without a schema
    schema_encoding: str
    schema_data: bytes
    encoding: str  # of the messages
    messages: int
    first_ns: int  # log time of the earliest message; 0 if there is none
    last_ns: int
    metadata: tuple[tuple[str, str], ...] = ()
    longest_gap_ns: int | None = None  # None: only known by reading the messages


@dataclass(frozen=True)
class Damage:
    """What is lost of a damaged log."""

    bytes_lost: int
    text: str  # one line
    offsets: int


class LogReader:
    """A log opened for reading; made by `open_log`. A context manager; holds no local file open between calls."""

    def __init__(self, path: AnyPath, *, recover: bool = False) -> None:
        """Scan the log; see `open_log`."""
        self.path = path
        parts = log_files(path, recover=recover)
        self.files = parts.files
        self.size = 0
        self._recover = recover
        self._streams: dict[RemotePath, BinaryIO] = {}  # of files behind URLs
        self._loaded: tuple[_SpanKey, Messages] | None = None  # the span that was loaded last, for the next pass
        self._scans: list[FileScan] = []
        for file in self.files:
            self._scans.append(self._scan(file))
            self.size += self._scans[-1].size
        self.channels: dict[int, LogChannel] = {}
        self._of_topic: dict[str, list[LogChannel]] = {}
        for number, scan in enumerate(self._scans):
            self._add_channels(number, scan)
        self.metadata: tuple[tuple[str, dict[str, str]], ...] = tuple(
            (m.name, dict(m.metadata)) for scan in self._scans for m in scan.metadata
        )
        self.profile = self._scans[0].profile
        self.notes = (*parts.notes, *self._unknown_records())
        self.damage = self._damage(parts.missing)
        if self.damage is not None and not recover:
            raise DamagedLogError(
                f"{path}: is damaged: {self.damage.text}; {self._intact()}; --recover replays that part"
            )

    def __enter__(self) -> LogReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the use of the reader."""
        self._loaded = None
        while self._streams:
            self._streams.popitem()[1].close()

    @property
    def topics(self) -> tuple[str, ...]:
        """All topics, sorted."""
        return tuple(sorted(self._of_topic))

    @property
    def messages(self) -> int:
        """Readable messages of all topics."""
        return sum(c.messages for c in self.channels.values())

    @property
    def start_ns(self) -> int:
        """Earliest log time; 0 for a log without messages."""
        return min((c.first_ns for c in self.channels.values() if c.messages), default=0)

    @property
    def end_ns(self) -> int:
        """Latest log time; 0 for a log without messages."""
        return max((c.last_ns for c in self.channels.values() if c.messages), default=0)

    def of_topic(self, topic: str) -> tuple[LogChannel, ...]:
        """The channels of a topic."""
        return tuple(self._of_topic.get(topic, ()))

    def read(self, keys: Container[int] | None = None, *, file_order: bool = False) -> Iterator[RawMessage]:
        """Stream the messages of the channels `keys` (None: of all) in the order of their log times.

        `keys` is evaluated for every message, so a caller may drop channels while it reads. See `read_runs`.
        """
        for run in self.read_runs(keys, file_order=file_order):
            for message in run:
                if keys is None or message.key in keys:
                    yield message

    def read_runs(self, keys: Container[int] | None = None, *, file_order: bool = False) -> Iterator[Messages]:
        """Stream the messages of the channels `keys` (None: of all) in the order of their log times, many at a time.

        Messages of one log time keep their order in the file; with `file_order` all do. `keys` is evaluated for every
        chunk. Memory: the messages asked for of the chunks that overlap in time, at most `PENDING_LIMIT` bytes and one
        chunk; where more overlap, the order is that of the file in part.

        Raises LogError if the file changed since it was opened or cannot be read any more.
        """
        spans = [(n, span) for n, scan in enumerate(self._scans) for span in scan.spans]
        if file_order:
            for number, span in spans:
                yield self._load(number, span, keys)
            return
        unread_spans = deque(sorted(enumerate(spans), key=lambda item: item[1][1].first))
        # a heap of the messages of each span from its first unread one on, by its time and the order of the spans
        pending: list[tuple[int, int, int, Messages]] = []
        size = 0
        while unread_spans or pending:
            while unread_spans and size < PENDING_LIMIT:
                order, (number, span) = unread_spans[0]
                if pending and span.first > pending[0][0]:
                    break
                unread_spans.popleft()
                run = self._load(number, span, keys).in_order_of_time()
                size += run.size
                if len(run):
                    heappush(pending, (int(run.log_times[0]), order, 0, run))
            next_start = unread_spans[0][1][1].first if unread_spans else None
            while pending and (next_start is None or size >= PENDING_LIMIT or pending[0][0] < next_start):
                _, order, begin, run = pending[0]
                later = [time for time, *_ in pending[1:3]]  # the next of the heap is one of these
                later += [] if next_start is None else [next_start]
                end = max(begin + 1, int(np.searchsorted(run.log_times, min(later)))) if later else len(run)
                if end < len(run):
                    heapreplace(pending, (int(run.log_times[end]), order, end, run))
                else:
                    heappop(pending)
                part = run.rows(begin, end)
                size -= part.size
                yield part

    def _load(self, number: int, span: Span, keys: Container[int] | None) -> Messages:
        """Messages of a span, in the order of the file."""
        base, channels, file = number << 16, self._scans[number].channels, self.files[number]
        selected = frozenset(c for c in span.channels if c in channels and (keys is None or base | c in keys))
        if not selected:
            return Messages.of([])
        span_key = number, span, selected
        if self._loaded is not None and self._loaded[0] == span_key:
            return self._loaded[1]
        try:
            with self._opened(file) as stream:
                stream.seek(span.offset)
                loaded = (self._chunk_messages if span.chunk else self._run_messages)(stream, span, selected, base)
        except OSError as problem:
            raise LogError(f"{file}: cannot be read any more ({problem.strerror})") from problem
        except (BadRecordError, ValueError, OverflowError, struct.error) as problem:
            if self._scans[number].verified:
                raise LogError(f"{file}: changed while it was read") from problem
            raise DamagedLogError(
                f"{file}: is damaged: the chunk at byte {span.offset} {problem}; --recover replays what is intact"
            ) from problem
        self._loaded = span_key, loaded
        return loaded

    @contextmanager
    def _opened(self, file: AnyPath) -> Iterator[BinaryIO]:
        """A file to read from; one behind a URL stays open until the reader is closed."""
        if not is_remote(file):
            with file.open("rb") as stream:
                yield stream
            return
        if file not in self._streams:
            self._streams[file] = file.open("rb")
        yield self._streams[file]

    @staticmethod
    def _chunk_messages(stream: BinaryIO, span: Span, selected: Set[int], base: int) -> Messages:
        """Messages of a chunk; the stream is positioned at its record. `base` is what keys add to numbers of channels."""
        first_bytes = stream.read(min(span.length, 9 + CHUNK.size + 80))
        if len(first_bytes) < 9:
            raise BadRecordError("the file is shorter than it was")
        head = read_chunk_header(first_bytes[9:], HEAD.unpack_from(first_bytes, 0)[1])
        if head.data_length > CHUNK_LIMIT:
            raise BadRecordError("the chunk is not what it was")
        start = 9 + head.header_length
        stream.seek(span.offset + start)
        if span.verified:
            head = head._replace(crc=0)
        unpacked, damage_text = unpack_chunk(head, stream.read(min(head.data_length, span.length - start)))
        if damage_text and not span.verified:
            raise BadRecordError(damage_text)
        if len(unpacked) < span.usable:
            raise BadRecordError("the chunk is not what it was")
        parts = [Messages.of([])]
        for heads in heads_of_records(unpacked, span.usable):
            heads = heads.taken(heads.fields["opcode"] == Opcode.MESSAGE)
            times = heads.fields["log_time"]
            if not span.verified and ((heads.end - heads.begin < MESSAGE.size) | (times > TIME_LIMIT)).any():
                raise BadRecordError("holds a message that cannot be")
            requested = np.isin(heads.fields["channel"], [*selected])
            if span.window is not None:
                requested &= (span.window[0] <= times) & (times <= span.window[1])
            fields, begin, end = heads.taken(requested)
            keys, log_times = (fields[name].astype(np.int64) for name in ("channel", "log_time"))
            publish_times, sequences = (fields[name].tolist() for name in ("publish_time", "sequence"))
            of_data = zip((begin + MESSAGE.size).tolist(), end.tolist(), strict=True)
            data = [unpacked[first:last] for first, last in of_data]
            parts.append(Messages(base | keys, log_times, publish_times, data, sequences))
        return Messages.joined(parts[1:] or parts)

    @staticmethod
    def _run_messages(stream: BinaryIO, span: Span, selected: Set[int], base: int) -> Messages:
        """Messages outside of chunks; see `_chunk_messages`."""
        read, seek, found = stream.read, stream.seek, list[tuple[int, int, int, bytes, int]]()
        at, stop = span.offset, span.offset + span.length
        while at < stop:
            seek(at)
            head = read(9 + MESSAGE.size)
            if len(head) < 9 + MESSAGE.size:
                raise BadRecordError("the file is shorter than it was")
            _, length = HEAD.unpack_from(head, 0)
            channel, sequence, log_time, publish_time = MESSAGE.unpack_from(head, 9)
            if not MESSAGE.size <= length <= CHUNK_LIMIT:
                raise BadRecordError("the record is not what it was")
            if channel in selected:
                found.append((base | channel, log_time, publish_time, read(length - MESSAGE.size), sequence))
            at += 9 + length
        return Messages.of(found)

    def _scan(self, file: AnyPath) -> FileScan:
        """Scan one file. Raises LogError if it is no MCAP at all."""
        try:
            with self._opened(file) as stream:
                size = stream.seek(0, 2)
                stream.seek(0)
                start = stream.read(MAGIC_BYTES)
                if not start:
                    raise LogError(f"{file}: is empty: the recording was not written or not fetched; copy it again")
                if start[: len(MAGIC)] != MAGIC[: len(start)]:
                    raise LogError(f"{file}: is not an MCAP file{describe_foreign_format(start)}")
                if is_remote(file) and not self._recover:
                    found = scan_summary(stream, size, file.ranges)
                    if found is not None:
                        return found
                return scan_file(stream, size)
        except OSError as problem:
            raise LogError(f"{file}: cannot be read ({problem.strerror})") from problem

    def _add_channels(self, number: int, scan: FileScan) -> None:
        """Add the channels of part `number`."""
        for i in sorted(scan.channels):
            channel = scan.channels[i]
            schema = scan.schemas.get(channel.schema_id)
            count = scan.counts.get(i)
            key = number << 16 | i
            self.channels[key] = LogChannel(
                key,
                channel.topic,
                schema.name if schema else "",
                schema.encoding if schema else "",
                schema.data if schema else b"",
                channel.message_encoding,
                count.messages if count else 0,
                count.first if count else 0,
                count.last if count else 0,
                tuple(sorted(channel.metadata.items())),
                count.longest_gap if count else None,
            )
            self._of_topic.setdefault(channel.topic, []).append(self.channels[key])

    def _unknown_records(self) -> Iterator[str]:
        """One line for each file with records of unknown kinds: where no checksum tells, damaged messages look like them."""
        for file, scan in zip(self.files, self._scans, strict=True):
            if scan.unknown:
                opcodes = ", ".join(f"0x{opcode:02x}" for opcode in sorted(scan.unknown)[:MAX_LISTED_OPCODES])
                more = ", …" if len(scan.unknown) > MAX_LISTED_OPCODES else ""
                yield (
                    f"{file.name}: {sum(scan.unknown.values())} records of unknown kinds were passed over (opcode "
                    f"{opcodes}{more}): a later version of MCAP has them, or their first byte is damaged"
                )

    def _damage(self, missing: tuple[str, ...]) -> Damage | None:
        """Summarise the losses of all files."""
        has_parts = len(self.files) > 1
        losses = [
            (loss.bytes_lost, f"{file.name}: {loss.text}" if has_parts else loss.text)
            for file, scan in zip(self.files, self._scans, strict=True)
            for loss in scan.losses
        ]
        texts = [*missing, *(text for _, text in losses)]
        if not texts:
            return None
        lost = sum(count for count, _ in losses)
        more = f", and {len(texts) - MAX_LISTED_DAMAGE} more places" if len(texts) > MAX_LISTED_DAMAGE else ""
        return Damage(
            lost, f"{'; '.join(texts[:MAX_LISTED_DAMAGE])}{more} ({lost} of {self.size} bytes lost)", len(texts)
        )

    def _intact(self) -> str:
        """Describe the intact part."""
        seconds = (self.end_ns - self.start_ns) / 1e9
        return f"{self.messages} messages over {seconds:.3f} s are intact"


def open_log(path: AnyPath | str, *, recover: bool = False) -> LogReader:
    """Open a log and scan it once.

    Parameters
    ----------
    path : Path or str
        An .mcap file or a ROS 2 bag directory (metadata.yaml and one or more .mcap), or the URL of one. A file behind a
        URL is opened by its summary alone where it has one, so that only what is asked for is read; its chunks are then
        checked when they are read, and damage is raised there.
    recover : bool
        Accept a damaged log: what can be read is read, `LogReader.damage` says what is lost.

    Returns
    -------
    LogReader

    Raises
    ------
    LogError
        Not there, not readable, not an MCAP.
    DamagedLogError
        Cut off or corrupt and `recover` is off; the text says how many messages and seconds are intact.
    """
    return LogReader(as_path(path), recover=recover)
