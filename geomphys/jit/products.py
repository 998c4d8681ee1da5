"""Machine code on disk: what numba cached of a kernel, guarded against damage and against two processes at once."""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import IO, Any, NamedTuple

import numba

from geomphys.jit.folder import cache_folder, store

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

    needs: bytes  # keys of the outlined kernels it jumps to, pickled
    files: dict[str, bytes]  # digests of the files numba keeps it in

    def callees(self) -> list[Key]:
        """Keys of the outlined kernels it jumps to."""
        keys: list[Key] = pickle.loads(self.needs)
        return keys


@lru_cache(maxsize=4096)
def symbol_of(key: Key) -> str:
    """Name of the machine code of a kernel: the same in all processes, and fit for a file."""
    digest = hashlib.sha256(f"{key.stamp} {key.types}".encode()).hexdigest()[:16]
    return f"{key.module}.{key.name}.{digest}"


class Place:
    """The folder numba keeps one kernel in, and the product that vouches for what is there.

    numba trusts the files it finds. A product holds their digests: files that it does not vouch for are deleted.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.folder = cache_folder() / f"{name}.numba"

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
            self.folder.mkdir(exist_ok=True)
            return (self.folder / LOCK).open("wb")
        except OSError:  # nothing can be written, so nothing would be found
            return Path("/dev/null").open("wb")

    def peek(self) -> Product | None:
        """The product, if there is one."""
        product: Product | None = store().load(self.name)
        return product

    def find(self) -> Product | None:
        """The product, if the files are as it says; else there are none any more. To be called when locked."""
        product = self.peek()
        if product is not None and self._digests() == product.files:
            return product
        for path in self.folder.glob("*"):
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
        return None

    def save(self, needs: Sequence[Key]) -> None:
        """Vouch for the files that are here now."""
        store().save(self.name, Product(pickle.dumps(list(needs)), self._digests()))

    def _digests(self) -> dict[str, bytes]:
        paths = sorted(path for path in self.folder.rglob("*") if path.is_file() and path.name != LOCK)
        return {str(path.relative_to(self.folder)): hashlib.sha256(path.read_bytes()).digest() for path in paths}

    def make(self, compiled: Callable[[bool], Any]) -> Any:
        """Call `compiled` so that numba keeps its files here, with whether it can keep any."""
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = str(self.folder)
        try:
            return compiled(os.access(self.folder, os.W_OK))
        except OSError:  # no space is left, or the like
            return compiled(False)
        finally:
            numba.config.CACHE_DIR = before
