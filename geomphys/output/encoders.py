"""The messages of the output log, from arrays to bytes."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from geomphys.output.contact_arrows import arrow_lengths, arrow_orientations
from geomphys.output.message_templates import StampedTemplate, Template, entry, markers, stamp_field
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


def frame_header(frame: int, stamp: bytes) -> bytes:
    """Timestamp and frame, the first two fields of the project's own messages; `stamp` is a `stamp_field`."""
    if frame == 0:  # protobuf leaves a zero out
        return stamp
    data = bytearray([0x10])
    while frame > 0x7F:
        data.append(frame & 0x7F | 0x80)
        frame >>= 7
    data.append(frame)
    return stamp + data


class TransformsEncoder:
    """foxglove.FrameTransforms from ``world`` to a list of frames, of which only poses and time vary.

    Parameters
    ----------
    children : sequence of str
        Frame ids, in the order of the rows handed to `encode`.
    """

    def __init__(self, children: Sequence[str]) -> None:
        self._children = tuple(children)
        self._template = StampedTemplate(self._build, 7 * len(self._children))

    def encode(self, poses: Floats, stamp: bytes) -> bytes:
        """The message with `poses` (n, 7), contiguous, at an encoded time."""
        return self._template.fill(poses, stamp)

    def layout(self, time_ns: int) -> Template:
        """The layout of the messages of times that take as many bytes as this one."""
        return self._template.of(len(stamp_field(time_ns)))

    def _build(self, stamp: Timestamp) -> bytes:
        message = FrameTransforms()
        for row, child in enumerate(self._children):
            transform = message.transforms.add(parent_frame_id=WORLD, child_frame_id=child)
            transform.timestamp.CopyFrom(stamp)
            p, q = transform.translation, transform.rotation
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = markers(7, first=7 * row)
        data: bytes = message.SerializeToString()
        return data


class JointStateEncoder:
    """sensor_msgs/msg/JointState in CDR: names fixed, time and positions vary; velocity and effort empty."""

    def __init__(self, names: Sequence[str]) -> None:
        data = bytearray(b"\x00\x01\x00\x00" + bytes(8))  # little endian; stamp
        data += _cdr_string("", len(data))
        data += _cdr_align(len(data), 4) + struct.pack("<I", len(names))
        for name in names:
            data += _cdr_string(name, len(data))
        data += _cdr_align(len(data), 4) + struct.pack("<I", len(names))
        if names:
            data += _cdr_align(len(data), 8) + struct.pack(f"<{len(names)}d", *markers(len(names)))
        data += bytes(8)
        self._template = Template(bytes(data), len(names))

    def encode(self, positions: Floats, time_ns: int) -> bytes:
        """The message with `positions` (n,) [rad or m]."""
        seconds, nanos = divmod(time_ns, 1_000_000_000)
        data = self._template.fill(positions)
        return data[:4] + struct.pack("<iI", seconds, nanos) + data[12:]


def encode_string(text: str) -> bytes:
    """std_msgs/msg/String in CDR."""
    return b"\x00\x01\x00\x00" + _cdr_string(text, 4)


class ContactsEncoder:
    """geomphys.Contacts; one template for each pair of bodies that ever met."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._header = Contacts()
        self._templates: dict[tuple[int, int], Template] = {}

    def encode(self, contacts: ContactArrays, header: bytes) -> bytes:
        """The message of a frame that begins with `frame_header` it."""
        count = len(contacts.body_a)
        if count == 0:
            return header
        rows = np.empty((count, 9))
        rows[:, :3], rows[:, 3:6], rows[:, 6] = contacts.point, contacts.normal, contacts.depth
        rows[:, 7], rows[:, 8] = contacts.normal_impulse, contacts.tangential_impulse
        pairs = list(zip(contacts.body_a.tolist(), contacts.body_b.tolist(), strict=True))
        parts = [header]
        start = 0
        for end in range(1, count + 1):  # contacts of a pair stand together
            if end == count or pairs[end] != pairs[start]:
                parts.append(self._of(pairs[start]).fill_rows(rows[start:end]))
                start = end
        return b"".join(parts)

    def _of(self, pair: tuple[int, int]) -> Template:
        template = self._templates.get(pair)
        if template is None:
            message = Contacts()
            contact = message.contacts.add(body_a=self._names[pair[0]], body_b=self._names[pair[1]])
            for vector, first in ((contact.point, 0), (contact.normal, 3)):
                vector.x, vector.y, vector.z = markers(3, first)
            contact.depth, contact.normal_impulse, contact.tangential_impulse = markers(3, 6)
            template = self._templates[pair] = Template(message.SerializeToString(), 9)
        return template


class ContactPointsEncoder:
    """foxglove.PointCloud of the contacts: x y z, depth, normal and the bodies' indices, all float32."""

    FIELDS = ("x", "y", "z", "depth", "nx", "ny", "nz", "body_a", "body_b")

    def __init__(self) -> None:
        message = PointCloud(frame_id=WORLD, point_stride=4 * len(self.FIELDS))
        message.pose.orientation.w = 1.0
        for column, name in enumerate(self.FIELDS):
            message.fields.add(name=name, offset=4 * column, type=PackedElementField.FLOAT32)
        self._fixed: bytes = message.SerializeToString()

    def encode(self, contacts: ContactArrays, stamp: bytes) -> bytes:
        """The message of a frame; `stamp` is a `stamp_field`."""
        rows = np.empty((len(contacts.depth), len(self.FIELDS)), np.dtype("<f4"))
        rows[:, :3], rows[:, 3], rows[:, 4:7] = contacts.point, contacts.depth, contacts.normal
        rows[:, 7], rows[:, 8] = contacts.body_a, contacts.body_b
        return stamp + self._fixed + (entry(6, rows.tobytes()) if len(rows) else b"")


