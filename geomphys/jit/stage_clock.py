"""Stage times from inside compiled code: the processor's cycle counter, scaled once against the monotonic clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import lru_cache
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from geomphys.jit.kernel import kernel

STAGES = (
    "step.kinematics",
    "step.recorded",
    "step.overlap",
    "step.impulses",
    "step.contacts",
)
"""Dotted call paths of the stages inside a frame's step; `step` itself is their whole."""


def _read_counter(typing_context: Any) -> Any:
    """llvm.readcyclecounter: cycles since some moment, as int64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function = builder.module.declare_intrinsic("llvm.readcyclecounter", fnty=ir.FunctionType(ir.IntType(64), []))
        return builder.call(function, [])

    return types.int64(), generate


_cycle_counter = cast(Callable[[], int], intrinsic(_read_counter))


@kernel
def cycles() -> int:
    """The processor's cycle counter."""
    return _cycle_counter()


@lru_cache(maxsize=1)
def ns_per_cycle() -> float:
    """Nanoseconds per count of `cycles`, measured once over 20 ms."""
    cycles()
    start_ns, start = time.perf_counter_ns(), cycles()
    while time.perf_counter_ns() - start_ns < 20_000_000:
        pass
    return (time.perf_counter_ns() - start_ns) / max(cycles() - start, 1)
