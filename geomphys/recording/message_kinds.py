"""The table of supported message types: schema names, encodings, content, and where the data is.

A message kind is one entry of `KINDS`: schema names, supported encodings, content, and
where its data is. Facts about types that have no page of their own:

- *vicon_receiver/Position*: ``x_trans`` … are mm, as Vicon's DataStream has them; ``x_rot, y_rot, z_rot, w`` are a quaternion in
  that order. Later versions have a header.
- *ManusGlove*: ``ergonomics`` are angles in degrees by name, ``raw_nodes`` poses by ``node_id``, ``chain_type`` and
  ``joint_type``; it has a ``side`` and no stamp.
- *mocap4r2_msgs/RigidBodies*: ``rigidbodies`` with ``rigid_body_name`` and ``pose``.
- *NamedPoseArray*: of motion_capture_tracking_interfaces a list ``poses`` of ``name`` and ``pose``; of teleop_ros2_interfaces
  the lists ``name``, ``pose`` and ``is_valid``.
- *core.…Record* of Isaac Teleop: a table ``data`` that is absent while nothing is tracked; times are those of the log, a clock
  that counts from the machine's start. A hand has 26 joints in the order of OpenXR (`HAND_JOINTS`), each with ``is_valid``; a
  head or tracker has ``pose`` and ``is_valid``; a joint has ``name``, ``position`` in rad or m, and ``valid``.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import NamedTuple

from geomphys.recording.message_layouts import POSE, STAMPED_POSE, TRANSFORM, JointLayout, Layout, PoseLayout, pose_at
from geomphys.recording.samples import ContentType

ENCODINGS = {
    "cdr": "ROS 2 (cdr)",
    "ros1": "ROS 1 (ros1)",
    "protobuf": "protobuf",
    "json": "JSON",
    "flatbuffer": "FlatBuffers",
}
"""Supported message encodings -> their display names."""

_FINGERS = ("thumb", "index", "middle", "ring", "little")
_SEGMENTS = ("metacarpal", "proximal", "intermediate", "distal", "tip")
HAND_JOINTS = (
    "palm",
    "wrist",
    *(f"{f}_{s}" for f in _FINGERS for s in _SEGMENTS if (f, s) != ("thumb", "intermediate")),
)
"""Names of OpenXR's 26 joints of a hand, in their order."""


class MessageKind(NamedTuple):
    """How messages of a type are read."""

    names: tuple[str, ...]  # full names of its schema: ``package/msg/Type``, or as protobuf has it
    encodings: tuple[str, ...]
    content: ContentType
    layout: Layout
    has_stamp: bool = True  # whether the type has a stamp at all
    in_metres: bool = False  # positions are converted to m by the type's own unit, whatever `[recording] unit` says
    points: PoseLayout | None = None  # poses in the same message as joint values

    @property
    def omits_defaults(self) -> bool:
        """Whether its JSON omits default values, as protobuf's JSON does."""
        return "protobuf" in self.encodings


_ROS = ("cdr", "ros1", "json")
_FOXGLOVE = ("protobuf", "json", "flatbuffer", "cdr", "ros1")
_HEADER = ("header.stamp", "header.frame_id")
_ISAAC = ("flatbuffer",)


def _foxglove(name: str) -> tuple[str, ...]:
    """Names of a schema of Foxglove: its own, and that of its ROS package."""
    return f"foxglove.{name}", f"foxglove_msgs/msg/{name}"


def _in_header(pose: tuple[str, ...], *, child: tuple[str, ...] = (), items: str = "") -> PoseLayout:
    """Poses of a ROS message with a header."""
    return PoseLayout(pose=pose, child=child, items=items, stamp=_HEADER[0], frame=_HEADER[1])


_TRANSFORM_STAMPED = _in_header(pose_at("transform.translation", "transform.rotation"), child=("child_frame_id",))
_TRANSFORMS = replace(_TRANSFORM_STAMPED, items="transforms", item_headers=True)
_FRAME_TRANSFORM = PoseLayout(pose=TRANSFORM, stamp="timestamp", frame="parent_frame_id", child=("child_frame_id",))
_VICON = ("vicon_receiver/msg/Position", "vicon_msgs/msg/Position")
_VICON_POSE = ("x_trans", "y_trans", "z_trans", "x_rot", "y_rot", "z_rot", "w")
_DATA_POSE = pose_at("data.pose.position", "data.pose.orientation")

