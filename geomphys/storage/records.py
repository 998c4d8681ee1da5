"""Bytes of plain values, arrays and records, and back: reading them runs no code.

A head of JSON says how the values are put together, numbers of arrays follow as they lie in memory. Records (named
tuples and dataclasses) are made again from the classes that the reader names, and from no others.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path, PosixPath
from typing import Any

import numpy as np

_HEAD_BYTES = 8
_ALIGNMENT = 16
_KINDS = "biufS"
"""Kinds of numpy's types that are stored: numbers and byte strings; never objects."""


class RecordError(ValueError):
    """Bytes that are no record, or a value that is stored in none."""


def encode(value: Any) -> bytes:
    """Bytes of a value: None, bool, int, float, str, bytes, paths, tuples, lists, dicts, arrays, and records of them.

    Raises RecordError for anything else.
    """
    blobs = _Blobs()
    head = json.dumps(_plain(value, blobs), separators=(",", ":")).encode()
    head += b" " * (-(len(head) + _HEAD_BYTES) % _ALIGNMENT)
    return b"".join([len(head).to_bytes(_HEAD_BYTES, "little"), head, *blobs.parts])


def decode(data: bytes, classes: Iterable[type] = ()) -> Any:
    """The value that `encode` was given; arrays are copies and can be written to. Raises RecordError."""
    try:
        size = int.from_bytes(data[:_HEAD_BYTES], "little")
        head = json.loads(data[_HEAD_BYTES : _HEAD_BYTES + size])
        known = {kind.__qualname__: kind for kind in classes}
        return _value(head, memoryview(data)[_HEAD_BYTES + size :], known, {})
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError, OverflowError) as problem:
        raise RecordError(f"no record: {problem}") from problem


class _Blobs:
    """Bytes behind the head; an array that occurs twice is stored once, and is one array again when it is read."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self._size = 0
        self._starts: dict[int, int] = {}

    def add(self, data: bytes) -> int:
        """Append bytes, aligned; returns where they begin."""
        start = self._size
        self.parts.append(data + b"\0" * (-len(data) % _ALIGNMENT))
        self._size += len(self.parts[-1])
        return start

    def add_array(self, array: np.ndarray) -> int:
        """Append an array's numbers, unless they are there; returns where they begin."""
        if id(array) not in self._starts:
            self._starts[id(array)] = self.add(array.tobytes())
        return self._starts[id(array)]


def _plain(value: Any, blobs: _Blobs) -> Any:
    if value is None or isinstance(value, bool | str):
        return value
    kind = type(value)
    if kind is int:
        return value
    if kind is float:
        return {"f": value.hex()}
    if kind is bytes:
        return {"b": [blobs.add(value), len(value)]}
    if kind is np.ndarray:
        if value.dtype.kind not in _KINDS:
            raise RecordError(f"an array of {value.dtype} is not stored")
        return {"a": [value.dtype.str, list(value.shape), blobs.add_array(value)]}
    if isinstance(value, np.generic) and value.dtype.kind in _KINDS:
        return {"n": [value.dtype.str, blobs.add(value.tobytes())]}
    if kind is PosixPath:
        return {"p": str(value)}
    if kind is tuple or kind is list:
        return {kind.__name__[0]: [_plain(item, blobs) for item in value]}
    if kind is dict:
        return {"d": [[_plain(key, blobs), _plain(item, blobs)] for key, item in value.items()]}
    if hasattr(kind, "_fields"):
        fields = dict(zip(kind._fields, value, strict=True))
    elif dataclasses.is_dataclass(value):
        fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    else:
        raise RecordError(f"a {kind.__name__} is not stored")
    return {"r": [kind.__qualname__, {name: _plain(item, blobs) for name, item in fields.items()}]}


def _value(head: Any, blobs: memoryview, classes: Mapping[str, type], arrays: dict[Any, Any]) -> Any:
    if not isinstance(head, dict):
        return head
    ((tag, content),) = head.items()
    if tag == "f":
        return float.fromhex(content)
    if tag == "b":
        start, size = content
        return bytes(_cut(blobs, start, size))
    if tag == "a":
        kind, shape, start = _dtype(content[0]), tuple(content[1]), content[2]
        key = (start, kind, shape)  # an empty array begins where the next one does
        if key not in arrays:
            size = kind.itemsize * int(np.prod(shape, dtype=np.int64))
            arrays[key] = np.frombuffer(_cut(blobs, start, size), kind).reshape(shape).copy()
        return arrays[key]
    if tag == "n":
        kind = _dtype(content[0])
        return np.frombuffer(_cut(blobs, content[1], kind.itemsize), kind)[0]
    if tag == "p":
        return Path(content)
    if tag in ("t", "l"):
        items = (_value(item, blobs, classes, arrays) for item in content)
        return tuple(items) if tag == "t" else list(items)
    if tag == "d":
        return {_value(key, blobs, classes, arrays): _value(item, blobs, classes, arrays) for key, item in content}
    if tag == "r":
        return classes[content[0]](**{name: _value(item, blobs, classes, arrays) for name, item in content[1].items()})
    raise RecordError(f"unknown kind of value {tag!r}")


def _dtype(text: str) -> np.dtype[Any]:
    kind = np.dtype(text)
    if kind.kind not in _KINDS:
        raise RecordError(f"an array of {text} is not stored")
    return kind


def _cut(blobs: memoryview, start: int, size: int) -> memoryview:
    if start < 0 or size < 0 or start + size > len(blobs):
        raise RecordError("cut off")
    return blobs[start : start + size]
