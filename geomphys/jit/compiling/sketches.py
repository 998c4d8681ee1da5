"""Kernels as other kernels see them: sketched for the compiler, part of a unit, or jumped to."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from numba import types
from numba.core import compiler, sigutils, typing
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from geomphys.jit.compiling.keys import Key, stamp_of, symbol_of
from geomphys.jit.compiling.parts import Part, describe, sketch
from geomphys.jit.compiling.returns import declared_return
from geomphys.storage.cache import Store

PACKAGE = Path(__file__).parents[2]

OPTIONS = {"nopython": True, "error_model": "numpy", "_nrt": False}

_kernels: dict[tuple[str, str], Sketched] = {}
_sketched: list[tuple[list[Key], list[Key]]] = []


class Callee:
    """What stands for a kernel, for certain types, in the code of its callers."""

    def __init__(self, key: Key, description: Any) -> None:
        self.key = key
        self.description = description
        self.signature = typing.signature(description.restype, *description.argtypes)


class Sketched(CPUDispatcher):  # type: ignore[misc]  # numba is untyped
    """A function for numba to compile; what is made of it is kept in `store`.

    A kernel is compiled into the kernels that call it, unless it is `outlined`: those are units of machine code of
    their own, which others jump to. What a kernel returns is taken from its annotation, and checked when it is
    sketched; so its callers can be sketched before it, and elsewhere.
    """

    def __init__(self, function: Any, store: Store, outlined: bool, inlined: bool) -> None:
        super().__init__(function, targetoptions=OPTIONS | {"forceinline": inlined})
        self.store, self.outlined, self.inlined = store, outlined, inlined
        self.module, self.name = function.__module__, function.__qualname__
        source = Path(inspect.getfile(function))
        self.stamp = "" if PACKAGE in source.parents else stamp_of(source)
        self._callees: dict[tuple[Any, ...], Callee] = {}
        self._parts: dict[tuple[Any, ...], Part] = {}
        _kernels[self.module, self.name] = self

    @cached_property
    def returns(self) -> Any:
        """What it is annotated to return."""
        return declared_return(self.py_func)

    def key(self, kinds: tuple[Any, ...]) -> Key:
        """Key of this kernel for these types of arguments."""
        return Key(self.module, self.name, kinds, self.stamp)

    # as other kernels see it

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Tell the compiler of a caller what a call with these types returns."""
        # a constant argument would otherwise be a type of its own, and compile the callee once for each value
        kws = {name: types.unliteral(kind) for name, kind in kws.items()}
        pysig, kinds = self._compiler.fold_argument_types(tuple(map(types.unliteral, args)), kws)
        callee = self.callee(tuple(kinds))
        if _sketched:
            parts, units = _sketched[-1]
            (units if self.outlined else parts).append(callee.key)
        template = typing.make_concrete_template(self.name, key=self.name, signatures=[callee.signature])
        return template, pysig, kinds, {}

    def get_overload(self, sig: Any) -> Any:
        """What the code of a caller refers to."""
        return self._callees[tuple(sigutils.normalize_signature(sig)[0])]

    def callee(self, kinds: tuple[Any, ...]) -> Callee:
        """What callers refer to."""
        if kinds not in self._callees:
            self._callees[kinds] = callee = Callee(self.key(kinds), self.describe(kinds))
            self.targetctx.insert_user_function(callee, callee.description)
        return self._callees[kinds]

    def describe(self, kinds: tuple[Any, ...]) -> Any:
        """Names and types of the machine code."""
        return describe(self.key(kinds), self.returns, tuple(inspect.signature(self.py_func).parameters), self.inlined)

    def flags(self) -> Any:
        """How it is compiled."""
        flags = compiler.Flags()
        self.targetdescr.options.parse_as_flags(flags, self.targetoptions)
        return flags

    # what is made of it

    def find_part(self, kinds: tuple[Any, ...]) -> Part | None:
        """The kernel in the language of LLVM, if it was sketched before."""
        if kinds not in self._parts:
            found = self.store.load(f"{symbol_of(self.key(kinds))}.part")
            if found is None:
                return None
            self._parts[kinds] = found
        return self._parts[kinds]

    def part(self, kinds: tuple[Any, ...]) -> Part:
        """The kernel in the language of LLVM, sketched now if it was not.

        Raises
        ------
        TypeError
            It returns something else than its annotation says.
        """
        found = self.find_part(kinds)
        if found is None:
            with global_compiler_lock:
                found = self._parts[kinds] = self._sketch(self.key(kinds))
            self.store.save(f"{symbol_of(found.key)}.part", found)
        return found

    def _sketch(self, key: Key) -> Part:
        _sketched.append(([], []))
        try:
            returns, code = sketch(key, self.py_func, self.flags(), self.targetdescr)
        finally:
            parts, units = _sketched.pop()
        if types.unliteral(returns) != self.returns:
            raise TypeError(f"{self.module}.{self.name}: annotated to return {self.returns}, but returns {returns}")
        return Part(key, tuple(dict.fromkeys(parts)), tuple(dict.fromkeys(units)), code)


def kernel_of(key: Key) -> Sketched:
    """The kernel of a key."""
    if (key.module, key.name) not in _kernels:
        importlib.import_module(key.module)
    return _kernels[key.module, key.name]


def closure(part: Part) -> tuple[list[Part], list[Key]]:
    """A part with all parts compiled into it, and the units all of them jump to."""
    seen: dict[Key, Part] = {}

    def visit(part: Part) -> Iterator[Key]:
        seen[part.key] = part
        yield from part.units
        for key in part.parts:
            if key not in seen:
                yield from visit(kernel_of(key).part(key.types))

    units = list(dict.fromkeys(visit(part)))
    return list(seen.values()), units
