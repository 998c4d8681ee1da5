"""Locks a folder behind a URL for one batch, by an object that names its owner.

The object is created by a conditional write, of which a store lets only one succeed. It remains when its batch is
killed. The same user on the same machine can then replace it: a running batch also locks a file in the user's cache
(``flock``), and the object holds that file's random identity.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import socket
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from typing import Any

from geomphys.errors import OutputError
from geomphys.storage.cache import user_cache_folder
from geomphys.storage.remote_files import RemotePath

LOCK = "lock.json"
"""Name of the object."""


def lock_or_refuse(file: int, busy: str) -> None:
    """Lock an open file or folder until it is closed; raises OutputError, which begins with `busy`, if it is locked."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as problem:
        raise OutputError(f"{busy}; wait for it, or choose another folder") from problem


@contextmanager
def remote_lock_held(path: RemotePath) -> Iterator[None]:
    """Hold the object at `path` in the block.

    Raises OutputError if another batch holds it, naming who and how to remove what a crashed one left.
    """
    local = _open_local(path)
    try:
        lock_or_refuse(local, f"{_folder(path)}: another batch of this machine is at work there")
        own_record = {
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "began": datetime.now(UTC).isoformat(timespec="seconds"),
            "machine": _identity(local),
            "batch": uuid.uuid4().hex,
        }
        _acquire(path, own_record)
        try:
            yield
        finally:
            _release(path, own_record)
    finally:
        os.close(local)


def _acquire(path: RemotePath, own_record: dict[str, Any]) -> None:
    """Create the object, replacing one left by a batch of this machine that no longer runs."""
    data = (json.dumps(own_record, indent=1) + "\n").encode()
    try:
        existing = _read(path)
        if existing is not None and _is_from_same_machine(
            existing, own_record
        ):  # a running batch would hold the local lock
            path.unlink(missing_ok=True)
        path.create(data)
        holder = _read(path)
    except FileExistsError:
        raise _refused(path, _read_or_none(path)) from None
    except OSError as problem:
        raise OutputError(f"{path}: cannot be written ({problem.strerror or problem})") from problem
    if holder != own_record:  # the store does not support conditional writes
        raise _refused(path, holder)


def _release(path: RemotePath, own_record: dict[str, Any]) -> None:
    try:
        if _read(path) == own_record:
            path.unlink(missing_ok=True)
    except OSError as problem:
        raise OutputError(f"{path}: cannot be removed ({problem.strerror or problem}); remove it") from problem


def _is_from_same_machine(existing: dict[str, Any], own_record: dict[str, Any]) -> bool:
    return all(existing.get(key) == own_record[key] for key in ("host", "machine"))


def _refused(path: RemotePath, holder: dict[str, Any] | None) -> OutputError:
    holder = holder or {}
    host, pid, began = (str(holder.get(key, "unknown"))[:100] for key in ("host", "pid", "began"))
    return OutputError(
        f"{_folder(path)}: another batch is at work there (process {pid} on {host!r} since {began}); wait for it, choose "
        f"another folder, or, if that process is no more, remove {path}"
    )


def _read(path: RemotePath) -> dict[str, Any] | None:
    """Content of the object: None if it does not exist, empty if it is not a lock; raises OSError."""
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}


def _read_or_none(path: RemotePath) -> dict[str, Any] | None:
    try:
        return _read(path)
    except OSError:
        return None


def _folder(path: RemotePath) -> RemotePath:
    """The folder of the batch."""
    return path.parent.parent


def _open_local(path: RemotePath) -> int:
    """The file of this user and machine that is locked while a batch works at that URL."""
    local = user_cache_folder("locks") / hashlib.sha256(str(path).encode()).hexdigest()[:32]
    try:
        return os.open(local, os.O_CREAT | os.O_RDWR, 0o600)
    except OSError as problem:
        raise OutputError(f"{local}: cannot be written ({problem.strerror or problem})") from problem


def _identity(local: int) -> str:
    """Random identity of the locked file, which distinguishes users and machines; written when it is first locked."""
    found = os.pread(local, 64, 0).decode("ascii", "replace")
    if len(found) != 32:
        found = uuid.uuid4().hex
        os.ftruncate(local, 0)
        os.pwrite(local, found.encode(), 0)
    return found
