"""Getters for fields of decoded messages: attributes (cdr, ros1, protobuf) or dictionary keys (json, flatbuffer)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import attrgetter, itemgetter
from typing import Any, TypeVar

from geomphys.recording.samples import MISSING, NAN
from geomphys.recording.stamps import json_stamp, stamp_of

Fetch = Callable[[Any], Any]
Values = tuple[float, ...]
T = TypeVar("T")

TIME_FIELDS = {"cdr": ("sec", "nanosec"), "ros1": ("secs", "nsecs"), "protobuf": ("seconds", "nanos")}
"""Encoding with attribute access -> the attributes of its time type."""
TEXT_NUMBERS = ("NaN", "Infinity", "-Infinity")
"""Numbers that protobuf's JSON writes as text."""


class FieldAccess:
    """How fields are fetched from messages of an encoding."""

    def __init__(self, encoding: str, *, lenient: bool, points: bool = False) -> None:
        """With `lenient` (json only), absent fields are zero or empty, as protobuf's JSON omits default values.

        With `points` poses may lack their orientation, and one without a position is missing.
        """
        self.points = points
        self.times = TIME_FIELDS.get(encoding)
        self.lenient = lenient or encoding == "flatbuffer"
        self.has_presence = encoding == "protobuf"

    def required(self, path: str) -> Fetch:
        """Fetch one field."""
        if self.times is not None:
            return attrgetter(path)
        return _nested_getter(path, lenient=self.lenient)

    def optional(self, path: str) -> Fetch:
        """Fetch one field of dictionaries; None for one that is not there."""
        return _nested_getter(path, lenient=True)

    def numbers(self, paths: Sequence[str]) -> Callable[[Any], Values]:
        """Fetch numbers; NaN for ``null``."""
        if self.times is not None:
            attributes: Callable[[Any], Values] = attrgetter(*paths)
            return attributes
        groups: list[tuple[Fetch | None, list[str]]] = []
        last = None
        for path in paths:
            parent, _, leaf = path.rpartition(".")
            if parent != last or not groups:
                groups.append((self.required(parent) if parent else None, []))
                last = parent
            groups[-1][1].append(leaf)
        numbers = _lenient_numbers(groups) if self.lenient else _strict_numbers(groups)
        return _point_numbers(numbers, groups[:1]) if self.points else numbers

    def stamp(self, path: str) -> Callable[[Any], int | None]:
        """Fetch a stamp in ns; None for one that is not there."""
        if not path:
            return _no_stamp
        if self.times is None:
            fetch_time = _nested_getter(path, lenient=True)
            return lambda m: json_stamp(fetch_time(m))
        fetch_parts = attrgetter(*(f"{path}.{k}" for k in self.times))
        if self.has_presence:
            return lambda m: stamp_of(*fetch_parts(m)) if m.HasField(path) else None
        return lambda m: stamp_of(*fetch_parts(m))

    def text(self, paths: Sequence[str]) -> Callable[[Any], str]:
        """Fetch a text, "" if absent; several are joined with "/", without repeats."""
        if not paths:
            return _no_text
        if len(paths) == 1:
            if self.times is not None:
                return attrgetter(paths[0])
            fetch = _nested_getter(paths[0], lenient=True)
            return lambda m: checked_text(fetch(m))
        parts = [self.text([path]) for path in paths]
        return lambda m: "/".join(dict.fromkeys(t for part in parts if (t := part(m))))


def with_default(fetch: Callable[[Any], T], otherwise: T) -> Callable[[Any], T]:
    """Fetch a field that some versions of a type lack."""

    def read(m: Any) -> T:
        try:
            return fetch(m)
        except AttributeError:
            return otherwise

    return read


def _no_stamp(_: Any) -> None:
    return None


def _no_text(_: Any) -> str:
    return ""


