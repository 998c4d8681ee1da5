"""Packs: kernels see a record's arrays; wrong ones are refused."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import Pack, pack
from geomphys.jit.record_copy import copy_record


class Inner(NamedTuple):
    numbers: np.ndarray
    grid: np.ndarray


class Outer(NamedTuple):
    weight: float
    inner: Inner
    rows: np.ndarray


def make() -> Outer:
    return Outer(0.5, Inner(np.arange(5), np.arange(24.0).reshape(2, 3, 4)), np.ones((4, 3)))


@kernel
def _sum(record: Outer) -> float:
    total = record.weight
    for i in range(len(record.inner.numbers)):
        total += record.inner.numbers[i]
    a, b, c = record.inner.grid.shape
    for i in range(a):
        for j in range(b):
            for k in range(c):
                total += record.inner.grid[i, j, k] * (100 * i + 10 * j + k)
    for row in record.rows:
        total += row[2]
    return total


@kernel
def _write(record: Outer) -> None:
    record.rows[3, 1] = 7.0
    record.inner.numbers[4] = -1


def test_a_kernel_reads_every_field() -> None:
    record = make()
    i, j, k = np.indices((2, 3, 4))
    expected = 0.5 + 10 + float((record.inner.grid * (100 * i + 10 * j + k)).sum()) + 4
    assert _sum(pack(record)) == expected


def test_arrays_are_shared_not_copied() -> None:
    record = make()
    packed = pack(record)
    _write(packed)
    assert record.rows[3, 1] == 7.0
    assert record.inner.numbers[4] == -1
    record.rows[:, 2] = 3.0
    assert _sum(packed) == _sum(pack(record))


def test_python_sees_the_same_attributes() -> None:
    record = make()
    packed = pack(record)
    assert packed.rows is record.rows
    assert packed.inner.grid is record.inner.grid
    assert isinstance(packed.inner, Pack)
    assert packed.weight == 0.5
    assert pack(packed) is packed
    with pytest.raises(AttributeError, match="nothing"):
        _ = packed.nothing


STATE = np.dtype([("count", np.int64), ("at", np.float64, 3)])


class Numbers(NamedTuple):
    whole: int
    flag: bool
    real: float
    state: np.ndarray


@kernel
def _count_up(numbers: Numbers, times: int) -> float:
    for _ in range(times):
        numbers.state.count += numbers.whole
    if numbers.flag:
        numbers.state.at[1] = numbers.real
    return numbers.state.count + numbers.state.at[2]


@pytest.mark.parametrize("flag", [False, True])
def test_numbers_and_a_record_are_fields(flag: bool) -> None:
    state = np.zeros((), STATE)
    state["count"], state["at"] = 2, (1.0, 2.0, 0.5)
    packed = pack(Numbers(-3, flag, 0.25, state))
    assert _count_up(packed, 4) == 2 - 12 + 0.5
    assert state["count"] == packed.state["count"] == -10
    assert state["at"].tolist() == [1.0, 0.25 if flag else 2.0, 0.5]
    assert packed.flag is flag
    assert len(packed.block) == 4


def test_it_keeps_its_arrays_alive() -> None:
    packed = pack(Outer(0.0, Inner(np.arange(5), np.full((2, 3, 4), 0.0)), np.full((4, 3), 2.0)))
    rubbish = [np.full((4, 3), float(k)) for k in range(200)]
    assert _sum(packed) == 10 + 8.0
    assert len(rubbish) == 200


def test_records_of_one_layout_share_a_kind() -> None:
    assert pack(make()).kind is pack(make()).kind
    assert pack(make()).kind != pack(Inner(np.arange(5), np.zeros((2, 2)))).kind
    assert len(pack(make()).block) == 1 + 1 + 3


@pytest.mark.parametrize(
    "rows", [np.ones((4, 6))[:, ::2], np.ones((3, 4)).T, [1.0, 2.0], "text", np.float32(1), None],
    ids=["strided", "fortran", "list", "text", "number", "none"],
)  # fmt: skip
def test_what_a_kernel_could_not_read_is_refused(rows: object) -> None:
    with pytest.raises(TypeError, match=r"Outer\.rows"):
        pack(make()._replace(rows=rows))


def test_read_only_arrays_are_refused() -> None:
    rows = np.ones((4, 3))
    rows.flags.writeable = False
    with pytest.raises(TypeError, match=r"Outer\.rows"):
        pack(make()._replace(rows=rows))


class Rows(NamedTuple):
    rows: np.ndarray


@kernel
def _copy_first(rows: Rows, to: int) -> None:
    copy_record(rows.rows[to], rows.rows[0])


def test_a_record_is_copied_with_all_its_fields_and_no_other() -> None:
    rows = np.zeros(4, STATE)
    rows["count"], rows["at"] = np.arange(4), np.arange(12.0).reshape(4, 3) - 0.5
    expected = rows.copy()
    expected[2] = expected[0]
    _copy_first(pack(Rows(rows)), 2)
    assert rows.tobytes() == expected.tobytes()
    expected[1] = expected[3]
    copy_record(rows[1], rows[3])
    assert rows.tobytes() == expected.tobytes()
