"""Entry point of the `geomphys` script: receives signals before anything that takes time is imported."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from contextlib import suppress

from .signals import STOP_SIGNALS, Stopped, signals_caught

_exit_code: int | None = None
"""Of the commands, once they have ended."""


def main() -> None:
    """Run the command line of this process; never returns."""
    global _exit_code
    atexit.register(_end_process)  # what is registered first is called last
    with signals_caught():
        try:
            from .main import main as run_commands
        except Stopped as stop:
            raise SystemExit(stop.exit_code) from None
        try:
            run_commands()
        except SystemExit as end:
            _exit_code = end.code if isinstance(end.code, int) else None
            raise
        finally:
            for signum in STOP_SIGNALS:
                signal.signal(signum, signal.SIG_IGN)


def _end_process() -> None:
    """End the process without freeing its objects one by one, which takes a twentieth of a replay, a tenth with rerun."""
    with suppress(OSError, ValueError):  # what cannot be flushed is reported by the interpreter
        if _exit_code is not None:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(_exit_code)
