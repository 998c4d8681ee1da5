"""Calls a kernel in a thread of its own, while this one reads the next frames and writes those before."""

from __future__ import annotations

import threading
from collections.abc import Callable

from geomphys.errors import GeomphysError
from geomphys.storage.child_process import available_cores, is_pool_worker


class OverlappedCall:
    """A call that gives a number, at work from now on if `is_overlapped`; otherwise it is made when it is waited for."""

    def __init__(self, call: Callable[[], int], *, is_overlapped: bool) -> None:
        self._call = call
        self._found: int | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True) if is_overlapped else None
        if self._thread is not None:
            self._thread.start()

    def _run(self) -> None:
        try:
            self._found = self._call()
        except BaseException as error:  # raised where it is waited for
            self._error = error

    def wait(self) -> int:
        """The result. Raises what the call raises; GeomphysError in a fork of the process that made it."""
        if self._thread is None:
            self._run()
        else:
            self._thread.join()
        if self._error is not None:
            raise self._error
        if self._found is None:
            raise GeomphysError("a fork of a process that replays cannot go on with its replay")
        return self._found

    def settle(self) -> None:
        """Wait until it is no longer at work."""
        if self._thread is not None:
            self._thread.join()


def can_overlap() -> bool:
    """Whether a second thread has a core: not where several processes share the work."""
    return available_cores() > 1 and not is_pool_worker()
