"""Another process that compiles for one: ``python -m geomphys.jit.helper``, keys of kernels on its standard input.

What it makes it leaves on disk. It ends when all is there, or is ended by the process it helps.
"""

from __future__ import annotations

import pickle
import signal
import sys

from geomphys.jit.work import undisturbed, work


def main() -> None:
    """Compile what is asked for, the last first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process it helps decides
    with undisturbed():
        work(pickle.load(sys.stdin.buffer), load=False, newest_first=True)


if __name__ == "__main__":
    main()
