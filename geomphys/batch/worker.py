"""Initializer of the worker processes of a batch.

Module-level imports are cheap on purpose: the parent waits until the child has read its arguments, which requires this
module to be imported.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from multiprocessing.connection import wait

from geomphys.storage.deferred_signals import restore_signals


def initialize_worker(world: bytes) -> None:
    """Ignore Ctrl-C, exit when the parent exits, and preload the pickled world."""
    restore_signals()
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    from geomphys.batch.job import preload_world

    preload_world(pickle.loads(world))
