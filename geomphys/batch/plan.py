"""Finds the logs of a batch and names their outputs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from geomphys.errors import LogError, RefusedTargetError
from geomphys.recording.bag import METADATA
from geomphys.storage.remote_files import AnyPath, RemotePath, as_path, is_remote, lies_within, relative_path

LOG = ".mcap"
PARTIAL = ".partial.mcap"


@dataclass(frozen=True, order=True)
class PlannedLog:
    """A log and the name of its outputs: `name`.mcap and `name`.rrd below the batch's folder."""

    name: str
    log: AnyPath  # absolute


def plan_logs(inputs: Sequence[AnyPath | str], folder: AnyPath | str) -> tuple[PlannedLog, ...]:
    """Find the logs among `inputs` and name their outputs, sorted by name.

    A file gives ``STEM``, a ROS 2 bag (a folder with metadata.yaml) the folder's name. Of any other folder all
    ``*.mcap`` files and bags in it and below it are taken, and their outputs keep their relative path:
    ``DIR/monday/take1.mcap`` becomes ``monday/take1``. Hidden files, ``*.partial.mcap`` and what lies in the batch's own
    `folder` are left out. A log named twice is replayed once. Files and folders may be URLs; whether a file
    ``….mcap`` behind one is there is seen when it is replayed.

    Raises
    ------
    LogError
        There is no such log, or a folder holds none.
    RefusedTargetError
        Two different logs would have the same output.
    """
    found: dict[str, AnyPath] = {}
    output_folder = as_path(folder).resolve()
    for input_path in map(as_path, inputs):
        for name, log in _logs_of(input_path, output_folder):
            other = found.setdefault(name, log)
            if other != log:
                raise RefusedTargetError(
                    f"{log} and {other} would both be written as {name}.mcap; rename one, or give the folder above "
                    "them, so that their outputs keep their subfolders"
                )
    names = sorted(found)
    folders = set[str]()
    for name in names:
        parent = name.rpartition("/")[0]
        while parent not in folders:
            folders.add(parent)
            parent = parent.rpartition("/")[0]
    for name in names:
        if f"{name}.mcap" in folders:
            raise RefusedTargetError(
                f"{found[name]}: its output {name}.mcap is the name of a folder of other outputs; rename it"
            )
    return tuple(PlannedLog(name, found[name]) for name in names)


def _logs_of(input_path: AnyPath, output_folder: AnyPath) -> Iterator[tuple[str, AnyPath]]:
    """Name of the output and resolved path of each log of one input."""
    if (is_remote(input_path) and input_path.suffix == ".mcap") or input_path.is_file():
        yield input_path.stem, input_path.resolve()
    elif not input_path.is_dir():
        raise LogError(f"{input_path}: there is no such log")
    elif (input_path / METADATA).is_file():
        bag = input_path.resolve()
        yield bag.name, bag
    else:
        logs: Sequence[tuple[str, AnyPath]]
        if is_remote(input_path):
            logs = sorted(_logs_under_url(input_path, output_folder))
        else:
            logs = sorted(_logs_under(input_path, output_folder))
        if not logs:
            raise LogError(f"{input_path}: holds neither an MCAP file nor a ROS 2 bag")
        yield from logs


def _logs_under(folder: Path, output_folder: AnyPath) -> Iterator[tuple[str, Path]]:
    """Name and resolved path of MCAP files and bags in a folder and its subfolders; cheap, as there may be 10⁵."""
    for directory, folders, files in os.walk(folder):
        current, resolved = Path(directory), Path(directory).resolve()
        if resolved == output_folder and current != folder:
            folders.clear()
            continue
        within = current.relative_to(folder)
        if METADATA in files and current != folder:
            folders.clear()
            yield within.as_posix(), resolved
            continue
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in filter(_is_log, files):
            log = resolved / name
            yield (within / name[: -len(LOG)]).as_posix(), log.resolve() if log.is_symlink() else log


def _is_log(name: str) -> bool:
    return name.endswith(LOG) and not name.endswith(PARTIAL) and not name.startswith(".")


def _logs_under_url(folder: RemotePath, output_folder: AnyPath) -> Iterator[tuple[str, RemotePath]]:
    """Name and path of MCAP files and bags below a folder at a URL."""
    files = folder.files()
    bags = {file.parent for file in files if file.name == METADATA} - {folder}
    for bag in bags:
        if not any(bag != other and lies_within(bag, other) for other in bags):
            yield relative_path(bag, folder).as_posix(), bag
    for file in files:
        within = relative_path(file, folder)
        hidden = any(part.startswith(".") for part in within.parts)
        inside = any(lies_within(file, bag) for bag in bags) or (
            output_folder != folder and lies_within(file, output_folder)
        )
        if _is_log(file.name) and not hidden and not inside:
            yield within.with_suffix("").as_posix(), file
