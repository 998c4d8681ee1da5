"""The decorators of every compiled kernel.

Kernels are numba functions without ``fastmath`` (results must not depend on the machine's vector width) whose machine
code is kept on disk, see `geomphys.jit`. They do not call themselves, and raise nothing.
"""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from typing import Any, TypeVar, cast

from geomphys.jit.calls import Entry
from geomphys.jit.folder import cache_folder
from geomphys.jit.kinds import kind_of
from geomphys.jit.registry import PLAIN_NUMBA, Definition, Instruction
from geomphys.jit.work import compile_ahead, load_entry

F = TypeVar("F", bound=Callable[..., object])

__all__ = ["are_compiled", "cache_folder", "inlined", "instruction", "kernel", "noinline"]

_lock = threading.RLock()
_compiled: set[str] = set()  # methods whose step was found in the cache


class Kernel(Definition):
    """A function that is compiled when it is first called, and into each kernel that calls it."""

    def __init__(self, function: Callable[..., Any], inlined: bool = False, noinline: bool = False) -> None:
        super().__init__(function, inlined, noinline)
        self._entries: dict[tuple[Any, ...], Entry] = {}

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Call it from Python; compiles what is not compiled yet."""
        return self._call(args, kwargs, unlocked=False)

    def unlocked(self, *args: Any) -> Any:
        """Call it so that other threads run meanwhile, which must leave its arguments alone."""
        return self._call(args, {}, unlocked=True)

    def compile_ahead(self, *args: Any) -> None:
        """Let other processes compile it for such arguments meanwhile, see `geomphys.jit.work.compile_ahead`."""
        compile_ahead(self, tuple(map(kind_of, args)))

    def _call(self, args: tuple[Any, ...], kwargs: dict[str, Any], *, unlocked: bool) -> Any:
        if kwargs or len(args) != self.parameters:
            bound = inspect.signature(self.py_func).bind(*args, **kwargs)
            bound.apply_defaults()
            args = bound.args
        kinds = tuple(map(kind_of, args))
        entry = self._entries.get(kinds)
        if entry is None:
            with _lock:
                entry = self._entries[kinds] = load_entry(self, kinds)
        return entry(args, unlocked=unlocked)


def are_compiled(method: str = "exact") -> bool:
    """Whether the machine code of the frame step by a method is in the cache: if not, the first frame waits for the compiler.

    `method` is "exact" or "paper", see `geomphys.config.Config`.
    """
    if PLAIN_NUMBA:
        return False
    if method not in _compiled:
        name = {"exact": "run_block", "paper": "run_block_as_published"}[method]
        if not any(cache_folder().glob(f"geomphys.engine.step.{name}.*.entry")):
            return False
        _compiled.add(method)
    return True


def kernel(function: F) -> F:
    """Compile `function` when it is first called, and into each kernel that calls it."""
    return cast(F, Kernel(function))


def noinline(function: F) -> F:
    """Compile `function` once; its callers jump to it: for long ones at the bottom of many others.

    What it returns must be annotated: None, bool, int, float, or a tuple or NamedTuple of them.
    """
    return cast(F, Kernel(function, noinline=True))


def inlined(function: F) -> F:
    """Compile `function` into each of its callers: for short ones that take many arrays and hand on a few numbers."""
    return cast(F, Kernel(function, inlined=True))


def instruction(name: str) -> Callable[[], int]:
    """An instruction of LLVM that takes nothing and gives an int64, for kernels."""
    return cast(Callable[[], int], Instruction(name))
