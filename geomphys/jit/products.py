"""Machine code on disk: what numba cached of a kernel, guarded against damage and against two processes at once."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import stat
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple

import numba

from geomphys.jit.folder import cache_folder, store
from geomphys.jit.type_records import text_of_type, type_of_text
from geomphys.storage.cache import is_private

LOCK = "lock"


class Key(NamedTuple):
    """A kernel, and the types it is compiled for."""

    module: str
    name: str
    types: tuple[Any, ...]
    stamp: str
    """Tells versions of a kernel apart that stands outside the package; empty inside it, see `cache_folder`."""


class Product(NamedTuple):
    """What is known of a kernel whose machine code is on disk."""

    needs: list[list[Any]]  # `plain_key` of each outlined kernel it jumps to
    files: dict[str, bytes]  # digests of the files numba keeps it in

    def callees(self) -> list[Key]:
        """Keys of the outlined kernels it jumps to."""
        return [key_of(plain) for plain in self.needs]


def plain_key(key: Key) -> list[Any]:
    """A key as JSON has values."""
    return [key.module, key.name, [text_of_type(kind) for kind in key.types], key.stamp]


def key_of(plain: Sequence[Any]) -> Key:
    """The key that `plain_key` was given."""
    module, name, texts, stamp = plain
    return Key(module, name, tuple(type_of_text(text) for text in texts), stamp)


@lru_cache(maxsize=4096)
def symbol_of(key: Key) -> str:
    """Name of the machine code of a kernel: the same in all processes, and fit for a file."""
    digest = hashlib.sha256(f"{key.stamp} {key.types}".encode()).hexdigest()[:16]
    return f"{key.module}.{key.name}.{digest}"


class CacheEntry:
    """The folder numba keeps one kernel in, and the product that vouches for what is there.

    numba trusts the files it finds, which are pickles. A product holds their digests: files that it does not vouch for are
    deleted before numba looks, and so are those of other users or in a folder that others can write to.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.folder = cache_folder() / f"{name}.numba"
        self._trusted = False  # numba may read what is there

    @contextmanager
    def locked(self, wait: bool) -> Iterator[bool]:
        """Within the block no other process reads or writes here; False if one is at it and `wait` is not set."""
        with self._lock_file() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            except BlockingIOError:
                yield False
                return
            except OSError:  # a file system without locks: the work is done twice
                pass
            yield True

    def _lock_file(self) -> IO[bytes]:
        try:
            self.folder.mkdir(mode=0o700, exist_ok=True)
            return (self.folder / LOCK).open("wb")
        except OSError:  # nothing can be written, so nothing would be found
            return Path("/dev/null").open("wb")

    def is_there(self) -> bool:
        """Whether there is a product, good or not."""
        return (cache_folder() / self.name).is_file()

    def peek(self) -> Product | None:
        """The product, if there is one."""
        content = store().load(self.name)
        return None if content is None else Product(content["needs"], content["files"])

    def find(self) -> Product | None:
        """The product, if the files are as it says; else there are none any more. To be called when locked."""
        product, found = self.peek(), self._digests()
        if product is not None and found is not None and found == product.files:
            self._trusted = True
            return product
        with suppress(OSError):
            if is_private(self.folder):
                for path in self.folder.iterdir():
                    if path.name != LOCK:
                        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
                self._trusted = True
        return None

    def save(self, needs: Sequence[Key]) -> None:
        """Vouch for the files that are here now."""
        files = self._digests()
        if files is not None:
            store().save(self.name, {"needs": [plain_key(key) for key in needs], "files": files})

    def _digests(self) -> dict[str, bytes] | None:
        """Digests of the files by their paths in the folder; None if another user could have put something there."""
        found: dict[str, bytes] = {}
        try:
            if not is_private(self.folder):
                return None
            for path in sorted(self.folder.rglob("*")):
                about = path.lstat()
                if about.st_uid != os.getuid() or stat.S_ISLNK(about.st_mode):
                    return None
                if stat.S_ISREG(about.st_mode) and path.name != LOCK:
                    found[str(path.relative_to(self.folder))] = hashlib.sha256(path.read_bytes()).digest()
        except OSError:
            return None
        return found

    def make(self, compiled: Callable[[bool], Any]) -> Any:
        """Call `compiled` so that numba keeps its files here, with whether it may; `find` says what is there first."""
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(self.folder)
        try:
            return compiled(self._trusted and os.access(self.folder, os.W_OK))
        except OSError:  # no space is left, or the like
            return compiled(False)
        finally:
            numba.config.CACHE_DIR = before
