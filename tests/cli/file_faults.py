"""A command whose n-th open, write, fsync or rename fails: ``python file_faults.py OUTPUTS WORDS…``, for every n.

OUTPUTS is the folder of its outputs: calls on files in it are counted, and fail one after the other. After each run the
folder is put back to what it was. Prints a JSON line for each: the call, n, the exit code, what was said, what is left.
A batch runs its jobs in this process, and the demonstration is that of the small log beside OUTPUTS.
"""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from geomphys_cli.main import run

import geomphys
import geomphys.authoring.demo_files
import geomphys.batch.run
from geomphys.authoring.demo_files import DemoFiles
from tests.cli.batch_here import run_here

CALLS = ("open", "write", "fsync", "replace")


class Faults:
    """Counts the calls of one kind that concern the folder; the one with number `failing` raises OSError."""

    def __init__(self, folder: Path, call: str, failing: int) -> None:
        self.folder, self.call, self.failing, self.count = str(folder.resolve()), call, failing, 0

    def concerns(self, target: Any) -> bool:
        """Whether a path or descriptor is in the folder."""
        try:
            path = (
                os.readlink(f"/proc/self/fd/{target}")
                if isinstance(target, int)
                else os.path.abspath(os.fspath(target))
            )
        except (OSError, TypeError):
            return False
        return f"{path}/".startswith(f"{self.folder}/")

    def check(self, call: str, target: Any) -> None:
        """Raise at the call that is to fail."""
        if call == self.call and self.concerns(target):
            self.count += 1
            if self.count == self.failing:
                raise OSError(errno.ENOSPC if call == "write" else errno.EIO, "made to fail", str(target))


class FaultyWriter(io.BufferedWriter):
    """A buffered file whose writes are counted; a buffer of one write makes each reach the file."""

    faults: Faults

    def write(self, data: Any) -> int:
        """Write, or fail."""
        self.faults.check("write", self.raw.fileno())
        return super().write(data)


@contextlib.contextmanager
def installed(faults: Faults) -> Iterator[None]:
    """Within the block the calls fail as they are to."""
    kept = {name: getattr(os, name) for name in ("open", "fsync", "replace", "fdopen")}

    def wrapped(name: str) -> Callable[..., Any]:
        def call(target: Any, *more: Any, **options: Any) -> Any:
            if name != "open" or (more and more[0] & (os.O_CREAT | os.O_WRONLY | os.O_RDWR)):
                faults.check(name, more[0] if name == "replace" else target)
            return kept[name](target, *more, **options)

        return call

    def fdopen(descriptor: int, mode: str = "r", *more: Any, **options: Any) -> Any:
        if mode != "wb" or not faults.concerns(descriptor):
            return kept["fdopen"](descriptor, mode, *more, **options)
        writer = FaultyWriter(io.FileIO(descriptor, "wb"))
        writer.faults = faults
        return writer

    for name in ("open", "fsync", "replace"):
        setattr(os, name, wrapped(name))
    os.fdopen = fdopen
    try:
        yield
    finally:
        for name, function in kept.items():
            setattr(os, name, function)


def listing(folder: Path) -> dict[str, bytes]:
    """Files below a folder and what they hold."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def restore(folder: Path, before: dict[str, bytes]) -> None:
    """Put a folder back to what it was."""
    for name in listing(folder).keys() - before.keys():
        (folder / name).unlink()
    for path in sorted(folder.rglob("*"), reverse=True):
        if path.is_dir() and not any(path.iterdir()):
            path.rmdir()
    for name, data in before.items():
        (folder / name).write_bytes(data)


def main() -> None:
    """Fail each call in turn."""
    folder, words = Path(sys.argv[1]), sys.argv[2:]
    geomphys.batch.run.run_in_processes = run_here
    files = DemoFiles(folder.parent / "press.mcap", folder.parent / "press.toml")
    geomphys.authoring.demo_files.demo_files = lambda: files
    before = listing(folder)
    for call in CALLS:
        failing = 0
        while True:
            failing += 1
            faults = Faults(folder, call, failing)
            said = io.StringIO()
            with installed(faults), contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
                code = run(words)
            left = listing(folder)
            changed = sorted(name for name, data in left.items() if before.get(name) != data)
            lost = sorted(before.keys() - left.keys())
            logs = [name for name in changed if name.endswith(".mcap") and ".partial." not in name]
            broken = [name for name in logs if not geomphys.open_output(folder / name).complete]
            restore(folder, before)
            if faults.count < failing:
                break
            end = {
                "call": call,
                "number": failing,
                "code": code,
                "said": said.getvalue(),
                "changed": changed,
                "lost": lost,
                "broken": broken,
            }
            sys.__stdout__.write(json.dumps(end) + "\n")  # type: ignore[union-attr]


if __name__ == "__main__":
    main()
