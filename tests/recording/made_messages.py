"""A message of every kind that is understood, in every encoding, by the official writers; `Item`s of `log_files` are their logs.

Every message holds the same: at 1.5 s, in the frame "room", a tracker "wrist" (or joints "a" and "b") with the values below.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import flatbuffers
import foxglove_schemas_protobuf as foxglove
from google.protobuf import json_format
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros1.decoder import dynamic
from mcap_ros2._dynamic import serialize_dynamic

from geomphys.recording.message_kinds import HAND_JOINTS, KINDS, MessageKind, find_kind
from geomphys.recording.ros_definitions import ROS1_TYPES, STANDARD_TYPES, joined

S = 10**9
STAMP = 3 * S // 2
SEVEN = (0.25, -1.5, 0.125, 0.0, 0.6, 0.0, 0.8)
OTHER = (1.25, 2.5, -0.5, 0.8, 0.0, 0.6, 0.0)
SCHEMAS = Path(__file__).with_name("schemas")

_POSE = {
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
}
_HEADER = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
}
_HEADED = _POSE | _HEADER
_GLOVE = {
    "P/ManusGlove": "int32 glove_id\nstring side\nint32 raw_node_count\nP/ManusRawNode[] raw_nodes\nint32 ergonomics_count\n"
    "P/ManusErgonomics[] ergonomics\ngeometry_msgs/Quaternion raw_sensor_orientation\nint32 raw_sensor_count\n"
    "geometry_msgs/Pose[] raw_sensor",
    "P/ManusRawNode": "int32 node_id\nint32 parent_node_id\nstring joint_type\nstring chain_type\ngeometry_msgs/Pose pose",
    "P/ManusErgonomics": "string type\nfloat32 value",
}
_VICON = (
    "float32 x_trans\nfloat32 y_trans\nfloat32 z_trans\nfloat32 x_rot\nfloat32 y_rot\nfloat32 z_rot\nfloat32 w\n"
    "string segment_name\nstring subject_name\nint32 frame_number\nstring translation_type"
)
_TIMED = {"builtin_interfaces/Time": _HEADER["builtin_interfaces/Time"]}
_FRAME_TRANSFORM = (
    "builtin_interfaces/Time timestamp\nstring parent_frame_id\nstring child_frame_id\n"
    "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
)
_VECTOR = {"geometry_msgs/Vector3": _POSE["geometry_msgs/Point"]}
OWN_TYPES: dict[str, dict[str, str]] = {
    **{
        f"{p}/ManusGlove": {k.replace("P/", f"{p}/"): v.replace("P/", f"{p}/") for k, v in (_GLOVE | _POSE).items()}
        for p in ("manus_ros2_msgs", "manus_ros2")
    },
    **{
        f"{p}/RigidBodies": {
            f"{p}/RigidBodies": f"std_msgs/Header header\nuint32 frame_number\n{p}/RigidBody[] rigidbodies",
            f"{p}/RigidBody": f"std_msgs/Header header\nuint32 frame_number\nstring rigid_body_name\n{p}/Marker[] markers\n"
            "geometry_msgs/Pose pose",
            f"{p}/Marker": "int8 id_type\nint32 marker_index\nstring marker_name\ngeometry_msgs/Point translation",
            **_HEADED,
        }
        for p in ("mocap4r2_msgs", "mocap_msgs")
    },
    **{
        f"motion_capture_tracking_interfaces/NamedPoseArray{v}": {
            f"motion_capture_tracking_interfaces/NamedPoseArray{v}": f"std_msgs/Header header\n{more}"
            "motion_capture_tracking_interfaces/NamedPose[] poses",
            "motion_capture_tracking_interfaces/NamedPose": "string name\ngeometry_msgs/Pose pose",
            **_HEADED,
        }
        for v, more in (("", ""), ("V2", "uint64 timestamp\n"))
    },
    "teleop_ros2_interfaces/NamedPoseArray": {
        "teleop_ros2_interfaces/NamedPoseArray": "std_msgs/Header header\nstring[] name\ngeometry_msgs/Pose[] pose\n"
        "bool[] is_valid",
        **_HEADED,
    },
    "vicon_receiver/Position": {"vicon_receiver/Position": f"std_msgs/Header header\n{_VICON}", **_HEADER},
    "vicon_msgs/Position": {"vicon_msgs/Position": _VICON},
    "tf/tfMessage": {
        "tf/tfMessage": "geometry_msgs/TransformStamped[] transforms",
        "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform",
        "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation",
        **_VECTOR,
        **_HEADED,
    },
    "foxglove_msgs/PoseInFrame": {
        "foxglove_msgs/PoseInFrame": "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose pose",
        **_TIMED,
        **_POSE,
    },
    "foxglove_msgs/PosesInFrame": {
        "foxglove_msgs/PosesInFrame": "builtin_interfaces/Time timestamp\nstring frame_id\ngeometry_msgs/Pose[] poses",
        **_TIMED,
        **_POSE,
    },
    "foxglove_msgs/FrameTransform": {"foxglove_msgs/FrameTransform": _FRAME_TRANSFORM, **_TIMED, **_POSE, **_VECTOR},
    "foxglove_msgs/FrameTransforms": {
        "foxglove_msgs/FrameTransforms": "foxglove_msgs/FrameTransform[] transforms",
        "foxglove_msgs/FrameTransform": _FRAME_TRANSFORM,
        **_TIMED,
        **_POSE,
        **_VECTOR,
    },
    "foxglove_msgs/JointStates": {
        "foxglove_msgs/JointStates": "builtin_interfaces/Time timestamp\nfoxglove_msgs/JointState[] joints",
        "foxglove_msgs/JointState": "string name\nfloat64 position\nfloat64 velocity\nfloat64 effort",
        **_TIMED,
    },
}
"""Types that ROS itself does not define, with the types in them."""


class Made(NamedTuple):
    """A message and what it stands in."""

    schema: str
    schema_encoding: str
    schema_data: bytes
    encoding: str
    data: bytes


def pairs() -> list[tuple[str, str]]:
    """Every schema name of the table with every encoding that there is a writer for."""
    found = [(name, e) for kind in KINDS for name in kind.names for e in kind.encodings]
    return sorted(p for p in found if not (p[0].startswith("foxglove.") and p[1] in ("cdr", "ros1")) and not (
        p[0].startswith("foxglove_msgs") and p[1] in ("protobuf", "flatbuffer")))  # fmt: skip


def definition(name: str, encoding: str) -> str:
    """Schema text of a ROS type."""
    standard = (STANDARD_TYPES if encoding == "cdr" else ROS1_TYPES).get(name)
    if standard is not None:
        return standard
    short = name.replace("/msg/", "/")
    types = dict(OWN_TYPES[short])
    if encoding == "ros1":
        types = {k: v.replace("builtin_interfaces/Time", "time") for k, v in types.items()}
        types.pop("builtin_interfaces/Time", None)
        if "std_msgs/Header" in types:
            types["std_msgs/Header"] = "uint32 seq\ntime stamp\nstring frame_id"
    return joined(types, short)


def xyz(v: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyzw", v, strict=False))


def pose_of(v: Sequence[float]) -> dict[str, Any]:
    return {"position": xyz(v[:3]), "orientation": xyz(v[3:])}


def transform_of(v: Sequence[float]) -> dict[str, Any]:
    return {"translation": xyz(v[:3]), "rotation": xyz(v[3:])}


def content(name: str, seven: Sequence[float] = SEVEN, stamp: int = STAMP, angle: float = 0.5) -> dict[str, Any]:
    """A message of a type as its JSON has it."""
    plain = name.split("/")[-1].split(".")[-1]
    sec, nanosec = divmod(stamp, S)
    header = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "room"}}
    fox = {"timestamp": {"sec": sec, "nsec": nanosec}}
    joints = {"a": angle, "b": -angle}
    frame_transform = fox | {"parent_frame_id": "room", "child_frame_id": "wrist"} | transform_of(seven)
    stamped = header | {"child_frame_id": "wrist", "transform": transform_of(seven)}
    x, y, z, *q = seven
    vicon = {"x_trans": 1000 * x, "y_trans": 1000 * y, "z_trans": 1000 * z}
    vicon |= dict(zip(("x_rot", "y_rot", "z_rot", "w"), q, strict=True))
    made: dict[str, Callable[[], dict[str, Any]]] = {
        "JointState": lambda: header | {"name": list(joints), "position": list(joints.values())},
        "JointStates": lambda: fox | {"joints": [{"name": k, "position": v} for k, v in joints.items()]},
        "ManusGlove": lambda: {
            "glove_id": 7, "side": "Left", "raw_node_count": 1, "ergonomics_count": 2,
            "raw_nodes": [
                {"node_id": 3, "parent_node_id": 0, "joint_type": "MCP", "chain_type": "Index", "pose": pose_of(seven)}
            ],
            "ergonomics": [{"type": k, "value": v} for k, v in joints.items()],
        },
        "PoseStamped": lambda: header | {"pose": pose_of(seven)},
        "PoseWithCovarianceStamped": lambda: header | {"pose": {"pose": pose_of(seven)}},
        "Pose": lambda: pose_of(seven),
        "Transform": lambda: transform_of(seven),
        "PoseInFrame": lambda: fox | {"frame_id": "room", "pose": pose_of(seven)},
        "TransformStamped": lambda: stamped,
        "Odometry": lambda: header | {"child_frame_id": "wrist", "pose": {"pose": pose_of(seven)}},
        "FrameTransform": lambda: frame_transform,
        "Position": lambda: header | vicon | {"segment_name": "wrist", "subject_name": "wrist", "translation_type": "Global"},
        "TFMessage": lambda: {"transforms": [stamped]},
        "tfMessage": lambda: {"transforms": [stamped]},
        "FrameTransforms": lambda: {"transforms": [frame_transform]},
        "PoseArray": lambda: header | {"poses": [pose_of(seven), pose_of(OTHER)]},
        "PosesInFrame": lambda: fox | {"frame_id": "room", "poses": [pose_of(seven), pose_of(OTHER)]},
        "RigidBodies": lambda: header | {"rigidbodies": [{"rigid_body_name": "wrist", "pose": pose_of(seven)}]},
        "NamedPoseArray": lambda: header | (
            {"name": ["wrist", "lost"], "pose": [pose_of(seven), pose_of(OTHER)], "is_valid": [True, False]}
            if name.startswith("teleop") else {"poses": [{"name": "wrist", "pose": pose_of(seven)}]}
        ),
        "NamedPoseArrayV2": lambda: header | {"poses": [{"name": "wrist", "pose": pose_of(seven)}]},
    }  # fmt: skip
    return made[plain]()


def ros2_data(name: str, value: dict[str, Any]) -> bytes:
    text = definition(name, "cdr")
    encoder: Callable[[Any], bytes] = serialize_dynamic(name, text)[name]
    return encoder(_spread(name.replace("/msg/", "/"), _blocks(name.replace("/msg/", "/"), text), value))


def _blocks(root: str, text: str) -> dict[str, list[list[str]]]:
    found = {}
    for number, part in enumerate(text.split("=" * 80)):
        lines = part.strip().splitlines()
        name = lines.pop(0).removeprefix("MSG: ") if number else root
        found[name] = [line.split() for line in lines]
    return found


def _spread(name: str, types: dict[str, list[list[str]]], value: Any) -> Any:
    """A message as an object with all its fields, zero where `value` has none."""
    if name not in types:
        return {"string": "", "bool": False}.get(name, 0) if value is None else value
    made = SimpleNamespace()
    for kind, field in types[name]:
        base, bracket, size = kind.partition("[")
        given = (value or {}).get(field)
        if not bracket:
            item = _spread(base, types, given)
        elif given is None and size != "]":
            item = [_spread(base, types, None)] * int(size[:-1])
        else:
            item = [_spread(base, types, x) for x in given or ()]
        setattr(made, field, item)
    return made


def ros1_data(name: str, value: dict[str, Any]) -> bytes:
    short = name.replace("/msg/", "/")
    classes = dynamic.generate_dynamic(short, definition(name, "ros1"))
    message = _ros1_object(classes, short, value)
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue()


def _ros1_object(classes: dict[str, Any], name: str, value: dict[str, Any]) -> Any:
    made = classes[name]()
    for field, kind in zip(made.__slots__, made._slot_types, strict=True):
        if field not in value:
            continue
        given, base = value[field], kind.partition("[")[0]
        if kind == "time":
            getattr(made, field).secs = given["sec"]
            getattr(made, field).nsecs = given.get("nanosec", given.get("nsec", 0))
        elif base in classes:
            items = given if kind.endswith("]") else [given]
            built = [_ros1_object(classes, base, x) for x in items]
            setattr(made, field, built if kind.endswith("]") else built[0])
        else:
            setattr(made, field, given)
    return made


def protobuf_message(name: str, value: dict[str, Any]) -> Any:
    """Foxglove's own message, filled."""
    plain = name.split(".")[-1]
    module = __import__(f"{foxglove.__name__}.{plain}_pb2", fromlist=[plain])

    def timed(x: Any) -> Any:
        if isinstance(x, dict):
            if set(x) == {"sec", "nsec"}:
                return f"1970-01-01T00:{x['sec'] // 60:02}:{x['sec'] % 60:02}.{x['nsec']:09}Z"
            return {k: timed(v) for k, v in x.items()}
        return [timed(v) for v in x] if isinstance(x, list) else x

    return json_format.ParseDict(timed(value), getattr(module, plain)())


