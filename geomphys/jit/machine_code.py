"""Machine code of kernels: object files made from LLVM's text of a kernel, and linked into this process.

Callers of a noinline kernel jump to the address in its *slot*, a word of memory known to LLVM by a name. So
a caller can be compiled and kept on disk before its callees are, and kernels are compiled in any order.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import chain
from typing import Any

import llvmlite.binding as llvm

SLOT = ".slot"

_slots: dict[str, ctypes.c_void_p] = {}

_LONG_NAME = re.compile(r"[\w.$]{200,}")
"""LLVM cuts names of blocks at 1,024 characters, by which two become one when a text is read again."""

_NEVER_CALLED = re.compile(
    r"numba_(gil_ensure|gil_release|do_raise|unpickle|runtime_build_excinfo_struct)|Py_?[A-Z]\w+"
)
"""What numba reports an exception with that a C function cannot raise: kernels raise none."""

_FOREIGN = re.compile(r"numba_|NRT_|_?Py")


def make_slots(symbols: Iterable[str]) -> None:
    """Define the slots of noinline kernels in LLVM."""
    for symbol in symbols:
        if symbol not in _slots:
            _slots[symbol] = ctypes.c_void_p()
            llvm.add_symbol(symbol + SLOT, ctypes.addressof(_slots[symbol]))


def is_linked(symbol: str) -> bool:
    """Whether a noinline kernel can be jumped to in this process."""
    return symbol in _slots and bool(_slots[symbol].value)


def link(codes: Mapping[str, bytes]) -> dict[str, int]:
    """Addresses of the functions of object files, by the symbols they were made with; fills the slots that there are.

    The slots that they jump to must have been made.
    """
    engine = _engine()
    for code in codes.values():
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    addresses = {symbol: engine.get_function_address(symbol) for symbol in codes}
    for symbol, address in addresses.items():
        if symbol in _slots:
            _slots[symbol].value = address
    return addresses


def object_file(text: str, name: str, symbol: str) -> tuple[bytes, list[str]]:
    """Machine code of a function as an object file, and the symbols of the noinline kernels that it jumps to.

    Parameters
    ----------
    text
        LLVM's assembly language of a module with the function.
    name
        Name of the function in it.
    symbol
        The only name that is seen from outside in the object file.

    Raises
    ------
    TypeError
        The module needs something of numba's runtime, as what allocates memory does.
    """
    module = llvm.parse_assembly(_LONG_NAME.sub(_short, text))
    needed = [f for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")]
    never_called = [function for function in needed if _NEVER_CALLED.fullmatch(function.name)]
    for outer in {f.name for f in needed} - {f.name for f in never_called}:
        if _FOREIGN.match(outer) or llvm.address_of_symbol(outer) is None:
            raise TypeError(f"{symbol} calls {outer}: kernels do without numba's runtime and Python")
    module.link_in(llvm.parse_assembly("\n".join(["declare void @llvm.trap()", *map(_trap, never_called)])))
    for value in chain(module.functions, module.global_variables):
        if not value.is_declaration:
            value.linkage = "internal"
    function = module.get_function(_LONG_NAME.sub(_short, name))
    function.linkage, function.name = "external", symbol
    outside = [value.name for value in module.global_variables if value.is_declaration]
    slots = [name.removesuffix(SLOT) for name in outside if name.endswith(SLOT)]
    return _optimised(module), slots


def _optimised(module: Any) -> bytes:
    """Machine code of a module, optimised once more: numba did it for functions that anyone may call, half of which now go."""
    machine, options = _target_machine(), llvm.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = False  # that is done
    options.slp_vectorization = True  # numba does not: operations that are alike become one, to the same bits
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    code: bytes = machine.emit_object(module)
    return code


def _short(name: re.Match[str]) -> str:
    return f"L{hashlib.sha256(name[0].encode()).hexdigest()[:24]}"


def _trap(function: Any) -> str:
    """A definition of a function that ends the process."""
    returned, _, parameters = str(function.global_value_type).partition(" (")
    return f"define {returned} @{function.name}({parameters} {{\n call void @llvm.trap()\n unreachable\n}}"


@lru_cache(maxsize=1)
def processor() -> tuple[str, str]:
    """Name and features of the processor that the machine code is for."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _target_machine() -> Any:
    """A target machine of its own: an engine takes it over."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = processor()
    return llvm.Target.from_default_triple().create_target_machine(cpu=cpu, features=features, opt=3, jit=True)


@lru_cache(maxsize=1)
def _engine() -> Any:
    """LLVM's linker of object files in memory."""
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine())
