"""Encodes the messages of the output log: protobuf messages of Foxglove and geomphys, ROS 2 messages in CDR."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from geomphys.output.cdr import HEADER, NS_PER_S, CdrWriter
from geomphys.output.contact_arrows import arrow_lengths, arrow_orientations
from geomphys.output.proto.geomphys_pb2 import Contacts, FrameMetrics, PenetrationDepths, Timing
from geomphys.output.urdf_description import WORLD
from geomphys.results import METHODS, Metrics
from geomphys.results import Contacts as ContactArrays
from geomphys.results import Penetrations as PenetrationArrays

Floats = NDArray[np.float64]

STRING_DEFINITION = b"string data\n"
JOINT_STATE_DEFINITION = b"""\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}


class TransformsEncoder:
    """foxglove.FrameTransforms from ``world`` to a list of frames; one message is reused, its poses and times are set.

    Parameters
    ----------
    children : sequence of str
        Frame ids, in the order of the rows handed to `encode`.
    """

    def __init__(self, children: Sequence[str]) -> None:
        self._message = FrameTransforms()
        self._fields: list[tuple[Timestamp, Vector3, Quaternion]] = []
        for child in children:
            transform = self._message.transforms.add(parent_frame_id=WORLD, child_frame_id=child)
            self._fields.append((transform.timestamp, transform.translation, transform.rotation))
        self._seconds = 0

    def encode(self, poses: Floats, time_ns: int) -> bytes:
        """The message with world poses (n, 7): position [m] and quaternion x y z w."""
        seconds, nanos = divmod(time_ns, NS_PER_S)
        if seconds != self._seconds:
            self._seconds = seconds
            for stamp, _, _ in self._fields:
                stamp.seconds = seconds
        for (stamp, p, q), pose in zip(self._fields, poses.tolist(), strict=True):
            stamp.nanos = nanos
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = pose
        return _serialized(self._message)


class JointStateEncoder:
    """sensor_msgs/msg/JointState in CDR with fixed names; velocity and effort are empty."""

    def __init__(self, names: Sequence[str]) -> None:
        message = CdrWriter()
        message.header(0, "")
        message.numbers("I", len(names))
        for name in names:
            message.string(name)
        message.numbers("I", len(names))
        if names:
            message.align(8)
        self._names = bytes(message.data()[12:])

    def encode(self, positions: Floats, time_ns: int) -> bytes:
        """The message with `positions` (n,) [rad or m]."""
        stamp = struct.pack("<iI", *divmod(time_ns, NS_PER_S))
        return HEADER + stamp + self._names + positions.astype("<f8").tobytes() + bytes(8)


def encode_string(text: str) -> bytes:
    """std_msgs/msg/String in CDR."""
    message = CdrWriter()
    message.string(text)
    return bytes(message.data())


class ContactPointsEncoder:
    """foxglove.PointCloud of the contacts: x y z, depth, normal and the bodies' indices, all float32."""

    FIELDS = ("x", "y", "z", "depth", "nx", "ny", "nz", "body_a", "body_b")

    def __init__(self) -> None:
        self._layout = PointCloud(frame_id=WORLD, point_stride=4 * len(self.FIELDS))
        self._layout.pose.orientation.w = 1.0
        for column, name in enumerate(self.FIELDS):
            self._layout.fields.add(name=name, offset=4 * column, type=PackedElementField.FLOAT32)

    def encode(self, contacts: ContactArrays, time_ns: int) -> bytes:
        """The message of a frame."""
        rows = np.empty((len(contacts.depth), len(self.FIELDS)), np.dtype("<f4"))
        rows[:, :3], rows[:, 3], rows[:, 4:7] = contacts.point, contacts.depth, contacts.normal
        rows[:, 7], rows[:, 8] = contacts.body_a, contacts.body_b
        message = PointCloud(data=rows.tobytes())
        message.MergeFrom(self._layout)
        _set_time(message.timestamp, time_ns)
        return _serialized(message)


class ContactArrowsEncoder:
    """foxglove.SceneUpdate with an arrow along the normal at each contact; it replaces the arrows of the frame before."""

    def __init__(self) -> None:
        self._arrow = ArrowPrimitive(shaft_diameter=0.002, head_length=0.005, head_diameter=0.005)
        color = self._arrow.color
        color.r, color.g, color.b, color.a = 0.95, 0.35, 0.1, 1.0

    def encode(self, contacts: ContactArrays, time_ns: int) -> bytes:
        """The message of a frame."""
        message = SceneUpdate()
        entity = message.entities.add(frame_id=WORLD, id="contacts")
        _set_time(entity.timestamp, time_ns)
        orientations, lengths = arrow_orientations(contacts.normal), arrow_lengths(contacts.depth)
        rows = zip(contacts.point.tolist(), orientations.tolist(), lengths.tolist(), strict=True)
        for point, orientation, length in rows:
            arrow = entity.arrows.add(shaft_length=length)
            arrow.MergeFrom(self._arrow)
            p, q = arrow.pose.position, arrow.pose.orientation
            p.x, p.y, p.z = point
            q.x, q.y, q.z, q.w = orientation
        return _serialized(message)


