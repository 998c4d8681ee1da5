"""Decodes FlatBuffers messages by their binary schema (``.bfbs``, reflection.fbs).

The `flatbuffers` package has generated code for known types only, so the description is read here with its `Table`, and
what a message holds becomes dictionaries, as of JSON: a table's or struct's fields by name; None for a table, struct,
list or optional number that is not there. The bytes are untrusted: offsets are checked, and a message
yields at most `VALUE_LIMIT` values, since tables may be shared, so that a few bytes can claim to hold any number.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from flatbuffers import number_types as nt
from flatbuffers.table import Table

VALUE_LIMIT = 200_000
"""Values of a message, and numbers of a struct."""
DEPTH_LIMIT = 32
"""Tables within tables."""
SCHEMA_LIMIT = 20_000
"""Types and fields of a schema."""
_STRING, _VECTOR, _OBJECT, _ARRAY = 13, 14, 15, 17
_FORMATS = {1: "B", 2: "?", 3: "b", 4: "B", 5: "h", 6: "H", 7: "i", 8: "I", 9: "q", 10: "Q", 11: "f", 12: "d"}
"""Number of a base type -> how `struct` writes it."""


class FlatBufferError(Exception):
    """A schema or message that cannot be read, with the reason. Internal to the package."""


class Type(NamedTuple):
    """Type of a field: a base type, that of a list's elements, and which object it is of."""

    base: int
    element: int
    object: int
    length: int  # of an array in a struct


class Field(NamedTuple):
    """A field of a table or struct."""

    name: str
    type: Type
    offset: int  # in the vtable, or in the struct
    default: Any  # of a number; None if it is optional


@dataclass(frozen=True)
class Object:
    """A table or a struct."""

    name: str
    fields: tuple[Field, ...]
    is_struct: bool
    size: int  # bytes of a struct


class _View:
    """A table in some bytes, by the numbers of its fields."""

    def __init__(self, data: bytes, at: int) -> None:
        if not 0 <= at <= len(data) - 4:
            raise FlatBufferError("an offset leads out of it")
        self.data, self.at = data, at
        self.table = Table(data, at)
        vtable = at - self.table.Get(nt.SOffsetTFlags, at)
        if not 0 <= vtable <= len(data) - 4:
            raise FlatBufferError("an offset leads out of it")

    def slot(self, offset: int) -> int:
        """Position of the field at `offset` of the vtable; 0 without it."""
        found = self.table.Offset(offset)
        return self.at + found if found else 0

    def number(self, number: int, code: str, default: Any) -> Any:
        """A number of the schema's own description."""
        at = self.slot(4 + 2 * number)
        return struct.unpack_from("<" + code, self.data, at)[0] if at else default

    def follow(self, at: int) -> int:
        """Where the offset at a position leads to."""
        return at + int(struct.unpack_from("<I", self.data, at)[0])

    def text(self, number: int) -> str:
        """A text of the schema's own description."""
        at = self.slot(4 + 2 * number)
        return _text(self.data, self.follow(at)) if at else ""

    def child(self, number: int) -> _View | None:
        """A table of the schema's own description."""
        at = self.slot(4 + 2 * number)
        return _View(self.data, self.follow(at)) if at else None

    def children(self, number: int) -> Iterator[_View]:
        """Tables of a list of the schema's own description."""
        at = self.slot(4 + 2 * number)
        if at:
            start, count = _list(self.data, self.follow(at), 4)
            for position in range(start, start + 4 * count, 4):
                yield _View(self.data, self.follow(position))


def _text(data: bytes, at: int) -> str:
    start, count = _list(data, at, 1)
    return bytes(data[start : start + count]).decode()


def _list(data: bytes, at: int, size: int) -> tuple[int, int]:
    """Where the elements of a list of elements of `size` bytes begin, and how many they are."""
    if not 0 <= at <= len(data) - 4:
        raise FlatBufferError("an offset leads out of it")
    count = int(struct.unpack_from("<I", data, at)[0])
    if size * count > len(data) - at - 4:
        raise FlatBufferError("a list is longer than what is left")
    return at + 4, count


