"""Output files: complete under their name or not there, never over an input, on disk when they are there.

Every file of every command is an `OutputFile`. It is written under a temporary name in the target's folder (made with
``O_EXCL`` and ``O_NOFOLLOW``, so that nothing that waits there is written through), flushed to disk (``fsync``), and
renamed; then the folder is flushed. Two processes that write one name both finish; the last one wins. The temporary
file is locked (``flock``) by its process: what a killed one left is removed by the next that writes the same name. A
fork of the process that writes has no part in the file: what it writes goes nowhere, and it ends nothing.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
import shutil
import stat
import sys
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from geomphys.errors import OutputError, RefusedTargetError
from geomphys.storage.deferred_signals import signals_deferred
from geomphys.storage.remote_files import AnyPath, RemotePath, is_remote
from geomphys.storage.temporary_folders import TemporaryFolder

STANDARD_OUTPUT = Path("-")
"""The path that stands for standard output."""

_NAME_BYTES = 180
"""Bytes of the target's name in the temporary one, which must stay within the 255 of a file system."""
_SUFFIX = ".tmp"
_ENDING = re.compile("[0-9a-f]{8}" + re.escape(_SUFFIX))


def is_standard_output(path: AnyPath | None) -> bool:
    """Whether a path is ``-``."""
    return path == STANDARD_OUTPUT


def partial_path(path: AnyPath) -> AnyPath:
    """Where the finished part of an output goes: ``STEM.partial.SUFFIX``."""
    return path.with_name(f"{path.stem}.partial{path.suffix}")


class InputFiles:
    """The files that a run reads: no output may be one of them under any name. Those that are not there count for nothing."""

    def __init__(self, paths: Iterable[AnyPath]) -> None:
        self._paths = dict.fromkeys(paths)

    @cached_property
    def _local(self) -> dict[tuple[int, int], Path]:
        """By device and inode; looked up when first asked for, which is where a file has an output's name already."""
        found: dict[tuple[int, int], Path] = {}
        for path in self._paths:
            if isinstance(path, Path):
                with suppress(OSError):
                    about = path.stat()
                    found.setdefault((about.st_dev, about.st_ino), path)
        return found

    def at(self, device_and_inode: tuple[int, int]) -> Path | None:
        """The input that is this file."""
        return self._local.get(device_and_inode)

    def __contains__(self, path: RemotePath) -> bool:
        return path in self._paths


def check_target(
    path: AnyPath, *, force: bool = False, inputs: InputFiles | Iterable[AnyPath] = (), partial: bool = False
) -> None:
    """Refuse a path that an output must not be written to.

    Parameters
    ----------
    path : Path
        The file to be written; ``-``, standard output, is never refused.
    force : bool
        Whether a file that is there may be replaced.
    inputs : InputFiles or iterable of Path
        The files that are read: refused under any name (by inode). Folders among them are not looked into.
    partial : bool
        Whether what is finished may be left in `partial_path`, which is then checked too.

    Raises
    ------
    RefusedTargetError
        It is an input, exists without `force`, or is a folder, a device or another thing than a regular file.
    OutputError
        Its folder does not exist, or cannot be looked into.
    """
    if is_standard_output(path):
        return
    read = inputs if isinstance(inputs, InputFiles) else InputFiles(inputs)
    for target in (path, partial_path(path)) if partial else (path,):
        try:
            if is_remote(target):
                _check_remote(target, force, read)
            else:
                _check_local(target, force, read)
        except (OSError, ValueError) as problem:
            raise _not_written(path, problem) from problem


def check_targets(
    paths: Sequence[AnyPath], *, force: bool = False, inputs: Iterable[AnyPath] = (), partial: bool = False
) -> None:
    """Refuse paths of one run as `check_target` does, and the same path twice."""
    read = InputFiles(inputs)
    for number, path in enumerate(paths):
        check_target(path, force=force, inputs=read, partial=partial)
        for other in paths[:number]:
            if path == other or (not is_remote(path) and not is_remote(other) and _is_same(path, other)):
                raise RefusedTargetError(f"{path}: is named for two outputs; give them different names")


def _is_same(path: Path, other: Path) -> bool:
    """Whether two files, which need not exist, have one name once links are followed."""
    return path.name == other.name and path.parent.resolve() == other.parent.resolve()


