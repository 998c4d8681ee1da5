"""Defers SIGINT, SIGTERM and SIGALRM during code that an exception raised by a handler would leave in an inconsistent state."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
RAISING_SIGNALS = (*STOP_SIGNALS, signal.SIGALRM)
"""The alarm brings an earlier signal back that a library dropped."""


_is_deferring = False
"""Whether the main thread is in a block of `signals_deferred`."""


@contextmanager
def signals_deferred() -> Iterator[None]:
    """Record the signals that arrive in the block and pass them to their handlers at its end.

    Masking them is not enough: the system may deliver a signal to any thread, and Python runs the handler in the main
    one. The block should be short. Within another such block this does nothing, nor in other threads than the main one.
    """
    global _is_deferring
    if _is_deferring or threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[int] = []
    before = {number: signal.signal(number, lambda received, _: pending.append(received)) for number in RAISING_SIGNALS}
    _is_deferring = True
    try:
        yield
    finally:
        _is_deferring = False
        for number, handler in before.items():
            signal.signal(number, handler)
        for received in pending:
            signal.raise_signal(received)


@contextmanager
def blocked_in_children() -> Iterator[None]:
    """Start processes in the block with the signals blocked, until they call `restore_signals`."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def restore_signals() -> None:
    """In a process begun under `blocked_in_children`: ignore Ctrl-C, which the parent handles, and unblock SIGTERM."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, STOP_SIGNALS)
