"""Types of kernels from annotations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import types

from geomphys.jit.returns import declared_return


class Found(NamedTuple):
    at: tuple[float, float, float]
    count: int


def nothing() -> None: ...
def number() -> float: ...  # type: ignore[empty-body]
def found() -> Found: ...  # type: ignore[empty-body]
def mixed() -> tuple[int, bool]: ...  # type: ignore[empty-body]
def array() -> np.ndarray: ...  # type: ignore[empty-body]
def untold(): ...  # type: ignore[no-untyped-def]


def test_scalars_tuples_and_named_tuples_are_types_of_kernels() -> None:
    assert declared_return(nothing) == types.none
    assert declared_return(number) == types.float64
    assert declared_return(mixed) == types.Tuple((types.int64, types.boolean))
    place = types.UniTuple(types.float64, 3)
    assert declared_return(found) == types.NamedTuple((place, types.int64), Found)


@pytest.mark.parametrize("function", [array, untold])
def test_others_are_refused(function: Any) -> None:
    with pytest.raises(TypeError, match=rf"{function.__name__}: annotated to return .*, which no kernel can"):
        declared_return(function)
