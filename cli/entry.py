"""Entry point of the `geomphys` script: receives signals before anything that takes time is imported."""

from __future__ import annotations

import signal

from .signals import STOP_SIGNALS, Stopped, signals_caught


def main() -> None:
    """Run the command line of this process; never returns."""
    with signals_caught():
        try:
            from .main import main as run_commands
        except Stopped as stop:
            raise SystemExit(stop.exit_code) from None
        try:
            run_commands()
        finally:
            for signum in STOP_SIGNALS:
                signal.signal(signum, signal.SIG_IGN)
