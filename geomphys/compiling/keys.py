"""What is compiled, and under which name its products are kept: a kernel for certain types of arguments."""

from __future__ import annotations

import fcntl
import hashlib
import os
import pickle
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple


class Key(NamedTuple):
    """A kernel, and the types it is called with."""

    module: str
    name: str
    types: tuple[Any, ...]
    stamp: str
    """Tells versions of a kernel apart that stands outside the package; empty for one inside, see `cache_folder`."""


@lru_cache(maxsize=4096)
def symbol_of(key: Key) -> str:
    """Name of the machine code of a kernel: the same in all processes, and fit for a file."""
    digest = hashlib.sha256(f"{key.stamp} {key.types}".encode()).hexdigest()[:16]
    return f"{key.module}.{key.name}.{digest}"


@lru_cache(maxsize=256)
def stamp_of(source: Path) -> str:
    """Digest of a file."""
    return hashlib.sha256(source.read_bytes()).hexdigest()[:16] if source.is_file() else ""


class Store:
    """A folder of products that any process may write to at any time: none is ever seen half written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def has(self, name: str) -> bool:
        """Whether there is a product of this name."""
        return (self.folder / name).is_file()

    def load(self, name: str) -> Any:
        """Return a product; None if there is none, or none that can be read."""
        try:
            return pickle.loads((self.folder / name).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError):
            return None

    def save(self, name: str, product: Any) -> None:
        """Write a product. Where that is not possible it will be made again by whoever needs it next."""
        draft = self.folder / f"{name}.{os.getpid()}"
        try:
            draft.write_bytes(pickle.dumps(product, protocol=pickle.HIGHEST_PROTOCOL))
            draft.replace(self.folder / name)
        except OSError:
            draft.unlink(missing_ok=True)

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Within the block no other process is in such a block: those that come wait, and find what was made."""
        try:
            lock = (self.folder / "lock").open("w")
        except OSError:  # nothing can be written, so nothing would be found
            yield
            return
        with lock:
            with suppress(OSError):  # a file system without locks: the work is done twice
                fcntl.flock(lock, fcntl.LOCK_EX)
            yield