def read_schema(data: bytes) -> tuple[dict[str, int], list[Object]]:
    """Types of a ``.bfbs`` schema: number by name, and all of them. Raises FlatBufferError."""
    if len(data) < 8 or data[4:8] != b"BFBS":
        raise FlatBufferError("it is no compiled FlatBuffers schema")
    try:
        root, objects, field_count = _View(data, int.from_bytes(data[:4], "little")), [], 0
        for view in root.children(0):
            fields = []
            for f in view.children(1):
                field_type = f.child(1)
                if field_type is not None and not f.number(6, "?", False):
                    fields.append(_field(f, field_type))
                field_count += 1
                if field_count > SCHEMA_LIMIT:
                    raise FlatBufferError(f"it has more than {SCHEMA_LIMIT} fields")
            objects.append(Object(view.text(0), tuple(fields), view.number(2, "?", False), view.number(4, "i", 0)))
            field_count += 1
    except (struct.error, ValueError, IndexError, OverflowError) as problem:
        raise FlatBufferError("it cannot be read to its end") from problem
    return {o.name: i for i, o in enumerate(objects)}, objects


def _field(view: _View, field_type: _View) -> Field:
    base = field_type.number(0, "b", 0)
    real = base in (11, 12)
    default = view.number(5, "d", 0.0) if real else view.number(4, "q", 0)
    if base == 2:
        default = bool(default)
    optional = view.number(11, "?", False)
    what = Type(base, field_type.number(1, "b", 0), field_type.number(2, "i", -1), field_type.number(3, "H", 0))
    return Field(view.text(0), what, view.number(3, "H", 0), None if optional else default)


class _Struct:
    """Decoder of a struct: numbers at fixed offsets, assembled into dictionaries."""

    def __init__(self, objects: list[Object], index: int) -> None:
        self.size = _object_at(objects, index).size
        leaves: list[tuple[int, str]] = []
        self._build = _assemble(objects, index, 0, leaves, 0)
        layout, at = "<", 0
        for offset, code in leaves:
            if offset < at:
                raise FlatBufferError("a struct's fields overlap")
            layout += f"{offset - at}x{code}"
            at = offset + struct.calcsize("<" + code)
        if not 0 < at <= self.size <= 8 * VALUE_LIMIT:
            raise FlatBufferError("a struct is smaller than its fields")
        self._numbers = struct.Struct(layout)
        self.values = len(leaves)

    def read(self, data: bytes, at: int) -> Any:
        """The struct at a position."""
        if at < 0:
            raise FlatBufferError("an offset leads out of it")
        return self._build(iter(self._numbers.unpack_from(data, at)))


Build = Callable[[Iterator[Any]], Any]


def _assemble(objects: list[Object], index: int, at: int, leaves: list[tuple[int, str]], depth: int) -> Build:
    """Append the numbers of a struct at byte `at` to `leaves`; returns the function that assembles it from them."""
    if depth > DEPTH_LIMIT:
        raise FlatBufferError("a struct holds itself")
    parts: list[tuple[str, Build]] = []
    for f in sorted(_object_at(objects, index).fields, key=lambda f: f.offset):
        base, offset = f.type.base, at + f.offset
        count = f.type.length if base == _ARRAY else 1
        field_type = f.type.element if base == _ARRAY else base
        size = (
            _object_at(objects, f.type.object).size
            if field_type == _OBJECT
            else struct.calcsize("<" + _code(field_type))
        )
        builds: list[Build] = []
        for i in range(count):
            if len(leaves) > VALUE_LIMIT:
                raise FlatBufferError("a struct has too many numbers")
            if field_type == _OBJECT:
                builds.append(_assemble(objects, f.type.object, offset + i * size, leaves, depth + 1))
            else:
                leaves.append((offset + i * size, _code(field_type)))
                builds.append(next)
        parts.append((f.name, _listed(builds) if base == _ARRAY else builds[0]))
    return lambda numbers: {name: build(numbers) for name, build in parts}


def _listed(builds: list[Build]) -> Build:
    return lambda numbers: [build(numbers) for build in builds]


def _code(base: int) -> str:
    if base not in _FORMATS:
        raise FlatBufferError("a struct has a field that is no number")
    return _FORMATS[base]