class FrameEncoder:
    """The channels with numbers of a frame: contacts, penetration depths, metrics, stage times, and log lines.

    Only messages of scalar fields are reused: one with repeated fields or strings keeps the memory of all its former
    contents.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._metrics = FrameMetrics()

    def contacts(self, contacts: ContactArrays, frame: int, time_ns: int) -> bytes:
        """geomphys.Contacts."""
        message, names = Contacts(frame=frame), self._names
        _set_time(message.timestamp, time_ns)
        columns = zip(*(column.tolist() for column in contacts), strict=True)
        for body_a, body_b, point, normal, depth, normal_impulse, tangential_impulse in columns:
            contact = message.contacts.add(
                body_a=names[body_a],
                body_b=names[body_b],
                depth=depth,
                normal_impulse=normal_impulse,
                tangential_impulse=tangential_impulse,
            )
            p, n = contact.point, contact.normal
            p.x, p.y, p.z = point
            n.x, n.y, n.z = normal
        return _serialized(message)

    def penetrations(self, pairs: PenetrationArrays, frame: int, time_ns: int) -> bytes:
        """geomphys.PenetrationDepths."""
        message = PenetrationDepths(frame=frame)
        _set_time(message.timestamp, time_ns)
        columns = zip(*(column.tolist() for column in pairs), strict=True)
        for body_a, body_b, pd, convex_pairs, largest, method in columns:
            pair = message.pairs.add(
                body_a=self._names[body_a],
                body_b=self._names[body_b],
                convex_pairs=convex_pairs,
                largest=largest,
                method=METHODS[method],
            )
            pair.pd.x, pair.pd.y, pair.pd.z = pd
        return _serialized(message)

    def metrics(self, metrics: Metrics, frame: int, time_ns: int) -> bytes:
        """geomphys.FrameMetrics."""
        message = self._metrics
        message.frame = frame
        _set_time(message.timestamp, time_ns)
        message.contacts = metrics.contacts
        message.recorded_penetration_m = metrics.recorded_penetration_m
        message.residual_penetration_m = metrics.residual_penetration_m
        message.iterations = metrics.iterations
        message.impacts = metrics.impacts
        message.fallbacks = metrics.fallbacks
        message.correction_m = metrics.correction_m
        message.correction_rad = metrics.correction_rad
        message.held = metrics.held
        message.flags = metrics.flags
        message.recorded_speed_m_s = metrics.recorded_speed_m_s
        message.correction_speed_m_s = metrics.correction_speed_m_s
        message.recorded_jerk_m_s3 = metrics.recorded_jerk_m_s3
        message.correction_jerk_m_s3 = metrics.correction_jerk_m_s3
        message.shape_change_rad = metrics.shape_change_rad
        message.amplification = metrics.amplification
        message.contacts_recorded = metrics.contacts_recorded
        message.contacts_kept = metrics.contacts_kept
        message.grasps_recorded = metrics.grasps_recorded
        message.grasps_kept = metrics.grasps_kept
        message.fingertip_error_m = metrics.fingertip_error_m
        message.contact_precision_m = metrics.contact_precision_m
        message.contact_alignment_rad = metrics.contact_alignment_rad
        return _serialized(message)

    def timing(self, stages: Iterable[tuple[str, int, int]], frame: int, time_ns: int) -> bytes:
        """geomphys.Timing of stages (dotted name, ns, count)."""
        message = Timing(frame=frame)
        _set_time(message.timestamp, time_ns)
        for name, ns, count in stages:
            message.stages.add(name=name, ns=ns, count=count)
        return _serialized(message)

    def log(self, level: str, text: str, time_ns: int) -> bytes:
        """foxglove.Log; `level` is info, warning or error."""
        message = Log(name="geomphys", level=_LEVELS[level], message=text)
        _set_time(message.timestamp, time_ns)
        return _serialized(message)


def _set_time(stamp: Timestamp, time_ns: int) -> None:
    stamp.seconds, stamp.nanos = divmod(time_ns, NS_PER_S)


def _serialized(message: Message) -> bytes:
    data: bytes = message.SerializeToString()
    return data
