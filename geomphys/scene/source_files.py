"""Tracks the files a world is loaded from, so that a cached world can be checked for changes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from geomphys.storage.remote_files import AnyPath


@dataclass
class Sources:
    """Files read and paths probed while a world was loaded."""

    contents: dict[AnyPath, str] = field(default_factory=dict)
    """Absolute path of each file read -> SHA-256 of its content."""
    existing: dict[AnyPath, bool] = field(default_factory=dict)
    """Absolute path of each file probed -> whether it existed."""

    def are_unchanged(self) -> bool:
        """Whether all files and probes give the same result now."""
        try:
            return all(path.exists() == found for path, found in self.existing.items()) and all(
                _digest(path.read_bytes()) == digest for path, digest in self.contents.items()
            )
        except OSError:
            return False


_active_sources: ContextVar[Sources | None] = ContextVar("_active_sources", default=None)


@contextmanager
def tracked_sources() -> Iterator[Sources]:
    """Record the files read within the block, also for an enclosing block."""
    sources = Sources()
    token = _active_sources.set(sources)
    try:
        yield sources
    finally:
        _active_sources.reset(token)
        track_sources(sources)


def track_sources(read: Sources) -> None:
    """Record files that were read before, such as those of a cached world."""
    sources = _active_sources.get()
    if sources is not None:
        sources.contents |= read.contents
        sources.existing |= read.existing


def track_contents(path: AnyPath, data: bytes) -> bytes:
    """Record the content read from a file; returns `data`."""
    sources = _active_sources.get()
    if sources is not None:
        sources.contents[path.absolute()] = _digest(data)
    return data


def path_exists(path: AnyPath) -> bool:
    """Whether a path exists, recorded; False for names that cannot be paths."""
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