def publish(source: Path, target: AnyPath, *, durable: bool = True) -> None:
    """Give a complete local file its name: rename, or upload; if `durable`, it is on disk when this returns. Raises OSError."""
    if is_remote(target):
        target.put(source)
        source.unlink()
        return
    _refuse_irregular(target)
    if durable:
        _sync(source)
    os.replace(source, target)
    with suppress(PermissionError):  # a folder that may be written to but not be read
        if durable:
            _sync(target.parent)


_flushed_later: ContextVar[bool] = ContextVar("flushed_later", default=False)


@contextmanager
def flushed_later() -> Iterator[None]:
    """In the block an `OutputFile` is not flushed to disk: the caller gives it its final name by `publish`, which does that."""
    before = _flushed_later.set(True)
    try:
        yield
    finally:
        _flushed_later.reset(before)


class OutputFile:
    """A file that appears under its name only when it is complete.

    In a ``with`` block it is published at the end, and discarded if an exception ends the block. Otherwise call `publish`
    or `discard`; a process that ends without either leaves nothing. In a fork of the process that made it `discard` does
    nothing, nor does `publish` of a part, and what is written to `stream` goes nowhere.

    Parameters
    ----------
    path : Path
        Where the complete file goes: a path, the URL of a store, or ``-`` for standard output, which gets it when it is
        complete.
    force, inputs, partial
        See `check_target`.

    Raises
    ------
    OutputError
        See `check_target`; or no file can be made in the folder.
    """

    def __init__(
        self, path: AnyPath, *, force: bool = False, inputs: Iterable[AnyPath] = (), partial: bool = False
    ) -> None:
        check_target(path, force=force, inputs=inputs, partial=partial)
        self.path = path
        self._maker = os.getpid()
        with signals_deferred():  # else one could fall between the file and what removes it
            try:
                if is_remote(path) or is_standard_output(path):
                    folder = TemporaryFolder()
                    self.temporary, descriptor = _new_file(folder.path, f"result{path.suffix}")
                    close = folder.close
                else:
                    assert isinstance(path, Path)
                    _remove_stale(path)
                    self.temporary, descriptor = _new_file(path.parent, path.name)
                    close = _nothing
            except OSError as problem:
                raise self.error(problem) from problem
            self.stream: BinaryIO = os.fdopen(descriptor, "wb")
            """Writes the file. A library that wants a name is given `temporary` instead."""
            self._end = weakref.finalize(self, _discard, self._maker, self.temporary, self.stream, close)
            _unfinished.add(self)

    @property
    def is_of_this_process(self) -> bool:
        """Whether this process made it, and is no fork of the one that did."""
        return os.getpid() == self._maker

    def publish(self, complete: bool = True) -> AnyPath:
        """Give the file its name, or `partial_path` if it is not `complete`; returns it.

        Raises OutputError; in a fork of the process that made it too, if it is `complete`.
        """
        to_standard_output = is_standard_output(self.path)
        target = self.path if complete or to_standard_output else partial_path(self.path)
        if not self.is_of_this_process:
            self.discard()
            if complete:
                raise OutputError(f"{self.path}: is written by the process that this one is a fork of")
            return target
        try:
            self.stream.flush()
            if to_standard_output:
                _copy_to_standard_output(self.temporary)
            else:
                publish(self.temporary, target, durable=not _flushed_later.get())
        except BrokenPipeError:  # nobody reads standard output any more
            raise
        except OSError as problem:
            raise self.error(problem) from problem
        finally:
            self.discard()
        return target

    def discard(self) -> None:
        """Remove what is under the temporary name; does nothing once the file is published or discarded."""
        self._end()

    def error(self, problem: OSError) -> OutputError:
        """The OutputError for an error of the file system."""
        return _not_written(self.path, problem)

    def __enter__(self) -> OutputFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.publish()
            return
        self.discard()
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            raise self.error(error) from error


_unfinished: weakref.WeakSet[OutputFile] = weakref.WeakSet()


def _release_in_fork() -> None:
    """In a fork: write to nothing what is buffered or still comes, as the files' positions are shared with the parent."""
    open_streams = [output.stream for output in _unfinished if not output.stream.closed]
    if not open_streams:
        return
    nothing = os.open(os.devnull, os.O_WRONLY | os.O_CLOEXEC)
    for stream in open_streams:
        os.dup2(nothing, stream.fileno(), inheritable=False)
    os.close(nothing)


os.register_at_fork(after_in_child=_release_in_fork)