@lru_cache(maxsize=1024)
def make(name: str, encoding: str, seven: Sequence[float] = SEVEN, stamp: int = STAMP, angle: float = 0.5) -> Made:
    """A message of a type in an encoding, with its schema."""
    if encoding == "flatbuffer":
        file = "isaac" if name.startswith("core.") else "foxglove"
        data = flatbuffer_data(name, seven, stamp, angle)
        return Made(name, "flatbuffer", (SCHEMAS / f"{file}.bfbs").read_bytes(), encoding, data)
    value = content(name, seven, stamp, angle)
    if encoding == "json":
        return Made(name, "jsonschema", b"{}", encoding, json.dumps(value).encode())
    if encoding == "protobuf":
        message = protobuf_message(name, value)
        descriptors = build_file_descriptor_set(type(message)).SerializeToString()
        return Made(name, "protobuf", descriptors, encoding, message.SerializeToString())
    if name.startswith("foxglove_msgs"):
        value = json.loads(json.dumps(value).replace('"nsec"', '"nanosec"'))
    text = definition(name, encoding).encode()
    if encoding == "cdr":
        return Made(name, "ros2msg", text, encoding, ros2_data(name, value))
    return Made(name.replace("/msg/", "/"), "ros1msg", text, encoding, ros1_data(name, value))


