"""Records: what is read is what was written, and reading runs no code."""

from __future__ import annotations

import contextlib
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geomphys.storage.records import RecordError, decode, encode


class Inner(NamedTuple):
    name: str
    values: np.ndarray


@dataclass(frozen=True)
class Outer:
    parts: tuple[Inner, ...]
    size: float


plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text()
    | st.binary()
    | st.builds(lambda words: Path(*words), st.lists(st.text("abc", min_size=1), min_size=1)),
    lambda inner: (
        st.lists(inner) | st.lists(inner).map(tuple) | st.dictionaries(st.text() | st.tuples(st.integers()), inner)
    ),
)


@given(plain)
def test_plain_values_come_back(value: object) -> None:
    again = decode(encode(value))
    assert again == value
    assert repr(again) == repr(value)  # kinds and signs of zero too


@pytest.mark.parametrize("kind", ["<f8", ">f4", "<i8", "|u1", "|b1", "|S3"])
@pytest.mark.parametrize("shape", [(), (0, 3), (2, 3)])
def test_arrays_come_back_bit_for_bit_and_can_be_written_to(kind: str, shape: tuple[int, ...]) -> None:
    array = np.frombuffer(bytes(range(64)), kind, count=int(np.prod(shape))).reshape(shape)
    again = decode(encode([array]))[0]
    assert (again.dtype, again.shape, again.tobytes()) == (array.dtype, array.shape, array.tobytes())
    assert again.flags.writeable
    assert again.flags.c_contiguous
    strided = np.arange(12.0).reshape(3, 4)[:, ::2]
    assert (decode(encode(strided)) == strided).all()


def test_an_array_that_occurs_twice_is_stored_once() -> None:
    array = np.zeros(1000)
    data = encode((array, array))
    assert len(data) < 9000
    one, other = decode(data)
    assert one is other


def test_an_empty_array_is_not_taken_for_the_next_one() -> None:
    empty, full, other = decode(encode([np.zeros((0, 3)), np.arange(4), np.zeros(0, np.int32)]))
    assert (empty.shape, full.tolist(), other.dtype) == ((0, 3), [0, 1, 2, 3], np.int32)


def test_records_are_made_of_the_classes_that_are_named_and_of_no_others() -> None:
    value = Outer((Inner("a", np.arange(3)), Inner("b", np.arange(0))), -0.0)
    data = encode(value)
    again = decode(data, (Outer, Inner))
    assert isinstance(again, Outer)
    assert again.parts[0].values.tolist() == [0, 1, 2]
    with pytest.raises(RecordError):
        decode(data, (Outer,))


def test_what_is_no_plain_value_is_refused() -> None:
    for value in (object(), {1, 2}, np.array([object()]), 1j, open):
        with pytest.raises(RecordError):
            encode(value)


class Evil:
    """Unpickled, it makes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return Path.touch, (self.path,)


def test_a_pickle_is_no_record_and_does_not_run(tmp_path: Path) -> None:
    data = pickle.dumps(Evil(tmp_path / "ran"))
    with pytest.raises(RecordError):
        decode(data)
    assert not (tmp_path / "ran").exists()
    pickle.loads(data)
    assert (tmp_path / "ran").exists()


@given(st.binary(max_size=200))
def test_any_bytes_are_a_record_or_an_error(data: bytes) -> None:
    with contextlib.suppress(RecordError):
        decode(data, (Outer, Inner))


@given(st.integers(0, 400), st.integers(0, 255))
def test_a_changed_byte_is_a_record_or_an_error(at: int, byte: int) -> None:
    data = bytearray(encode(Outer((Inner("a", np.arange(3)),), 1.5)))
    data[at % len(data)] = byte
    with contextlib.suppress(RecordError):
        decode(bytes(data), (Outer, Inner))
