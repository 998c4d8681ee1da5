"""Stage times from inside compiled code: the processor's cycle counter, scaled once against the monotonic clock."""

from __future__ import annotations

import time
from functools import lru_cache

from geomphys.jit.kernel import instruction, kernel

STAGES = (
    "step.kinematics",
    "step.recorded",
    "step.overlap",
    "step.impulses",
    "step.contacts",
)
"""Dotted call paths of the stages inside a frame's step; `step` itself is their whole."""


_cycle_counter = instruction("llvm.readcyclecounter")


@kernel
def cycles() -> int:
    """The processor's cycle counter."""
    return _cycle_counter()


@lru_cache(maxsize=1)
def start_clock() -> tuple[int, int]:
    """Time [ns] and `cycles` of the first call: `ns_per_cycle` is measured from there."""
    cycles()
    return time.perf_counter_ns(), cycles()


@lru_cache(maxsize=1)
def ns_per_cycle() -> float:
    """Nanoseconds per count of `cycles`, measured once, over at least 20 ms."""
    start_ns, start = start_clock()
    while time.perf_counter_ns() - start_ns < 20_000_000:
        pass
    return (time.perf_counter_ns() - start_ns) / max(cycles() - start, 1)
