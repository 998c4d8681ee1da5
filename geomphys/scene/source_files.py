"""The files a world is made of: who reads one says so here, and a world that was kept is good as long as they are the same."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Sources:
    """What was found in the file system."""

    contents: dict[Path, str] = field(default_factory=dict)
    """SHA-256 of what was read of each file, by its absolute path."""
    there: dict[Path, bool] = field(default_factory=dict)
    """Where something was looked for, and whether it was there."""

    def are_unchanged(self) -> bool:
        """Whether all would be found the same now."""
        try:
            return all(path.exists() == found for path, found in self.there.items()) and all(
                _digest(path.read_bytes()) == digest for path, digest in self.contents.items()
            )
        except OSError:
            return False


_noting: ContextVar[Sources | None] = ContextVar("_noting", default=None)


@contextmanager
def noted_sources() -> Iterator[Sources]:
    """Note what is read within the block."""
    sources = Sources()
    token = _noting.set(sources)
    try:
        yield sources
    finally:
        _noting.reset(token)


def note_contents(path: Path, data: bytes) -> bytes:
    """Note what was read of a file; returns it."""
    sources = _noting.get()
    if sources is not None:
        sources.contents[path.absolute()] = _digest(data)
    return data


def is_there(path: Path) -> bool:
    """Look for something, and note whether it is there; what cannot be a path is not."""
    try:
        found = path.exists()
    except (OSError, ValueError):
        return False
    sources = _noting.get()
    if sources is not None:
        sources.there[path.absolute()] = found
    return found


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
