"""The decorators of every compiled kernel.

Kernels are numba functions without ``fastmath`` (results must not depend on the machine's vector width) whose machine
code is cached on disk, see `geomphys.jit`. They do not call themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

from geomphys.jit.folder import cache_folder
from geomphys.jit.kernels import Kernel, Outlined

F = TypeVar("F", bound=Callable[..., object])

__all__ = ["are_compiled", "cache_folder", "inlined", "kernel", "outlined"]


def are_compiled(method: str = "exact") -> bool:
    """Whether the machine code of the frame step by a method is in the cache: if not, the first frame waits for the compiler.

    `method` is "exact" or "paper", see `geomphys.config.Config`.
    """
    name = {"exact": "run_block", "paper": "run_block_as_published"}[method]
    return any(cache_folder().glob(f"geomphys.engine.step.{name}.*.entry"))


def kernel(function: F) -> F:
    """Compile `function` when it is first called, and into each kernel that calls it."""
    return cast(F, Kernel(function))


def outlined(function: F) -> F:
    """Compile `function` once; its callers jump to it: for long ones at the bottom of many others.

    What it returns must be annotated: None, bool, int, float, or a tuple or NamedTuple of them.
    """
    return cast(F, Outlined(function))


def inlined(function: F) -> F:
    """Compile `function` into each of its callers: for short ones that take many arrays and hand on a few numbers."""
    return cast(F, Kernel(function, inlined=True))
