"""Disk caches in the user's cache folder: compiled kernels, convex decompositions, loaded worlds."""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

DIGEST_SIZE = hashlib.sha256().digest_size


@lru_cache(maxsize=16)
def user_cache_folder(name: str) -> Path:
    """A folder of this name in the user's cache, created on first use.

    ``$XDG_CACHE_HOME/geomphys`` (default ``~/.cache/geomphys``); the system's temporary folder where that is not
    writable, and a new temporary folder where even that belongs to someone else.
    """
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    shared = Path(tempfile.gettempdir()) / f"geomphys-{os.getuid()}"
    for base in (Path(home) / "geomphys", shared):
        folder = base / name
        try:
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            folder.mkdir(exist_ok=True)
            if os.access(folder, os.W_OK) and (base != shared or _is_own(base)):
                return folder
        except OSError:
            continue
    return Path(tempfile.mkdtemp(prefix="geomphys-"))


def _is_own(folder: Path) -> bool:
    """Whether a folder in a shared place belongs to this user and nobody else can write to it."""
    about = folder.lstat()
    return stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o022


@lru_cache(maxsize=1)
def sources() -> dict[str, bytes]:
    """Text of every module of the package, by the module's name (``geomphys.scene.arrays``)."""
    package = Path(__file__).parents[1]
    texts = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        texts[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path.read_bytes()
    return texts


class Store:
    """Pickled objects by name in a folder; writes are atomic, so concurrent processes never read a partial file.

    Unpickling runs code, so the folder must belong to the user: see `user_cache_folder`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def has(self, name: str) -> bool:
        """Whether an object of this name is stored."""
        return (self.folder / name).is_file()

    def load(self, name: str) -> Any:
        """Return an object; None if it is missing or damaged."""
        try:
            data = (self.folder / name).read_bytes()
        except OSError:
            return None
        digest, product = data[:DIGEST_SIZE], data[DIGEST_SIZE:]
        return pickle.loads(product) if hashlib.sha256(product).digest() == digest else None

    def save(self, name: str, product: Any) -> None:
        """Store an object. A failure to write is ignored: it will be computed again."""
        draft = self.folder / f"{name}.{os.getpid()}"
        try:
            data = pickle.dumps(product, protocol=pickle.HIGHEST_PROTOCOL)
            draft.write_bytes(hashlib.sha256(data).digest() + data)
            draft.replace(self.folder / name)
        except OSError:
            draft.unlink(missing_ok=True)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Hold the folder's lock within the block: other processes wait."""
        try:
            lock = (self.folder / "lock").open("w")
        except OSError:  # read-only: nothing to protect
            yield
            return
        with lock:
            with suppress(OSError):  # a file system without locks: work may be done twice
                fcntl.flock(lock, fcntl.LOCK_EX)
            yield
