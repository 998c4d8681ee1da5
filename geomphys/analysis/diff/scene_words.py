"""Says in words what the scene files and the other files of two outputs differ in."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

from geomphys.analysis.diff.quantities import length_text

_FILES = ("mesh", "urdf")
"""Keys of paths: what counts is the name, as the files themselves are compared too."""
_NAMES_SHOWN = 6


def scene_differences(a: Mapping[str, bytes], b: Mapping[str, bytes]) -> tuple[str, ...]:
    """Sentences on what differs between the files attached to two outputs (name -> bytes), scene file first.

    Tables are matched by their names, those of pairs of materials by the materials, reach cones by their numbers.
    """
    return (*_of_scenes(a, b), *_of_files(a, b))


def _of_scenes(a: Mapping[str, bytes], b: Mapping[str, bytes]) -> Iterator[str]:
    scenes = [next((data for name, data in files.items() if name.endswith(".toml")), None) for files in (a, b)]
    if scenes[0] == scenes[1]:
        return
    for side, data in zip("ab", scenes, strict=True):
        if data is None:
            yield f"{side} has no scene file attached"
            return
    try:
        one, other = (tomllib.loads((data or b"").decode("utf-8-sig")) for data in scenes)
    except ValueError:
        yield "the scene files differ, and one of them is no TOML"
        return
    found = list(_of_tables("", one, other))
    yield from found or ["the scene files differ in comments or their order only"]


def _of_tables(where: str, a: dict[str, Any], b: dict[str, Any]) -> Iterator[str]:
    """Differences of two tables; `where` names them."""
    label = f"{where}: " if where else ""
    for key in dict.fromkeys([*a, *b]):
        one, other = a.get(key), b.get(key)
        if one == other:
            continue
        if _is_array_of_tables(one) or _is_array_of_tables(other):
            yield from _of_arrays(f"{label}{key.replace('_', ' ')}", key, one or [], other or [])
        elif isinstance(one, dict) and isinstance(other, dict):
            yield from _of_tables(f"{label}{key}", one, other)
        elif key not in _FILES or _file_name(one) != _file_name(other):
            yield f"{label}{key} {_values(one, other)}"


def _of_arrays(where: str, key: str, a: list[Any], b: list[Any]) -> Iterator[str]:
    """Differences of two arrays of tables, such as the objects."""
    one, other = ({_name(table, k): table for k, table in enumerate(tables, 1)} for tables in (a, b))
    for side, tables, others in (("a", one, other), ("b", other, one)):
        alone = [name for name in tables if name not in others]
        if alone:
            yield f"{where} {', '.join(alone)}: only in {side}"
    for name in one:
        if name in other:
            yield from _of_tables(f"{where} {name}", one[name], other[name])


def _of_files(a: Mapping[str, bytes], b: Mapping[str, bytes]) -> Iterator[str]:
    """Differences of URDFs and meshes."""
    one, other = ({_file_name(name): data for name, data in files.items() if _is_model(name)} for files in (a, b))
    changed = [name for name in sorted(one) if name in other and one[name] != other[name]]
    if changed:
        yield f"{_list(changed)}: not the same file in both"
    for side, files, others in (("a", one, other), ("b", other, one)):
        alone = sorted(name for name in files if name not in others)
        if alone:
            yield f"{_list(alone)}: only in {side}"


def _values(a: Any, b: Any) -> str:
    """The two values of a key, in words."""
    if a is None or b is None:
        return f"is {_text(b if a is None else a)} in {'b' if a is None else 'a'} and not given in the other"
    apart = f", {length_text(math.dist(a, b))} apart" if _is_point(a) and _is_point(b) else ""
    return f"is {_text(a)} in a, {_text(b)} in b{apart}"


def _text(value: Any) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(map(_text, value))}]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_text(inner)}" for key, inner in value.items()) + " }"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _name(table: dict[str, Any], number: int) -> str:
    """What a table of an array is called."""
    if isinstance(table.get("name"), str):
        return str(table["name"])
    materials = table.get("materials")
    return "/".join(map(str, materials)) if isinstance(materials, list) else str(number)


def _list(names: list[str]) -> str:
    """The first names, and how many there are more."""
    more = len(names) - _NAMES_SHOWN
    return ", ".join(names[:_NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "")


def _is_array_of_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(table, dict) for table in value)


def _is_point(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 3 and all(type(x) in (int, float) for x in value)


def _is_model(name: str) -> bool:
    return name.endswith(".urdf") or name.startswith("meshes/")


def _file_name(path: Any) -> str:
    return PurePosixPath(str(path)).name
