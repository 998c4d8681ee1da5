"""Kinds: the types of kernels' arguments as plain values, found without numba.

A kind is a name (``"float64"``) or a tuple of a tag and its parts:

    ("array", kind of an element, dimensions, layout, read-only, aligned)
    ("record", structured type, aligned)
    ("pack", (name, kind), ...)
    ("named", module, class, kind, ...)
    ("tuple", kind, ...)
"""

from __future__ import annotations

import importlib
import json
from functools import lru_cache
from typing import Any

import numpy as np

Kind = Any
"""A name, or a tuple of a tag and its parts."""

PLAIN = (
    "boolean",
    "none",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    "float32",
    "float64",
)

_SCALARS: dict[type, str] = {
    bool: "boolean",
    int: "int64",
    float: "float64",
    type(None): "none",
    np.bool_: "boolean",
    **{np.dtype(name).type: name for name in PLAIN[2:]},
}


class PackKind(tuple[Any, ...]):
    """Kind of a pack, whose hash is computed once: it has hundreds of parts."""

    _hash: int | None = None

    def __hash__(self) -> int:
        """As of any tuple."""
        if self._hash is None:
            self._hash = super().__hash__()
        return self._hash


def kind_of(value: Any) -> Kind:
    """Kind of a value; raises TypeError for one that no kernel takes."""
    scalar = _SCALARS.get(type(value))
    if scalar is not None:
        return scalar
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
        aligned = value.dtype.fields is None or value.dtype.isalignedstruct
        return ("array", kind_of_dtype(value.dtype), value.ndim, layout, not flags.writeable, aligned)
    if isinstance(value, tuple):
        owner = type(value)
        if hasattr(value, "_fields"):
            return ("named", owner.__module__, owner.__qualname__, *map(kind_of, value))
        return ("tuple", *map(kind_of, value))
    if isinstance(value, np.void):
        return kind_of_dtype(value.dtype)
    kind = getattr(value, "kind", None)
    if isinstance(kind, PackKind):
        return kind
    raise TypeError(f"{type(value).__name__} is a type that kernels do not take")


def kind_of_dtype(dtype: np.dtype[Any]) -> Kind:
    """Kind of the elements of an array."""
    return _kind_of_dtype(dtype, dtype.isalignedstruct)  # types that differ in that alone are equal


@lru_cache(maxsize=256)
def _kind_of_dtype(dtype: np.dtype[Any], is_aligned: bool) -> Kind:
    if dtype.fields is not None:
        return ("record", plain_dtype(dtype), is_aligned)
    scalar = _SCALARS.get(dtype.type)
    if scalar is None or not dtype.isnative:
        raise TypeError(f"arrays of {dtype} are a type that kernels do not take")
    return scalar


def plain_dtype(dtype: np.dtype[Any]) -> Any:
    """A structured type: names, types, shapes and offsets of its fields, and its size."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return ("sub", plain_dtype(base), tuple(shape))
    if dtype.fields is None:
        return dtype.str
    names = tuple(dtype.names or ())
    fields = [dtype.fields[name] for name in names]
    return (
        "fields",
        names,
        tuple(plain_dtype(field[0]) for field in fields),
        tuple(field[1] for field in fields),
        dtype.itemsize,
    )


def dtype_of(plain: Any) -> Any:
    """The structured type that `plain_dtype` was given."""
    if isinstance(plain, str):
        return np.dtype(plain)
    if plain[0] == "sub":
        return np.dtype((dtype_of(plain[1]), tuple(plain[2])))
    _, names, formats, offsets, size = plain
    fields = [dtype_of(one) for one in formats]
    return {"names": list(names), "formats": fields, "offsets": list(offsets), "itemsize": size}


@lru_cache(maxsize=256)
def named_tuple(module: str, name: str) -> Any:
    """The NamedTuple of a kind. Raises ValueError where the name is that of something else."""
    owner = getattr(importlib.import_module(module), name)
    if not (isinstance(owner, type) and issubclass(owner, tuple) and hasattr(owner, "_fields")):
        raise ValueError(f"{name} is no named tuple")
    return owner


def text_of(kind: Kind) -> str:
    """A kind as a text."""
    return json.dumps(kind, separators=(",", ":"))


def kind_of_text(text: str) -> Kind:
    """The kind that `text_of` was given."""
    return _frozen(json.loads(text))


def _frozen(plain: Any) -> Any:
    return tuple(map(_frozen, plain)) if isinstance(plain, list) else plain
