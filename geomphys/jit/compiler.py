"""From kernels to machine code by numba: imported where something is compiled, and nowhere else.

This uses two features of numba's public interface: `numba.njit` compiles a kernel into its
callers; `numba.cfunc` makes a noinline kernel, or what Python calls, a function of its own, whose text in LLVM's
language becomes an object file (`geomphys.jit.machine_code`).

Where numba is to do everything (`geomphys.jit.registry.PLAIN_NUMBA`) no kernel is noinline.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable, typeof_impl

from geomphys.jit.kinds import Kind, kind_of_text
from geomphys.jit.machine_code import SLOT, make_slots, object_file
from geomphys.jit.numba_types import kind_of_type, type_of_kind
from geomphys.jit.products import Key, Product, symbol_of
from geomphys.jit.record_copy import copy_record
from geomphys.jit.registry import Definition, Instruction, definitions, instructions
from geomphys.jit.returns import declared_return
from geomphys.jit.words import load_value, words_of_value


def _options() -> dict[str, Any]:
    """Options of every kernel.

    Kernels never allocate, so the counting of references to arrays, which costs a fifth of the compiling, is left out
    where numba has a switch for that.
    """
    options: dict[str, Any] = {"error_model": "numpy"}
    try:
        numba.njit(_nrt=False)(lambda: None)
    except (KeyError, TypeError):
        return options
    return options | {"_nrt": False}


OPTIONS = _options()
INSIDE = OPTIONS | {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of what only other kernels call."""

ENTRY = types.void(types.intp, types.intp)
"""Signature of what Python calls."""

_known: set[Definition | Instruction] = set()
_inside: dict[Definition, Any] = {}
"""Functions of numba that are compiled into their callers: once for all of them. Those of `numba.extending.overload` are compiled
anew for a caller with other options, for arguments by name, and for each constant among them."""

_requested: dict[str, Key] = {}
"""What compiled code of this process jumps to, by symbol."""

_in_memory: list[Any] = []
"""What `compile_in_memory` made: its machine code lives as long as it does."""


def compile_unit(kernel: Definition, key: Key) -> Product:
    """Compile a noinline kernel."""
    return _product(kernel.py_func, declared_return(kernel.py_func)(*_types(key)), symbol_of(key))


def compile_entry(kernel: Definition, key: Key) -> Product:
    """Compile a function of two pointers, to the words of arguments and of a result, that calls a kernel.

    Raises TypeError where the kernel returns what is no number or tuple.
    """
    returned: list[Any] = []
    product = _product(_entry(kernel, key, returned), ENTRY, f"{symbol_of(key)}.entry")
    return product._replace(returns=kind_of_type(returned[-1]))


def compile_in_memory(kernel: Definition, key: Key) -> tuple[int, Kind]:
    """Compile the same function in memory: its address, and what the kernel returns."""
    _introduce_kernels()
    returned: list[Any] = []
    compiled: Any = numba.cfunc(ENTRY, **OPTIONS)(_entry(kernel, key, returned))
    _in_memory.append(compiled)
    address: int = compiled.address
    return address, kind_of_type(returned[-1])


def _entry(kernel: Definition, key: Key, returned: list[Any]) -> Callable[..., None]:
    """The function of two pointers that calls a kernel; `returned` gets the type of its result when it is compiled."""
    kinds = _types(key)
    called: Any = kernel
    arguments, store = _arguments(kinds), _store(returned)

    def entry(words: int, result: int) -> None:
        store(result, called(*arguments(words)))

    def entry_without_arguments(words: int, result: int) -> None:
        store(result, called())

    return entry if kinds else entry_without_arguments


def _types(key: Key) -> list[Any]:
    return list(map(type_of_kind, kind_of_text(key.kinds)))


def _product(function: Callable[..., Any], signature: Any, symbol: str) -> Product:
    _introduce_kernels()
    compiled = numba.cfunc(signature, **OPTIONS)(function)
    code, callees = object_file(compiled.inspect_llvm(), compiled.native_name, symbol)
    return Product(code, [_requested[callee] for callee in callees], "none")


