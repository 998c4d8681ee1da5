"""Kernels: functions that numba compiles, as Python calls them and as other kernels do.

Three numba features carry this, all of its public interface: `numba.extending.overload` compiles a kernel into its
callers; `numba.cfunc` makes an outlined kernel a function of its own, with an address; callers of an outlined kernel
jump to the address that stands in its *slot*, a word of memory known to LLVM by a name (`llvmlite.binding.add_symbol`).
So a caller can be compiled and cached before its callees are, and kernels are compiled in any order.
"""

from __future__ import annotations

import hashlib
import inspect
import threading
from collections.abc import Callable, Iterator
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, overload, type_callable

from geomphys.jit.products import CacheEntry, Key, symbol_of
from geomphys.jit.returns import declared_return
from geomphys.jit.slots import make_slots, requested, units
from geomphys.jit.work import complete, undisturbed

PACKAGE = Path(__file__).parent.parent


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

kernels: dict[tuple[str, str], Kernel] = {}
_lock = threading.RLock()


class Kernel:
    """A function that is compiled when it is first called, and into each kernel that calls it."""

    def __init__(self, function: Callable[..., Any], inlined: bool = False) -> None:
        self.py_func = self.__wrapped__ = function
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.cached, self.stamp = _source_of(inspect.getfile(function))
        self._parameters = function.__code__.co_argcount
        self._entries: dict[tuple[Any, ...], Any] = {}
        kernels[self.__module__, self.__qualname__] = self
        self._introduce(INSIDE | {"forceinline": inlined})

    def _introduce(self, options: dict[str, Any]) -> None:
        """Tell numba what a call of it in another kernel is."""
        overload(self, jit_options=options, strict=False)(lambda *args, **kwargs: self.py_func)

    def key(self, kinds: tuple[Any, ...]) -> Key:
        """Key of this kernel for these types of arguments."""
        return Key(self.__module__, self.__qualname__, kinds, self.stamp)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call it from Python; compiles what is not compiled yet."""
        if len(args) != self._parameters:
            bound = inspect.signature(self.py_func).bind(*args, **kwargs)
            bound.apply_defaults()
            args = bound.args
        kinds = tuple(map(numba.typeof, args))
        entry = self._entries.get(kinds)
        if entry is None:
            with _lock:
                entry = self._entries[kinds] = self._enter(kinds)
        return entry(*args)

    def _enter(self, kinds: tuple[Any, ...]) -> Any:
        stored = CacheEntry(f"{symbol_of(self.key(kinds))}.entry")
        with undisturbed(), stored.locked(wait=True):
            product = stored.find()
            needs = [] if product is None else product.callees()
            make_slots(needs)
            dispatcher = stored.make(lambda cache: self._compiled(kinds, cache and self.cached))
            if not dispatcher.stats.cache_hits:
                needs = self.needs()
            complete(needs)
            if not dispatcher.stats.cache_hits:
                stored.save(needs)
        return dispatcher

    def _compiled(self, kinds: tuple[Any, ...], cache: bool) -> Any:
        dispatcher = numba.njit(cache=cache, **OPTIONS)(self.py_func)
        dispatcher.compile(kinds)
        return dispatcher

    def needs(self) -> list[Key]:
        """Keys of the outlined kernels it jumps to, as far as it was compiled in this process."""
        reachable = {(k.__module__, k.__qualname__) for k in self._reachable(set()) if isinstance(k, Outlined)}
        return [key for key in requested if (key.module, key.name) in reachable]

    def _reachable(self, seen: set[Kernel]) -> Iterator[Kernel]:
        """Kernels it calls, and those that are compiled into it call."""
        for name in self.py_func.__code__.co_names:
            callee = self.py_func.__globals__.get(name)
            if isinstance(callee, Kernel) and callee not in seen:
                seen.add(callee)
                yield callee
                if not isinstance(callee, Outlined):
                    yield from callee._reachable(seen)


class Outlined(Kernel):
    """A kernel that is compiled once for each signature; its callers jump to it."""

    def _introduce(self, options: dict[str, Any]) -> None:
        self.loaded: dict[Key, tuple[Any, list[Key]]] = {}
        units[self.__module__, self.__qualname__] = self

        def typed(context: Any) -> Any:
            def call(*args: Any) -> Any:
                return self.returns

            call.pysig = inspect.signature(self.py_func)  # type: ignore[attr-defined]
            return call

        def lowered(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            key = self.key(tuple(types.unliteral(kind) for kind in signature.args))
            requested[key] = None
            make_slots([key])
            given = [context.get_value_type(kind) for kind in signature.args]
            pointer = ir.FunctionType(context.get_value_type(signature.return_type), given).as_pointer()
            name = f"{symbol_of(key)}.slot"
            slot = builder.module.globals.get(name) or ir.GlobalVariable(builder.module, pointer, name)
            return builder.call(builder.load(slot), args)

        type_callable(self)(typed)
        lower_builtin(self, types.VarArg(types.Any))(lowered)

    @cached_property
    def returns(self) -> Any:
        """What it is annotated to return."""
        return declared_return(self.py_func)

    def make(self, key: Key, stored: CacheEntry) -> Any:
        """Have numba compile it, or load what it has cached."""
        signature = self.returns(*key.types)
        return stored.make(lambda cache: numba.cfunc(signature, cache=cache and self.cached, **OPTIONS)(self.py_func))


@lru_cache(maxsize=256)
def _source_of(path: str) -> tuple[bool, str]:
    """Whether a source is a file, and the digest of one that stands outside the package; "" inside."""
    source = Path(path)
    if PACKAGE in source.parents:
        return True, ""
    return source.is_file(), hashlib.sha256(source.read_bytes()).hexdigest()[:16] if source.is_file() else ""
