"""Writes poses and joint angles to an MCAP file in one of the three encodings that trackers and gloves use.

Numbers are rounded before writing (positions and angles to 1e-9, quaternions to 1e-10), so that the bytes of the
messages do not hang on the last bit of a sine.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

START_NS = 1_760_601_600_000_000_000  # 2025-10-16 08:00:00 UTC
HEADER = "std_msgs/Header header\n"
RULE = "=" * 80 + "\n"
HEADER_PARTS = (
    RULE + "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + RULE + "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)  # fmt: skip
POSE_STAMPED = (
    HEADER + "geometry_msgs/Pose pose\n"
    + RULE + "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
    + RULE + "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
    + RULE + "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
    + HEADER_PARTS
)  # fmt: skip
JOINT_STATE = HEADER + "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + HEADER_PARTS


class Recording(NamedTuple):
    """``poses``: topic -> positions (n, 3), quaternions (n, 4); ``joints``: topic -> name -> angles; ``rate`` in Hz."""

    rate: float
    poses: dict[str, tuple[np.ndarray, np.ndarray]]
    joints: dict[str, dict[str, np.ndarray]]
    note: str


def write(path: Path, recording: Recording, encoding: str) -> None:
    """Write with encoding ``ros2``, ``protobuf`` or ``json``; stamps and log times are the sample's time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as stream:
        {"ros2": _ros2, "protobuf": _protobuf, "json": _json}[encoding](stream, recording)


def stamps(count: int, rate: float) -> list[int]:
    """Times of the samples in ns since 1970."""
    return [START_NS + round(k * 1_000_000_000 / rate) for k in range(count)]


def _samples(recording: Recording, pose: Callable[..., None], joints: Callable[..., None]) -> None:
    """Call ``pose(topic, k, t, position, quaternion)`` and ``joints(topic, k, t, names, angles)`` in order of time."""
    poses = {t: (np.round(p, 9) + 0.0, np.round(q, 10) + 0.0) for t, (p, q) in sorted(recording.poses.items())}
    angles = {
        topic: (list(values), np.round(np.stack(list(values.values()), axis=1), 9) + 0.0)
        for topic, values in sorted(recording.joints.items())
    }
    count = len(next(iter(poses.values()))[0])
    for k, t in enumerate(stamps(count, recording.rate)):
        for topic, (p, q) in poses.items():
            pose(topic, k, t, p[k].tolist(), q[k].tolist())
        for topic, (names, values) in angles.items():
            joints(topic, k, t, names, values[k].tolist())


def _ros2(stream: BinaryIO, recording: Recording) -> None:
    writer = Ros2Writer(stream, compression=CompressionType.ZSTD)
    pose_schema = writer.register_msgdef("geometry_msgs/msg/PoseStamped", POSE_STAMPED)
    joint_schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)

    def header(t: int, frame: str) -> dict[str, object]:
        return {"stamp": {"sec": t // 10**9, "nanosec": t % 10**9}, "frame_id": frame}

    def pose(topic: str, k: int, t: int, p: list[float], q: list[float]) -> None:
        value = {"position": dict(zip("xyz", p, strict=True)), "orientation": dict(zip("xyzw", q, strict=True))}
        writer.write_message(topic, pose_schema, {"header": header(t, "world"), "pose": value}, t, t, k)

    def joints(topic: str, k: int, t: int, names: list[str], angles: list[float]) -> None:
        message = {"header": header(t, ""), "name": names, "position": angles, "velocity": [], "effort": []}
        writer.write_message(topic, joint_schema, message, t, t, k)

    _samples(recording, pose, joints)
    _note(writer, recording)
    writer.finish()


def _protobuf(stream: BinaryIO, recording: Recording) -> None:
    with ProtobufWriter(stream, compression=CompressionType.ZSTD) as writer:

        def pose(topic: str, k: int, t: int, p: list[float], q: list[float]) -> None:
            m = PoseInFrame(frame_id="world")
            m.timestamp.FromNanoseconds(t)
            m.pose.position.x, m.pose.position.y, m.pose.position.z = p
            m.pose.orientation.x, m.pose.orientation.y, m.pose.orientation.z, m.pose.orientation.w = q
            writer.write_message(topic, m, t, t, k)

        def joints(topic: str, k: int, t: int, names: list[str], angles: list[float]) -> None:
            m = JointStates()
            m.timestamp.FromNanoseconds(t)
            for name, angle in zip(names, angles, strict=True):
                m.joints.add(name=name, position=angle)
            writer.write_message(topic, m, t, t, k)

        _samples(recording, pose, joints)
        _note(writer, recording)


def _json(stream: BinaryIO, recording: Recording) -> None:
    writer = RawWriter(stream, compression=CompressionType.ZSTD)
    writer.start(profile="", library="geomphys recordings")
    channels: dict[str, int] = {}

    def put(topic: str, schema: str, k: int, t: int, message: dict[str, object]) -> None:
        if topic not in channels:
            layout = json.dumps({"title": schema, "type": "object"}).encode()
            channels[topic] = writer.register_channel(
                topic, "json", writer.register_schema(schema, "jsonschema", layout)
            )
        stamped = {"timestamp": {"sec": t // 10**9, "nsec": t % 10**9}, **message}
        data = json.dumps(stamped, separators=(",", ":"), allow_nan=False).encode()
        writer.add_message(channels[topic], log_time=t, data=data, publish_time=t, sequence=k)

    def pose(topic: str, k: int, t: int, p: list[float], q: list[float]) -> None:
        value = {"position": dict(zip("xyz", p, strict=True)), "orientation": dict(zip("xyzw", q, strict=True))}
        put(topic, "foxglove.PoseInFrame", k, t, {"frame_id": "world", "pose": value})

    def joints(topic: str, k: int, t: int, names: list[str], angles: list[float]) -> None:
        rows = [{"name": name, "position": angle} for name, angle in zip(names, angles, strict=True)]
        put(topic, "foxglove.JointStates", k, t, {"joints": rows})

    _samples(recording, pose, joints)
    _note(writer, recording)
    writer.finish()


def _note(writer: Ros2Writer | ProtobufWriter | RawWriter, recording: Recording) -> None:
    writer.add_metadata(
        "source", {"description": recording.note, "licence": "MIT", "origin": "synthetic, make_recordings.py"}
    )
