"""Writes ROS 2 messages in little-endian CDR, field by field."""

from __future__ import annotations

import struct
from collections.abc import Sequence

HEADER = b"\x00\x01\x00\x00"
"""Little endian, no options; positions are counted from after it."""
NS_PER_S = 1_000_000_000


class CdrWriter:
    """A message under construction; fields are appended in the order of its definition."""

    def __init__(self) -> None:
        self._data = bytearray(HEADER)

    def numbers(self, kind: str, *values: float) -> None:
        """Append numbers of one kind (a letter of `struct`), each aligned to its size."""
        self.align(struct.calcsize(kind))
        self._data += struct.pack(f"<{len(values)}{kind}", *values)

    def string(self, text: str) -> None:
        """Append a string."""
        data = text.encode() + b"\0"
        self.numbers("I", len(data))
        self._data += data

    def stamp(self, time_ns: int) -> int:
        """Append a builtin_interfaces/Time; returns its position in the message."""
        self.align(4)
        position = len(self._data)
        self._data += struct.pack("<iI", *divmod(time_ns, NS_PER_S))
        return position

    def header(self, time_ns: int, frame_id: str) -> int:
        """Append a std_msgs/Header; returns the position of its stamp."""
        position = self.stamp(time_ns)
        self.string(frame_id)
        return position

    def vectors(self, rows: Sequence[Sequence[float]]) -> None:
        """Append a sequence of messages of doubles, such as geometry_msgs/Point."""
        self.numbers("I", len(rows))
        for row in rows:
            self.numbers("d", *row)

    def align(self, size: int) -> None:
        """Pad to a multiple of `size`."""
        self._data += bytes(-(len(self._data) - len(HEADER)) % size)

    @property
    def length(self) -> int:
        """Bytes so far, the header's among them."""
        return len(self._data)

    def data(self) -> bytearray:
        """The message."""
        return self._data
