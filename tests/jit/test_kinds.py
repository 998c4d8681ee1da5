"""Kinds of arguments are what numba takes the arguments for; nothing else is one."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof, types

from geomphys.jit.kinds import kind_of, kind_of_text, text_of
from geomphys.jit.numba_types import kind_of_type, type_of_kind
from geomphys.jit.packed_records import Pack, pack

ROW = np.dtype({"names": ["a", "b"], "formats": ["<i4", ("<f8", (2, 3))], "offsets": [0, 16], "itemsize": 72})


class Arrays(NamedTuple):
    first: np.ndarray
    size: float


@pytest.mark.parametrize(
    "value",
    [
        True,
        1,
        2.5,
        None,
        np.int32(3),
        np.zeros(3),
        np.zeros((2, 3), np.int32, order="F"),
        np.zeros((4, 4))[::2],
        np.zeros(2, ROW),
        np.zeros(2, ROW)[0],
        (1, 2.0, (True, 3)),
        (1.0, 2.0),
        Arrays(np.zeros(3), 1.0),
        pack(Arrays(np.zeros(3), 1.0)),
        pack(Arrays(np.zeros((), ROW), 3)),
        pack(Arrays(np.zeros(3), True)),
    ],
    ids=lambda value: text_of(kind_of(value)),
)
def test_a_type_comes_back(value: Any) -> None:
    kind = kind_of(value)
    again = kind_of_text(text_of(kind))
    assert again == kind
    kind_of_type.cache_clear()
    assert kind_of_type(type_of_kind(again)) == kind
    if not isinstance(value, Pack):
        assert type_of_kind(kind) == typeof(value)


def test_read_only_arrays_stay_read_only() -> None:
    array = np.zeros(3)
    array.flags.writeable = False
    assert not type_of_kind(kind_of(array)).mutable


@pytest.mark.parametrize("kind", [types.unicode_type, types.pyobject, types.List(types.int64)])
def test_types_that_no_kernel_takes_are_refused(kind: Any) -> None:
    with pytest.raises(TypeError):
        kind_of_type(kind)


@pytest.mark.parametrize("value", ["text", [1], {}, np.zeros(2, ">f8"), np.array(["a"]), np.array([None])], ids=repr)
def test_values_that_no_kernel_takes_are_refused(value: Any) -> None:
    with pytest.raises(TypeError):
        kind_of(value)


@pytest.mark.parametrize(
    "plain", ["pyobject", ["named", "os", "system"], ["named", "pathlib", "Path"], ["other"], [], {}, 3]
)
def test_other_texts_are_refused(plain: Any) -> None:
    with pytest.raises((LookupError, TypeError, ValueError)):
        type_of_kind(kind_of_text(json.dumps(plain)))
