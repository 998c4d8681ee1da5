"""Pools of worker processes, begun anew (spawned) rather than forked."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

from geomphys.errors import GeomphysError


def process_pool(count: int, **options: Any) -> ProcessPoolExecutor:
    """A pool of `count` processes; `options` are those of `ProcessPoolExecutor`.

    Raises GeomphysError where processes cannot share work, as without a writable /dev/shm.
    """
    try:
        return ProcessPoolExecutor(count, mp_context=get_context("spawn"), **options)
    except (OSError, ImportError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise GeomphysError(f"/dev/shm: processes cannot share work here ({reason}); make it writable") from problem
