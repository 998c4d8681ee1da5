"""Vectors in arrays: what is written is read again, where it belongs and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.numerics import row_vectors as r

V, Q = (1.5, -2.5, 3.5), (0.1, 0.2, 0.3, 0.9)
ROT = tuple(float(k) for k in range(1, 10))


def numbers(n: int) -> np.ndarray:
    return np.arange(n) + 100.0


def changed(before: np.ndarray, after: np.ndarray) -> list[int]:
    return np.flatnonzero(before.ravel() != after.ravel()).tolist()


def test_reading() -> None:
    a, rows = numbers(12), numbers(12).reshape(3, 4)
    assert r.vec_of(a) == (100, 101, 102)
    assert r.vec_at(rows, 2) == (108, 109, 110)
    assert r.vec_from(a, 5) == (105, 106, 107)
    assert r.quat_of(a) == (100, 101, 102, 103)
    assert r.quat_from(a, 3) == (103, 104, 105, 106)
    assert r.rot_of(a) == tuple(range(100, 109))


@pytest.mark.parametrize(
    ("write", "arguments", "where", "values"),
    [
        (r.set_vec, (V,), [0, 1, 2], V),
        (r.set_vec_from, (4, V), [4, 5, 6], V),
        (r.set_quat, (Q,), [0, 1, 2, 3], Q),
        (r.set_quat_from, (5, Q), [5, 6, 7, 8], Q),
        (r.set_rot, (ROT,), list(range(9)), ROT),
    ],
)
def test_writing(write, arguments, where, values) -> None:
    a = numbers(12)
    write(a, *arguments)
    assert a[where].tolist() == list(values)
    assert changed(numbers(12), a) == where


def test_a_row_is_written_and_no_other() -> None:
    rows = numbers(12).reshape(4, 3)
    r.set_vec_at(rows, 2, V)
    assert rows[2].tolist() == list(V)
    assert changed(numbers(12), rows) == [6, 7, 8]


def test_adding_a_multiple() -> None:
    a = numbers(12)
    r.add_vec(a, V, 2.0)
    r.add_vec_from(a, 6, V, -1.0)
    expected = numbers(12)
    expected[:3] += 2.0 * np.array(V)
    expected[6:9] -= V
    assert a.tolist() == expected.tolist()
