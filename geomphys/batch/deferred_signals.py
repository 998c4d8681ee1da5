"""SIGINT and SIGTERM wait while code runs that an exception out of a handler would leave half done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STOPPING = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Keep the signals that come until the end, and give them to their handlers then.

    Masking them would not do: Python runs handlers in the main thread whichever thread the system picks. Keep it short.
    In another thread than the main one, where no handler ever runs, it does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    noted: list[int] = []
    before = {number: signal.signal(number, lambda came, _: noted.append(came)) for number in STOPPING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for came in noted:
            signal.raise_signal(came)


@contextmanager
def blocked_in_children() -> Iterator[None]:
    """Let a process that is begun meanwhile start with the signals blocked, until it calls `take_signals`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOPPING)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def take_signals() -> None:
    """In a process begun under `blocked_in_children`: leave Ctrl-C to the parent, and take SIGTERM again."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOPPING)
