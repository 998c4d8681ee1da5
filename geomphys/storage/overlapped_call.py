"""Calls that leave the interpreter's lock alone, in a thread of their own, while this one goes on."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Generic, TypeVar

from geomphys.errors import GeomphysError
from geomphys.storage.child_process import available_cores, is_pool_worker

T = TypeVar("T")


class OverlappedCall(Generic[T]):
    """A call that is at work from now on if `is_overlapped`; otherwise it is made when it is waited for."""

    def __init__(self, call: Callable[[], T], *, is_overlapped: bool) -> None:
        self._call = call
        self._found: list[T] = []
        self._errors = _RaisedLater()
        self._thread = threading.Thread(target=self._run, daemon=True) if is_overlapped else None
        if self._thread is not None:
            self._thread.start()

    def _run(self) -> None:
        with self._errors:
            self._found.append(self._call())

    def wait(self) -> T:
        """The result, once. Raises what the call raises; GeomphysError in a fork of the process that made it."""
        if self._thread is None:
            return self._call()
        self._thread.join()
        self._errors.raise_again()
        if not self._found:
            raise GeomphysError("a fork of this process cannot go on with what the process does")
        return self._found.pop()

    def settle(self) -> None:
        """Wait until it is no longer at work."""
        if self._thread is not None:
            self._thread.join()


class _RaisedLater:
    """Takes an error out of one thread, to be raised in another."""

    def __init__(self) -> None:
        self._error: BaseException | None = None

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self._error = error
        return True

    def raise_again(self) -> None:
        """Raise the error, if there was one."""
        if self._error is not None:
            raise self._error


def can_overlap() -> bool:
    """Whether a second thread has a core: not where several processes share the work."""
    return available_cores() > 1 and not is_pool_worker()
