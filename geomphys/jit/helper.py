"""Another process that compiles for one: ``python -m geomphys.jit.helper PARENT``, keys of kernels on its standard input.

What it makes it leaves on disk. It ends when all is there, or with the process it helps.
"""

from __future__ import annotations

import json
import signal
import sys

from geomphys.jit.products import Key
from geomphys.jit.work import help_with, without_garbage_collection
from geomphys.storage.child_process import end_with_parent


def main(parent: int) -> None:
    """Compile what is asked for."""
    end_with_parent(parent)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process it helps decides
    with without_garbage_collection():
        entries, units = ([Key(*plain) for plain in keys] for keys in json.load(sys.stdin))
        help_with(entries, units)


if __name__ == "__main__":
    main(int(sys.argv[1]))
