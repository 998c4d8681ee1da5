"""Copies a record of a structured type, in kernels at once: numba's assignment takes it byte by byte."""

from __future__ import annotations

from geomphys.jit.packed_records import Record


def copy_record(target: Record, source: Record) -> None:
    """Copy all fields of a record to another of the same structured type; for kernels, and from Python.

    ``array[k] = record`` does the same, but hands LLVM the record as an array of bytes, hundreds for a pair of bodies:
    it is slower, and the copies of a module of six such assignments took LLVM four seconds.
    """
    for name in source.dtype.names:
        target[name] = source[name]