KINDS: tuple[MessageKind, ...] = (
    MessageKind(
        ("sensor_msgs/msg/JointState",), _ROS, "joints",
        JointLayout(name="name", value="position", stamp="header.stamp"),
    ),
    MessageKind(
        _foxglove("JointStates"), _FOXGLOVE, "joints",
        JointLayout(items="joints", name="name", value="position", stamp="timestamp", optional=True),
    ),
    MessageKind(
        ("core.JointStateOutputRecord",), _ISAAC, "joints",
        JointLayout(items="data.joints", name="name", value="position", valid="valid"), has_stamp=False,
    ),
    MessageKind(
        ("manus_ros2_msgs/msg/ManusGlove", "manus_ros2/msg/ManusGlove"), _ROS, "glove",
        JointLayout(items="ergonomics", name="type", value="value", side="side"), has_stamp=False,
        points=PoseLayout(
            items="raw_nodes", pose=STAMPED_POSE, number="node_id", child=("chain_type", "joint_type"), side="side"
        ),
    ),
    MessageKind(("geometry_msgs/msg/PoseStamped",), _ROS, "pose", _in_header(STAMPED_POSE)),
    MessageKind(
        ("geometry_msgs/msg/PoseWithCovarianceStamped",), _ROS, "pose",
        _in_header(pose_at("pose.pose.position", "pose.pose.orientation")),
    ),
    MessageKind(("geometry_msgs/msg/Pose",), _ROS, "pose", PoseLayout(pose=POSE), has_stamp=False),
    MessageKind(("geometry_msgs/msg/Transform",), _ROS, "pose", PoseLayout(pose=TRANSFORM), has_stamp=False),
    MessageKind(
        _foxglove("PoseInFrame"), _FOXGLOVE, "pose",
        PoseLayout(pose=STAMPED_POSE, stamp="timestamp", frame="frame_id"),
    ),
    MessageKind(
        ("core.Se3TrackerPoseRecord", "core.HeadPoseRecord"), _ISAAC, "pose",
        PoseLayout(pose=_DATA_POSE, valid="data.is_valid"), has_stamp=False, in_metres=True,
    ),
    MessageKind(("geometry_msgs/msg/TransformStamped",), _ROS, "transform", _TRANSFORM_STAMPED),
    MessageKind(
        ("nav_msgs/msg/Odometry",), _ROS, "transform",
        _in_header(pose_at("pose.pose.position", "pose.pose.orientation"), child=("child_frame_id",)),
    ),
    MessageKind(_foxglove("FrameTransform"), _FOXGLOVE, "transform", _FRAME_TRANSFORM),
    MessageKind(
        _VICON, _ROS, "transform",
        replace(
            _in_header(_VICON_POSE, child=("subject_name", "segment_name")), scale=0.001, header_optional=True
        ),
        in_metres=True,
    ),
    MessageKind(("tf2_msgs/msg/TFMessage",), _ROS, "transforms", _TRANSFORMS),
    MessageKind(("tf/msg/tfMessage",), ("ros1", "json"), "transforms", _TRANSFORMS),
    MessageKind(
        _foxglove("FrameTransforms"), _FOXGLOVE, "transforms",
        replace(_FRAME_TRANSFORM, items="transforms", item_headers=True),
    ),
    MessageKind(("geometry_msgs/msg/PoseArray",), _ROS, "poses", _in_header(POSE, items="poses")),
    MessageKind(
        _foxglove("PosesInFrame"), _FOXGLOVE, "poses",
        PoseLayout(pose=POSE, items="poses", stamp="timestamp", frame="frame_id"),
    ),
    MessageKind(
        ("mocap4r2_msgs/msg/RigidBodies", "mocap_msgs/msg/RigidBodies"), _ROS, "named_poses",
        _in_header(STAMPED_POSE, items="rigidbodies", child=("rigid_body_name",)),
    ),
    MessageKind(
        (
            "motion_capture_tracking_interfaces/msg/NamedPoseArray",
            "motion_capture_tracking_interfaces/msg/NamedPoseArrayV2",
        ),
        _ROS, "named_poses",
        _in_header(STAMPED_POSE, items="poses", child=("name",)),
    ),
    MessageKind(
        ("teleop_ros2_interfaces/msg/NamedPoseArray",), _ROS, "named_poses",
        PoseLayout(
            pose=POSE, items="pose", child=("name",), valid="is_valid", parallel_lists=True, stamp=_HEADER[0], frame=_HEADER[1]
        ),
    ),
    MessageKind(
        ("core.HandPoseRecord",), _ISAAC, "named_poses",
        PoseLayout(
            pose=STAMPED_POSE, items="data.joints.poses", names=HAND_JOINTS, valid="is_valid"
        ),
        has_stamp=False, in_metres=True,
    ),
)  # fmt: skip
"""Supported message kinds, in the order of the documentation."""

