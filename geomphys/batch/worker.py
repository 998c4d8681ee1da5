"""A process of a batch, as it begins.

Nothing is imported here that takes long: the process that starts this one waits until all it sends is read, and it is
read only as far as what it names is imported.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
from multiprocessing.connection import wait

from geomphys.batch.deferred_signals import take_signals


def begin_worker(world: bytes) -> None:
    """Leave Ctrl-C to the parent, and end with it however it ends; keep the pickled world at hand."""
    take_signals()
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end_with_parent() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()
    from geomphys.batch.job import give_world

    give_world(pickle.loads(world))
