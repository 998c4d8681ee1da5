"""Where a kind of message has its data, and the functions that fetch it.

A layout names fields by their paths (``pose.position.x``). What a message looks like once it is decoded hangs on its
encoding alone: objects with attributes (cdr, ros1, protobuf) or dictionaries (json, flatbuffer); so one layout makes the
reading function of every encoding, and all of them yield the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from geomphys.recording.samples import MISSING, NAN, Content, Joints, Pose
from geomphys.recording.stamps import json_stamp, stamp_of

Read = Callable[[Any], Content]
Fetch = Callable[[Any], Any]
Values = tuple[float, ...]

TIME_FIELDS = {"cdr": ("sec", "nanosec"), "ros1": ("secs", "nsecs"), "protobuf": ("seconds", "nanos")}
"""Encoding whose messages have attributes -> those of a time."""
SPELLED = ("NaN", "Infinity", "-Infinity")
"""Numbers that protobuf's JSON writes as text."""


def pose_at(position: str, orientation: str) -> tuple[str, ...]:
    """Paths of the seven numbers of a pose with a position x, y, z and a quaternion x, y, z, w."""
    return (*(f"{position}.{k}" for k in "xyz"), *(f"{orientation}.{k}" for k in "xyzw"))


POSE = pose_at("position", "orientation")
TRANSFORM = pose_at("translation", "rotation")
STAMPED_POSE = pose_at("pose.position", "pose.orientation")


@dataclass(frozen=True, kw_only=True)
class PoseLayout:
    """One pose, or a list of them. Paths within a message; "" for what it does not have."""

    pose: tuple[str, ...]  # paths of the seven numbers; in a list, within its item
    each: str = ""  # path of the list
    stamp: str = ""
    frame: str = ""  # frame id
    child: tuple[str, ...] = ()  # paths of the name of what it is the pose of; several are joined with "/"
    number: str = ""  # path of a whole number that is its name
    names: tuple[str, ...] = ()  # names of the items of a list, in their order
    valid: str = ""  # a flag: what has it off is no pose
    own_header: bool = False  # each item has a stamp and frame of its own
    beside: bool = False  # names and flags are lists of the message, as long as that of the poses
    scale: float = 1.0  # m per unit of the positions

    @property
    def spelled_out(self) -> bool:
        """Whether the names of poses stand in a message as they are: not so indices, and names that are put together."""
        return len(self.child) == 1 or not (self.each or self.child)


@dataclass(frozen=True, kw_only=True)
class JointLayout:
    """Names and values side by side, or a list of items that have one each."""

    name: str
    value: str
    each: str = ""
    stamp: str = ""
    side: str = ""
    valid: str = ""  # path within an item
    optional: bool = False  # an item may lack its value


Layout = PoseLayout | JointLayout


class Access:
    """How fields are fetched from messages of an encoding."""

    def __init__(self, encoding: str, *, lenient: bool) -> None:
        """With `lenient`, what is not there is zero or empty, as protobuf leaves out what it is so; json only."""
        self.times = TIME_FIELDS.get(encoding)
        self.lenient = lenient or encoding == "flatbuffer"
        self.has_presence = encoding == "protobuf"

    def one(self, path: str) -> Fetch:
        """Fetch one field."""
        if self.times is not None:
            return attrgetter(path)
        return _walk(path, lenient=self.lenient)

    def numbers(self, paths: Sequence[str]) -> Callable[[Any], Values]:
        """Fetch numbers; NaN for what is not one by intention (``null``)."""
        if self.times is not None:
            fetch: Callable[[Any], Values] = attrgetter(*paths)
            return fetch
        groups: list[tuple[Fetch | None, list[str]]] = []
        last = None
        for path in paths:
            parent, _, leaf = path.rpartition(".")
            if parent != last or not groups:
                groups.append((self.one(parent) if parent else None, []))
                last = parent
            groups[-1][1].append(leaf)
        return _numbers_of(groups, lenient=self.lenient)

    def stamp(self, path: str) -> Callable[[Any], int | None]:
        """Fetch a stamp in ns; None for one that is not there."""
        if not path:
            return _nothing
        if self.times is None:
            when = _walk(path, lenient=True)
            return lambda m: json_stamp(when(m))
        both = attrgetter(*(f"{path}.{k}" for k in self.times))
        if self.has_presence:
            return lambda m: stamp_of(*both(m)) if m.HasField(path) else None
        return lambda m: stamp_of(*both(m))

    def text(self, paths: Sequence[str]) -> Callable[[Any], str]:
        """Fetch a text; "" for one that is not there; several are joined, equal ones told once."""
        if not paths:
            return _empty
        if len(paths) == 1:
            if self.times is not None:
                return attrgetter(paths[0])
            fetch = _walk(paths[0], lenient=True)
            return lambda m: _text(fetch(m))
        parts = [self.text([path]) for path in paths]
        return lambda m: "/".join(dict.fromkeys(t for part in parts if (t := part(m))))


def make_read(layout: Layout, access: Access) -> Read:
    """Make the function from a decoded message to its content."""
    if isinstance(layout, JointLayout):
        return _joint_list(layout, access) if layout.each else _joint_columns(layout, access)
    if layout.beside:
        return _poses_beside(layout, access)
    return _pose_list(layout, access) if layout.each else _one_pose(layout, access)


def _one_pose(layout: PoseLayout, access: Access) -> Read:
    """A message with one pose."""
    numbers, stamp = access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, child = access.text((layout.frame,) if layout.frame else ()), access.text(layout.child)
    scale, valid = layout.scale, access.one(layout.valid) if layout.valid else None

    def read(m: Any) -> Content:
        value = numbers(m) if valid is None or valid(m) else MISSING
        if scale != 1.0:
            value = (value[0] * scale, value[1] * scale, value[2] * scale, *value[3:])
        return [Pose(stamp(m), child(m), value, frame(m))]

    return read


