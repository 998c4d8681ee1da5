"""Byte strings in one array against lists of bytes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from geomphys.output.byte_strings import ByteStrings, side_by_side

TEXTS = st.lists(st.binary(max_size=40), max_size=6)


@given(TEXTS, TEXTS, st.data())
def test_they_are_taken_cut_and_joined_as_lists(some: list[bytes], more: list[bytes], data: st.DataObject) -> None:
    strings = ByteStrings.joined([ByteStrings.of(some), ByteStrings.of(more)])
    texts = some + more
    assert list(strings) == texts
    assert len(strings) == len(texts)
    assert list(strings[1:3]) == texts[1:3]
    index = data.draw(st.lists(st.integers(0, len(texts) - 1), max_size=6) if texts else st.just([]))
    assert list(strings[np.array(index, np.int64)]) == [texts[k] for k in index]
    assert [strings[k] for k in range(len(texts))] == texts


@given(st.lists(st.tuples(st.binary(max_size=300), st.binary(max_size=300)), max_size=5), st.binary(max_size=9))
def test_columns_are_put_side_by_side(rows: list[tuple[bytes, bytes]], between: bytes) -> None:
    first, second = (ByteStrings.of(row[k] for row in rows) for k in range(2))
    backwards = second[::-1][::-1]
    joined = side_by_side(first, ByteStrings.of([between]), backwards)
    assert list(joined) == [a + between + b for a, b in rows]


def test_rows_of_numbers_are_little_endian() -> None:
    assert list(ByteStrings.of_rows(np.array([[1, 2], [3, 258]], ">u2"))) == [b"\1\0\2\0", b"\3\0\2\1"]
    assert list(ByteStrings.of_rows(np.zeros((0, 3)))) == []
    assert list(ByteStrings.of_rows(np.zeros((2, 0)))) == [b"", b""]
