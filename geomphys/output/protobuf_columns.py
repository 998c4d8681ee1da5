"""Encodes many protobuf messages of one type at once: columns of values in, one byte string per row out.

The bytes are those that the protobuf package writes for messages of proto3: fields in the order of their numbers, numbers of
value zero and empty strings left out. The package builds a message field by field in Python, which took a third of a replay.

Rows are written backwards, from the last byte of the last one on: so the length of a message is known where it is written.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.output.byte_strings import Bytes, ByteStrings, bytes_array

Ints = NDArray[np.int64]

NS_PER_S = 1_000_000_000
_VARINT, _FIXED64, _DELIMITED = 0, 1, 2  # wire types
_WIRE_TYPES = {
    FieldDescriptor.TYPE_DOUBLE: _FIXED64,
    FieldDescriptor.TYPE_STRING: _DELIMITED,
    FieldDescriptor.TYPE_BYTES: _DELIMITED,
    FieldDescriptor.TYPE_MESSAGE: _DELIMITED,
    **dict.fromkeys(
        (
            FieldDescriptor.TYPE_INT32,
            FieldDescriptor.TYPE_INT64,
            FieldDescriptor.TYPE_UINT32,
            FieldDescriptor.TYPE_UINT64,
            FieldDescriptor.TYPE_BOOL,
            FieldDescriptor.TYPE_ENUM,
        ),
        _VARINT,
    ),
}
"""Kinds of fields that are encoded here."""

VARINT_BYTES = 10
"""Most bytes of a whole number."""
HEAD_BYTES = 8
"""Most bytes of a tag and a length."""


class _Numbers(NamedTuple):
    """A field of numbers, left out where they are zero."""

    tag: int
    values: NDArray[Any]  # (n,)

    @property
    def is_double(self) -> bool:
        return self.tag & 7 == _FIXED64


class _Strings(NamedTuple):
    """A field of strings; with the tag 0 their bytes as they are."""

    tag: int
    values: ByteStrings  # n
    with_empty: bool  # else it is left out where they are empty


class _Message(NamedTuple):
    """A field of messages."""

    tag: int
    parts: tuple[_Part, ...]


_Part = bytes | _Numbers | _Strings | _Message


class Rows:
    """n byte strings. Made by `message` and `Rows.beside`.

    Parameters
    ----------
    parts : sequence of _Part
        What is side by side in each row; `bytes` are the same in all.
    """

    def __init__(self, parts: Sequence[_Part]) -> None:
        merged: list[_Part] = []
        for part in parts:
            before = merged[-1] if merged else None
            if isinstance(part, bytes) and isinstance(before, bytes):
                merged[-1] = before + part
            else:
                merged.append(part)
        self.parts = tuple(merged)

    @staticmethod
    def beside(columns: Sequence[Rows | ByteStrings | bytes]) -> Rows:
        """Columns side by side, each of n strings, or of one that is in every row."""
        parts: list[_Part] = []
        for column in columns:
            if isinstance(column, Rows):
                parts += column.parts
            elif isinstance(column, ByteStrings):
                parts.append(column[0] if len(column) == 1 else _Strings(0, column, with_empty=True))
            else:
                parts.append(column)
        return Rows(parts)

    def split(self, counts: Ints | None = None) -> ByteStrings:
        """The strings; with `counts` (k,), that many rows after another are one string."""
        sheet = _Sheet()
        sheet.add(self.parts)
        found = sheet.write()
        return found if counts is None else found.grouped(counts)


class _Sheet:
    """Columns as the kernel takes them."""

    def __init__(self) -> None:
        self.operations: list[tuple[int, int, int, int]] = []
        self.literals = bytearray()
        self.numbers: list[tuple[NDArray[Any], bool]] = []  # columns (n,), and whether they are doubles
        self.contents: dict[int, tuple[Bytes, int]] = {}  # identity -> what strings are pieces of, and where it begins
        self.row_bytes = 0  # most that a row takes but for its strings
        self.string_bytes = 0  # of all rows

    def add(self, parts: Sequence[_Part], depth: int = 0) -> None:
        """Add what is side by side."""
        for part in parts:
            if isinstance(part, bytes):
                self.operations.append((LITERAL, 0, len(self.literals), len(part)))
                self.literals += part
                self.row_bytes += len(part)
            elif isinstance(part, _Numbers):
                self.operations.append((DOUBLE if part.is_double else VARINT, part.tag, len(self.numbers), 0))
                self.numbers.append((part.values, part.is_double))
                self.row_bytes += len(_varint(part.tag)) + (8 if part.is_double else VARINT_BYTES)
            elif isinstance(part, _Strings):
                self.operations.append((STRING, part.tag, len(self.numbers), int(part.with_empty)))
                content = part.values.content
                _, start = self.contents.setdefault(id(content), (content, self._content_bytes()))
                self.numbers += [(part.values.begin + start, False), (part.values.length, False)]
                self.row_bytes += HEAD_BYTES
                self.string_bytes += int(part.values.length.sum())
            else:
                self.operations.append((LENGTH, part.tag, depth, 0))
                self.row_bytes += HEAD_BYTES
                self.add(part.parts, depth + 1)
                self.operations.append((END, 0, depth, 0))

    def _content_bytes(self) -> int:
        return sum(len(content) for content, _ in self.contents.values())

    def write(self) -> ByteStrings:
        """The rows."""
        count = len(self.numbers[0][0]) if self.numbers else 1
        values = np.empty((len(self.numbers), count), np.int64)
        bits_of_doubles = values.view(np.float64)
        for row, (column, is_double) in enumerate(self.numbers):
            (bits_of_doubles if is_double else values)[row] = column
        contents = [content for content, _ in self.contents.values()]
        content = contents[0] if len(contents) == 1 else np.concatenate([np.zeros(0, np.uint8), *contents])
        operations = np.array(self.operations, OPERATION)
        out = np.empty(self.row_bytes * count + self.string_bytes, np.uint8)
        begin, ends = np.empty(count + 1, np.int64), np.empty(len(operations), np.int64)
        write_rows(operations, values, bytes_array(bytes(self.literals)), content, ends, out, begin)
        return ByteStrings(out[begin[0] :], begin[:-1] - begin[0], np.diff(begin))


OPERATION = np.dtype(
    [
        ("kind", np.int64),
        ("tag", np.int64),  # 0: neither tag nor length is written
        ("column", np.int64),  # of the values; of a literal where it begins, of a message its depth
        ("extent", np.int64),  # bytes of a literal; of strings 1 if empty ones are written
    ]
)
"""What is written of a row, in the order of its bytes."""

DOUBLE, VARINT, STRING, LITERAL, LENGTH, END = range(6)
"""Kinds of operations. A string takes two columns, where it begins and its length. LENGTH and END enclose a message."""


@kernel
def write_rows(
    operations: NDArray[np.void], values: Ints, literals: Bytes, content: Bytes, ends: Ints, out: Bytes, begin: Ints
) -> None:
    """Write rows to the end of `out`, from the last byte on.

    Parameters
    ----------
    operations : (o,) OPERATION
    values : (m, n)
        Of the columns; bits of doubles.
    literals, content
        Pieces of these are written.
    ends : (o,)
        Workspace.
    out
        Large enough.
    begin : (n + 1,)
        Set to where each row begins in `out`, and the last one ends.
    """
    at = len(out)
    begin[-1] = at
    for row in range(values.shape[1] - 1, -1, -1) if len(values) > 0 else range(0, -1, -1):
        for k in range(len(operations) - 1, -1, -1):
            o = operations[k]
            if o.kind == DOUBLE:
                bits = values[o.column, row]
                if bits != 0:
                    at -= 8
                    target = out[at : at + 8]
                    for j in range(8):
                        target[j] = (bits >> (8 * j)) & 0xFF
                    at = put_varint(o.tag, out, at)
            elif o.kind == VARINT:
                if values[o.column, row] != 0:
                    at = put_varint(o.tag, out, put_varint(values[o.column, row], out, at))
            elif o.kind == STRING:
                length = values[o.column + 1, row]
                if length > 0 or o.extent == 1:
                    at = put_bytes(content, values[o.column, row], length, out, at)
                    if o.tag != 0:
                        at = put_varint(o.tag, out, put_varint(length, out, at))
            elif o.kind == LITERAL:
                at = put_bytes(literals, o.column, o.extent, out, at)
            elif o.kind == END:
                ends[o.column] = at
            else:
                at = put_varint(o.tag, out, put_varint(ends[o.column] - at, out, at))
        begin[row] = at


@kernel
def put_bytes(content: Bytes, begin: int, length: int, out: Bytes, end: int) -> int:
    """Write a piece of `content` so that it ends before `end`; returns where it begins."""
    target, source = out[end - length : end], content[begin : begin + length]  # slices: many bytes are copied at once
    for j in range(len(target)):
        target[j] = source[j]
    return end - length


@kernel
def put_varint(value: int, out: Bytes, end: int) -> int:
    """Write a whole number, 7 bits a byte, lowest first, negative ones as of 64 bits, before `end`; returns where it begins."""
    if 0 <= value < 0x80:
        out[end - 1] = value
        return end - 1
    size, rest = 1, (value >> 7) & 0x1FFFFFFFFFFFFFF
    while rest > 0:
        size, rest = size + 1, rest >> 7
    begin = end - size
    for k in range(begin, end - 1):
        out[k] = value & 0x7F | 0x80
        value = (value >> 7) & 0x1FFFFFFFFFFFFFF
    out[end - 1] = value
    return begin


def message(kind: type[Message], **columns: Any) -> Rows:
    """Messages of one type, one per row.

    Parameters
    ----------
    kind
        The type.
    columns
        Field name -> its values: of numbers an array (n,) or one number; of messages `Rows`; of these, strings and bytes
        `ByteStrings`, or bytes that are the same in all. A repeated field has one entry per row.
    """
    return Rows([field.part(columns[field.name]) for field in _fields(kind.DESCRIPTOR) if field.name in columns])


def stamps(times_ns: Ints) -> Rows:
    """google.protobuf.Timestamp of times (n,) [ns]."""
    seconds, nanos = np.divmod(times_ns, NS_PER_S)
    return message(Timestamp, seconds=seconds, nanos=nanos)


def _varint(value: int) -> bytes:
    """The bytes of a whole number."""
    value &= 0xFFFFFFFFFFFFFFFF
    found = bytearray()
    while value >= 0x80:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


class _Field(NamedTuple):
    name: str
    tag: int
    is_message: bool

    def part(self, value: Any) -> _Part:
        """The field with its values, see `message`."""
        if self.tag & 7 != _DELIMITED:
            values = np.asarray(value)
            return self._number(values.item()) if values.size == 1 else _Numbers(self.tag, values)
        if isinstance(value, Rows):
            parts = value.parts
            if not all(isinstance(part, bytes) for part in parts):
                return _Message(self.tag, parts)
            value = b"".join(part for part in parts if isinstance(part, bytes))
        elif isinstance(value, ByteStrings):
            if len(value) != 1:
                return _Strings(self.tag, value, with_empty=self.is_message)
            value = value[0]
        return _varint(self.tag) + _varint(len(value)) + value if value or self.is_message else b""

    def _number(self, value: float) -> bytes:
        """The field with one number."""
        bits = struct.pack("<d", value) if self.tag & 7 == _FIXED64 else _varint(int(value))
        return _varint(self.tag) + bits if any(bits) else b""


@cache
def _fields(kind: Descriptor) -> tuple[_Field, ...]:
    """The fields of a type that can be encoded, in the order of their numbers."""
    return tuple(_known_fields(kind))


def _known_fields(kind: Descriptor) -> Iterator[_Field]:
    for field in sorted(kind.fields, key=lambda f: f.number):
        if field.type in _WIRE_TYPES:
            tag = field.number << 3 | _WIRE_TYPES[field.type]
            yield _Field(field.name, tag, field.type == FieldDescriptor.TYPE_MESSAGE)
