"""Small logs of known content, in every encoding, and small worlds that follow them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from mcap_ros2._dynamic import serialize_dynamic

from geomphys.recording.ros_definitions import STANDARD_TYPES
from geomphys.scene.arrays import (
    DRIVEN,
    FIXED,
    JOINT_FIXED,
    JOINT_REVOLUTE,
    Bodies,
    Chains,
    Dofs,
    Materials,
    Pieces,
    ReachCones,
    Scene,
    Trees,
)
from geomphys.scene.recording_tables import RecordingTable
from geomphys.scene.scene_facts import SceneFacts, facts_of_recording
from geomphys.scene.scene_file import SceneFile
from geomphys.scene.topic_sources import JointSource, RootSource
from geomphys.scene.world import World

S = 10**9
IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
GLOVE_TYPE = "manus_ros2_msgs/msg/ManusGlove"
GLOVE_DEFINITION = f"""int32 glove_id
string side
int32 ergonomics_count
manus_ros2_msgs/ManusErgonomics[] ergonomics
{"=" * 80}
MSG: manus_ros2_msgs/ManusErgonomics
string type
float32 value
"""
PROTOBUF = {
    "joints": JointStates,
    "pose": PoseInFrame,
    "transform": FrameTransform,
    "transforms": FrameTransforms,
}
ROS = {
    "joints": "sensor_msgs/msg/JointState",
    "pose": "geometry_msgs/msg/PoseStamped",
    "transforms": "tf2_msgs/msg/TFMessage",
    "glove": GLOVE_TYPE,
}


@dataclass
class Item:
    """A message. `stamp` None: the log time; times in ns."""

    topic: str
    kind: str  # joints, pose, transform, transforms, glove, raw
    value: (
        Any  # joints, glove: {name: value}, or of ROS (names, positions); pose: 7; transforms: {child: 7}; raw: bytes
    )
    log_time: int
    stamp: int | None = None
    publish_time: int | None = None
    side: str = "left"
    channel: int = 0  # tells channels of the same topic apart
    frame: str = "world"

    @property
    def time(self) -> int:
        return self.log_time if self.stamp is None else self.stamp


def joints(topic: str, time: float, values: dict[str, float | None], **more: Any) -> Item:
    return Item(topic, "joints", values, round(time * S), **more)


def pose(topic: str, time: float, value: Sequence[float], **more: Any) -> Item:
    return Item(topic, "pose", tuple(value), round(time * S), **more)


def transforms(topic: str, time: float, values: dict[str, Sequence[float]], **more: Any) -> Item:
    return Item(topic, "transforms", values, round(time * S), **more)


def glove(topic: str, time: float, values: dict[str, float], **more: Any) -> Item:
    return Item(topic, "glove", values, round(time * S), **more)


def write_log(
    path: Path,
    items: Iterable[Item],
    *,
    encoding: str = "ros2",
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 1024 * 1024,
    metadata: dict[str, dict[str, str]] | None = None,
    **options: Any,
) -> Path:
    """Write messages as ros2, protobuf, json (Foxglove's shape) or json-ros; `options` are of mcap's writer."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, chunk_size=chunk_size, **options)
        writer.start(profile="ros2" if encoding == "ros2" else "", library="test")
        book = _Book(writer, encoding)
        for k, item in enumerate(items):
            publish = item.log_time if item.publish_time is None else item.publish_time
            writer.add_message(book.channel(item), item.log_time, book.encode(item), publish, k)
        for name, content in (metadata or {}).items():
            writer.add_metadata(name, content)
        writer.finish()
    return path


@dataclass
class _Book:
    """Channels of a log being written, and how messages are encoded."""

    writer: Writer
    encoding: str
    channels: dict[tuple[str, str, int], int] = field(default_factory=dict)
    schemas: dict[str, int] = field(default_factory=dict)
    encoders: dict[str, Any] = field(default_factory=dict)

    def _how(self, item: Item) -> str:
        if item.kind == "raw":
            return "raw"
        if item.kind == "glove":
            return "ros2" if self.encoding in ("ros2", "protobuf") else "json-ros"
        return self.encoding

    def channel(self, item: Item) -> int:
        key = (item.topic, item.kind, item.channel)
        if key not in self.channels:
            how = self._how(item)
            name, encoding, data, messages = {
                "ros2": lambda: (ROS[item.kind], "ros2msg", _definition(ROS[item.kind]).encode(), "cdr"),
                "json-ros": lambda: (ROS[item.kind], "jsonschema", b"{}", "json"),
                "json": lambda: (PROTOBUF[item.kind].DESCRIPTOR.full_name, "jsonschema", b"{}", "json"),
                "protobuf": lambda: (
                    PROTOBUF[item.kind].DESCRIPTOR.full_name,
                    "protobuf",
                    build_file_descriptor_set(PROTOBUF[item.kind]).SerializeToString(),
                    "protobuf",
                ),
                "raw": lambda: ("some/msg/Image", "ros2msg", b"uint8[] data", "cdr"),
            }[how]()
            if name not in self.schemas:
                self.schemas[name] = self.writer.register_schema(name, encoding, data)
            self.channels[key] = self.writer.register_channel(item.topic, messages, self.schemas[name])
        return self.channels[key]

    def encode(self, item: Item) -> bytes:
        how = self._how(item)
        if isinstance(item.value, bytes):
            return item.value
        if how == "ros2":
            name = ROS[item.kind]
            if name not in self.encoders:
                self.encoders[name] = serialize_dynamic(name, _definition(name))[name]
            return self.encoders[name](_ros(item))
        if how == "protobuf":
            return _protobuf(item).SerializeToString()
        return json.dumps(_json(item) if how == "json" else _json_ros(item)).encode()


def _definition(name: str) -> str:
    return GLOVE_DEFINITION if name == GLOVE_TYPE else STANDARD_TYPES[name]


def _ros(item: Item) -> Any:
    sec, nanosec = divmod(item.time, S)
    header = SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id=item.frame)
    if item.kind == "joints":
        names, positions = _lists(item.value)
        return SimpleNamespace(header=header, name=names, position=positions, velocity=[], effort=[])
    if item.kind == "glove":
        parts = [SimpleNamespace(type=k, value=v) for k, v in item.value.items()]
        return SimpleNamespace(glove_id=1, side=item.side, ergonomics_count=len(parts), ergonomics=parts)
    if item.kind == "pose":
        return SimpleNamespace(
            header=header, pose=SimpleNamespace(position=_xyz(item.value), orientation=_xyzw(item.value))
        )
    return SimpleNamespace(
        transforms=[
            SimpleNamespace(
                header=header,
                child_frame_id=child,
                transform=SimpleNamespace(translation=_xyz(value), rotation=_xyzw(value)),
            )
            for child, value in item.value.items()
        ]
    )


