"""Temporary folders that do not pile up: what a killed process left is removed when the next one needs such a folder.

Each folder holds a file that its process keeps locked (``flock``); the kernel lets go of the lock however the process
ends. Only a folder with such a file, of this user, whose lock is free, is removed: nothing else is ever touched.
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
"""Name of the locked file. It is locked under another name first, so that nobody finds it unlocked."""


class TemporaryFolder:
    """A new temporary folder, removed by `close`, at the end of a ``with`` block, of this object or of the process.

    The first one of a process removes what killed processes left. Raises OSError if none can be made.
    """

    def __init__(self) -> None:
        _remove_stale_once(tempfile.gettempdir())
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        unfinished = self.path / f"{LOCK}.new"
        lock = os.open(unfinished, os.O_CREAT | os.O_RDWR, 0o600)
        self._remove = weakref.finalize(self, _remove, self.path, lock)
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


def sweep(folder: Path) -> None:
    """Remove the temporary folders in `folder` that processes of this user left which are gone."""
    for found in folder.glob(f"{PREFIX}*"):
        try:
            status = found.lstat()
            if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.getuid():
                continue
            lock = os.open(found / LOCK, os.O_RDWR | os.O_NOFOLLOW)
        except OSError:  # somebody else's, without the file, or just removed
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:  # in use, or on a file system without locks
            os.close(lock)
            continue
        _remove(found, lock)


@lru_cache(maxsize=4)
def _remove_stale_once(folder: str) -> None:
    sweep(Path(folder))


def _remove(folder: Path, lock: int) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    os.close(lock)