def _nested_getter(path: str, *, lenient: bool) -> Fetch:
    """Fetch a field of nested dictionaries; with `lenient`, None if it is absent."""
    keys = path.split(".")
    if not lenient:
        return _strict_getter(keys)
    spellings = [(key, _camel(key)) for key in keys]

    def search(m: Any) -> Any:
        for key, other in spellings:
            if m is None:
                return None
            found = m.get(key)
            m = m.get(other) if found is None and other != key else found
        return m

    first, last = keys[0], keys[-1]
    if len(keys) > 2:
        return search

    def fetch(m: Any) -> Any:
        try:
            return m[first][last] if first is not last else m[first]
        except (KeyError, TypeError):
            return search(m)

    return fetch


def _strict_getter(keys: Sequence[str]) -> Fetch:
    """Fetch a field that must be there."""
    if len(keys) == 1:
        return itemgetter(keys[0])
    if len(keys) == 2:
        first, second = keys
        return lambda m: m[first][second]

    def fetch(m: Any) -> Any:
        for key in keys:
            m = m[key]
        return m

    return fetch


def _camel(key: str) -> str:
    """A field's name as protobuf's JSON has it."""
    first, *others = key.split("_")
    return first + "".join(word.capitalize() for word in others)


def _strict_numbers(groups: Sequence[tuple[Fetch | None, list[str]]]) -> Callable[[Any], Values]:
    """Fetch numbers grouped by parent dictionary."""
    getters = [(parent, itemgetter(*leaves)) for parent, leaves in groups]

    def fetch(m: Any) -> Values:
        found: list[Any] = []
        for parent, leaves in getters:
            found += leaves(m if parent is None else parent(m))
        return tuple(floats(found))

    return fetch


def _lenient_numbers(groups: Sequence[tuple[Fetch | None, list[str]]]) -> Callable[[Any], Values]:
    """Fetch numbers grouped by parent dictionary, zero for absent ones."""
    strict = _strict_numbers(groups)

    def fetch(m: Any) -> Values:
        found: list[Any] = []
        for parent, leaves in groups:
            group_parent = m if parent is None else parent(m)
            if group_parent is None:
                if "w" in leaves:  # zero would be no rotation, so a writer never leaves it out
                    raise KeyError("rotation")
                group_parent = {}
            found += [group_parent.get(leaf, 0.0) for leaf in leaves]
        return tuple(floats(found))

    def numbers(m: Any) -> Values:
        try:
            return strict(m)
        except (KeyError, TypeError):
            return fetch(m)

    return numbers


def _point_numbers(
    numbers: Callable[[Any], Values], position: Sequence[tuple[Fetch | None, list[str]]]
) -> Callable[[Any], Values]:
    """Fetch the numbers of a pose: with the orientation 0 0 0 1 where it has none, all NaN where it has no position."""
    only_position, parent = _strict_numbers(position), position[0][0]

    def fetch(m: Any) -> Values:
        try:
            if parent is not None and parent(m) is None:
                return MISSING
            return numbers(m)
        except (KeyError, TypeError):
            try:
                return (*only_position(m), 0.0, 0.0, 0.0, 1.0)
            except (KeyError, TypeError):
                return MISSING

    return fetch


_ONLY_FLOATS = {float}


def floats(values: list[Any]) -> list[float]:
    """Numbers of JSON as they are meant."""
    return values if set(map(type, values)) == _ONLY_FLOATS else [_number(x) for x in values]


def _number(x: Any) -> float:
    """A number of JSON; ``null`` is how writers put NaN."""
    kind = type(x)
    if kind is float:
        return x  # type: ignore[no-any-return]
    if kind is int:
        return float(x)
    if x is None:
        return NAN
    if kind is str and x in TEXT_NUMBERS:
        return float(x)
    raise TypeError("not a number")


def checked_text(text: Any) -> str:
    """A text of JSON, "" for ``null``."""
    if text is None:
        return ""
    if not isinstance(text, str):
        raise TypeError("not a text")
    return text


def checked_names(names: Any) -> list[str]:
    """Names of JSON."""
    if not isinstance(names, list) or not set(map(type, names)) <= {str}:
        raise TypeError("names are not a list of strings")
    return names
