"""Arrays by address, for the innermost kernels.

An array is a structure of eight or nine words with a counted reference; handing a dozen of them down to a function
that takes a tenth of a microsecond costs more than the function. An address is one number. It says neither its array's
length nor keeps it alive: whoever takes one holds the array for as long as the address is used.

Usable inside kernels only.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

_WORD = ir.IntType(64)
_HALF = ir.IntType(32)


def _address(context: Any, array: Any) -> Any:
    if not (
        isinstance(array, types.Array)
        and array.layout == "C"
        and array.dtype in (types.float64, types.int64, types.int32)
    ):
        return None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        structure = context.make_array(signature.args[0])(context, builder, args[0])
        return builder.ptrtoint(structure.data, _WORD)

    return types.int64(array), generate


def _float_at(context: Any, address: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(builder.gep(builder.inttoptr(args[0], ir.DoubleType().as_pointer()), [args[1]]))

    return types.float64(types.int64, types.int64), generate


def _int_at(context: Any, address: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.load(builder.gep(builder.inttoptr(args[0], _WORD.as_pointer()), [args[1]]))

    return types.int64(types.int64, types.int64), generate


def _int32_at(context: Any, address: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        half = builder.load(builder.gep(builder.inttoptr(args[0], _HALF.as_pointer()), [args[1]]))
        return builder.sext(half, _WORD)

    return types.int64(types.int64, types.int64), generate


def _set_float(context: Any, address: Any, index: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], builder.gep(builder.inttoptr(args[0], ir.DoubleType().as_pointer()), [args[1]]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), generate


def _set_int(context: Any, address: Any, index: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        builder.store(args[2], builder.gep(builder.inttoptr(args[0], _WORD.as_pointer()), [args[1]]))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


address = cast(Callable[[NDArray[Any]], int], intrinsic(_address))
"""Address of the first element of a C-contiguous array of float64, int64 or int32."""
float_at = cast(Callable[[int, int], float], intrinsic(_float_at))
"""``float_at(address, i)``: element i of a float64 array."""
int_at = cast(Callable[[int, int], int], intrinsic(_int_at))
"""``int_at(address, i)``: element i of an int64 array."""
int32_at = cast(Callable[[int, int], int], intrinsic(_int32_at))
"""``int32_at(address, i)``: element i of an int32 array."""
set_float = cast(Callable[[int, int, float], None], intrinsic(_set_float))
"""``set_float(address, i, value)``: store element i of a float64 array."""
set_int = cast(Callable[[int, int, int], None], intrinsic(_set_int))
"""``set_int(address, i, value)``: store element i of an int64 array."""
