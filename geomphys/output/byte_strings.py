"""Many byte strings in one array, and the compiled loop that writes columns of them side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


class ByteStrings(Sequence[bytes]):
    """n byte strings, the pieces of one array; they may overlap and repeat.

    Parameters
    ----------
    content : (c,) uint8
    begin, length : (n,) int
        String k is ``content[begin[k] : begin[k] + length[k]]``.
    """

    def __init__(self, content: Bytes, begin: Ints, length: Ints) -> None:
        self.content, self.begin, self.length = content, begin, length

    @staticmethod
    def of(texts: Iterable[bytes]) -> ByteStrings:
        """Strings, copied."""
        texts = list(texts)
        length = np.fromiter(map(len, texts), np.int64, len(texts))
        return ByteStrings(bytes_array(b"".join(texts)), np.cumsum(length) - length, length)

    @staticmethod
    def of_rows(values: NDArray[Any]) -> ByteStrings:
        """The little-endian bytes of each row of numbers (n, k), or of each record (n,)."""
        little = np.array(values, values.dtype.newbyteorder("<"), order="C")
        length = np.full(len(little), little.itemsize * math.prod(little.shape[1:]), np.int64)
        return ByteStrings(little.reshape(-1).view(np.uint8), np.cumsum(length) - length, length)

    @staticmethod
    def joined(parts: Sequence[ByteStrings]) -> ByteStrings:
        """The strings of parts, one part after another."""
        sizes = np.array([len(part.content) for part in parts], np.int64)
        starts: Ints = np.repeat(np.cumsum(sizes) - sizes, [len(part) for part in parts])
        return ByteStrings(
            np.concatenate([part.content for part in parts]),
            np.concatenate([part.begin for part in parts]) + starts,
            np.concatenate([part.length for part in parts]),
        )

    def grouped(self, counts: Ints) -> ByteStrings:
        """So many (k,) of the strings one after another as one each; they must lie one after another in the content."""
        first = np.cumsum(counts) - counts
        ends = np.concatenate([np.zeros(1, np.int64), np.cumsum(self.length)])
        begin = ends[first] + (self.begin[0] if len(self) else 0)
        return ByteStrings(self.content, begin, ends[first + counts] - ends[first])

    def __len__(self) -> int:
        return len(self.begin)

    @overload
    def __getitem__(self, index: int) -> bytes: ...
    @overload
    def __getitem__(self, index: slice | Ints) -> ByteStrings: ...
    def __getitem__(self, index: int | slice | Ints) -> bytes | ByteStrings:
        """One of the strings, or those of a slice or of indices (m,), which share the content."""
        if isinstance(index, (slice, np.ndarray)):
            return ByteStrings(self.content, self.begin[index], self.length[index])
        begin = int(self.begin[index])
        return bytes(self.content.data[begin : begin + int(self.length[index])])

    def __iter__(self) -> Iterator[bytes]:
        content = self.content.data
        for begin, length in zip(self.begin.tolist(), self.length.tolist(), strict=True):
            yield bytes(content[begin : begin + length])


def bytes_array(data: bytes) -> Bytes:
    """An array of bytes that may be written to, as kernels take it."""
    return np.frombuffer(bytearray(data), np.uint8)


def side_by_side(*columns: ByteStrings) -> ByteStrings:
    """The strings of each row of columns as one; each column has n of them, or one that is in every row."""
    lengths = sum((column.length for column in columns), np.zeros(1, np.int64))
    begin = np.cumsum(lengths) - lengths
    content, at = np.empty(int(lengths.sum()), np.uint8), begin.copy()
    for column in columns:
        write_strings(column.content, column.begin, column.length, content, at)
    return ByteStrings(content, begin, lengths)


@kernel
def write_strings(content: Bytes, begin: Ints, length: Ints, out: Bytes, at: Ints) -> None:
    """Write strings (n or 1,) to `out` from `at` (n,) on, which is moved behind them."""
    for i in range(len(at)):
        row = i if len(begin) > 1 else 0
        first, size, k = begin[row], length[row], at[i]
        # slices: with indices from 0, many bytes are copied at once
        target, source = out[k : k + size], content[first : first + size]
        for j in range(len(target)):
            target[j] = source[j]
        at[i] = k + size
