"""Child processes that end with their parent, however it ends: ``python -m geomphys.storage.child_process PID PROGRAM …``.

Linux ends a process when its parent ends if the process has asked for that (``prctl(PR_SET_PDEATHSIG)``); the request
outlives ``exec``. It goes by the thread that started the process, which must therefore wait for it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Sequence

_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int) -> None:
    """End this process (SIGKILL) when its parent, the process `parent`, ends; at once if it has already."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def ending_with_this_process(command: Sequence[str]) -> list[str]:
    """The command that runs another program so that it ends with this process."""
    return [sys.executable, "-P", "-m", __name__, str(os.getpid()), *command]


def available_cores() -> int:
    """Number of processor cores available to this process and its children."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def is_pool_worker() -> bool:
    """Whether this process was begun to share work with others, by Python's `multiprocessing` or what builds on it."""
    loaded = sys.modules.get("multiprocessing.process")  # of a worker it is
    return loaded is not None and loaded.parent_process() is not None


if __name__ == "__main__":
    end_with_parent(int(sys.argv[1]))
    os.execv(sys.argv[2], sys.argv[2:])
