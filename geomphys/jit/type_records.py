"""Types of kernels' arguments as plain values, and back: those that kernels take, and no others."""

from __future__ import annotations

import importlib
import json
from functools import lru_cache
from typing import Any

import numpy as np
from numba import from_dtype, types

from geomphys.jit.packed_records import PackType

_PLAIN = (
    "boolean",
    "none",
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
    "float32",
    "float64",
)
_BY_TYPE = {getattr(types, name): name for name in _PLAIN}


@lru_cache(maxsize=4096)
def text_of_type(kind: Any) -> str:
    """A type as a text; raises TypeError for one that no kernel takes."""
    return json.dumps(_plain(kind), separators=(",", ":"))


@lru_cache(maxsize=4096)
def type_of_text(text: str) -> Any:
    """The type that `text_of_type` was given; raises LookupError, TypeError or ValueError for anything else."""
    return _type(json.loads(text))


def _plain(kind: Any) -> Any:
    if kind in _BY_TYPE:
        return _BY_TYPE[kind]
    if isinstance(kind, PackType):
        return ["pack", *([name, _plain(field)] for name, field in kind.fields)]
    if isinstance(kind, types.Record):
        return ["record", _plain_dtype(kind.dtype), kind.aligned]
    if type(kind) is types.Array:
        return ["array", _plain(kind.dtype), kind.ndim, kind.layout, not kind.mutable, kind.aligned]
    if isinstance(kind, types.BaseNamedTuple):
        owner = kind.instance_class
        return ["named", owner.__module__, owner.__qualname__, *map(_plain, kind.types)]
    if isinstance(kind, types.BaseTuple):
        return ["tuple", *map(_plain, kind.types)]
    raise TypeError(f"{kind} is a type that kernels do not take")


def _type(plain: Any) -> Any:
    if isinstance(plain, str):
        if plain not in _PLAIN:
            raise ValueError(f"{plain!r} is no type of a kernel")
        return getattr(types, plain)
    tag, *parts = plain
    if tag == "pack":
        return PackType(tuple((name, _type(field)) for name, field in parts))
    if tag == "record":
        return from_dtype(np.dtype(_structured(parts[0]), align=bool(parts[1])))
    if tag == "array":
        dtype, ndim, layout, readonly, aligned = parts
        return types.Array(_type(dtype), ndim, layout, readonly=readonly, aligned=aligned)
    if tag == "named":
        owner = getattr(importlib.import_module(parts[0]), parts[1])
        if not (isinstance(owner, type) and issubclass(owner, tuple) and hasattr(owner, "_fields")):
            raise ValueError(f"{parts[1]} is no named tuple")
        return types.BaseTuple.from_types([_type(part) for part in parts[2:]], owner)
    if tag == "tuple":
        return types.BaseTuple.from_types([_type(part) for part in parts])
    raise ValueError(f"{tag!r} is no type of a kernel")


def _plain_dtype(dtype: np.dtype[Any]) -> Any:
    """A structured type: names, types, shapes and offsets of its fields, and its size."""
    if dtype.subdtype is not None:
        base, shape = dtype.subdtype
        return ["sub", _plain_dtype(base), list(shape)]
    if dtype.fields is None:
        return dtype.str
    names = list(dtype.names or ())
    fields = [dtype.fields[name] for name in names]
    return [
        "fields",
        names,
        [_plain_dtype(field[0]) for field in fields],
        [field[1] for field in fields],
        dtype.itemsize,
    ]


def _structured(plain: Any) -> Any:
    if isinstance(plain, str):
        return np.dtype(plain)
    if plain[0] == "sub":
        return np.dtype((_structured(plain[1]), tuple(plain[2])))
    _, names, formats, offsets, size = plain
    return {"names": names, "formats": [_structured(one) for one in formats], "offsets": offsets, "itemsize": size}
