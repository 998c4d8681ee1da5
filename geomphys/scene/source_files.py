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
    existing: dict[Path, bool] = field(default_factory=dict)
    """Where something was looked for, and whether it was there."""

    def are_unchanged(self) -> bool:
        """Whether all would be found the same now."""
        try:
            return all(path.exists() == found for path, found in self.existing.items()) and all(
                _digest(path.read_bytes()) == digest for path, digest in self.contents.items()
            )
        except OSError:
            return False


_active_sources: ContextVar[Sources | None] = ContextVar("_active_sources", default=None)


@contextmanager
def tracked_sources() -> Iterator[Sources]:
    """Note what is read within the block."""
    sources = Sources()
    token = _active_sources.set(sources)
    try:
        yield sources
    finally:
        _active_sources.reset(token)


def track_contents(path: Path, data: bytes) -> bytes:
    """Note what was read of a file; returns it."""
    sources = _active_sources.get()
    if sources is not None:
        sources.contents[path.absolute()] = _digest(data)
    return data


def path_exists(path: Path) -> bool:
    """Look for something, and note whether it is there; what cannot be a path is not."""
    try:
        found = path.exists()
    except (OSError, ValueError):
        return False
    sources = _active_sources.get()
    if sources is not None:
        sources.existing[path.absolute()] = found
    return found


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
