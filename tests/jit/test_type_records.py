"""Types of kernels as texts: every type that a kernel of the package takes comes back, and nothing else does."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import typeof, types

from geomphys.jit.packed_records import pack
from geomphys.jit.type_records import text_of_type, type_of_text

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
        pack(Arrays(np.zeros(3), 1.0)).type,
        pack(Arrays(np.zeros((), ROW), 3)).type,
        pack(Arrays(np.zeros(3), True)).type,
    ],
    ids=repr,
)
def test_a_type_comes_back(value: Any) -> None:
    kind = value if isinstance(value, types.Type) else typeof(value)
    text = text_of_type(kind)
    text_of_type.cache_clear()
    type_of_text.cache_clear()
    again = type_of_text(text)
    assert again == kind
    assert str(again) == str(kind)  # files are named after it


def test_read_only_arrays_stay_read_only() -> None:
    array = np.zeros(3)
    array.flags.writeable = False
    assert not type_of_text(text_of_type(typeof(array))).mutable


@pytest.mark.parametrize("kind", [types.unicode_type, types.pyobject, types.List(types.int64)])
def test_what_no_kernel_takes_is_refused(kind: Any) -> None:
    with pytest.raises(TypeError):
        text_of_type(kind)


@pytest.mark.parametrize(
    "plain", ["pyobject", ["named", "os", "system"], ["named", "pathlib", "Path"], ["other"], [], {}, 3]
)
def test_other_texts_are_refused(plain: Any) -> None:
    with pytest.raises((LookupError, TypeError, ValueError)):
        type_of_text(json.dumps(plain))
