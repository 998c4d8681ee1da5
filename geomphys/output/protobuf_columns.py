"""Encodes many protobuf messages of one type at once: columns of values in, one byte string per row out.

The bytes are those that the protobuf package writes for messages of proto3: fields in the order of their numbers, numbers of
value zero and empty strings left out. The package builds a message field by field in Python, which took a third of a replay.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from geomphys.output.byte_strings import Bytes, ByteStrings, write_doubles, write_strings, write_varints

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


class _Doubles(NamedTuple):
    """A field of numbers of 64 bits, left out where they are zero."""

    tag: int
    values: Ints  # (n or 1,) their bits

    def lengths(self) -> Ints:
        lengths: Ints = (_tag_length(self.tag) + 8) * (self.values != 0)
        return lengths

    def take(self, index: Ints) -> _Doubles:
        return _Doubles(self.tag, _taken(self.values, index))

    def write(self, out: Bytes, at: Ints) -> None:
        write_doubles(self.tag, self.values, out, at)


class _Varints(NamedTuple):
    """A field of whole numbers."""

    tag: int
    values: Ints  # (n or 1,)
    with_zero: bool  # else it is left out where they are zero

    def lengths(self) -> Ints:
        length = _tag_length(self.tag) + _varint_lengths(self.values)
        return length if self.with_zero else length * (self.values != 0)

    def take(self, index: Ints) -> _Varints:
        return _Varints(self.tag, _taken(self.values, index), self.with_zero)

    def write(self, out: Bytes, at: Ints) -> None:
        write_varints(self.tag, self.values, self.with_zero, out, at)


class _Strings(NamedTuple):
    """Bytes as they are."""

    values: ByteStrings  # n or 1

    def lengths(self) -> Ints:
        return self.values.length

    def take(self, index: Ints) -> _Strings:
        return _Strings(self.values if len(self.values) == 1 else self.values[index])

    def write(self, out: Bytes, at: Ints) -> None:
        write_strings(self.values.content, self.values.begin, self.values.length, out, at)


Column = _Doubles | _Varints | _Strings


class Rows:
    """n byte strings: `columns` side by side, each of n values, or of one that is in every row.

    Parameters
    ----------
    columns : sequence of Column
    own_lengths : (n or 1,) int
        Bytes of each row, the sum of what the columns have.
    following : (n,) int, optional
        Bytes that the caller writes after each row: the length of what holds a row counts them.
    """

    def __init__(self, columns: Sequence[Column], own_lengths: Ints, following: Ints | None = None) -> None:
        self.columns, self.own_lengths, self.following = columns, own_lengths, following

    @staticmethod
    def beside(parts: Sequence[Rows]) -> Rows:
        """The rows of all parts side by side; the last may have bytes that follow."""
        columns = [column for part in parts for column in part.columns]
        return Rows(columns, _sum([part.own_lengths for part in parts]), parts[-1].following if parts else None)

    def followed_by(self, following: Ints) -> Rows:
        """The same rows, each with more bytes after it."""
        return Rows(self.columns, self.own_lengths, following)

    def take(self, index: Ints) -> Rows:
        """Rows by their indices (m,)."""
        return Rows([column.take(index) for column in self.columns], _taken(self.own_lengths, index))

    def lengths(self) -> Ints:
        """Bytes (n,) of each row, those that follow included; (1,) if all are the same."""
        return self.own_lengths if self.following is None else self.own_lengths + self.following

    def split(self, counts: Ints | None = None) -> ByteStrings:
        """The strings; with `counts` (k,), that many rows after another are one string."""
        lengths = self.own_lengths
        ends = np.cumsum(lengths)
        content, at = np.empty(int(lengths.sum()), np.uint8), ends - lengths
        for column in self.columns:
            column.write(content, at)
        if counts is not None:
            ends = np.concatenate([[0], ends])[np.cumsum(counts)]
            lengths = np.diff(ends, prepend=0)
        return ByteStrings(content, ends - lengths, lengths)


def constant(data: bytes) -> Rows:
    """The same bytes in every row."""
    return strings([data])


def strings(texts: Sequence[bytes]) -> Rows:
    """A row for each text."""
    return _rows(_Strings(ByteStrings.of(texts)))


def array_rows(values: NDArray[Any]) -> Rows:
    """The little-endian bytes of each row of numbers (n, k), or of each record (n,)."""
    return _rows(_Strings(ByteStrings.of_rows(values)))


def _rows(column: Column) -> Rows:
    return Rows([column], column.lengths())


def message(kind: type[Message], **columns: Any) -> Rows:
    """Messages of one type, one per row.

    Parameters
    ----------
    kind
        The type.
    columns
        Field name -> its values: of numbers an array (n,) or one number; of strings, bytes and messages `Rows`, or bytes
        that are the same in all. A repeated field has one entry per row.

    Returns
    -------
    Rows
        A column with `followed_by` bytes goes last, and its length includes them.
    """
    found: list[Rows] = []
    for name, tag, wire, is_message in _fields(kind.DESCRIPTOR):
        if name not in columns:
            continue
        value = columns[name]
        if wire == _DELIMITED:
            rows = value if isinstance(value, Rows) else constant(value)
            found += [_rows(_Varints(tag, rows.lengths(), with_zero=is_message)), rows]
        elif wire == _FIXED64:
            found.append(_rows(_Doubles(tag, np.array(value, np.float64, ndmin=1).view(np.int64))))
        else:
            found.append(_rows(_Varints(tag, np.array(value, ndmin=1).astype(np.int64), with_zero=False)))
    return Rows.beside(found)


def stamps(times_ns: Ints) -> Rows:
    """google.protobuf.Timestamp of times (n,) [ns]."""
    seconds, nanos = np.divmod(times_ns, NS_PER_S)
    return message(Timestamp, seconds=seconds, nanos=nanos)


def _sum(lengths: Sequence[Ints]) -> Ints:
    """The sum (n or 1,) of lengths (n or 1,), those of one first: n of them are added as seldom as can be."""
    total: Ints = sum(sorted(lengths, key=len), np.zeros(1, np.int64))
    return total


def _taken(values: Ints, index: Ints) -> Ints:
    return values if len(values) == 1 else values[index]


def _varint_lengths(values: Ints) -> Ints:
    """Bytes of whole numbers (n,)."""
    unsigned, lengths = values.view(np.uint64), np.ones(len(values), np.int64)
    for limit in range(7, 7 * -(-int(unsigned.max(initial=1)).bit_length() // 7), 7):
        lengths += unsigned >= 1 << limit
    return lengths


def _tag_length(tag: int) -> int:
    return 1 if tag < 0x80 else 2


class _Field(NamedTuple):
    name: str
    tag: int
    wire: int
    is_message: bool


@cache
def _fields(kind: Descriptor) -> tuple[_Field, ...]:
    """The fields of a type that can be encoded, in the order of their numbers."""
    found = []
    for field in sorted(kind.fields, key=lambda f: f.number):
        if field.type in _WIRE_TYPES:
            wire = _WIRE_TYPES[field.type]
            is_message = field.type == FieldDescriptor.TYPE_MESSAGE
            found.append(_Field(field.name, field.number << 3 | wire, wire, is_message))
    return tuple(found)