_KIND_BY_TYPE = {(name, encoding): kind for kind in KINDS for name in kind.names for encoding in kind.encodings}
_SEPARATORS = re.compile(r"/|::|\.")
_OWN_PACKAGES = ("foxglove", "core")
_COMMON_PACKAGES = ("foxglove", "geometry_msgs", "nav_msgs", "sensor_msgs", "tf2_msgs")


def _short_type_names() -> dict[str, str]:
    """Type name without package -> full name, where only one kind of the packages that everybody has goes by it."""
    found: dict[str, set[int]] = {}
    for number, kind in enumerate(KINDS):
        for name in kind.names if _SEPARATORS.split(kind.names[0])[0] in _COMMON_PACKAGES else ():
            found.setdefault(_SEPARATORS.split(name)[-1], set()).add(number)
    return {printable: KINDS[numbers.pop()].names[0] for printable, numbers in found.items() if len(numbers) == 1}


_TYPE_BY_SHORT_NAME = _short_type_names()


def canonical_type_name(schema_name: str) -> str:
    """Schema name in the one spelling of the table, from any of those that writers use.

    ``sensor_msgs/JointState``, ``sensor_msgs.msg.JointState`` and ``sensor_msgs::msg::dds_::JointState_`` all are
    ``sensor_msgs/msg/JointState``; what is no name of such a form is returned as it is.
    """
    parts = _SEPARATORS.split(schema_name.strip())
    if len(parts) == 4 and parts[2] == "dds_":
        parts = [parts[0], parts[1], parts[3].removesuffix("_")]
    if len(parts) == 3 and parts[1] == "msg":
        parts = [parts[0], parts[2]]
    if len(parts) != 2 or not all(parts):
        return schema_name
    package, name = parts
    return f"{package}.{name}" if package in _OWN_PACKAGES else f"{package}/msg/{name}"


def find_kind(schema_name: str, encoding: str) -> MessageKind | None:
    """How messages of a schema in an encoding are read; None if they are not understood.

    JSON writers often leave the package out: there, a plain type name counts as the one of a common package.
    """
    name = canonical_type_name(schema_name)
    kind = _KIND_BY_TYPE.get((name, encoding))
    if kind is None and encoding == "json":
        kind = _KIND_BY_TYPE.get((_TYPE_BY_SHORT_NAME.get(schema_name.strip(), ""), encoding))
    return kind


def encodings_of(schema_name: str) -> tuple[str, ...]:
    """Encodings in which a schema is read."""
    name = canonical_type_name(schema_name)
    name = _TYPE_BY_SHORT_NAME.get(name, name)
    return tuple(e for e in ENCODINGS if (name, e) in _KIND_BY_TYPE)


def type_names(what: tuple[ContentType, ...]) -> list[str]:
    """Display names of the types with some content: the first name of each kind."""
    return [kind.names[0].replace("/msg/", "/") for kind in KINDS if kind.content in what]
