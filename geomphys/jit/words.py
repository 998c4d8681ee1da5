"""Arguments and results of kernels as words of 64 bits in memory, for LLVM: see `geomphys.jit.calls`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from llvmlite import ir
from numba import types

from geomphys.jit.pack_type import PackType, make_array

WORD = ir.IntType(64)
DOUBLE = ir.DoubleType()


def load_value(context: Any, builder: Any, kind: Any, words: Any, position: int) -> tuple[Any, int]:
    """A value of a type from the words from `position` on, and the position behind it."""
    if isinstance(kind, types.BaseTuple):
        items = []
        for part in kind.types:
            item, position = load_value(context, builder, part, words, position)
            items.append(item)
        return context.make_tuple(builder, kind, items), position
    if kind is types.none:
        return context.get_dummy_value(), position

    def word(offset: int) -> Any:
        return builder.load(builder.gep(words, [ir.Constant(WORD, position + offset)]))

    if isinstance(kind, types.Array):
        shape = [word(1 + axis) for axis in range(kind.ndim)]
        strides = [word(1 + kind.ndim + axis) for axis in range(kind.ndim)]
        return make_array(context, builder, kind, word(0), shape, strides), position + 1 + 2 * kind.ndim
    form = context.get_value_type(kind)
    if isinstance(kind, PackType | types.Record):
        return builder.inttoptr(word(0), form), position + 1
    if isinstance(kind, types.Float):
        number = builder.bitcast(word(0), DOUBLE)
        return (number if form == DOUBLE else builder.fptrunc(number, form)), position + 1
    return (word(0) if form == WORD else builder.trunc(word(0), form)), position + 1


def words_of_value(builder: Any, kind: Any, value: Any) -> Iterator[Any]:
    """Words of a value of a type. Raises TypeError for what is neither a number nor a tuple of them."""
    if isinstance(kind, types.BaseTuple):
        for position, part in enumerate(kind.types):
            yield from words_of_value(builder, part, builder.extract_value(value, position))
    elif isinstance(kind, types.Float):
        yield builder.bitcast(value if value.type == DOUBLE else builder.fpext(value, DOUBLE), WORD)
    elif isinstance(kind, types.Boolean):
        yield builder.zext(value, WORD)
    elif isinstance(kind, types.Integer):
        yield value if value.type == WORD else (builder.sext if kind.signed else builder.zext)(value, WORD)
    elif kind is not types.none:
        raise TypeError(f"Python calls no kernel that returns {kind}")
