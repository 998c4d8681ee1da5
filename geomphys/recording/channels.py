"""Which messages are understood and what each yields.

`KINDS` is the table of the interface: (schema name, message encoding) to what the messages are and how they are read.
Every encoding of the same data yields the same `Joints` or `Poses`, to the bit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, NamedTuple

from geomphys.recording.decoders import PAYLOAD_ERRORS, BadMessageError, make_decoder
from geomphys.recording.reader import LogChannel

MESSAGE_LIMIT = 4 * 2**20
"""Bytes; a longer message of joints or poses is not decoded: decoded it would take many times that."""
STAMP_LIMIT = 2**62  # ns
NAN = math.nan

What = Literal["joints", "pose", "transforms", "glove"]


class Joints(NamedTuple):
    """A message with joint values, in the units of the log."""

    stamp: int | None  # ns, as stamped; None if the message carries no stamp
    names: Sequence[str]
    values: Sequence[float]  # NaN where the log has one; a joint without a value is left out
    side: str  # of a glove: "left", "right" or ""

    @property
    def sample(self) -> Sequence[float]:
        """The values that count: none where there are fewer than names, as nobody knows whose they are.

        Such messages are valid in ROS (velocities only) and are passed over by its own tools. Of more values than names
        the first ones are those of the names.
        """
        return self.values if len(self.values) >= len(self.names) else ()


class Pose(NamedTuple):
    """A pose. `child` is the frame it is the pose of; "" where the message does not name one."""

    stamp: int | None
    child: str
    value: tuple[float, ...]  # (7,) position and quaternion x y z w, as recorded


Content = Joints | list[Pose]


class Kind(NamedTuple):
    """How messages of a (schema, encoding) are read."""

    what: What
    read: Callable[[Any], Content]
    stamped: bool  # whether the type has a stamp at all


def _stamp(sec: int, nanosec: int) -> int:
    """Stamp in ns; raises ValueError if it is none that can be."""
    stamp = int(sec) * 10**9 + int(nanosec)
    if not 0 <= stamp < STAMP_LIMIT:
        raise ValueError(f"stamp {stamp}")
    return stamp


# --- cdr: attributes throughout


def _ros_joints(m: Any) -> Joints:
    stamp = m.header.stamp
    return Joints(_stamp(stamp.sec, stamp.nanosec), m.name, m.position, "")


def _ros_pose(m: Any) -> list[Pose]:
    stamp, p, q = m.header.stamp, m.pose.position, m.pose.orientation
    return [Pose(_stamp(stamp.sec, stamp.nanosec), "", (p.x, p.y, p.z, q.x, q.y, q.z, q.w))]


def _ros_transforms(m: Any) -> list[Pose]:
    poses = []
    for x in m.transforms:
        stamp, p, q = x.header.stamp, x.transform.translation, x.transform.rotation
        poses.append(Pose(_stamp(stamp.sec, stamp.nanosec), x.child_frame_id, (p.x, p.y, p.z, q.x, q.y, q.z, q.w)))
    return poses


def _ros_glove(m: Any) -> Joints:
    return Joints(None, [e.type for e in m.ergonomics], [e.value for e in m.ergonomics], _side(m.side))


def _side(text: str) -> str:
    """Side of a glove in one spelling."""
    side = str(text).strip().lower()
    return {"l": "left", "r": "right"}.get(side, side)


# --- protobuf: a stamp or a position that is not set is none, not zero


def _proto_stamp(m: Any) -> int | None:
    return _stamp(m.timestamp.seconds, m.timestamp.nanos) if m.HasField("timestamp") else None


def _proto_joints(m: Any) -> Joints:
    given = [j for j in m.joints if j.HasField("position")]
    if not given:  # velocities only, as a ROS message with names and without positions
        return Joints(_proto_stamp(m), [j.name for j in m.joints], (), "")
    return Joints(_proto_stamp(m), [j.name for j in given], [j.position for j in given], "")


def _proto_pose(m: Any) -> list[Pose]:
    p, q = m.pose.position, m.pose.orientation
    return [Pose(_proto_stamp(m), "", (p.x, p.y, p.z, q.x, q.y, q.z, q.w))]


def _proto_transform(m: Any) -> list[Pose]:
    p, q = m.translation, m.rotation
    return [Pose(_proto_stamp(m), m.child_frame_id, (p.x, p.y, p.z, q.x, q.y, q.z, q.w))]


def _proto_transforms(m: Any) -> list[Pose]:
    return [pose for x in m.transforms for pose in _proto_transform(x)]


# --- json: null is how writers put NaN


def _number(x: Any) -> float:
    return NAN if x is None else float(x)


def _json_stamp(t: Any) -> int | None:
    if t is None:
        return None
    nanosec = t["nsec"] if "nsec" in t else t["nanosec"]
    return _stamp(t["sec"], nanosec)


def _json_seven(p: Any, q: Any) -> tuple[float, ...]:
    return (
        *(_number(p[k]) for k in ("x", "y", "z")),
        *(_number(q[k]) for k in ("x", "y", "z", "w")),
    )


def _json_ros_joints(m: Any) -> Joints:
    stamp = _json_stamp(m.get("header", {}).get("stamp"))
    return Joints(stamp, _names(m["name"]), [_number(x) for x in m.get("position") or ()], "")


def _names(names: Any) -> list[str]:
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise TypeError("names are not a list of strings")
    return names


def _json_ros_pose(m: Any) -> list[Pose]:
    pose = m["pose"]
    value = _json_seven(pose["position"], pose["orientation"])
    return [Pose(_json_stamp(m.get("header", {}).get("stamp")), "", value)]


def _json_ros_transforms(m: Any) -> list[Pose]:
    return [
        Pose(
            _json_stamp(x.get("header", {}).get("stamp")),
            str(x["child_frame_id"]),
            _json_seven(x["transform"]["translation"], x["transform"]["rotation"]),
        )
        for x in m["transforms"]
    ]


def _json_glove(m: Any) -> Joints:
    parts = m["ergonomics"]
    return Joints(None, _names([e["type"] for e in parts]), [_number(e["value"]) for e in parts], _side(m["side"]))


def _json_joints(m: Any) -> Joints:
    given = [j for j in m["joints"] if j.get("position") is not None]
    if not given:
        return Joints(_json_stamp(m.get("timestamp")), _names([j["name"] for j in m["joints"]]), (), "")
    return Joints(
        _json_stamp(m.get("timestamp")), _names([j["name"] for j in given]), [float(j["position"]) for j in given], ""
    )


def _json_pose(m: Any) -> list[Pose]:
    pose = m["pose"]
    return [Pose(_json_stamp(m.get("timestamp")), "", _json_seven(pose["position"], pose["orientation"]))]


def _json_transform(m: Any) -> list[Pose]:
    return [
        Pose(_json_stamp(m.get("timestamp")), str(m["child_frame_id"]), _json_seven(m["translation"], m["rotation"]))
    ]


def _json_transforms(m: Any) -> list[Pose]:
    return [pose for x in m["transforms"] for pose in _json_transform(x)]


KINDS: dict[tuple[str, str], Kind] = {
    ("sensor_msgs/msg/JointState", "cdr"): Kind("joints", _ros_joints, True),
    ("sensor_msgs/msg/JointState", "json"): Kind("joints", _json_ros_joints, True),
    ("foxglove.JointStates", "protobuf"): Kind("joints", _proto_joints, True),
    ("foxglove.JointStates", "json"): Kind("joints", _json_joints, True),
    ("geometry_msgs/msg/PoseStamped", "cdr"): Kind("pose", _ros_pose, True),
    ("geometry_msgs/msg/PoseStamped", "json"): Kind("pose", _json_ros_pose, True),
    ("foxglove.PoseInFrame", "protobuf"): Kind("pose", _proto_pose, True),
    ("foxglove.PoseInFrame", "json"): Kind("pose", _json_pose, True),
    ("tf2_msgs/msg/TFMessage", "cdr"): Kind("transforms", _ros_transforms, True),
    ("tf2_msgs/msg/TFMessage", "json"): Kind("transforms", _json_ros_transforms, True),
    ("foxglove.FrameTransform", "protobuf"): Kind("transforms", _proto_transform, True),
    ("foxglove.FrameTransform", "json"): Kind("transforms", _json_transform, True),
    ("foxglove.FrameTransforms", "protobuf"): Kind("transforms", _proto_transforms, True),
    ("foxglove.FrameTransforms", "json"): Kind("transforms", _json_transforms, True),
    ("manus_ros2_msgs/msg/ManusGlove", "cdr"): Kind("glove", _ros_glove, False),
    ("manus_ros2_msgs/msg/ManusGlove", "json"): Kind("glove", _json_glove, False),
}
"""(schema name, message encoding) to how such messages are read."""


def full_name(schema_name: str) -> str:
    """Schema name of a ROS type with the ``msg`` that some writers leave out."""
    parts = schema_name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else schema_name


def kind_of(channel: LogChannel) -> Kind | None:
    """How a channel's messages are read; None if they are not understood."""
    return KINDS.get((full_name(channel.schema_name), channel.encoding))


def make_reader(channel: LogChannel, kind: Kind) -> Callable[[bytes], Content]:
    """Make the function from a message's bytes to its content; it raises BadMessageError on bytes that hold none.

    Raises LogError if the channel's schema cannot be read.
    """
    decode, read = make_decoder(channel, full_name(channel.schema_name)), kind.read

    def content(data: bytes) -> Content:
        if len(data) > MESSAGE_LIMIT:
            raise BadMessageError(f"of {len(data)} bytes is longer than the limit of {MESSAGE_LIMIT}")
        message = decode(data)
        try:
            return read(message)
        except PAYLOAD_ERRORS as problem:
            raise BadMessageError(f"does not hold what its type says ({type(problem).__name__})") from problem

    return content