class ContactArrowsEncoder:
    """foxglove.SceneUpdate with an arrow along the normal at each contact; it replaces the arrows of before."""

    def __init__(self) -> None:
        entity = SceneEntity()
        arrow = entity.arrows.add(shaft_diameter=0.002, head_length=0.005, head_diameter=0.005)
        p, q = arrow.pose.position, arrow.pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w, arrow.shaft_length = markers(8)
        arrow.color.r, arrow.color.g, arrow.color.b, arrow.color.a = 0.95, 0.35, 0.1, 1.0
        self._arrow = Template(entity.SerializeToString(), 8)
        self._entity = SceneEntity(frame_id=WORLD, id="contacts").SerializeToString()

    def encode(self, contacts: ContactArrays, stamp: bytes) -> bytes:
        """The message of a frame."""
        count = len(contacts.depth)
        arrows = b""
        if count:
            rows = np.empty((count, 8))
            rows[:, :3] = contacts.point
            rows[:, 3:7] = arrow_orientations(contacts.normal)
            rows[:, 7] = arrow_lengths(contacts.depth)
            arrows = self._arrow.fill_rows(rows)
        return entry(2, stamp + self._entity + arrows)


class FrameEncoder:
    """The channels of figures: penetration depths, metrics, stage times and log lines.

    A message that holds more than numbers is made anew each time: one that is filled again keeps the memory of all it
    ever held.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._metrics = FrameMetrics()

    def penetration(self, pairs: PenetrationArrays, header: bytes) -> bytes:
        """geomphys.PenetrationDepths."""
        if len(pairs.body_a) == 0:
            return header
        message = PenetrationDepths()
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
        body: bytes = message.SerializeToString()
        return header + body

    def metrics(self, plot_values: Metrics, header: bytes) -> bytes:
        """geomphys.FrameMetrics."""
        message = self._metrics
        message.contacts = plot_values.contacts
        message.recorded_penetration_m = plot_values.recorded_penetration_m
        message.residual_penetration_m = plot_values.residual_penetration_m
        message.iterations = plot_values.iterations
        message.impacts = plot_values.impacts
        message.fallbacks = plot_values.fallbacks
        message.correction_m = plot_values.correction_m
        message.correction_rad = plot_values.correction_rad
        message.held = plot_values.held
        message.flags = plot_values.flags
        message.recorded_speed_m_s = plot_values.recorded_speed_m_s
        message.correction_speed_m_s = plot_values.correction_speed_m_s
        message.recorded_jerk_m_s3 = plot_values.recorded_jerk_m_s3
        message.correction_jerk_m_s3 = plot_values.correction_jerk_m_s3
        body: bytes = message.SerializeToString()
        return header + body

    def timing(self, stages: Iterable[tuple[str, int, int]], header: bytes) -> bytes:
        """geomphys.Timing."""
        message = Timing()
        for name, ns, count in stages:
            message.stages.add(name=name, ns=ns, count=count)
        body: bytes = message.SerializeToString()
        return header + body

    def log(self, level: str, text: str, time_ns: int) -> bytes:
        """foxglove.Log; `level` is info, warning or error."""
        message = Log(name="geomphys")
        message.timestamp.seconds, message.timestamp.nanos = divmod(time_ns, 1_000_000_000)
        message.level = _LEVELS[level]
        message.message = text
        data: bytes = message.SerializeToString()
        return data


def _cdr_align(position: int, size: int) -> bytes:
    """Padding at `position` to a multiple of `size`, counted from after the four bytes of the header."""
    return bytes(-(position - 4) % size)


def _cdr_string(text: str, position: int) -> bytes:
    data = text.encode() + b"\0"
    return _cdr_align(position, 4) + struct.pack("<I", len(data)) + data
