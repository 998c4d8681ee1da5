"""What a kernel returns, from its annotation: its callers need not wait until it is compiled."""

from __future__ import annotations

import typing
from collections.abc import Callable
from types import NoneType, SimpleNamespace
from typing import Any

from numba import types

SCALARS: dict[Any, Any] = {
    NoneType: types.none,
    bool: types.boolean,
    int: types.int64,
    float: types.float64,
}


def declared_return(function: Callable[..., object]) -> Any:
    """Type of what `function` is annotated to return.

    Raises
    ------
    TypeError
        It has no annotation, or one for no type of a kernel: these are None, bool, int, float, and tuples
        and NamedTuples of them.
    """
    annotations = {"return": function.__annotations__.get("return", Any)}
    hint = typing.get_type_hints(SimpleNamespace(__annotations__=annotations), vars(_module_of(function)))["return"]
    found = _type_of(hint)
    if found is None:
        raise TypeError(
            f"{function.__module__}.{function.__qualname__}: annotated to return {hint}, which no kernel can"
        )
    return found


def _module_of(function: Callable[..., object]) -> Any:
    return SimpleNamespace(**function.__globals__)


def _type_of(hint: Any) -> Any:
    """The type of a kernel for a hint, or None."""
    if hint in SCALARS:
        return SCALARS[hint]
    if typing.get_origin(hint) is tuple:
        items = [_type_of(item) for item in typing.get_args(hint)]
        return None if None in items else types.BaseTuple.from_types(items)
    if hasattr(hint, "_fields"):
        items = [_type_of(item) for item in typing.get_type_hints(hint).values()]
        return None if None in items else types.BaseTuple.from_types(items, hint)
    return None
