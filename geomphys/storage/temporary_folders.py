"""Temporary folders that are removed even after a crash: the next process removes those of killed ones.

Each folder contains a file that its process keeps locked (``flock``); the kernel releases the lock when the process
ends. Only folders of this user with such a file and a free lock are removed.
"""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import tempfile
import weakref
from functools import lru_cache
from pathlib import Path
from types import TracebackType

PREFIX = "geomphys-"
LOCK = ".in-use"
"""Name of the locked file. It is locked before it gets this name, so it is never seen unlocked."""


class TemporaryFolder:
    """A new temporary folder, removed by `close`, at the end of a ``with`` block, of this object or of the process.

    The first one in a process removes those of killed processes. Raises OSError if none can be created.
    """

    def __init__(self) -> None:
        _remove_stale_once(tempfile.gettempdir())
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        unfinished = self.path / f"{LOCK}.new"
        lock = os.open(unfinished, os.O_CREAT | os.O_RDWR, 0o600)
        self._remove = weakref.finalize(self, _remove_own, os.getpid(), self.path, lock)
        fcntl.flock(lock, fcntl.LOCK_EX)
        unfinished.rename(self.path / LOCK)

    def close(self) -> None:
        """Remove the folder and all that is in it."""
        self._remove()

    def __enter__(self) -> Path:
        return self.path

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def remove_stale(folder: Path) -> None:
    """Remove the temporary folders in `folder` left by processes of this user that have ended."""
    for found in folder.glob(f"{PREFIX}*"):
        try:
            status = found.lstat()
            if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
                continue
            lock = os.open(found / LOCK, os.O_RDWR | os.O_NOFOLLOW)
        except OSError:  # another user's, without the lock file, or just removed
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # in use, or on a file system without locks
            os.close(lock)
            continue
        _remove(found, lock)


@lru_cache(maxsize=4)
def _remove_stale_once(folder: str) -> None:
    remove_stale(Path(folder))


def _remove_own(maker: int, folder: Path, lock: int) -> None:
    """Remove a folder of this process; a fork of it leaves the folder alone."""
    if os.getpid() == maker:
        _remove(folder, lock)


def _remove(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)
