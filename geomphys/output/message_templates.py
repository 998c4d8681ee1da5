"""Messages of which only numbers change: encoded once, patched for each frame.

Encoding a message of fifty transforms field by field costs more than computing them. So a message is encoded once by
its own library, with marker numbers in the places that vary; where a marker's bytes turn up, later numbers are put.
What the library would leave out, a double of value zero, stands in the patched message explicitly: the same message
to every reader.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import numpy as np
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bytes = NDArray[np.uint8]

_STAMP = Timestamp()
_MARK = 0x7FE5A5C3 << 32  # bits of finite doubles that stand in no message


def marker(index: int) -> float:
    """The number that stands for the double of that index in a message handed to `Template`."""
    value: float = struct.unpack("<d", struct.pack("<Q", _MARK | index))[0]
    return value


def markers(count: int, first: int = 0) -> list[float]:
    """`count` markers in a row."""
    return [marker(first + i) for i in range(count)]


class Template:
    """Bytes of an encoded message and where its doubles stand.

    Parameters
    ----------
    data : bytes
        The message, with each of ``marker(0) … marker(count - 1)`` in it once.
    count : int
        How many doubles vary.
    stamp : bytes
        What stands for the time in it, each occurrence; empty if it has none.
    """

    def __init__(self, data: bytes, count: int, stamp: bytes = b"") -> None:
        offsets = [_only(data, struct.pack("<d", marker(i))) for i in range(count)]
        self._data: Bytes = np.frombuffer(data, np.uint8)
        self._doubles = (np.array(offsets, np.int64).reshape(-1, 1) + np.arange(8)).ravel()
        starts = _all(data, stamp)
        if stamp and not starts:
            raise ValueError("the time stands nowhere in the message")
        self._stamps = np.array(starts, np.int64).reshape(-1, 1) + np.arange(len(stamp))
        self._constant: NDArray[np.int64] | None = None
        self._constant_data: Bytes = self._data[:0]

    def fill(self, values: Floats, stamp: bytes = b"") -> bytes:
        """The message with `values` (count,) as its doubles and `stamp` for its times."""
        message = self._data.copy()
        message[self._doubles] = values.view(np.uint8).ravel()
        if stamp and len(self._stamps):
            message[self._stamps] = np.frombuffer(stamp, np.uint8)
        return message.tobytes()

    def read(self, data: bytes) -> Floats | None:
        """The doubles (count,) of a message of this layout, of any time; None if `data` is not one."""
        message = np.frombuffer(data, np.uint8)
        if len(message) != len(self._data):
            return None
        if self._constant is None:
            varies = np.zeros(len(self._data), bool)
            varies[self._doubles] = varies[self._stamps.ravel()] = True
            self._constant = np.flatnonzero(~varies)
            self._constant_data = self._data[self._constant]
        if not np.array_equal(message[self._constant], self._constant_data):
            return None
        values: Floats = message[self._doubles].view(np.dtype("<f8")).astype(np.float64)
        return values

    def fill_rows(self, rows: Floats) -> bytes:
        """Messages end to end, one for each row of (n, count); for entries of a repeated field."""
        messages = np.repeat(self._data[None], len(rows), axis=0)
        messages[:, self._doubles] = np.ascontiguousarray(rows).view(np.uint8)
        return messages.tobytes()


class StampedTemplate:
    """A protobuf message whose doubles and times vary; one `Template` for each length a time can have.

    Parameters
    ----------
    build : callable
        Gives the encoded message with markers as its doubles, and the time it is handed as every timestamp (each
        the field number 1 of its message).
    count : int
        How many doubles vary.
    """

    def __init__(self, build: Callable[[Timestamp], bytes], count: int) -> None:
        self._build = build
        self._count = count
        self._templates: dict[int, Template] = {}

    def fill(self, values: Floats, stamp: bytes) -> bytes:
        """The message with `values` (count,) as its doubles at the time `stamp`, an encoded field 1 (`stamp_field`)."""
        return self.of(len(stamp)).fill(values, stamp if len(stamp) > 2 else b"")

    def of(self, length: int) -> Template:
        """The template for times whose field 1 takes `length` bytes."""
        template = self._templates.get(length)
        if template is None:
            example = _longest(length - 2)
            data = self._build(example)
            # a list of no entries has no times either
            mark = entry(1, example.SerializeToString()) if length > 2 and data else b""
            template = self._templates[length] = Template(data, self._count, mark)
        return template


def stamp_field(time_ns: int) -> bytes:
    """A time as the protobuf field 1 of a message, a Timestamp; never longer than 14 bytes."""
    _STAMP.seconds, _STAMP.nanos = divmod(time_ns, 1_000_000_000)
    return entry(1, _STAMP.SerializeToString())


def entry(number: int, body: bytes) -> bytes:
    """`body` as a length-delimited protobuf field of that number: a message, a string, an entry of a repeated field."""
    length, head = len(body), bytearray([number << 3 | 2])
    while length > 0x7F:
        head.append(length & 0x7F | 0x80)
        length >>= 7
    head.append(length)
    return bytes(head) + body


def _longest(length: int) -> Timestamp:
    """A time that takes that many bytes, of digits that turn up nowhere else."""
    choices: Sequence[tuple[int, int]] = [
        (seconds, nanos)
        for seconds in (0, *((1 << 7 * n) - 1 for n in range(1, 6)))
        for nanos in (0, *((1 << 7 * n) - 1 for n in range(1, 5)), 999_999_999)
    ]
    for seconds, nanos in choices:
        stamp = Timestamp(seconds=seconds, nanos=nanos)
        if stamp.ByteSize() == length:
            return stamp
    raise ValueError(f"no time takes {length} bytes")


def _only(data: bytes, pattern: bytes) -> int:
    found = _all(data, pattern)
    if len(found) != 1:
        raise ValueError(f"a marker stands {len(found)} times in the message instead of once")
    return found[0]


def _all(data: bytes, pattern: bytes) -> list[int]:
    found: list[int] = []
    start = data.find(pattern) if pattern else -1
    while start >= 0:
        found.append(start)
        start = data.find(pattern, start + len(pattern))
    return found