def _introduce_kernels() -> None:
    """Register with numba how a kernel compiles a call of another."""
    for instruction in instructions:
        if instruction not in _known:
            _introduce_instruction(instruction)
    for kernel in list(definitions.values()):
        if kernel not in _known:
            if kernel.noinline:
                _introduce_noinline(kernel)
            else:
                _inside[kernel] = numba.njit(**INSIDE, forceinline=kernel.inlined)(kernel.py_func)
    _known.update(instructions, definitions.values())


class _Inside(types.Dispatcher):  # type: ignore[misc] # numba has no types for mypy
    """Type of a kernel that is compiled into its callers: for an int64, not for each constant that a caller gives."""

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        args, kws = map(types.unliteral, args), {name: types.unliteral(kind) for name, kind in kws.items()}
        return super().get_call_type(context, tuple(args), kws)


register_model(_Inside)(models.OpaqueModel)


@typeof_impl.register(Definition)
def _type_of_kernel(kernel: Definition, context: Any) -> Any:
    """Type of a kernel that is compiled into its callers; that of a noinline one numba finds by itself."""
    return None if kernel.noinline else _Inside(_inside[kernel])


def _introduce_noinline(kernel: Definition) -> None:
    def typed(context: Any) -> Any:
        def call(*args: Any) -> Any:
            return declared_return(kernel.py_func)

        call.pysig = inspect.signature(kernel.py_func)  # type: ignore[attr-defined]
        return call

    def lowered(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kinds = tuple(kind_of_type(types.unliteral(kind)) for kind in signature.args)
        symbol = symbol_of(kernel.key(kinds))
        _requested[symbol] = kernel.key(kinds)
        make_slots([symbol])
        given = [context.get_value_type(kind) for kind in signature.args]
        pointer = ir.FunctionType(context.get_value_type(signature.return_type), given).as_pointer()
        name = symbol + SLOT
        slot = builder.module.globals.get(name) or ir.GlobalVariable(builder.module, pointer, name)
        return builder.call(builder.load(slot), args)

    type_callable(kernel)(typed)
    lower_builtin(kernel, types.VarArg(types.Any))(lowered)


def _introduce_instruction(instruction: Instruction) -> None:
    def typed(context: Any) -> Any:
        return lambda: types.int64

    def lowered(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.IntType(64), [])
        return builder.call(builder.module.declare_intrinsic(instruction.name, fnty=kind), [])

    type_callable(instruction)(typed)
    lower_builtin(instruction)(lowered)


@type_callable(copy_record)
def _typed_copy(context: Any) -> Any:
    def call(target: Any, source: Any) -> Any:
        return types.none if isinstance(target, types.Record) and target == source else None

    return call


@lower_builtin(copy_record, types.Record, types.Record)
def _lowered_copy(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    pointer, word = ir.IntType(8).as_pointer(), ir.IntType(64)
    move = builder.module.declare_intrinsic("llvm.memmove", [pointer, pointer, word])
    target, source = (builder.bitcast(record, pointer) for record in args)
    builder.call(move, [target, source, ir.Constant(word, signature.args[0].size), ir.Constant(ir.IntType(1), 0)])
    return context.get_dummy_value()


def _arguments(kinds: list[Any]) -> Any:
    """A function for kernels: the arguments of these types, from the address of their words."""

    def typed(context: Any, words: Any) -> Any:
        def lowered(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            words = builder.inttoptr(given[0], ir.IntType(64).as_pointer())
            value, _ = load_value(context, builder, signature.return_type, words, 0)
            return value

        return types.BaseTuple.from_types(kinds)(words), lowered

    return intrinsic(typed)


def _store(returned: list[Any]) -> Any:
    """A function for kernels that stores a value as words; `returned` gets the value's type."""

    def typed(context: Any, words: Any, value: Any) -> Any:
        returned.append(types.unliteral(value))

        def lowered(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            words = builder.inttoptr(given[0], ir.IntType(64).as_pointer())
            for position, word in enumerate(words_of_value(builder, value, given[1])):
                builder.store(word, builder.gep(words, [ir.Constant(ir.IntType(64), position)]))
            return context.get_dummy_value()

        return types.none(words, value), lowered

    return intrinsic(typed)
