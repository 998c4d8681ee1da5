"""Writes the variants of the format's conformance suite, record by record, from its published description alone.

Five kinds of content (and none) are each written with every set of features that makes sense for it; the names of the
features are the suite's. What is not a feature is as small as the format allows: no compression, no checksums.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from itertools import chain, combinations
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"
FEATURES = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum", "pad")
"""Chunks, message indexes, statistics, repeated schemas and channels, indexes of attachments, metadata and chunks, summary
offsets, and bytes of unknown fields behind every record that may grow."""
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
FIXED = {FOOTER, MESSAGE, CHUNK, DATA_END}
"""Records that end where their length says, so that nothing can be added."""


class Message(NamedTuple):
    """A message of channel 1."""

    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Content(NamedTuple):
    """What a log holds."""

    schema: tuple[str, str, bytes] | None = None
    channel: tuple[str, str, dict[str, str]] | None = None
    messages: tuple[Message, ...] = ()
    attachment: tuple[str, str, bytes] | None = None
    metadata: tuple[str, dict[str, str]] | None = None

    def takes(self, features: frozenset[str]) -> bool:
        """Whether a set of features makes sense for it."""
        needs = {
            "ax": self.attachment,
            "mdx": self.metadata,
            "rsh": self.schema,
            "rch": self.channel,
            "ch": self.channel,
        }
        return (
            all(needs[f] for f in features & needs.keys())
            and ("ch" in features or not features & {"mx", "chx"})
            and ("sum" not in features or bool(features & {"chx", "rsh", "rch", "mdx", "ax", "st"}))
        )


_SCHEMA = ("Example", "c", bytes((4, 5, 6)))
_CHANNEL = ("example", "a", {"foo": "bar"})
CONTENTS = {
    "NoData": Content(),
    "OneMessage": Content(_SCHEMA, _CHANNEL, (Message(10, 2, 1, bytes((1, 2, 3))),)),
    "OneSchemalessMessage": Content(None, _CHANNEL, (Message(10, 2, 1, bytes((1, 2, 3))),)),
    "TenMessages": Content(_SCHEMA, _CHANNEL, tuple(Message(k, k, k, bytes((k, 7, 7))) for k in range(10))),
    "OneAttachment": Content(attachment=("myFile", "application/octet-stream", bytes((1, 2, 3)))),
    "OneMetadata": Content(metadata=("myMetadata", {"foo": "bar"})),
}


def variants() -> Iterator[tuple[str, Content, frozenset[str]]]:
    """Name, content and features of each."""
    sets = chain.from_iterable(combinations(FEATURES, count) for count in range(len(FEATURES) + 1))
    for names in sets:
        for kind, content in CONTENTS.items():
            if content.takes(frozenset(names)):
                yield "-".join((kind, *sorted(names))), content, frozenset(names)


def text(value: str | bytes) -> bytes:
    """A text or block of bytes with its length."""
    data = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(data)) + data


def table(values: dict[str, str]) -> bytes:
    """A map of texts."""
    return text(b"".join(text(key) + text(value) for key, value in values.items()))


class Book:
    """Bytes of a log being written, and where its records begin."""

    def __init__(self, *, pad: bool) -> None:
        self.data, self.pad = bytearray(MAGIC), pad
        self.records: list[tuple[int, int]] = []  # opcode, offset

    def add(self, opcode: int, body: bytes) -> tuple[int, int]:
        """Append a record; its offset and length."""
        begin = len(self.data)
        self.records.append((opcode, begin))
        self.data += record(opcode, body, pad=self.pad)
        return begin, len(self.data) - begin


def record(opcode: int, body: bytes, *, pad: bool) -> bytes:
    """A record."""
    body += b"\x01\xff\xff" if pad and opcode not in FIXED else b""
    return struct.pack("<BQ", opcode, len(body)) + body


def write(content: Content, features: frozenset[str]) -> Book:
    """A log of some content with some features."""
    book = Book(pad="pad" in features)
    book.add(HEADER, text("") + text(""))
    schema, channel = b"", b""
    definitions: list[tuple[int, bytes]] = []
    if content.schema is not None:
        schema = struct.pack("<H", 1) + b"".join(map(text, content.schema))
        definitions.append((SCHEMA, schema))
    if content.channel is not None:
        topic, encoding, more = content.channel
        channel = struct.pack("<HH", 1, int(content.schema is not None)) + text(topic) + text(encoding) + table(more)
        definitions.append((CHANNEL, channel))
    messages = [struct.pack("<HIQQ", 1, m.sequence, m.log_time, m.publish_time) + m.data for m in content.messages]
    groups: list[tuple[int, list[bytes]]] = []  # of the summary
    if "rsh" in features:
        groups.append((SCHEMA, [schema]))
    if "rch" in features:
        groups.append((CHANNEL, [channel]))
    times = [m.log_time for m in content.messages] or [0]
    if "ch" in features:
        index = _add_chunk(book, definitions, messages, content, features)
        if "chx" in features:
            groups.append((CHUNK_INDEX, [index]))
    else:
        for opcode, body in [*definitions, *((MESSAGE, body) for body in messages)]:
            book.add(opcode, body)
    if content.attachment is not None:
        name, media, data = content.attachment
        body = struct.pack("<QQ", 2, 1) + text(name) + text(media) + struct.pack("<Q", len(data)) + data
        offset, length = book.add(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))
        if "ax" in features:
            found = struct.pack("<QQQQQ", offset, length, 2, 1, len(data)) + text(name) + text(media)
            groups.append((ATTACHMENT_INDEX, [found]))
    if content.metadata is not None:
        name, values = content.metadata
        offset, length = book.add(METADATA, text(name) + table(values))
        if "mdx" in features:
            groups.append((METADATA_INDEX, [struct.pack("<QQ", offset, length) + text(name)]))
    if "st" in features:
        counts = (len(messages), len(schema) > 0, len(channel) > 0, content.attachment is not None,
                  content.metadata is not None, "ch" in features)  # fmt: skip
        each = struct.pack("<HQ", 1, len(messages)) if messages else b""
        groups.append(
            (STATISTICS, [struct.pack("<QHIIII", *counts) + struct.pack("<QQ", min(times), max(times)) + text(each)])
        )
    book.add(DATA_END, bytes(4))
    _add_summary(book, groups, offsets="sum" in features)
    return book


def _add_chunk(
    book: Book, definitions: list[tuple[int, bytes]], messages: list[bytes], content: Content, features: frozenset[str]
) -> bytes:
    """Append a chunk and its message index; the body of its chunk index."""
    inner, entries = b"", b""
    for opcode, body in definitions:
        inner += record(opcode, body, pad="pad" in features)
    for message, body in zip(content.messages, messages, strict=True):
        entries += struct.pack("<QQ", message.log_time, len(inner))
        inner += record(MESSAGE, body, pad=False)
    first, last = content.messages[0].log_time, content.messages[-1].log_time
    head = struct.pack("<QQQI", first, last, len(inner), 0) + text("") + struct.pack("<Q", len(inner))
    offset, length = book.add(CHUNK, head + inner)
    places, index_length = b"", 0
    if "mx" in features:
        at, index_length = book.add(MESSAGE_INDEX, struct.pack("<H", 1) + text(entries))
        places = struct.pack("<HQ", 1, at)
    return (
        struct.pack("<QQQQ", first, last, offset, length) + text(places) + struct.pack("<Q", index_length)
        + text("") + struct.pack("<QQ", len(inner), len(inner))
    )  # fmt: skip


def _add_summary(book: Book, groups: list[tuple[int, list[bytes]]], *, offsets: bool) -> None:
    """Append the summary, its offsets, footer and magic bytes."""
    start, found = len(book.data), []
    for opcode, bodies in groups:
        begin = len(book.data)
        for body in bodies:
            book.add(opcode, body)
        found.append(struct.pack("<BQQ", opcode, begin, len(book.data) - begin))
    offset_start = len(book.data) if offsets else 0
    for body in found if offsets else []:
        book.add(SUMMARY_OFFSET, body)
    book.add(FOOTER, struct.pack("<QQI", start if groups else 0, offset_start, 0))
    book.data += MAGIC