def _pose_list(layout: PoseLayout, access: Access) -> Read:
    """A message with a list of poses."""
    items, numbers, stamp = access.one(layout.each), access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, names = access.text((layout.frame,) if layout.frame else ()), layout.names
    child = access.text(layout.child) if layout.child else None
    if layout.number:
        number = access.one(layout.number)
        child = lambda x: str(int(number(x)))  # noqa: E731
    valid, own = access.one(layout.valid) if layout.valid else None, layout.own_header

    def read(m: Any) -> Content:
        if own and child is not None:
            return [Pose(stamp(x), child(x), numbers(x), frame(x)) for x in items(m) or ()]
        when, where, listed = stamp(m), frame(m), items(m)
        if listed is None:
            return [Pose(when, name, MISSING, where) for name in names]
        return [
            Pose(
                when,
                child(x) if child is not None else names[i] if i < len(names) else str(i),
                numbers(x) if x is not None and (valid is None or valid(x)) else MISSING,
                where,
            )
            for i, x in enumerate(listed)
        ]

    return read


def _poses_beside(layout: PoseLayout, access: Access) -> Read:
    """A message with lists of names, poses and flags."""
    items, numbers, stamp = access.one(layout.each), access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, flags = access.text((layout.frame,) if layout.frame else ()), access.one(layout.valid)
    names = access.one(layout.child[0])

    def read(m: Any) -> Content:
        when, where = stamp(m), frame(m)
        return [
            Pose(when, _text(name), numbers(x) if valid else MISSING, where)
            for name, x, valid in zip(names(m), items(m), flags(m), strict=True)
        ]

    return read


def _joint_columns(layout: JointLayout, access: Access) -> Read:
    """A message with a list of names and one of values."""
    names, values, stamp = access.one(layout.name), access.one(layout.value), access.stamp(layout.stamp)
    if access.times is not None:
        return lambda m: Joints(stamp(m), names(m), values(m), "")
    return lambda m: Joints(stamp(m), _names(names(m)), [_number(x) for x in values(m)], "")


def _joint_list(layout: JointLayout, access: Access) -> Read:
    """A message with an item a joint."""
    items, stamp, side = access.one(layout.each), access.stamp(layout.stamp), access.text((layout.side,))
    side = side if layout.side else _empty
    name, value = access.one(layout.name), access.one(layout.value)
    if access.times is not None:
        if layout.optional and access.has_presence:
            field = layout.value

            def present(m: Any) -> Content:
                given = [x for x in items(m) if x.HasField(field)]
                return Joints(stamp(m), [name(x) for x in given], [value(x) for x in given], _side(side(m)))

            return present

        def attributes(m: Any) -> Content:
            given = items(m)
            return Joints(stamp(m), [name(x) for x in given], [value(x) for x in given], _side(side(m)))

        return attributes
    valid, optional, value_key = layout.valid, layout.optional, layout.value

    def read(m: Any) -> Content:
        given = [x for x in items(m) or () if not optional or x.get(value_key) is not None]
        good = [_number(value(x)) if not valid or x[valid] else NAN for x in given]
        return Joints(stamp(m), _names([name(x) for x in given]), good, _side(side(m)))

    return read


def _walk(path: str, *, lenient: bool) -> Fetch:
    """Fetch a field of dictionaries in dictionaries; with `lenient`, None for what is not there."""
    keys = path.split(".")
    if not lenient:

        def strict(m: Any) -> Any:
            for key in keys:
                m = m[key]
            return m

        return strict
    spellings = [(key, _camel(key)) for key in keys]

    def fetch(m: Any) -> Any:
        for key, other in spellings:
            if m is None:
                return None
            found = m.get(key)
            m = m.get(other) if found is None else found
        return m

    return fetch


def _camel(key: str) -> str:
    """A field's name as protobuf's JSON has it."""
    first, *others = key.split("_")
    return first + "".join(word.capitalize() for word in others)


def _numbers_of(groups: Sequence[tuple[Fetch | None, list[str]]], *, lenient: bool) -> Callable[[Any], Values]:
    """Fetch numbers that stand side by side in few dictionaries."""

    def strict(m: Any) -> Values:
        found: list[float] = []
        for parent, leaves in groups:
            within = m if parent is None else parent(m)
            found += [_number(within[leaf]) for leaf in leaves]
        return tuple(found)

    def fetch(m: Any) -> Values:
        found: list[float] = []
        for parent, leaves in groups:
            within = m if parent is None else parent(m)
            if within is None:
                if "w" in leaves:  # zero would be no rotation, so a writer never leaves it out
                    raise KeyError("rotation")
                within = {}
            found += [_number(within.get(leaf, 0.0)) for leaf in leaves]
        return tuple(found)

    return fetch if lenient else strict


def _number(x: Any) -> float:
    """A number of JSON; ``null`` is how writers put NaN."""
    kind = type(x)
    if kind is float:
        return x  # type: ignore[no-any-return]
    if kind is int:
        return float(x)
    if x is None:
        return NAN
    if kind is str and x in SPELLED:
        return float(x)
    raise TypeError("not a number")


def _text(text: Any) -> str:
    if text is None:
        return ""
    if not isinstance(text, str):
        raise TypeError("not a text")
    return text


def _names(names: Any) -> list[str]:
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise TypeError("names are not a list of strings")
    return names


def _side(text: str) -> str:
    """Side of a glove in one spelling."""
    side = text.strip().lower()
    return {"l": "left", "r": "right"}.get(side, side)


def _nothing(_: Any) -> None:
    return None


def _empty(_: Any) -> str:
    return ""
