"""Encodes the messages of the output log, those of many frames at once: protobuf of Foxglove and geomphys, ROS 2 in CDR."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from numpy.typing import NDArray

from geomphys.output.byte_strings import ByteStrings
from geomphys.output.cdr import HEADER, NS_PER_S, CdrWriter
from geomphys.output.contact_arrows import arrow_lengths, arrow_orientations
from geomphys.output.frame_columns import RaggedContacts, RaggedPenetrations
from geomphys.output.proto.geomphys_pb2 import (
    Contact,
    Contacts,
    FrameMetrics,
    PairPenetration,
    PenetrationDepths,
    Stage,
    Timing,
)
from geomphys.output.protobuf_columns import Rows, message, stamps
from geomphys.output.urdf_description import WORLD
from geomphys.results import METHODS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

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
    """foxglove.FrameTransforms from ``world`` to a list of frames.

    Parameters
    ----------
    children : sequence of str
        Frame ids, in the order of the columns handed to `encode`.
    """

    def __init__(self, children: Sequence[str]) -> None:
        names = ByteStrings.of([child.encode() for child in children])
        self._names = message(FrameTransform, parent_frame_id=WORLD.encode(), child_frame_id=names).split()
        self._count = len(children)

    def encode(self, poses: Floats, times_ns: Ints) -> ByteStrings:
        """The messages with world poses (n, m, 7), position [m] and quaternion x y z w, at times (n,)."""
        frames = np.repeat(np.arange(len(poses)), self._count)
        heads = message(FrameTransform, timestamp=stamps(times_ns)).split()
        pose = message(
            FrameTransform,
            translation=_vectors(poses[..., :3].reshape(-1, 3)),
            rotation=_vectors(poses[..., 3:].reshape(-1, 4)),
        )
        transforms = Rows.beside([heads[frames], self._names[np.tile(np.arange(self._count), len(poses))], pose])
        return message(FrameTransforms, transforms=transforms).split(np.full(len(poses), self._count))


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

    def encode(self, positions: Floats, times_ns: Ints) -> ByteStrings:
        """The messages with `positions` (n, q) [rad or m] at times (n,)."""
        stamp = ByteStrings.of_rows(np.stack(np.divmod(times_ns, NS_PER_S), axis=1).astype(np.uint32))
        return Rows.beside([HEADER, stamp, self._names, ByteStrings.of_rows(positions), bytes(8)]).split()


def encode_string(text: str) -> bytes:
    """std_msgs/msg/String in CDR."""
    message = CdrWriter()
    message.string(text)
    return bytes(message.data())


class ContactPointsEncoder:
    """foxglove.PointCloud of the contacts: x y z, depth, normal and the bodies' indices, all float32."""

    POINT = np.dtype([(name, "<f4") for name in ("x", "y", "z", "depth", "nx", "ny", "nz", "body_a", "body_b")])

    def __init__(self) -> None:
        layout = PointCloud(frame_id=WORLD, point_stride=self.POINT.itemsize)
        layout.pose.orientation.w = 1.0
        for name, (_, offset, *_) in (self.POINT.fields or {}).items():
            layout.fields.add(name=name, offset=offset, type=PackedElementField.FLOAT32)
        self._layout = layout.SerializeToString()

    def encode(self, contacts: RaggedContacts, times_ns: Ints) -> ByteStrings:
        """The messages of frames at times (n,)."""
        columns, counts = contacts
        points = np.empty(len(columns.depth), self.POINT)
        points["x"], points["y"], points["z"] = columns.point.T
        points["nx"], points["ny"], points["nz"] = columns.normal.T
        points["depth"], points["body_a"], points["body_b"] = columns.depth, columns.body_a, columns.body_b
        time = message(PointCloud, timestamp=stamps(times_ns))
        data = message(PointCloud, data=ByteStrings.of_rows(points).grouped(counts))
        return Rows.beside([time, self._layout, data]).split()


