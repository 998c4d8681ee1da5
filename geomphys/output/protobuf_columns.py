"""Encodes many protobuf messages of one type at once: columns of values in, one byte string per row out.

The bytes are those that the protobuf package writes for messages of proto3: fields in the order of their numbers, numbers of
value zero and empty strings left out. The package builds a message field by field in Python, which took a third of a replay.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from google.protobuf.descriptor import Descriptor, FieldDescriptor
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Flags = NDArray[np.bool_]
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


class Block(NamedTuple):
    """Columns of bytes: (n, w), or (1, w) if all rows are the same."""

    data: Bytes
    present: Flags | None = None  # (n or 1, w or 1) mask of bytes that are written; None: all
    lengths: Ints | None = None  # (n or 1,) bytes that are written of each row, where they are known


class Rows:
    """n byte strings: `blocks` side by side. One row stands for as many as the others beside it have.

    Parameters
    ----------
    blocks : sequence of Block
    following : (n,) int, optional
        Bytes that the caller writes after each row: the length of what holds a row counts them.
    """

    def __init__(self, blocks: Sequence[Block], following: Ints | None = None) -> None:
        self.blocks, self.following = blocks, following
        sizes = (len(part) for block in blocks for part in block if part is not None)
        self.count = next((size for size in sizes if size != 1), 1)

    def followed_by(self, following: Ints) -> Rows:
        """The same rows, each with more bytes after it."""
        return Rows(self.blocks, following)

    def take(self, index: Ints) -> Rows:
        """Rows by their indices (m,)."""

        def taken(part: Any) -> Any:
            return part if part is None or len(part) == 1 else part[index]

        return Rows([Block(*map(taken, block)) for block in self.blocks])

    def lengths(self) -> Ints:
        """Bytes (n,) of each row, those that follow included; (1,) if all are the same."""
        own = self._own_lengths()
        return own if self.following is None else own + self.following

    def _own_lengths(self) -> Ints:
        total = np.zeros(1, np.int64)
        for data, present, lengths in self.blocks:
            if lengths is not None:
                total = total + lengths
            elif present is None:
                total = total + data.shape[1]
            elif present.shape[1] == data.shape[1]:
                total = total + present.sum(axis=1)
            else:
                total = total + data.shape[1] * present[:, 0]
        return total

    def split(self, counts: Ints | None = None) -> list[bytes]:
        """The strings; with `counts` (k,), that many rows after another are one string."""
        width = sum(block.data.shape[1] for block in self.blocks)
        data = np.empty((self.count, width), np.uint8)
        mask = np.ones((self.count, width), bool) if any(b.present is not None for b in self.blocks) else None
        start = 0
        for block in self.blocks:
            end = start + block.data.shape[1]
            data[:, start:end] = block.data
            if mask is not None and block.present is not None:
                mask[:, start:end] = block.present
            start = end
        if mask is None:
            flat, ends = data.ravel(), np.arange(1, self.count + 1) * width
        else:
            flat, ends = data[mask], np.cumsum(np.broadcast_to(self._own_lengths(), self.count))
        ends = np.concatenate([[0], ends])
        if counts is not None:
            ends = ends[np.concatenate([[0], np.cumsum(counts)])]
        content = flat.data  # the array's own memory: a copy as one string would cost as much as all that precedes
        return [bytes(content[a:b]) for a, b in pairwise(ends.tolist())]


def constant(data: bytes) -> Rows:
    """The same bytes in every row."""
    return Rows([Block(np.frombuffer(data, np.uint8)[None])])


def strings(texts: Sequence[bytes]) -> Rows:
    """A row for each text."""
    width = max(map(len, texts), default=0)
    padded = np.frombuffer(b"".join(text.ljust(width, b"\0") for text in texts), np.uint8).reshape(len(texts), width)
    lengths = np.array([len(text) for text in texts], np.int64)
    return Rows([Block(padded, np.arange(width) < lengths[:, None], lengths)])


def array_rows(values: NDArray[Any]) -> Rows:
    """The little-endian bytes of each row of numbers (n, k), or of each record (n,)."""
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    size = values.itemsize * math.prod(values.shape[1:])
    return Rows([Block(little.view(np.uint8).reshape(len(values), size))])


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
    blocks: list[Block] = []
    following: Ints | None = None
    for name, tag, wire, is_message in _fields(kind.DESCRIPTOR):
        if name not in columns:
            continue
        value = columns[name]
        if wire == _DELIMITED:
            rows = value if isinstance(value, Rows) else constant(value)
            lengths, following = rows.lengths(), rows.following
            is_there = None if is_message or lengths.all() else (lengths > 0)[:, None]
            blocks += [Block(tag, is_there), *_varints(lengths, is_there), *rows.blocks]
        elif wire == _FIXED64:
            numbers = np.ascontiguousarray(np.atleast_1d(value), "<f8")
            is_there = None if (present := numbers.view(np.int64) != 0).all() else present[:, None]
            blocks += [Block(tag, is_there), Block(numbers.view(np.uint8).reshape(-1, 8), is_there)]
        else:
            whole = np.atleast_1d(value).astype(np.int64)
            is_there = None if (present := whole != 0).all() else present[:, None]
            blocks += [Block(tag, is_there), *_varints(whole, is_there)]
    return Rows(blocks, following)


def stamps(times_ns: Ints) -> Rows:
    """google.protobuf.Timestamp of times (n,) [ns]."""
    seconds, nanos = np.divmod(times_ns, NS_PER_S)
    return message(Timestamp, seconds=seconds, nanos=nanos)


def _varints(values: Ints, is_there: Flags | None) -> Iterable[Block]:
    """Whole numbers (n,) in 7 bits a byte, lowest first; negative ones as of 64 bits."""
    bits = values.astype(np.uint64)
    width = max(1, -(-int(bits.max(initial=0)).bit_length() // 7))
    shifted = bits[:, None] >> np.arange(0, 7 * width, 7, dtype=np.uint64)
    data = (shifted & np.uint64(0x7F)).astype(np.uint8)
    present = shifted != 0
    present[:, 0] = True
    data[:, :-1] |= present[:, 1:].astype(np.uint8) << 7
    if is_there is not None:
        present = present & is_there
    elif present.all():
        yield Block(data)
        return
    lengths = np.zeros(len(present), np.int64)
    for column in present.T:  # few of them, of many rows
        lengths += column
    yield Block(data, present, lengths)


class _Field(NamedTuple):
    name: str
    tag: Bytes  # (1, w)
    wire: int
    is_message: bool


@cache
def _fields(kind: Descriptor) -> tuple[_Field, ...]:
    """The fields of a type that can be encoded, in the order of their numbers."""
    found = []
    for field in sorted(kind.fields, key=lambda f: f.number):
        if field.type in _WIRE_TYPES:
            wire = _WIRE_TYPES[field.type]
            (tag,) = _varints(np.array([field.number << 3 | wire]), None)
            is_message = field.type == FieldDescriptor.TYPE_MESSAGE
            found.append(_Field(field.name, tag.data, wire, is_message))
    return tuple(found)
