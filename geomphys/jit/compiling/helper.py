"""Another process that compiles for this one: ``python -m geomphys.jit.compiling.helper``.

It is asked for one job after the other through its standard input, and leaves what it made in the store.
"""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from typing import Any

from geomphys.jit.compiling.jobs import Job

BROKEN = (OSError, EOFError, ValueError, pickle.PickleError)
"""What comes of talking to a process that has ended."""


class Helper:
    """A process that compiles; nothing depends on its success."""

    def __init__(self) -> None:
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        self._ready = False
        self._process: subprocess.Popen[bytes] | None = None
        with suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__],
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )

    def is_ready(self) -> bool:
        """Wait until it is up; False if it never will be."""
        self._ready = self._ready or self._answer()
        return self._ready

    def do(self, job: Job) -> bool:
        """Have a job done; False if that did not work."""
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            pickle.dump(job, self._process.stdin)
            self._process.stdin.flush()
        except BROKEN:
            return False
        return self._answer()

    def _answer(self) -> bool:
        if self._process is None or self._process.stdout is None:
            return False
        try:
            return pickle.load(self._process.stdout) is True
        except BROKEN:
            return False

    def end(self) -> None:
        """End the process, whatever it is at."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            for pipe in (self._process.stdin, self._process.stdout):
                with suppress(OSError):  # what was written last has no reader any more
                    if pipe is not None:
                        pipe.close()


def serve(requests: Any, answers: Any) -> None:
    """Do what is asked for until there are no more requests."""

    def answer(done: bool) -> None:
        pickle.dump(done, answers)
        answers.flush()

    answer(True)
    while True:
        try:
            job: Job = pickle.load(requests)
        except EOFError:
            return
        job.make()
        answer(True)


if __name__ == "__main__":
    gc.disable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, at whose end the requests end
    serve(sys.stdin.buffer, sys.stdout.buffer)
