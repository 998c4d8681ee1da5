"""Writes calibrated values into a scene file (TOML): the keys that change, with a comment; all else stays as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from geomphys.errors import SceneError
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.storage.output_file import write_file

LENGTH_DIGITS = 5
ANGLE_DIGITS = 3
QUATERNION_DIGITS = 8
MARK = "calibrated: "
"""How the comment on a value begins."""


@dataclass(frozen=True)
class SceneChange:
    """New values of one table of a scene file."""

    kind: str  # "avatar" or "object"
    name: str
    key: str  # table of the avatar: root, joints, keypoints; "" for an object itself
    position: tuple[float, ...] | None = None  # m
    orientation: tuple[float, ...] | None = None  # x y z w
    delay: float | None = None  # s
    link_factors: dict[str, float] | None = None  # link -> factor of its lengths, for a URDF beside the one it has


def write_changes(path: Path, changes: Sequence[SceneChange], comment: str) -> None:
    """Write changes into a scene file.

    A rotation is written in the form the file has, `rpy` or `orientation`; `up` is replaced by `orientation`. Factors of lengths
    make a new URDF beside the one of the avatar, which stays, and the file then names that.

    Raises
    ------
    SceneError
        The file has no such table.
    OutputError, ModelError
        It, or a scaled URDF, cannot be written.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    try:
        document = tomlkit.parse(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise SceneError(f"{path}: cannot be read to be changed ({problem.strerror})") from problem
    except (TOMLKitError, UnicodeDecodeError) as problem:
        raise SceneError(f"{path}: cannot be read to be changed ({type(problem).__name__})") from problem
    for change in changes:
        table = _table(document, path, change)
        _apply(table, change, comment)
        if change.link_factors is not None:
            _set(table, "urdf", _write_scaled(path, str(table["urdf"]), change.link_factors), comment)
    write_file(path, tomlkit.dumps(document).encode(), force=True)


def _table(document: Any, path: Path, change: SceneChange) -> Any:
    """The table of a change."""
    for table in document.get(change.kind, []):
        if table.get("name") == change.name:
            found = table.get(change.key) if change.key else table
            if found is not None:
                return found
    raise SceneError(f"{path}: has no {change.key or change.kind} of {change.name!r} to be changed")


def _apply(table: Any, change: SceneChange, comment: str) -> None:
    if change.position is not None:
        _set(table, "position", [_rounded(v, LENGTH_DIGITS) for v in change.position], comment)
    if change.orientation is not None:
        if "rpy" in table:
            _set(table, "rpy", [_rounded(v, ANGLE_DIGITS) for v in rpy_degrees(change.orientation)], comment)
        else:
            table.pop("up", None)
            _set(table, "orientation", [_rounded(v, QUATERNION_DIGITS) for v in change.orientation], comment)
    if change.delay is not None:
        _set(table, "delay", _rounded(change.delay, 4), comment)


def _write_scaled(scene: Path, urdf: str, factors: Mapping[str, float]) -> str:
    """Write a URDF with other lengths beside `urdf`, under the first free name; returns its name in the scene file."""
    source = scene.parent / urdf
    stem, count = source.stem.removesuffix(".urdf"), 1
    target = source.with_name(f"{stem}_scaled.urdf")
    while target.exists():
        count += 1
        target = source.with_name(f"{stem}_scaled_{count}.urdf")
    write_file(target, scaled_urdf(source, factors, beside=True), force=False)
    return str(PurePath(urdf).with_name(target.name))


def _set(table: Any, key: str, value: Any, comment: str) -> None:
    """Set a key with a comment; where the table is on one line the comment is added to that of the line."""
    import tomlkit
    from tomlkit.items import InlineTable

    item = tomlkit.item(value)
    if isinstance(table, InlineTable):
        others = [part for part in table.trivia.comment.lstrip("# ").split("; ") if part and not part.startswith(MARK)]
        table.comment("; ".join([*others, comment]))
    else:
        item.comment(comment)
    table[key] = item


def _rounded(value: float, digits: int) -> float:
    return round(float(value), digits) + 0.0


def rpy_degrees(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw about fixed axes, degrees."""
    m = rotation_from_quaternion(quaternion)
    roll, pitch = np.arctan2(m[2, 1], m[2, 2]), np.arctan2(-m[2, 0], np.hypot(m[0, 0], m[1, 0]))
    yaw = np.arctan2(m[1, 0], m[0, 0])
    return float(np.degrees(roll)), float(np.degrees(pitch)), float(np.degrees(yaw))
