"""Pools of worker processes: begun anew (spawned) rather than forked; they leave signals to their parent and end with it.

What this module imports is cheap on purpose: where a process starts, the parent waits until it has read its arguments,
which requires this module to be imported.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import pickle
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from pathlib import Path
from tempfile import gettempdir
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

from geomphys.errors import GeomphysError
from geomphys.storage.deferred_signals import blocked_in_children, restore_signals, signals_deferred
from geomphys.storage.temporary_folders import TemporaryFolder

P = ParamSpec("P")
T = TypeVar("T")


class ProcessPool(ProcessPoolExecutor):
    """A pool of `count` processes; each calls `initializer` with `arguments` as it begins.

    What they call is handed over in a file, by its digest: the pipe that a process reads its arguments from holds 64 KiB,
    and the parent would wait for ever for a process that ends before it has read more.

    Raises GeomphysError where processes cannot share work, as without a writable /dev/shm.
    """

    def __init__(self, count: int, initializer: Callable[..., None], *arguments: Any) -> None:
        context = get_context("spawn")
        try:
            self._folder = TemporaryFolder()
            begin = self._folder.path / "begin"
            data = pickle.dumps((initializer, arguments))
            begin.write_bytes(data)
        except OSError as problem:
            raise GeomphysError(
                f"{gettempdir()}: processes cannot be started ({problem.strerror}); is the disk full?"
            ) from problem
        reading, self._lifeline = context.Pipe(duplex=False)
        try:
            super().__init__(count, mp_context=context, initializer=_begin, initargs=(begin, _digest(data), reading))
        except (OSError, ImportError) as problem:
            reason = getattr(problem, "strerror", None) or problem
            raise GeomphysError(f"/dev/shm: processes cannot share work here ({reason}); make it writable") from problem

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> Future[T]:
        """Have a process call a function; a signal waits while it begins, and is not for it."""
        with signals_deferred(), blocked_in_children():
            return super().submit(fn, *args, **kwargs)

    def kill(self) -> None:
        """End the processes at once."""
        self._lifeline.close()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Wait for the calls, or drop those that have not begun; see `ProcessPoolExecutor.shutdown`."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            self._lifeline.close()
            self._folder.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the calls; an exception ends the processes. Raises GeomphysError if one died."""
        if kind is not None:
            self.kill()
        self.shutdown(cancel_futures=kind is not None)
        if isinstance(error, BrokenProcessPool):
            raise GeomphysError("one of the processes died; was it short of memory? try with fewer --jobs") from error


def _digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def _begin(path: Path, digest: bytes, lifeline: Connection) -> None:
    """Ignore Ctrl-C, exit when the parent exits or says so, and initialize by the file that the parent wrote."""
    restore_signals()
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        wait([parent.sentinel, lifeline])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    data = path.read_bytes()
    if _digest(data) != digest:
        raise GeomphysError(f"{path}: is not what the process that began this one wrote")
    initializer, arguments = pickle.loads(data)
    initializer(*arguments)