def write_file(path: AnyPath, data: bytes, *, force: bool = False, inputs: Iterable[AnyPath] = ()) -> None:
    """Write a whole file as an `OutputFile`; raises OutputError."""
    with OutputFile(path, force=force, inputs=inputs) as output:
        output.stream.write(data)


def _check_local(path: Path, force: bool, inputs: InputFiles) -> None:
    if not path.parent.is_dir():
        raise OutputError(f"{path}: the folder {path.parent} does not exist; make it first")
    try:
        named = path.lstat()
    except FileNotFoundError:
        return
    _refuse_irregular(path)
    identity = (named.st_dev, named.st_ino)
    if stat.S_ISLNK(named.st_mode):
        with suppress(FileNotFoundError):  # the link leads nowhere
            identity = (path.stat().st_dev, path.stat().st_ino)
    read = inputs.at(identity)
    if read is not None:
        raise RefusedTargetError(f"{path}: is an input ({read}) and cannot be the output too; choose another name")
    if not force:
        raise RefusedTargetError(f"{path}: exists already; choose another name or use --force to replace it")


def _refuse_irregular(path: Path) -> None:
    """Raise RefusedTargetError for what is there and is no regular file, nor a link to one."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return
    if stat.S_ISDIR(mode):
        raise RefusedTargetError(f"{path}: is a folder; name a file in it")
    if not stat.S_ISREG(mode):
        raise RefusedTargetError(f"{path}: is no regular file; name a file, or - for standard output")


def _check_remote(path: RemotePath, force: bool, inputs: InputFiles) -> None:
    if not path.lists:
        raise RefusedTargetError(
            f"{path}: a web server takes no files; write to a local path or to a store such as s3://"
        )
    if path in inputs:
        raise RefusedTargetError(f"{path}: is an input and cannot be the output too; choose another name")
    if not force and path.exists():
        raise RefusedTargetError(f"{path}: exists already; choose another name or use --force to replace it")


def _new_file(folder: Path, name: str) -> tuple[Path, int]:
    """A new file with a hidden unique name, open for writing and locked."""
    stem = _stem(name)
    while True:
        path = folder / f"{stem}{secrets.token_hex(4)}{_SUFFIX}"
        try:
            descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_RDWR, 0o666)
        except FileExistsError:
            continue
        with suppress(OSError):  # a file system without locks, where nothing is taken for stale either
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        if os.fstat(descriptor).st_nlink:
            return path, descriptor
        os.close(descriptor)  # taken for stale before it was locked


def _remove_stale(target: Path) -> None:
    """Remove temporary files of this target whose process has ended."""
    stem, found = _stem(target.name), list[str]()
    with suppress(PermissionError), os.scandir(target.parent) as entries:
        for entry in entries:
            if entry.name.startswith(stem) and _ENDING.fullmatch(entry.name, len(stem)):
                found.append(entry.path)
    for name in found:
        with suppress(OSError):  # another user's, no file, just removed, in use, or locks do not work here
            descriptor = os.open(name, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                about = os.fstat(descriptor)
                if stat.S_ISREG(about.st_mode) and about.st_uid == os.getuid():
                    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    os.unlink(name)
            finally:
                os.close(descriptor)


def _stem(name: str) -> str:
    """Beginning of the temporary names of a target."""
    return f".{os.fsdecode(os.fsencode(name)[:_NAME_BYTES])}."


def _sync(path: Path) -> None:
    """Flush a file or folder to disk, on file systems that can."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    except OSError as problem:
        if problem.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(descriptor)


def _copy_to_standard_output(path: Path) -> None:
    with path.open("rb") as stream:
        shutil.copyfileobj(stream, sys.stdout.buffer, 2**20)
    sys.stdout.buffer.flush()


def _discard(maker: int, temporary: Path, stream: BinaryIO, close: Callable[[], None]) -> None:
    with suppress(OSError):  # renamed, or the folder has gone
        if os.getpid() == maker:
            temporary.unlink()
    with suppress(OSError):  # of what could not be written; the file is gone
        stream.close()
    close()


def _nothing() -> None:
    """Close nothing."""


def _not_written(path: AnyPath, problem: OSError | ValueError) -> OutputError:
    reason = getattr(problem, "strerror", None) or problem
    return OutputError(f"{path}: cannot be written ({reason}); is the disk full or the folder read-only?")