class ContactArrowsEncoder:
    """foxglove.SceneUpdate with an arrow along the normal at each contact; it replaces the arrows of the frame before."""

    COLOR = Color(r=0.95, g=0.35, b=0.1, a=1.0)

    def encode(self, contacts: RaggedContacts, times_ns: Ints, durations: Floats) -> ByteStrings:
        """The messages of frames at times (n,), with their durations (n,) [s]; see `arrow_lengths`."""
        columns, counts = contacts
        arrows = message(
            ArrowPrimitive,
            pose=message(
                Pose,
                position=_vectors(columns.point),
                orientation=_vectors(arrow_orientations(columns.normal)),
            ),
            shaft_length=arrow_lengths(columns, np.repeat(durations, counts)),
            shaft_diameter=0.002,
            head_length=0.005,
            head_diameter=0.005,
            color=self.COLOR.SerializeToString(),
        )
        tails = message(SceneEntity, arrows=arrows).split(counts)
        entity = message(SceneEntity, timestamp=stamps(times_ns), frame_id=WORLD.encode(), id=b"contacts")
        return message(SceneUpdate, entities=Rows.beside([entity, tails])).split()


class FrameEncoder:
    """The channels with numbers of frames: contacts, penetration depths, metrics, stage times, and log lines."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = ByteStrings.of([name.encode() for name in names])
        self._methods = ByteStrings.of([name.encode() for name in METHODS])

    def contacts(self, contacts: RaggedContacts, frames: Ints, times_ns: Ints) -> ByteStrings:
        """geomphys.Contacts of frames (n,) at times (n,)."""
        columns, counts = contacts
        rows = message(
            Contact,
            body_a=self._names[columns.body_a],
            body_b=self._names[columns.body_b],
            point=_vectors(columns.point),
            normal=_vectors(columns.normal),
            depth=columns.depth,
            normal_impulse=columns.normal_impulse,
            tangential_impulse=columns.tangential_impulse,
        )
        return _with_rows(Contacts, frames, times_ns, counts, contacts=rows)

    def penetrations(self, pairs: RaggedPenetrations, frames: Ints, times_ns: Ints) -> ByteStrings:
        """geomphys.PenetrationDepths of frames (n,) at times (n,)."""
        columns, counts = pairs
        rows = message(
            PairPenetration,
            body_a=self._names[columns.body_a],
            body_b=self._names[columns.body_b],
            pd=_vectors(columns.pd),
            convex_pairs=columns.convex_pairs,
            largest=columns.largest,
            method=self._methods[columns.method],
        )
        return _with_rows(PenetrationDepths, frames, times_ns, counts, pairs=rows)

    def metrics(self, metrics: Mapping[str, NDArray[Any]], frames: Ints, times_ns: Ints) -> ByteStrings:
        """geomphys.FrameMetrics of frames (n,) at times (n,)."""
        return message(FrameMetrics, timestamp=stamps(times_ns), frame=frames, **metrics).split()

    def timing(self, stages: Sequence[str], ns: Ints, counts: Ints, frames: Ints, times_ns: Ints) -> ByteStrings:
        """geomphys.Timing of s stages, their times (n, s) and counts (n, s), of frames (n,) at times (n,)."""
        n = len(frames)
        rows = message(
            Stage,
            name=ByteStrings.of([name.encode() for name in stages])[np.tile(np.arange(len(stages)), n)],
            ns=ns.ravel(),
            count=counts.ravel(),
        )
        return _with_rows(Timing, frames, times_ns, np.full(n, len(stages), np.int64), stages=rows)

    def log(self, level: str, text: str, time_ns: int) -> bytes:
        """foxglove.Log; `level` is info, warning or error."""
        line = Log(name="geomphys", level=_LEVELS[level], message=text)
        line.timestamp.seconds, line.timestamp.nanos = divmod(time_ns, NS_PER_S)
        data: bytes = line.SerializeToString()
        return data


def _vectors(values: Floats) -> Rows:
    """Messages with the fields x y z, or x y z w, of (n, 3) or (n, 4)."""
    kind = Vector3 if values.shape[1] == 3 else Quaternion
    return message(kind, **dict(zip("xyzw", values.T, strict=False)))


def _with_rows(kind: type[Message], frames: Ints, times_ns: Ints, counts: Ints, **rows: Rows) -> ByteStrings:
    """Messages of frames (n,) at times (n,), each with `counts` (n,) of the rows of one repeated field."""
    head = message(kind, timestamp=stamps(times_ns), frame=frames)
    return Rows.beside([head, message(kind, **rows).split(counts)]).split()