def _lists(value: Any) -> tuple[list[str], list[float]]:
    """Names and positions of a ROS message of joints."""
    if isinstance(value, tuple):
        return list(value[0]), list(value[1])
    given = {k: v for k, v in value.items() if v is not None}
    return list(given), list(given.values())


def _xyz(v: Sequence[float]) -> SimpleNamespace:
    return SimpleNamespace(x=v[0], y=v[1], z=v[2])


def _xyzw(v: Sequence[float]) -> SimpleNamespace:
    return SimpleNamespace(x=v[3], y=v[4], z=v[5], w=v[6])


def _protobuf(item: Item) -> Any:
    message = PROTOBUF[item.kind]()
    if item.kind == "joints":
        message.timestamp.FromNanoseconds(item.time)
        for name, value in item.value.items():
            joint = message.joints.add(name=name)
            if value is not None:
                joint.position = value
    elif item.kind == "pose":
        message.timestamp.FromNanoseconds(item.time)
        message.frame_id = item.frame
        _fill(message.pose.position, message.pose.orientation, item.value)
    elif item.kind == "transform":
        ((child, value),) = item.value.items()
        message.timestamp.FromNanoseconds(item.time)
        message.child_frame_id = child
        message.parent_frame_id = item.frame
        _fill(message.translation, message.rotation, value)
    else:
        for child, value in item.value.items():
            part = message.transforms.add(child_frame_id=child, parent_frame_id=item.frame)
            part.timestamp.FromNanoseconds(item.time)
            _fill(part.translation, part.rotation, value)
    return message


