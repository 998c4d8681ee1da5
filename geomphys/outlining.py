"""Kernels that are compiled once and jumped to, instead of being compiled into each of their callers.

numba hands the code of a callee to the compiler together with the caller's, level by level: what lies at the bottom of
a deep stack of kernels is optimised and translated once for each kernel above it. An outlined kernel is not handed on;
its callers know its name only, and the name must have an address before one of them is loaded. Beside the machine code
of each kernel in the cache lies therefore a list of the outlined kernels it needs.
"""

from __future__ import annotations

import copy
import hashlib
import importlib
import os
import pickle
from pathlib import Path
from typing import Any, cast

import llvmlite.binding
import numba
from numba.core.imputils import user_function

Key = tuple[str, str, tuple[Any, ...]]  # module, name and argument types of a kernel

_needs: dict[Key, list[Key]] = {}
_compiling: list[list[Key]] = []


def follow(compiled: Any, folder: Path, outlined: bool) -> None:
    """Make the dispatcher `compiled` note which outlined kernels it needs, and load them before itself."""
    types = cast(Any, numba.types)
    template, build = compiled.get_call_template, compiled.compile
    module, name = compiled.py_func.__module__, compiled.py_func.__qualname__

    def get_call_template(args: Any, kws: Any) -> Any:
        # a constant argument of a call would otherwise be a type of its own, and compile the callee once for each value
        pysig, widened = compiled._compiler.fold_argument_types(tuple(map(types.unliteral, args)), kws)
        result = template(widened, {})
        if _compiling:
            key = (module, name, tuple(widened))
            _compiling[-1].extend([*_needs[key], key] if outlined else _needs[key])
        return result[0], pysig, result[2], result[3]

    def compile_(sig: Any) -> Any:
        args = tuple(cast(Any, numba).core.sigutils.normalize_signature(sig)[0])
        known = compiled.overloads.get(args)
        if known is not None:
            return known.entry_point
        key = (module, name, args)
        notes = folder / f"{module}.{name}-{_digest(key)}.needs"
        _needs[key] = _read(notes)
        for there, callee, types_of in _needs[key]:
            getattr(importlib.import_module(there), callee).compile(types_of)
        _compiling.append([])
        try:
            entry = build(sig)
        finally:
            found = list(dict.fromkeys(_compiling.pop()))
        if found:
            _needs[key] = found
            _write(notes, found)
        if outlined:
            _publish(compiled, compiled.overloads[args], f"{module}.{name}.{_digest(key)}")
        return entry

    vars(compiled)["get_call_template"] = get_call_template
    vars(compiled)["compile"] = compile_


def _publish(compiled: Any, overload: Any, symbol: str) -> None:
    """Give the machine code of an overload a name, and make callers refer to it by that name."""
    description = copy.copy(overload.fndesc)
    llvmlite.binding.add_symbol(symbol, overload.library.get_pointer_to_function(description.llvm_func_name))
    description.mangled_name = symbol
    target = compiled.targetctx
    target.remove_user_function(overload.entry_point)
    jump = cast(Any, user_function)(description, ())
    target._defns[overload.entry_point].append(jump, jump.signature)


def _digest(key: Key) -> str:
    return hashlib.sha256(str(key).encode()).hexdigest()[:16]


def _read(notes: Path) -> list[Key]:
    return cast(list[Key], pickle.loads(notes.read_bytes())) if notes.exists() else []


def _write(notes: Path, found: list[Key]) -> None:
    draft = notes.with_suffix(f".{os.getpid()}")
    draft.write_bytes(pickle.dumps(found))
    draft.replace(notes)