# --- FlatBuffers, by the official builder


def _seven_floats(b: flatbuffers.Builder, v: Sequence[float]) -> int:
    for x in reversed(v):
        b.PrependFloat32(x)
    return int(b.Offset())


def _record(b: flatbuffers.Builder, data: int | None, stamp: int) -> bytes:
    b.StartObject(2)
    if data is not None:
        b.PrependUOffsetTRelativeSlot(0, data, 0)
    b.Prep(8, 24)
    for k in (2, 1, 0):
        b.PrependInt64(stamp + 1000 * k)
    b.PrependStructSlot(1, b.Offset(), 0)
    b.Finish(b.EndObject())
    return bytes(b.Output())


def hand_record(poses: Sequence[Sequence[float] | None] | None, stamp: int = STAMP) -> bytes:
    """core.HandPoseRecord of 26 poses, None for an invalid one; of no data at all."""
    b = flatbuffers.Builder(0)
    if poses is None:
        return _record(b, None, stamp)
    b.StartObject(1)
    b.Prep(4, 26 * 36)
    for v in reversed(poses):
        b.Prep(4, 36)
        b.PrependFloat32(0.01)
        b.Pad(3)
        b.PrependBool(v is not None)
        _seven_floats(b, v if v is not None else (9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0))
    b.PrependStructSlot(0, b.Offset(), 0)
    return _record(b, b.EndObject(), stamp)


