"""What is compiled, and under which name its products are kept: a kernel for certain types of arguments."""

from __future__ import annotations

import hashlib
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
