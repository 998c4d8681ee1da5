"""Records of many arrays, handed to compiled kernels as one pointer.

A kernel that takes a NamedTuple of arrays takes seven machine words for each array, in every call and at every
attribute: with the hundred arrays of a scene that is minutes of compile time and tens of microseconds a call.
`pack` lays the addresses and shapes of the arrays of a (nested) NamedTuple out in one block of memory; kernels see
the same attributes and pay one load for each. The arrays are shared, not copied, and must not be replaced or freed
while the pack is in use: it keeps them alive itself. Besides arrays there are numbers, which never change, and records: an array
of a structured type without dimensions, of which a kernel reads and sets the attributes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import from_dtype, typeof, types
from numba.core.typing.templates import AttributeTemplate  # what `infer_getattr` takes; it has no public name
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

WORD = 8

Record = Any
"""A field that is one record of a structured type: ``array["name"]`` in Python, ``record.name`` in kernels."""


class PackType(types.Type):
    """Type of a pack: the names and types of its fields, in order."""

    def __init__(self, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.fields = fields
        super().__init__(name=f"Pack({', '.join(f'{name}: {kind}' for name, kind in fields)})")

    @property
    def key(self) -> str:
        """What tells two pack types apart: quicker to compare than the fields, which have types of their own."""
        name: str = self.name
        return name

    def locate(self, name: str) -> tuple[int, types.Type]:
        """Byte offset of a field in the block, and its type."""
        offset = 0
        for field, kind in self.fields:
            if field == name:
                return offset, kind
            offset += WORD * words_of(kind)
        raise AttributeError(name)


def words_of(kind: types.Type) -> int:
    """Machine words a field takes: a number or an address, and for an array its shape."""
    return 1 + (kind.ndim if isinstance(kind, types.Array) else 0)


class Pack:
    """A NamedTuple of arrays and packs, and the block of memory that describes it; attributes are those of the tuple."""

    def __init__(self, record: Any) -> None:
        self.record = record
        self.parts = [pack(value) if isinstance(value, tuple) else value for value in record]
        words: list[int] = []
        fields: list[tuple[str, types.Type]] = []
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
            fields.append((name, _type_of_field(part)))
        self.block = np.array(words, dtype=np.int64)
        self.address: int = int(self.block.ctypes.data)
        self.type: PackType = _type_of(tuple(fields))

    def __getattr__(self, name: str) -> Any:
        """A field as Python sees it: the array, or the inner pack."""
        record = self.__dict__["record"]
        if name in record._fields:
            return self.parts[record._fields.index(name)]
        raise AttributeError(name)


def _type_of_field(part: Any) -> Any:
    """What kernels take a field for."""
    if isinstance(part, Pack):
        return part.type
    if isinstance(part, np.ndarray) and part.ndim == 0 and part.dtype.names is not None:
        return from_dtype(part.dtype)
    return typeof(part)


_TYPES: dict[tuple[tuple[str, types.Type], ...], PackType] = {}


def _type_of(fields: tuple[tuple[str, types.Type], ...]) -> PackType:
    return _TYPES.setdefault(fields, PackType(fields))


def pack(record: Any) -> Any:
    """A pack of a NamedTuple of C-contiguous arrays, numbers and inner NamedTuples."""
    return record if isinstance(record, Pack) else Pack(record)


@typeof_impl.register(Pack)
def _typeof_pack(value: Pack, context: Any) -> PackType:
    return value.type


@register_model(PackType)
class _PackModel(models.PrimitiveModel):  # type: ignore[misc]
    """A pointer to the block."""

    def __init__(self, manager: Any, kind: PackType) -> None:
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


@unbox(PackType)
def _unbox_pack(kind: PackType, value: Any, context: Any) -> NativeValue:
    number = context.pyapi.object_getattr_string(value, "address")
    address = context.pyapi.long_as_longlong(number)
    context.pyapi.decref(number)
    pointer = context.builder.inttoptr(address, ir.IntType(8).as_pointer())
    error = context.pyapi.err_occurred()
    return NativeValue(pointer, is_error=context.builder.icmp_unsigned("!=", error, ir.Constant(error.type, None)))


@infer_getattr
class _PackAttributes(AttributeTemplate):  # type: ignore[misc]
    key = PackType

    def generic_resolve(self, kind: PackType, name: str) -> types.Type | None:
        """Type of a field."""
        return dict(kind.fields).get(name)


def _load(builder: Any, block: Any, offset: int) -> Any:
    """A word of the block. It never changes, so LLVM may load it once."""
    word = ir.IntType(64)
    address_of_field = builder.bitcast(builder.gep(block, [ir.Constant(word, offset)]), word.as_pointer())
    value = builder.load(address_of_field)
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


def _tuple_of(builder: Any, values: list[Any], kind: Any) -> Any:
    """The values as an LLVM array of a type."""
    packed = ir.Constant(kind, ir.Undefined)
    for position, value in enumerate(values):
        packed = builder.insert_value(packed, value, position)
    return packed


@lower_getattr_generic(PackType)
def _lower_attribute(context: Any, builder: Any, kind: PackType, block: Any, name: str) -> Any:
    offset, field = kind.locate(name)
    address = _load(builder, block, offset)
    if isinstance(field, PackType):
        return builder.inttoptr(address, ir.IntType(8).as_pointer())
    if isinstance(field, types.Record):
        return builder.inttoptr(address, context.get_value_type(field))
    if isinstance(field, types.Float):
        return builder.bitcast(address, ir.DoubleType())
    if isinstance(field, types.Boolean):
        return builder.trunc(address, context.get_value_type(field))
    if isinstance(field, types.Integer):
        return address
    array = context.make_array(field)(context, builder)
    shape = [_load(builder, block, offset + WORD * (1 + axis)) for axis in range(field.ndim)]
    itemsize = context.get_abi_sizeof(context.get_data_type(field.dtype))
    strides: list[Any] = []
    stride = ir.Constant(ir.IntType(64), itemsize)
    for extent in reversed(shape):
        strides.insert(0, stride)
        stride = builder.mul(stride, extent)
    array.data = builder.inttoptr(address, array.data.type)
    array.shape = _tuple_of(builder, shape, array.shape.type)
    array.strides = _tuple_of(builder, strides, array.strides.type)
    array.itemsize = ir.Constant(ir.IntType(64), itemsize)
    count = ir.Constant(ir.IntType(64), 1)
    for extent in shape:
        count = builder.mul(count, extent)
    array.nitems = count
    array.meminfo = ir.Constant(array.meminfo.type, None)
    array.parent = ir.Constant(array.parent.type, None)
    return array._getvalue()