def _object_at(objects: list[Object], index: int) -> Object:
    if not 0 <= index < len(objects):
        raise FlatBufferError("it speaks of a type that it does not have")
    return objects[index]


@dataclass
class FlatBufferDecoder:
    """Messages of one root table of a schema; called with bytes it returns the table as a dictionary."""

    objects: list[Object]
    root: int
    structs: dict[int, _Struct] = field(default_factory=dict)
    values_left: int = 0  # values that the message may still have

    def __post_init__(self) -> None:
        """Look at every type that a message can have."""
        pending, field_count = [self.root], {self.root}
        while pending:
            index = pending.pop()
            found = _object_at(self.objects, index)
            if found.is_struct:
                self.structs[index] = _Struct(self.objects, index)
                continue
            for f in found.fields:
                if (f.type.base == _OBJECT or f.type.element == _OBJECT) and f.type.object not in field_count:
                    field_count.add(f.type.object)
                    pending.append(f.type.object)

    def __call__(self, data: bytes) -> dict[str, Any]:
        """Decode a message. Raises FlatBufferError, or struct.error or ValueError on bytes that hold none."""
        self.values_left = VALUE_LIMIT
        if len(data) < 8:
            raise FlatBufferError("it is too short")
        return self._table(data, int.from_bytes(data[:4], "little"), self.root, 0)

    def _count(self, values: int) -> None:
        self.values_left -= values
        if self.values_left < 0:
            raise FlatBufferError(f"it has more than {VALUE_LIMIT} values")

    def _table(self, data: bytes, at: int, index: int, depth: int) -> dict[str, Any]:
        if depth > DEPTH_LIMIT:
            raise FlatBufferError("it has tables within tables without end")
        view = _View(data, at)
        fields = self.objects[index].fields
        self._count(1 + len(fields))
        return {f.name: self._value(view, f, depth) for f in fields}

    def _value(self, view: _View, f: Field, depth: int) -> Any:
        at, base = view.slot(f.offset), f.type.base
        if base in _FORMATS:
            return struct.unpack_from("<" + _FORMATS[base], view.data, at)[0] if at else f.default
        if not at:
            return None
        if base == _OBJECT:
            if f.type.object in self.structs:
                return self._struct(view.data, at, f.type.object)
            return self._table(view.data, view.follow(at), f.type.object, depth + 1)
        if base == _STRING:
            return _text(view.data, view.follow(at))
        return self._list(view.data, view.follow(at), f.type, depth) if base == _VECTOR else None

    def _struct(self, data: bytes, at: int, index: int) -> Any:
        found = self.structs[index]
        self._count(found.values)
        return found.read(data, at)

    def _list(self, data: bytes, at: int, field_type: Type, depth: int) -> Any:
        if field_type.element in _FORMATS:
            code = _FORMATS[field_type.element]
            start, count = _list(data, at, struct.calcsize("<" + code))
            self._count(count)
            return list(struct.unpack_from(f"<{count}{code}", data, start))
        if field_type.element == _OBJECT and field_type.object in self.structs:
            size = self.structs[field_type.object].size
            start, count = _list(data, at, size)
            return [self._struct(data, start + i * size, field_type.object) for i in range(count)]
        if field_type.element not in (_OBJECT, _STRING):
            return None  # a list of unions: of no use here
        start, count = _list(data, at, 4)
        self._count(count)
        positions = [p + int(struct.unpack_from("<I", data, p)[0]) for p in range(start, start + 4 * count, 4)]
        if field_type.element == _STRING:
            return [_text(data, p) for p in positions]
        return [self._table(data, p, field_type.object, depth + 1) for p in positions]


def make_flatbuffer_decoder(name: str, schema: bytes) -> FlatBufferDecoder:
    """Decoder of messages whose root table is `name`, by a ``.bfbs`` schema. Raises FlatBufferError."""
    numbers, objects = read_schema(schema)
    if name not in numbers or objects[numbers[name]].is_struct:
        raise FlatBufferError("its schema does not have the table")
    return FlatBufferDecoder(objects, numbers[name])
