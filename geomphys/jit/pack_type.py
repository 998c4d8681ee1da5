"""Packed records as numba sees them: a pointer to a block of words, one for a number or an address, and the shape of an array."""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.typing.templates import AttributeTemplate  # what `infer_getattr` takes; it has no public name
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model

WORD = 8

_sizes: dict[types.Type, int] = {}
"""Bytes of the elements of arrays."""


class PackType(types.Type):
    """Type of a pack: the names and types of its fields, in order."""

    def __init__(self, fields: tuple[tuple[str, types.Type], ...]) -> None:
        self.fields = fields
        text = ", ".join(f"{name}: {kind}" for name, kind in fields)
        super().__init__(name=f"Pack({hashlib.sha256(text.encode()).hexdigest()[:16]})")

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


@register_model(PackType)
class _PackModel(models.PrimitiveModel):  # type: ignore[misc]
    """A pointer to the block."""

    def __init__(self, manager: Any, kind: PackType) -> None:
        super().__init__(manager, kind, ir.IntType(8).as_pointer())


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


def _tuple_of(builder: Any, values: list[Any]) -> Any:
    """Numbers as an LLVM array."""
    packed = ir.Constant(ir.ArrayType(ir.IntType(64), len(values)), ir.Undefined)
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
    shape = [_load(builder, block, offset + WORD * (1 + axis)) for axis in range(field.ndim)]
    strides: list[Any] = []
    stride = ir.Constant(ir.IntType(64), _itemsize(context, field))
    for extent in reversed(shape):
        strides.insert(0, stride)
        stride = builder.mul(stride, extent)
    return make_array(context, builder, field, address, shape, strides)


def make_array(context: Any, builder: Any, kind: Any, address: Any, shape: list[Any], strides: list[Any]) -> Any:
    """An array of a type whose memory belongs to somebody else."""
    model, form = context.data_model_manager[kind], context.get_value_type(kind)
    count = shape[0] if shape else ir.Constant(ir.IntType(64), 1)
    for extent in shape[1:]:
        count = builder.mul(count, extent)
    array = ir.Constant(form, None)  # nobody's: without `meminfo` and `parent`
    for name, value in (
        ("nitems", count),
        ("itemsize", ir.Constant(ir.IntType(64), _itemsize(context, kind))),
        ("data", builder.inttoptr(address, form.elements[model.get_field_position("data")])),
        ("shape", _tuple_of(builder, shape)),
        ("strides", _tuple_of(builder, strides)),
    ):
        array = builder.insert_value(array, value, model.get_field_position(name))
    return array


def _itemsize(context: Any, kind: Any) -> int:
    size = _sizes.get(kind.dtype)
    if size is None:  # LLVM parses a module for that
        size = _sizes[kind.dtype] = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    return size
