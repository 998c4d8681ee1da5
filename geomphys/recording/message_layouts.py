"""Layouts of message types, and the functions that extract joint values or poses by them.

A layout names fields by their paths (``pose.position.x``). The form of a decoded message depends on its
encoding alone: objects with attributes (cdr, ros1, protobuf) or dictionaries (json, flatbuffer); so one layout makes the
reading function of every encoding, and all of them yield the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from geomphys.recording.field_access import FieldAccess, checked_names, checked_text, floats, with_default
from geomphys.recording.samples import MISSING, Content, JointSample, Pose
from geomphys.recording.stamps import stamp_of

Extractor = Callable[[Any], Content]


def pose_at(position: str, orientation: str) -> tuple[str, ...]:
    """Paths of the seven numbers of a pose with a position x, y, z and a quaternion x, y, z, w."""
    return (*(f"{position}.{k}" for k in "xyz"), *(f"{orientation}.{k}" for k in "xyzw"))


POSE = pose_at("position", "orientation")
TRANSFORM = pose_at("translation", "rotation")
STAMPED_POSE = pose_at("pose.position", "pose.orientation")


@dataclass(frozen=True, kw_only=True)
class PoseLayout:
    """Field paths of one pose or a list of poses in a message; "" for a field it lacks."""

    pose: tuple[str, ...]  # paths of the seven numbers; in a list, within its item
    items: str = ""  # path of the list
    stamp: str = ""
    frame: str = ""  # frame id
    child: tuple[str, ...] = ()  # paths of the child frame id or body name; several are joined with "/"
    number: str = ""  # path of a whole number that is its name, or the beginning of it
    side: str = ""  # path of the side of the message, with which names begin
    names: tuple[str, ...] = ()  # names of the items of a list, in their order
    valid: str = ""  # path of a flag; false: no pose
    item_headers: bool = False  # each item has a stamp and frame of its own
    header_optional: bool = False  # versions of the type have neither
    parallel_lists: bool = False  # names and flags are lists of the message, as long as that of the poses
    scale: float = 1.0  # m per unit of the positions

    @property
    def has_literal_names(self) -> bool:
        """Whether child names occur literally in the message bytes: not indices, nor joined names."""
        return len(self.child) == 1 or not (self.items or self.child)


@dataclass(frozen=True, kw_only=True)
class JointLayout:
    """Names and values side by side, or a list of items that have one each."""

    name: str
    value: str
    items: str = ""
    stamp: str = ""
    side: str = ""
    valid: str = ""  # path within an item
    optional: bool = False  # an item may lack its value


Layout = PoseLayout | JointLayout


def make_extractor(layout: Layout, access: FieldAccess) -> Extractor:
    """Make the function from a decoded message to its content."""
    if isinstance(layout, JointLayout):
        return _joint_list_extractor(layout, access) if layout.items else _joint_array_extractor(layout, access)
    if layout.parallel_lists:
        return _parallel_list_extractor(layout, access)
    return _pose_list_extractor(layout, access) if layout.items else _pose_extractor(layout, access)


def _fast_pose_reader(layout: PoseLayout, access: FieldAccess) -> Callable[[Any], Pose] | None:
    """A pose with stamp and frame among attributes, in as few steps as there are; None if it is not of that form.

    Nearly all messages are.
    """
    parents = tuple(dict.fromkeys(path.rpartition(".")[0] for path in layout.pose))
    if access.times is None or layout.pose != pose_at(parents[0], parents[-1]) or not (layout.stamp and layout.frame):
        return None
    if layout.valid or layout.scale != 1.0 or layout.header_optional or len(layout.child) > 1:
        return None
    times = (f"{layout.stamp}.{k}" for k in access.times)
    presence = layout.stamp if access.has_presence else ""
    fetch = attrgetter(*parents, *times, layout.frame, *layout.child)

    def one(m: Any) -> Pose:
        p, q, sec, nanosec, frame = fetch(m)
        stamp = stamp_of(sec, nanosec) if not presence or m.HasField(presence) else None
        return Pose(stamp, "", (p.x, p.y, p.z, q.x, q.y, q.z, q.w), frame)

    def named(m: Any) -> Pose:
        p, q, sec, nanosec, frame, child = fetch(m)
        stamp = stamp_of(sec, nanosec) if not presence or m.HasField(presence) else None
        return Pose(stamp, child, (p.x, p.y, p.z, q.x, q.y, q.z, q.w), frame)

    return named if layout.child else one


def _pose_extractor(layout: PoseLayout, access: FieldAccess) -> Extractor:
    """A message with one pose."""
    headed = _fast_pose_reader(layout, access)
    if headed is not None:
        return lambda m: [headed(m)]
    numbers, stamp = access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, child = access.text((layout.frame,) if layout.frame else ()), access.text(layout.child)
    if layout.header_optional:
        stamp, frame = with_default(stamp, None), with_default(frame, "")
    scale, valid = layout.scale, access.required(layout.valid) if layout.valid else None
    if valid is None and scale == 1.0:
        if not layout.child:
            return lambda m: [Pose(stamp(m), "", numbers(m), frame(m))]
        return lambda m: [Pose(stamp(m), child(m), numbers(m), frame(m))]

    def read(m: Any) -> Content:
        value = numbers(m) if valid is None or valid(m) else MISSING
        if scale != 1.0:
            value = (value[0] * scale, value[1] * scale, value[2] * scale, *value[3:])
        return [Pose(stamp(m), child(m), value, frame(m))]

    return read


def _pose_list_extractor(layout: PoseLayout, access: FieldAccess) -> Extractor:
    """A message with a list of poses."""
    headed = _fast_pose_reader(layout, access) if layout.item_headers else None
    if headed is not None:
        items_of = access.required(layout.items)
        return lambda m: [headed(x) for x in items_of(m)]
    items, numbers, stamp = access.required(layout.items), access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, names = access.text((layout.frame,) if layout.frame else ()), layout.names
    child = access.text(layout.child) if layout.child else None
    if layout.number:
        number = access.required(layout.number)
        text = child
        child = lambda x: str(int(number(x))) + (f"/{text(x)}" if text is not None else "")  # noqa: E731
    valid, has_item_headers = access.required(layout.valid) if layout.valid else None, layout.item_headers
    side = access.text((layout.side,)) if layout.side else None

    def read(m: Any) -> Content:
        if has_item_headers and child is not None:
            return [Pose(stamp(x), child(x), numbers(x), frame(x)) for x in items(m) or ()]
        stamp_ns, frame_id, join_names = stamp(m), frame(m), items(m)
        if join_names is None:
            return [Pose(stamp_ns, name, MISSING, frame_id) for name in names]
        prefix = f"{_side(side(m))}/" if side is not None else ""
        return [
            Pose(
                stamp_ns,
                prefix + child(x) if child is not None else names[i] if i < len(names) else str(i),
                numbers(x) if x is not None and (valid is None or valid(x)) else MISSING,
                frame_id,
            )
            for i, x in enumerate(join_names)
        ]

    return read


def _parallel_list_extractor(layout: PoseLayout, access: FieldAccess) -> Extractor:
    """A message with lists of names, poses and flags."""
    items, numbers, stamp = access.required(layout.items), access.numbers(layout.pose), access.stamp(layout.stamp)
    frame, flags = access.text((layout.frame,) if layout.frame else ()), access.required(layout.valid)
    names = access.required(layout.child[0])

    def read(m: Any) -> Content:
        stamp_ns, frame_id = stamp(m), frame(m)
        return [
            Pose(stamp_ns, checked_text(name), numbers(x) if valid else MISSING, frame_id)
            for name, x, valid in zip(names(m), items(m), flags(m), strict=True)
        ]

    return read


def _joint_array_extractor(layout: JointLayout, access: FieldAccess) -> Extractor:
    """A message with a list of names and one of values."""
    names, stamp = access.required(layout.name), access.stamp(layout.stamp)
    if access.times is not None:
        attributes = access.required(layout.value)
        return lambda m: JointSample(stamp(m), names(m), attributes(m), "")
    values = access.optional(layout.value)
    return lambda m: JointSample(stamp(m), checked_names(names(m)), floats(list(values(m) or ())), "")


def _joint_list_extractor(layout: JointLayout, access: FieldAccess) -> Extractor:
    """A message with an item a joint."""
    items, stamp, side = (
        access.required(layout.items),
        access.stamp(layout.stamp),
        access.text((layout.side,) if layout.side else ()),
    )
    name, value = access.required(layout.name), access.required(layout.value)
    if access.times is not None:
        if layout.optional and access.has_presence:
            field = layout.value

            def read_present_values(m: Any) -> Content:
                with_value = [x for x in items(m) if x.HasField(field)]
                if not with_value:  # velocities only: as a ROS message with names and without positions
                    return JointSample(stamp(m), list(map(name, items(m))), (), "")
                return JointSample(stamp(m), list(map(name, with_value)), list(map(value, with_value)), "")

            return read_present_values

        def attributes(m: Any) -> Content:
            with_value = items(m)
            return JointSample(stamp(m), list(map(name, with_value)), list(map(value, with_value)), _side(side(m)))

        return attributes
    name_key, value_key, valid, optional = layout.name, layout.value, layout.valid, layout.optional

    def read(m: Any) -> Content:
        with_value = join_names = items(m) or ()
        if optional:
            with_value = [x for x in join_names if x.get(value_key) is not None]
            if not with_value:
                return JointSample(stamp(m), checked_names([x[name_key] for x in join_names]), (), "")
        values = [x[value_key] if not valid or x[valid] else None for x in with_value]
        return JointSample(stamp(m), checked_names([x[name_key] for x in with_value]), floats(values), _side(side(m)))

    return read


def _side(text: str) -> str:
    """Side of a glove in one spelling."""
    side = text.strip().lower()
    return {"l": "left", "r": "right"}.get(side, side)
