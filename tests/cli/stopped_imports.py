"""A signal at every n-th import of a command: ``python stopped_imports.py STRIDE SIGNAL FOLDER WORDS…``.

At each of these imports the process forks; the child gets the signal there and goes on. Prints a JSON line for each: the
module, the exit code, what was said. The first signal is raised at the import; where someone swallows it, it is raised
again sooner than outside this test, so that the child ends close to the import.

Once there is a pool of processes, whose queues a fork would share, it forks no more and prints the number of the imports
that follow: with ``@N`` for STRIDE the process itself gets the signal at the N-th of these.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
import threading
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

LIMIT_S = 60.0
INTERVAL_S = 0.002


class Forks(MetaPathFinder):
    """Finds nothing; forks at every n-th name that is looked for."""

    def __init__(self, stride: int, only: int, signum: int, folder: Path) -> None:
        self.stride, self.only, self.signum, self.folder = stride, only, signum, folder
        self.count, self.maker = 0, os.getpid()
        self.has_pool, self.later = False, 0

    @property
    def is_child(self) -> bool:
        """Whether this process was forked, here or elsewhere."""
        return os.getpid() != self.maker

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Fork, or do nothing; imports of other threads count for nothing, as signals come to the main one."""
        if threading.current_thread() is not threading.main_thread():
            return None
        self.count += 1
        if fullname == "multiprocessing.synchronize":
            self.has_pool = True
        if self.has_pool and not self.is_child:
            self.later += 1
            if self.later == self.only:
                os.kill(os.getpid(), self.signum)
        if self.has_pool or self.only or self.is_child or self.count % self.stride:
            return None
        said = self.folder / "said.txt"
        child = os.fork()
        if child == 0:
            os.dup2(os.open(said, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), 2)
            os.dup2(2, 1)
            os.kill(os.getpid(), self.signum)
            return None
        descriptor = os.pidfd_open(child)
        if not select.select([descriptor], [], [], LIMIT_S)[0]:
            os.kill(child, signal.SIGKILL)
        os.close(descriptor)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        sys.__stdout__.write(json.dumps({"module": fullname, "code": code, "said": said.read_text()}) + "\n")  # type: ignore[union-attr]
        return None


def main() -> None:
    """Run the command, with a child for every n-th import."""
    one, number = sys.argv[1].startswith("@"), int(sys.argv[1].removeprefix("@"))
    forks = Forks(1 if one else number, number if one else 0, getattr(signal, sys.argv[2]), Path(sys.argv[3]))
    sys.argv = ["geomphys", *sys.argv[4:]]
    from geomphys_cli import signals
    from geomphys_cli.entry import main as run

    signals.INTERVAL_S = INTERVAL_S
    sys.meta_path.insert(0, forks)
    try:
        run()
    except SystemExit as end:
        sys.stderr.flush()
        sys.stdout.flush()
        if forks.is_child:
            os._exit(end.code if isinstance(end.code, int) else 1)
        if forks.later:
            sys.__stdout__.write(json.dumps({"later": forks.later}) + "\n")
        raise


if __name__ == "__main__":
    main()
