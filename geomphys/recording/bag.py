"""Lists the MCAP files of a log: a single .mcap, or the parts of a ROS 2 bag directory in order."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.display_names import join_names
from geomphys.recording.foreign_formats import CONVERT_SQLITE
from geomphys.storage.remote_files import AnyPath, is_remote, lies_within

METADATA = "metadata.yaml"
METADATA_LIMIT = 4 * 2**20
"""Bytes; a longer metadata.yaml is refused."""
MAX_LISTED = 4  # file names listed in a message


@dataclass(frozen=True)
class LogFiles:
    """The MCAP files of a log, in order, and the missing parts."""

    files: tuple[AnyPath, ...]
    missing: tuple[str, ...] = ()  # one line each; never empty but with `recover`
    notes: tuple[str, ...] = ()  # one line each, for the user


def log_files(path: AnyPath, *, recover: bool = False) -> LogFiles:
    """Say which MCAP files make up the log `path`.

    Parameters
    ----------
    path : Path
        An .mcap file, or a directory with metadata.yaml and the .mcap files that it names. Parts that it does not name
        but that carry on their numbering are read too: a recorder that is killed does not name its last ones.
    recover : bool
        Take a directory without metadata.yaml (the recorder was killed) or with missing parts for what is there.

    Raises
    ------
    LogError
        Nothing there, not readable, not MCAP inside, a part outside of the directory.
    DamagedLogError
        metadata.yaml or a part is missing and `recover` is off.
    """
    try:
        return _log_files(path, recover)
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror})") from problem


def _log_files(path: AnyPath, recover: bool) -> LogFiles:
    if path.is_file():
        return LogFiles((path,))
    if not path.exists():
        raise LogError(f"{path}: does not exist")
    if not path.is_dir():
        raise LogError(f"{path}: is neither a file nor a bag directory")
    if not (path / METADATA).is_file():
        return _without_metadata(path, recover)
    named = _named_parts(path)
    files: list[AnyPath] = []
    missing: list[str] = []
    for name in dict.fromkeys(named):
        part = _inside(path, name)
        if part.is_file():
            files.append(part)
        elif recover:
            missing.append(f"{name} is not in the bag")
        else:
            raise DamagedLogError(
                f"{path}: {METADATA} names {name}, which is not there; --recover replays the other parts"
            )
    if not files:
        raise LogError(f"{path}: none of the {len(named)} files that {METADATA} names is there")
    return _add_unnamed_parts(path, files, missing)


def _add_unnamed_parts(path: AnyPath, files: list[AnyPath], missing: list[str]) -> LogFiles:
    """Add parts that metadata.yaml does not name, and note unrelated logs in the directory."""
    if is_remote(path) and not path.lists:
        return LogFiles(tuple(files), tuple(missing))
    known = {file.name for file in files}
    others = sorted((p for p in path.glob("*.mcap") if p.is_file() and p.name not in known), key=_natural_key)
    stems = {stem for name in known if (stem := _stem(name)) is not None}
    parts = [p for p in others if _stem(p.name) in stems]
    unrelated = [p.name for p in others if p not in parts]
    notes = []
    if parts:
        names = join_names([p.name for p in parts], MAX_LISTED)
        notes.append(
            f"{METADATA} does not name {names}, which carry on its numbering: they are read as parts of the bag"
        )
    if unrelated:
        notes.append(
            f"{METADATA} does not name {join_names(unrelated, MAX_LISTED)}: not read, as their names are not those of its parts"
        )
    in_order = [*files, *parts]
    if parts and files == sorted(files, key=_natural_key):
        in_order.sort(key=_natural_key)
    return LogFiles(tuple(in_order), tuple(missing), tuple(notes))


def _stem(name: str) -> str | None:
    """What the names of all parts of a bag begin with: ``take_`` of ``take_3.mcap``; None for a name without a number."""
    match = re.fullmatch(r"(.*_)[0-9]+\.mcap", name)
    return match[1] if match else None


def _without_metadata(path: AnyPath, recover: bool) -> LogFiles:
    """Take the .mcap files of a directory in the order of the numbers in their names."""
    files = sorted((p for p in path.glob("*.mcap") if p.is_file()), key=_natural_key)
    if not files:
        if any(path.glob("*.db3")):
            raise LogError(f"{path}: is a bag stored as 'sqlite3'; {CONVERT_SQLITE}")
        raise LogError(f"{path}: is a directory without {METADATA} and without .mcap files: not a bag")
    stems = {_stem(file.name) for file in files}
    names = join_names([file.name for file in files], MAX_LISTED)
    if len(files) > 1 and (len(stems) > 1 or None in stems):
        raise LogError(
            f"{path}: is a folder of {len(files)} logs ({names}) and no bag, as it has no {METADATA}; name one of them "
            "(`geomphys batch` replays all logs of a folder)"
        )
    if not recover:
        files_text = "its .mcap file" if len(files) == 1 else f"its {len(files)} .mcap files as one log"
        raise DamagedLogError(
            f"{path}: has no {METADATA}, so the recorder was not closed; --recover replays {files_text} ({names}); if it is no "
            "bag but a folder of logs, name one of them"
        )
    return LogFiles(tuple(files), (f"{METADATA} is missing; the parts are taken in the order of their names",))


def _natural_key(path: AnyPath) -> list[tuple[int, str]]:
    """Sort key that puts part 10 behind part 9."""
    return [(int(x), "") if x.isdigit() else (-1, x) for x in re.split(r"([0-9]+)", path.name)]


def _named_parts(path: AnyPath) -> list[str]:
    """Names of the parts in metadata.yaml, in order."""
    import yaml

    file = path / METADATA
    try:
        if file.stat().st_size > METADATA_LIMIT:
            raise LogError(f"{file}: is larger than {METADATA_LIMIT} bytes; that is no bag's metadata")
        content: Any = yaml.load(file.read_bytes(), _yaml_loader())
    except OSError as problem:
        raise LogError(f"{file}: cannot be read ({problem.strerror})") from problem
    except (yaml.YAMLError, ValueError, RecursionError) as problem:
        line = getattr(getattr(problem, "problem_mark", None), "line", None)
        where = f" at line {line + 1}" if line is not None else ""
        raise LogError(f"{file}: is not readable as YAML{where}") from problem
    bag = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    if not isinstance(bag, dict):
        raise LogError(f"{file}: has no rosbag2_bagfile_information; is this a ROS 2 bag?")
    names = bag.get("relative_file_paths")
    storage = bag.get("storage_identifier")
    if not storage and isinstance(names, list) and names:  # some tools leave it empty: inferred from the file names
        storage = "sqlite3" if all(str(name).endswith(".db3") for name in names) else "mcap"
    if storage == "sqlite3":
        raise LogError(f"{path}: is a bag stored as 'sqlite3'; {CONVERT_SQLITE}")
    if storage and storage != "mcap":
        raise LogError(f"{path}: is a bag stored as {storage!r}; convert it to mcap with `ros2 bag convert`")
    if str(bag.get("compression_mode") or "").upper() in ("FILE", "MESSAGE"):
        raise LogError(
            f"{path}: is a bag with {bag['compression_mode']} compression; make it plain mcap with `ros2 bag convert`"
        )
    if not isinstance(names, list) or not names or not all(isinstance(n, str) and n for n in names):
        raise LogError(f"{file}: relative_file_paths is not a list of file names")
    return names


@lru_cache
def _yaml_loader() -> Any:
    """A loader of plain data that takes no merge keys, which grow with the square of a file, and bounds how deep lists nest."""
    import yaml

    class Loader(yaml.CSafeLoader):  # type: ignore[misc]  # the package has no types
        def flatten_mapping(self, node: Any) -> None:
            """Leave a mapping as it stands."""

    return Loader


def _inside(path: AnyPath, name: str) -> AnyPath:
    """Path of a part; older recorders put the bag's own name before it. Raises LogError if it lies outside."""
    if "\0" in name:
        raise LogError(f"{path / METADATA}: relative_file_paths holds a name that no file can have")
    root = path.resolve()
    for candidate in (path / name, path / Path(name).name):
        if not lies_within(candidate.resolve(), root):
            raise LogError(f"{path / METADATA}: names the file {name!r}, which lies outside of the bag")
        if candidate.is_file():
            return candidate
    return path / name