def tracker_record(v: Sequence[float], valid: bool = True, stamp: int = STAMP) -> bytes:
    """core.Se3TrackerPoseRecord or core.HeadPoseRecord."""
    b = flatbuffers.Builder(0)
    b.StartObject(2)
    b.Prep(4, 28)
    b.PrependStructSlot(0, _seven_floats(b, v), 0)
    b.PrependBoolSlot(1, valid, False)
    return _record(b, b.EndObject(), stamp)


def joint_record(joints: dict[str, float | None], stamp: int = STAMP) -> bytes:
    """core.JointStateOutputRecord; None for a joint that is not valid."""
    b = flatbuffers.Builder(0)
    items = []
    for name, value in joints.items():
        text = b.CreateString(name)
        b.StartObject(5)
        b.PrependUOffsetTRelativeSlot(0, text, 0)
        b.PrependFloat32Slot(1, 3.0 if value is None else value, 0.0)
        b.PrependBoolSlot(4, value is not None, True)
        items.append(b.EndObject())
    listed = _offsets(b, items)
    b.StartObject(6)
    b.PrependUOffsetTRelativeSlot(0, listed, 0)
    return _record(b, b.EndObject(), stamp)


def _offsets(b: flatbuffers.Builder, items: Sequence[int]) -> int:
    b.StartVector(4, len(items), 4)
    for item in reversed(items):
        b.PrependUOffsetTRelative(item)
    return int(b.EndVector())