def _fill(p: Any, q: Any, v: Sequence[float]) -> None:
    p.x, p.y, p.z = v[:3]
    q.x, q.y, q.z, q.w = v[3:]


def _dict(v: Sequence[float]) -> dict[str, float]:
    return dict(zip("xyzw", v, strict=False))


def _json(item: Item) -> Any:
    sec, nsec = divmod(item.time, S)
    stamp: dict[str, Any] = {"timestamp": {"sec": sec, "nsec": nsec}}
    if item.kind == "joints":
        listed = [{"name": k} | ({} if v is None else {"position": v}) for k, v in item.value.items()]
        return stamp | {"joints": listed}
    if item.kind == "pose":
        return (
            stamp
            | {"frame_id": item.frame}
            | {"pose": {"position": _dict(item.value[:3]), "orientation": _dict(item.value[3:])}}
        )
    parts = [
        stamp
        | {
            "parent_frame_id": item.frame,
            "child_frame_id": child,
            "translation": _dict(v[:3]),
            "rotation": _dict(v[3:]),
        }
        for child, v in item.value.items()
    ]
    return parts[0] if item.kind == "transform" else {"transforms": parts}


def _json_ros(item: Item) -> Any:
    sec, nanosec = divmod(item.time, S)
    header = {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": item.frame}}
    if item.kind == "joints":
        names, positions = _lists(item.value)
        return header | {"name": names, "position": positions}
    if item.kind == "glove":
        parts = [{"type": k, "value": v} for k, v in item.value.items()]
        return {"glove_id": 1, "side": item.side, "ergonomics": parts}
    if item.kind == "pose":
        return header | {"pose": {"position": _dict(item.value[:3]), "orientation": _dict(item.value[3:])}}
    return {
        "transforms": [
            header | {"child_frame_id": child, "transform": {"translation": _dict(v[:3]), "rotation": _dict(v[3:])}}
            for child, v in item.value.items()
        ]
    }


@dataclass
class Tree:
    """A tree of a made-up world: a root and joints without geometry. `root` and `topic` are topics."""

    name: str = "hand"
    root: str | None = None
    offset: Sequence[float] = IDENTITY
    topic: str | None = None
    joints: Sequence[str] = ()
    unit: str | None = None
    rename: dict[str, str] = field(default_factory=dict)
    mimics: tuple[str, ...] = ()
    limits: tuple[float, float] = (-np.inf, np.inf)
    kinds: dict[str, int] = field(default_factory=dict)
    avatar: bool = True
    rest: Sequence[float] = IDENTITY


def make_world(*trees: Tree, recording: dict[str, Any] | None = None) -> World:
    """A world of trees, avatars first, and its `[recording]`. Only what a recording needs of it is filled in."""
    ordered = sorted(trees, key=lambda t: not t.avatar)
    roots, sources, dof_names, dof_tree, lower, upper = [], [], [], [], [], []
    body_tree, parent, joint, dof = [], [], [], []
    for k, tree in enumerate(ordered):
        body_tree.append(k)
        parent.append(-1)
        joint.append(JOINT_FIXED)
        dof.append(-1)
        columns = {}
        for name in tree.joints:
            columns[name] = len(dof_names)
            body_tree.append(k)
            parent.append(len(parent) - 1)
            joint.append(tree.kinds.get(name, JOINT_REVOLUTE))
            dof.append(len(dof_names))
            dof_names.append(name)
            dof_tree.append(k)
            lower.append(tree.limits[0])
            upper.append(tree.limits[1])
        if tree.root is not None:
            position, orientation = tuple(tree.offset[:3]), tuple(tree.offset[3:])
            roots.append(RootSource(tree=k, topic=tree.root, position=position, orientation=orientation))  # type: ignore[arg-type]
        if tree.topic is not None:
            sources.append(
                JointSource(
                    tree=k, topic=tree.topic, unit=tree.unit, rename=tree.rename, dofs=columns, mimics=tree.mimics
                )
            )
    bodies, none, nothing = len(body_tree), np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    starts = np.searchsorted(body_tree, np.arange(len(ordered) + 1))
    scene = Scene(
        gravity=np.array([0, 0, -9.81]),
        pieces=Pieces(*[nothing] * len(Pieces._fields)),
        bodies=Bodies(
            role=np.array([DRIVEN if ordered[t].avatar else FIXED for t in body_tree]),
            tree=np.array(body_tree),
            piece_start=np.zeros(bodies + 1, dtype=np.int64),
            material=np.zeros(bodies, dtype=np.int64),
            mass=np.zeros(bodies),
            com=np.zeros((bodies, 3)),
            inertia=np.zeros((bodies, 3)),
            principal=np.tile(IDENTITY[3:], (bodies, 1)),
            parent=np.array(parent),
            joint=np.array(joint),
            origin=np.zeros((bodies, 12)),
            axis=np.tile([0.0, 0.0, 1.0], (bodies, 1)),
            dof=np.array(dof),
            multiplier=np.ones(bodies),
            offset=np.zeros(bodies),
        ),
        trees=Trees(
            body_start=starts,
            dof_start=np.searchsorted(dof_tree, np.arange(len(ordered) + 1)),
            role=np.array([DRIVEN if t.avatar else FIXED for t in ordered]),
            moving=np.array([int(t.root is not None or t.topic is not None) for t in ordered]),
            rest=np.array([tuple(t.rest) for t in ordered], dtype=float).reshape(-1, 7),
            mass=np.ones(len(ordered)),
            stiffness=np.ones(len(ordered)),
            damping=np.ones(len(ordered)),
            chains=np.zeros(len(ordered), dtype=np.int64),
            self_collision=np.zeros(len(ordered), dtype=np.int64),
            effort=np.full(len(ordered), np.inf),
            squeeze=np.zeros(len(ordered)),
        ),
        dofs=Dofs(
            np.array(lower, dtype=float),
            np.array(upper, dtype=float),
            np.array(dof_tree, dtype=np.int64),
            nothing,
            none,
        ),
        chains=Chains(nothing, nothing, nothing),
        cones=ReachCones(nothing, nothing, none, nothing, none),
        materials=Materials(np.zeros((0, 0)), np.zeros((0, 0))),
        excluded=np.zeros((0, 0), dtype=np.int64),
        initial_velocity=np.zeros((bodies, 6)),
    )
    names = tuple(f"{ordered[t].name}/{i}" for i, t in enumerate(body_tree))
    table = RecordingTable(**(recording or {}))
    return World(
        facts=SceneFacts(recording=facts_of_recording(table)),
        parsed_file=SceneFile.model_construct(recording=table),
        path=Path("scene.toml"),
        scene=scene,
        tree_names=tuple(t.name for t in ordered),
        body_names=names,
        frame_names=names,
        dof_names=tuple(dof_names),
        avatar_count=sum(t.avatar for t in ordered),
        roots=tuple(roots),
        joints=tuple(sources),
        urdfs={},
        zero_pose_overlaps=(),
        triangles=(),
        collision_triangles=(),
    )


def turned(angle: float, axis: int = 2) -> tuple[float, float, float, float]:
    """Quaternion of a turn about an axis."""
    q = [0.0, 0.0, 0.0, float(np.cos(angle / 2))]
    q[axis] = float(np.sin(angle / 2))
    return (q[0], q[1], q[2], q[3])
