"""SIGINT and SIGTERM: never lost, and raised as `Stopped` where the work can end cleanly.

A handler that raises is not enough: libraries catch every exception while they try an optional import, and the
interpreter drops what is raised in a finalizer. So the signal is noted, and raised again at short intervals until it is
on its way out; if the work ends otherwise, `run` in `main.py` still ends with the signal's exit code.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any

INTERVAL_S = 0.02
"""Seconds after which a signal that was caught by someone else is raised again."""

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(BaseException):
    """A signal asked the program to stop."""

    def __init__(self, signum: int) -> None:
        self.exit_code = 128 + signum
        super().__init__("interrupted" if signum == signal.SIGINT else "terminated")


class Signals:
    """Receives the signals of the process within a ``with`` block; in other threads than the main one it does nothing."""

    def __init__(self) -> None:
        self.received: int | None = None
        """The first signal that came."""
        self._frames = 0  # `StopAtFrame` blocks whose frames have begun
        self._ends = False
        self._handlers: dict[int, Any] = {}
        self._unraisable = sys.unraisablehook

    def __enter__(self) -> Signals:
        """Install the handlers."""
        if threading.current_thread() is threading.main_thread():
            sys.unraisablehook = self._hide_own
            for signum in (*STOP_SIGNALS, signal.SIGALRM):
                self._handlers[signum] = signal.signal(signum, self._receive)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Restore the handlers that were there."""
        self.settle()
        for signum, handler in self._handlers.items():
            signal.signal(signum, handler)
        sys.unraisablehook = self._unraisable

    def settle(self) -> None:
        """Raise nothing from here on: the work has ended, one way or another."""
        self._ends = True
        if self._handlers:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def begin_frames(self) -> None:
        """Let a first signal wait for the end of the frame that is being computed."""
        self._frames = 1

    def end_frames(self) -> None:
        """Let signals interrupt at once again."""
        self._frames = 0

    def stop_if_received(self) -> None:
        """Raise `Stopped` if a signal came."""
        if self.received is not None:
            raise Stopped(self.received)

    def _receive(self, signum: int, frame: FrameType | None) -> None:
        """Handle a signal, or the alarm that follows it."""
        if self._ends or (signum == signal.SIGALRM and self.received is None):
            return
        if signum != signal.SIGALRM:
            if self.received is None:
                self.received = signum
                if self._frames:
                    return
            self._frames = 0  # a second one does not wait
            signal.setitimer(signal.ITIMER_REAL, INTERVAL_S, INTERVAL_S)
        if not (self._frames or _hides(frame) or (signum == signal.SIGALRM and _is_raised())):
            assert self.received is not None
            raise Stopped(self.received)

    def _hide_own(self, unraisable: Any) -> None:
        """Say nothing of a `Stopped` that a finalizer dropped: it is raised again."""
        if not isinstance(unraisable.exc_value, Stopped):
            self._unraisable(unraisable)


def _hides(frame: FrameType | None) -> bool:
    """Whether the hook for what finalizers dropped is at work, out of which nothing can be raised."""
    while frame is not None:
        if frame.f_code is Signals._hide_own.__code__:
            return True
        frame = frame.f_back
    return False


def _is_raised() -> bool:
    """Whether `Stopped` is being handled: cleanup is under way."""
    error, seen = sys.exc_info()[1], set[int]()
    while error is not None and id(error) not in seen:
        if isinstance(error, Stopped):
            return True
        seen.add(id(error))
        error = error.__context__
    return False


_active: Signals | None = None


@contextmanager
def signals_caught() -> Iterator[Signals]:
    """Receive the signals within the block; a block inside another one shares its `Signals`."""
    global _active
    if _active is not None:
        yield _active
        return
    with Signals() as _active:
        try:
            yield _active
        finally:
            _active = None


class StopAtFrame:
    """Context in which SIGINT and SIGTERM stop the work at the end of the current frame.

    Call `at_frame` after every frame: it raises `Stopped` if a signal came. Before the first frame, and at a second
    signal, `Stopped` is raised at once; at the end of the block if the signal came after the last frame.
    """

    def __enter__(self) -> StopAtFrame:
        """Begin: signals interrupt at once."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End; raises `Stopped` if a signal came after the last frame."""
        if _active is not None:
            _active.end_frames()
            if error is None:
                _active.stop_if_received()

    def at_frame(self) -> None:
        """Raise `Stopped` if a signal was received."""
        if _active is not None:
            _active.begin_frames()
            _active.stop_if_received()
