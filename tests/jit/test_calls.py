"""What Python hands to a kernel, and what it gets back, by kernels that return what they are given."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from geomphys.jit.kernel import kernel


class Pair(NamedTuple):
    first: float
    second: bool


class Nested(NamedTuple):
    numbers: np.ndarray
    pair: Pair


@kernel
def _read(nested: Nested, rows: np.ndarray, whole: int, flag: bool, none: None) -> tuple[float, Pair, int, bool]:
    total = 0.0
    for i in range(rows.shape[0]):
        for j in range(rows.shape[1]):
            total += rows[i, j] * (10 * i + j)
    return total + nested.numbers[-1], Pair(nested.pair.first, not nested.pair.second), -whole, flag


@kernel
def _square(x: float) -> float:
    return x * x


@kernel
def _nothing() -> None:
    pass


@kernel
def _set(rows: np.ndarray, value: float) -> None:
    rows[:] = value


@pytest.mark.parametrize(
    "rows", [np.arange(6.0).reshape(2, 3), np.arange(6.0).reshape(3, 2).T, np.ones((4, 6))[::2, ::2]]
)
@pytest.mark.parametrize("whole", [0, 2**62, -(2**62), np.int32(-7)])
def test_arrays_of_every_layout_and_tuples(rows: np.ndarray, whole: int) -> None:
    nested = Nested(np.array([1, 2, 5]), Pair(-0.0, True))
    total, pair, negative, flag = _read(nested, rows, whole, np.True_, None)
    i, j = np.indices(rows.shape)
    assert total == 5 + float((rows * (10 * i + j)).sum())
    assert isinstance(pair, Pair)
    assert pair == (0.0, False)
    assert math.copysign(1.0, pair.first) == -1.0
    assert negative == -int(whole)
    assert flag is True


@pytest.mark.parametrize("value", [0.1, -0.0, math.inf, 5e-324, np.float32(0.1)])
def test_numbers_keep_every_bit(value: float) -> None:
    expected = value * value
    assert _square(value) == expected
    assert math.isnan(_square(math.nan))


def test_a_kernel_of_nothing_returns_none() -> None:
    assert _nothing() is None


def test_named_and_missing_arguments_are_those_of_the_function() -> None:
    rows = np.zeros((2, 2))
    _set(value=3.0, rows=rows)
    assert (rows == 3.0).all()
    with pytest.raises(TypeError, match="value"):
        _set(rows)


@kernel
def _give(rows: np.ndarray) -> np.ndarray:
    return rows


def test_python_gets_no_arrays_from_kernels() -> None:
    with pytest.raises(TypeError, match="no kernel that returns array"):
        _give(np.zeros(3))


def test_arguments_by_name_go_where_python_puts_them_and_unknown_ones_are_refused() -> None:
    rows = np.zeros(3)
    _set(value=2.0, rows=rows)
    assert rows.tolist() == [2.0, 2.0, 2.0]
    with pytest.raises(TypeError, match="other"):
        _square(3.0, other=1)  # type: ignore[call-arg]
