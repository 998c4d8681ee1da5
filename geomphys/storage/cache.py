"""Disk caches in the user's cache folder: compiled kernels, convex decompositions, loaded worlds."""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from geomphys.storage.records import RecordError, decode, encode
from geomphys.storage.temporary_folders import TemporaryFolder

DIGEST_SIZE = hashlib.sha256().digest_size

UNUSED_S = 30 * 86_400
"""s; folders of other versions that were used within this time are left alone."""

REMOVED = ".removed-"
"""Between the name of a folder that is being removed and a random number."""

_temporary: dict[str, TemporaryFolder] = {}
"""Caches of this process alone, removed at its end."""


@lru_cache(maxsize=16)
def user_cache_folder(name: str) -> Path:
    """A folder of this name in the user's cache, created on first use.

    ``$XDG_CACHE_HOME/geomphys`` (default ``~/.cache/geomphys``), else a folder in the system's temporary one. Only
    folders that belong to this user and that nobody else can write to are used; without any, a temporary one that ends
    with the process. Raises OSError if not even that can be made.
    """
    for base in _bases():
        folder = base / name
        try:
            base.mkdir(mode=0o700, parents=True, exist_ok=True)
            if is_private(base):
                folder.mkdir(mode=0o700, exist_ok=True)
                if is_private(folder) and os.access(folder, os.W_OK):
                    return folder
        except OSError:
            continue
    if name not in _temporary:
        _temporary[name] = TemporaryFolder()
    return _temporary[name].path


def _bases() -> Iterator[Path]:
    """Where the user's cache may be."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(named):
        yield Path(named) / "geomphys"
    else:
        with suppress(RuntimeError):  # neither $HOME nor a passwd entry
            yield Path.home() / ".cache" / "geomphys"
    yield Path(tempfile.gettempdir()) / f"geomphys-{os.getuid()}"


def is_private(path: Path) -> bool:
    """Whether a folder or regular file belongs to this user and nobody else can write to it; a link never does."""
    about = path.lstat()
    is_plain = stat.S_ISDIR(about.st_mode) or stat.S_ISREG(about.st_mode)
    return is_plain and about.st_uid == os.getuid() and not about.st_mode & 0o022


def remove_unused(folder: Path, names: re.Pattern[str]) -> None:
    """Mark a folder as used now, and remove those beside it with such names that were not for `UNUSED_S`.

    The mark is the modification time. A folder is renamed before it is removed, so a process that starts meanwhile finds
    all of it or nothing; one that was marked at that moment gets its name back. What a crash leaves renamed is removed later.
    """
    if not names.fullmatch(folder.name):
        return  # the temporary folder of a process, which has other programs' folders beside it
    oldest = time.time() - UNUSED_S
    with suppress(OSError):
        os.utime(folder)
        for other in folder.parent.iterdir():
            name = other.name.partition(REMOVED)[0]
            if names.fullmatch(name) and other.stat().st_mtime < oldest:
                _remove_if_unused(other, other.with_name(f"{name}{REMOVED}{secrets.token_hex(4)}"), oldest)


def _remove_if_unused(folder: Path, renamed: Path, oldest: float) -> None:
    """Remove a folder under another name, if it is this user's own and was not marked as used meanwhile."""
    with suppress(OSError):
        if is_private(folder):
            folder.rename(renamed)
            if renamed.stat().st_mtime < oldest:
                shutil.rmtree(renamed, ignore_errors=True)
            else:
                renamed.rename(folder)


PACKAGE = str(Path(__file__).parents[1])


@lru_cache(maxsize=1)
def sources() -> dict[str, bytes]:
    """Text of every module of the package, by the module's name (``geomphys.scene.arrays``)."""
    texts = {}
    for path in _source_files(PACKAGE):
        name = path[len(os.path.dirname(PACKAGE)) + 1 : -len(".py")].replace(os.sep, ".")
        with open(path, "rb") as stream:
            texts[name.removesuffix(".__init__")] = stream.read()
    return texts


@lru_cache(maxsize=4)
def installed_state(*libraries: str) -> str:
    """Digest of when and with which size the sources of the package, and these libraries, were written.

    It is another after every change of them, and takes a tenth of the time of reading them.
    """
    found = [spec.origin for spec in map(find_spec, libraries) if spec is not None and spec.origin is not None]
    about = [(path, os.stat(path)) for path in (*_source_files(PACKAGE), *found)]
    return hashlib.sha256(repr([(path, of.st_size, of.st_ctime_ns) for path, of in about]).encode()).hexdigest()


def _source_files(folder: str) -> Iterator[str]:
    """Paths of the modules in a folder and those below it, sorted by name."""
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            if entry.name.endswith(".py"):
                yield entry.path
            elif entry.name != "__pycache__" and entry.is_dir():
                yield from _source_files(entry.path)


class Store:
    """Values and records by name in a folder, see `geomphys.storage.records`: reading them runs no code.

    Writes are atomic, so concurrent processes never read a partial file. Each file holds its own digest; one that is
    damaged, or that others can write to, counts as missing.

    Parameters
    ----------
    folder : Path
    classes : iterable of type
        The records that are stored.
    """

    def __init__(self, folder: Path, classes: Iterable[type] = ()) -> None:
        self.folder = folder
        self._classes = tuple(classes)

    def load(self, name: str) -> Any:
        """Return a value; None if it is missing or damaged."""
        try:
            if not is_private(self.folder / name):
                return None
            data = (self.folder / name).read_bytes()
            digest, content = data[:DIGEST_SIZE], data[DIGEST_SIZE:]
            return decode(content, self._classes) if hashlib.sha256(content).digest() == digest else None
        except (OSError, RecordError):
            return None

    def save(self, name: str, value: Any) -> None:
        """Store a value. A failure to write is ignored: it will be computed again."""
        data = encode(value)
        draft = self.folder / f"{name}.{secrets.token_hex(4)}"
        try:
            descriptor = os.open(draft, os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC, 0o600)
            with os.fdopen(descriptor, "wb") as stream:
                stream.write(hashlib.sha256(data).digest() + data)
            draft.replace(self.folder / name)
        except OSError:
            with suppress(OSError):
                draft.unlink(missing_ok=True)
