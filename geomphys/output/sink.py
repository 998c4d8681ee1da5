"""The protocol of sinks, which receive the frames of a replay, and the shared handling of output files."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol

from geomphys.config import Config
from geomphys.errors import OutputError
from geomphys.output.provenance import Provenance
from geomphys.results import FrameResult
from geomphys.scene.arrays import World
from geomphys.storage.remote_files import AnyPath, RemotePath, is_remote, move
from geomphys.storage.temporary_folders import TemporaryFolder


class Sink(Protocol):
    """Receives frames in order: `open` once, `write` once a frame, `close` once."""

    def open(self, world: World, config: Config, provenance: Provenance) -> None:
        """Begin. Raises OutputError if the output cannot be made."""

    def write(self, result: FrameResult) -> None:
        """Take a frame. Raises OutputError if it cannot be written."""

    def close(self, complete: bool) -> None:
        """End; `complete` is false if frames are missing. Does nothing if the sink is not open."""


class ContextManaged:
    """Base of sinks usable in a ``with`` block, which closes them: complete, unless an exception ends the block."""

    def close(self, complete: bool) -> None:
        """See `Sink.close`."""
        raise NotImplementedError

    def __enter__(self) -> ContextManaged:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close(complete=error is None)


class OutputFile:
    """A file that appears under its name only when it is complete.

    It is written beside its target under a hidden name; `publish` renames it to the target, or, if it is not
    complete, to ``STEM.partial.SUFFIX``. A file behind a URL is written in the system's temporary folder, and `publish`
    sends it as a whole.

    Parameters
    ----------
    path : Path
        Where the complete file goes.
    force : bool
        Whether a file that is there may be replaced; without it OutputError is raised.
    """

    def __init__(self, path: AnyPath, force: bool = False) -> None:
        self.path = path
        self.partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        if is_remote(path):
            self._check_remote(path, force)
            self._folder = TemporaryFolder()
            self.temporary = self._folder.path / f"result{path.suffix}"
            return
        if not force and path.exists():
            raise OutputError(f"{path}: exists already; choose another name or use --force to replace it")
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file in it")
        if not path.parent.is_dir():
            raise OutputError(f"{path}: the folder {path.parent} does not exist; make it first")
        self.temporary = path.with_name(f".{path.name}.tmp")

    def publish(self, complete: bool) -> AnyPath:
        """Give the file its name; returns it. Raises OutputError if the folder refuses."""
        target = self.path if complete else self.partial
        try:
            move(self.temporary, target)
        except OSError as problem:
            raise self.error(problem) from problem
        return target

    def discard(self) -> None:
        """Remove the file if it was begun."""
        self.temporary.unlink(missing_ok=True)

    @staticmethod
    def _check_remote(path: RemotePath, force: bool) -> None:
        """Raise OutputError if a file cannot go to this URL."""
        if not path.lists:
            raise OutputError(f"{path}: a web server takes no files; write to a local path or to a store such as s3://")
        try:
            if path.exists() and not force:
                raise OutputError(f"{path}: exists already; choose another name or use --force to replace it")
        except OSError as problem:
            raise OutputError(f"{path}: cannot be written ({problem.strerror})") from problem

    def error(self, problem: OSError) -> OutputError:
        """The OutputError for an error of the file system."""
        return OutputError(
            f"{self.path}: cannot be written ({problem.strerror or problem}); is the disk full or the folder read-only?"
        )
