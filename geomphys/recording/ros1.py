"""Decodes ROS 1 messages with ``mcap-ros1-support``, from definitions that are parsed and checked first.

That library writes Python source from a message definition and runs it. So none of a log's text reaches it: a definition
is parsed here, and what it gets is written anew from names and types that are checked, without constants, comments and
defaults. The same check refuses what could make a short message take all memory or time: elements that take no bytes,
huge arrays of fixed size, types that hold each other.
"""

from __future__ import annotations

import importlib
import keyword
import re
import sys
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from mcap.records import Schema

from geomphys.recording.ros_definitions import ROS1_HEADER, joined

FIELD_LIMIT = 1_000
"""Numbers and texts of a message, without those of its lists."""
TYPE_LIMIT = 64
"""Types of a definition that are in use: the library's time grows with their square."""
LIST_LIMIT = 8
"""Lists within lists: the library writes a loop for each, and Python nests at most 20."""
_SIZES = {
    "bool": 1, "int8": 1, "uint8": 1, "byte": 1, "char": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4,
    "float32": 4, "int64": 8, "uint64": 8, "float64": 8, "time": 8, "duration": 8, "string": 4,
}  # fmt: skip
_BYTES = {"uint8", "char"}
"""Fixed arrays of these are sliced out of a message without a bounds check."""
_FIELD = re.compile(r"([A-Za-z]\w*(?:/[A-Za-z]\w*)?)(\[\d{0,5}\])?\s+([A-Za-z]\w*)(?=\s|=|$)\s*(=?)", re.ASCII)
_TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)
_SEPARATOR = re.compile(r"^=+[ \t]*$", re.MULTILINE)
_RESERVED_NAMES = {"serialize", "deserialize", "serialize_numpy", "deserialize_numpy", "self", "struct", "genpy"}
"""Names that the library needs itself."""


class DefinitionError(Exception):
    """A message definition that cannot be used, with the reason. Internal to the package."""


class Field(NamedTuple):
    """A field of a ROS 1 message."""

    type: str
    array: str  # "", "[]" or "[N]"
    name: str

    @property
    def elements(self) -> int:
        """Elements of an array of fixed size; 1 of anything else."""
        return int(self.array[1:-1]) if len(self.array) > 2 else 1


def parse_definition(root: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Types of a concatenated definition and their fields. Raises DefinitionError."""
    types: dict[str, tuple[Field, ...]] = {"std_msgs/Header": _fields("std_msgs/Header", ROS1_HEADER)}
    for number, part in enumerate(_SEPARATOR.split(text)):
        name, body = root, part
        if number:
            head, _, body = part.strip().partition("\n")
            name = head.removeprefix("MSG:").strip()
            if not head.startswith("MSG:"):
                raise DefinitionError("a part of it does not begin with MSG:")
        if _TYPE.fullmatch(name) is None:
            raise DefinitionError("it names a type that is none")
        types[name.replace("roslib/Header", "std_msgs/Header")] = _fields(name, body)
    _check(types, root)
    return types


def _fields(owner: str, body: str) -> tuple[Field, ...]:
    found = []
    for line in body.splitlines():
        printable = line.partition("#")[0].strip()
        if not printable:
            continue
        match = _FIELD.match(printable)
        if match is None:
            raise DefinitionError("it has a line that is no field")
        kind, array, name, constant = match.groups()
        if constant:
            continue
        if keyword.iskeyword(name) or name.startswith("_") or name in _RESERVED_NAMES:
            raise DefinitionError(f"it has a field named {name}")
        if kind in ("Header", "roslib/Header"):
            kind = "std_msgs/Header"
        elif "/" not in kind and kind not in _SIZES:
            kind = f"{owner.partition('/')[0]}/{kind}"
        found.append(Field(kind, array or "", name))
    if len({f.name for f in found}) < len(found):
        raise DefinitionError("it has two fields of one name")
    return tuple(found)


def _check(types: Mapping[str, tuple[Field, ...]], root: str) -> None:
    """Refuse types with which a short message could exhaust memory or time."""
    known: dict[str, tuple[int, int, int]] = {}  # least bytes that are checked when it is read, fields, lists in lists

    def measure(name: str, ancestors: tuple[str, ...]) -> tuple[int, int, int]:
        if name in _SIZES:
            return _SIZES[name], 1, 0
        if name in ancestors or len(ancestors) > 32:
            raise DefinitionError("it has types that hold each other")
        if name not in types:
            raise DefinitionError(f"it lacks the type {name[:80]}")
        if name not in known:
            size = fields = lists = 0
            for field in types[name]:
                least, count, inner = measure(field.type, (*ancestors, name))
                lists = max(lists, inner + (bool(field.array) and field.type not in _SIZES))
                if field.array == "[]":
                    if least == 0:
                        raise DefinitionError("it has lists of elements that take no bytes")
                    size, fields = size + 4, fields + 1
                    continue
                fixed_bytes = bool(field.array) and field.type in _BYTES
                size += 0 if fixed_bytes else least * field.elements
                fields += 1 if fixed_bytes else count * field.elements
            if fields > FIELD_LIMIT:
                raise DefinitionError(f"a message of it has more than {FIELD_LIMIT} fields")
            if lists > LIST_LIMIT:
                raise DefinitionError(f"it has lists in one another more than {LIST_LIMIT} deep")
            known[name] = size, fields, lists
            if len(known) > TYPE_LIMIT or sum(len(types[used]) for used in known) > FIELD_LIMIT:
                raise DefinitionError(f"it has more than {TYPE_LIMIT} types or {FIELD_LIMIT} fields")
        return known[name]

    measure(root, ())


def make_ros1_decoder(name: str, definition: str) -> tuple[Callable[[bytes], Any], type[Exception]]:
    """Decoder of a ROS 1 type, and the exception it raises on too few bytes.

    Parameters
    ----------
    name : str
        ``package/Type``.
    definition : str
        The type's definition and those of the types in it, as a ``ros1msg`` schema has them.

    Raises
    ------
    DefinitionError
        It cannot be read, or no temporary folder can be written to.
    """
    types = parse_definition(name, definition)
    lines = {n: "\n".join(f"{f.type}{f.array} {f.name}" for f in fields) for n, fields in types.items()}
    return _generate(name, joined(lines, name))


@lru_cache(maxsize=1024)
def _generate(name: str, definition: str) -> tuple[Callable[[bytes], Any], type[Exception]]:
    """Run the library on a definition that was checked; it leaves a folder on the module path, which is taken off."""
    path = list(sys.path)
    try:
        from mcap_ros1 import decoder

        schema = Schema(id=1, name=name, encoding="ros1msg", data=definition.encode())
        decode = decoder.DecoderFactory().decoder_for("ros1", schema)
        genpy = importlib.import_module(decoder.dynamic.__package__)  # type: ignore[attr-defined]
        too_short_error: type[Exception] = genpy.DeserializationError
    except OSError as problem:
        raise DefinitionError(f"its library needs a temporary folder: {problem.strerror}") from problem
    finally:
        sys.path[:] = path
    if decode is None:
        raise DefinitionError("its library does not take it")
    return decode, too_short_error
