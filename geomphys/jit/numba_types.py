"""Types of numba from kinds, and back: those that kernels take, and no others."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import from_dtype, types

from geomphys.jit.kinds import PLAIN, Kind, dtype_of, named_tuple, plain_dtype
from geomphys.jit.pack_type import PackType

_BY_TYPE = {getattr(types, name): name for name in PLAIN}


@lru_cache(maxsize=4096)
def kind_of_type(kind: Any) -> Kind:
    """The kind of a type; raises TypeError for one that no kernel takes."""
    if kind in _BY_TYPE:
        return _BY_TYPE[kind]
    if isinstance(kind, PackType):
        return ("pack", *((name, kind_of_type(field)) for name, field in kind.fields))
    if isinstance(kind, types.Record):
        return ("record", plain_dtype(kind.dtype), kind.aligned)
    if type(kind) is types.Array:
        return ("array", kind_of_type(kind.dtype), kind.ndim, kind.layout, not kind.mutable, kind.aligned)
    if isinstance(kind, types.BaseNamedTuple):
        owner = kind.instance_class
        return ("named", owner.__module__, owner.__qualname__, *map(kind_of_type, kind.types))
    if isinstance(kind, types.BaseTuple):
        return ("tuple", *map(kind_of_type, kind.types))
    raise TypeError(f"{kind} is a type that kernels do not take")


@lru_cache(maxsize=4096)
def type_of_kind(kind: Kind) -> Any:
    """The type of a kind; raises LookupError, TypeError or ValueError for what is none."""
    if isinstance(kind, str):
        if kind not in PLAIN:
            raise ValueError(f"{kind!r} is no type of a kernel")
        return getattr(types, kind)
    tag, *parts = kind
    if tag == "pack":
        return PackType(tuple((name, type_of_kind(field)) for name, field in parts))
    if tag == "record":
        return from_dtype(np.dtype(dtype_of(parts[0]), align=bool(parts[1])))
    if tag == "array":
        dtype, ndim, layout, readonly, aligned = parts
        return types.Array(type_of_kind(dtype), ndim, layout, readonly=readonly, aligned=aligned)
    if tag == "named":
        return types.BaseTuple.from_types([type_of_kind(part) for part in parts[2:]], named_tuple(*parts[:2]))
    if tag == "tuple":
        return types.BaseTuple.from_types([type_of_kind(part) for part in parts])
    raise ValueError(f"{tag!r} is no type of a kernel")