def _table(b: flatbuffers.Builder, numbers: Sequence[float] = (), offsets: Sequence[int] = ()) -> int:
    b.StartObject(len(numbers) + len(offsets))
    for slot, x in enumerate(numbers):
        b.PrependFloat64Slot(slot, x, 0.0)
    for slot, at in enumerate(offsets):
        b.PrependUOffsetTRelativeSlot(slot, at, 0)
    return int(b.EndObject())


def flatbuffer_data(name: str, v: Sequence[float], stamp: int, angle: float) -> bytes:
    """A message of a FlatBuffers type."""
    if name == "core.HandPoseRecord":
        return hand_record([OTHER, v, *[None] * 24], stamp)
    if name == "core.JointStateOutputRecord":
        return joint_record({"a": angle, "b": -angle}, stamp)
    if name.startswith("core."):
        return tracker_record(v, stamp=stamp)
    b = flatbuffers.Builder(0)
    plain = name.split(".")[-1]
    texts = [b.CreateString(t) for t in (("room", "wrist") if "Transform" in plain else ("room",))]
    if plain == "JointStates":
        items = []
        for joint, value in {"a": angle, "b": -angle}.items():
            text = b.CreateString(joint)
            b.StartObject(4)
            b.PrependUOffsetTRelativeSlot(0, text, 0)
            b.PrependFloat64Slot(1, value, None)
            items.append(b.EndObject())
        parts = [_offsets(b, items)]
    elif "Transform" in plain:
        parts = [*texts, _table(b, v[:3]), _table(b, v[3:])]
    else:
        poses = [_table(b, offsets=[_table(b, p[:3]), _table(b, p[3:])]) for p in (v, OTHER)]
        parts = [*texts, _offsets(b, poses) if plain == "PosesInFrame" else poses[0]]
    b.StartObject(1 + len(parts))
    for slot, at in enumerate(parts):
        b.PrependUOffsetTRelativeSlot(1 + slot, at, 0)
    b.Prep(4, 8)
    b.PrependUint32(stamp % S)
    b.PrependUint32(stamp // S)
    b.PrependStructSlot(0, b.Offset(), 0)
    found = b.EndObject()
    if plain == "FrameTransforms":
        found = _table(b, offsets=[_offsets(b, [found])])
    b.Finish(found)
    return bytes(b.Output())


def write_messages(path: Path, messages: Iterable[tuple[str, int, Made]]) -> Path:
    """A log of messages (topic, log time in ns, message)."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schemas: dict[tuple[str, str, bytes], int] = {}
        channels: dict[tuple[str, int], int] = {}
        for topic, log_time, made in messages:
            key = made[:3]
            if key not in schemas:
                schemas[key] = writer.register_schema(*key) if made.schema else 0
            if (topic, schemas[key]) not in channels:
                channels[topic, schemas[key]] = writer.register_channel(topic, made.encoding, schemas[key])
            writer.add_message(channels[topic, schemas[key]], log_time, made.data, log_time)
        writer.finish()
    return path


def kind(made: Made) -> MessageKind:
    """The table's entry for a message."""
    found = find_kind(made.schema, made.encoding)
    assert found is not None, made.schema
    return found


def part_of(kind: MessageKind) -> str:
    """What a scene writes behind the topic to follow the tracker of a message of this `kind`."""
    return {"transforms": "#wrist", "poses": "#0", "named_poses": "#wrist"}.get(kind.content, "")


assert HAND_JOINTS[1] == "wrist"
