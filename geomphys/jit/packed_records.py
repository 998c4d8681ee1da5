"""Records of many arrays, handed to compiled kernels as one pointer.

A kernel that takes a NamedTuple of arrays takes seven machine words for each array, in every call and at every
attribute: with the hundred arrays of a scene that is minutes of compile time and tens of microseconds a call.
`pack` lays the addresses and shapes of the arrays of a (nested) NamedTuple out in one block of memory; kernels see
the same attributes and pay one load for each, see `geomphys.jit.pack_type`. The arrays are shared, not copied, and
must not be replaced or freed while the pack is in use: it keeps them alive itself. Besides arrays there are numbers,
which never change, and records: an array of a structured type without dimensions, of which a kernel reads and sets the
attributes.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from geomphys.jit.kinds import Kind, PackKind, kind_of, kind_of_dtype

Record = Any
"""A field that is one record of a structured type: ``array["name"]`` in Python, ``record.name`` in kernels."""


class Pack:
    """A NamedTuple of arrays and packs, and the block of memory that describes it; attributes are those of the tuple."""

    def __init__(self, record: Any) -> None:
        self.record = record
        self.parts = [pack(value) if isinstance(value, tuple) else value for value in record]
        words: list[int] = []
        fields: list[tuple[str, Kind]] = []
        for name, part in zip(record._fields, self.parts, strict=True):
            if isinstance(part, Pack):
                words.append(part.address)
            elif isinstance(part, np.ndarray) and part.flags.c_contiguous and part.flags.writeable:
                words += [part.ctypes.data, *part.shape]
            elif isinstance(part, float):
                words.append(int(np.array(part).view(np.int64)))
            elif isinstance(part, int):
                words.append(int(part))
            else:
                raise TypeError(
                    f"{type(record).__name__}.{name}: a C-contiguous, writeable array or a number is needed"
                )
            fields.append((name, _kind_of_field(part)))
        self.block = np.array(words, dtype=np.int64)
        self.address: int = int(self.block.ctypes.data)
        self.kind: Kind = _same(PackKind(("pack", *fields)))

    def __getattr__(self, name: str) -> Any:
        """A field as Python sees it: the array, or the inner pack."""
        record = self.__dict__["record"]
        if name in record._fields:
            return self.parts[record._fields.index(name)]
        raise AttributeError(name)


def _kind_of_field(part: Any) -> Kind:
    """What kernels take a field for."""
    if isinstance(part, np.ndarray) and part.ndim == 0 and part.dtype.names is not None:
        return kind_of_dtype(part.dtype)
    return kind_of(part)


_KINDS: dict[Kind, Kind] = {}


def _same(kind: Kind) -> Kind:
    """One object for all that are equal: quicker to compare."""
    return _KINDS.setdefault(kind, kind)


def pack(record: Any) -> Any:
    """A pack of a NamedTuple of C-contiguous arrays, numbers and inner NamedTuples."""
    return record if isinstance(record, Pack) else Pack(record)
