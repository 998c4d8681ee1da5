"""Decodes the messages of an output log; the inverse of `geomphys.output.encoders`."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from numpy.typing import NDArray

from geomphys.output.proto.geomphys_pb2 import Contacts, FrameMetrics, PenetrationDepths, Timing

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

METRICS = tuple(f.name for f in FrameMetrics.DESCRIPTOR.fields if f.name != "timestamp")
"""Names of the fields of a frame's metrics."""


class Poses(NamedTuple):
    """Named poses in the world."""

    names: tuple[str, ...]  # frame ids as in the channel
    values: Floats  # (n, 7) position [m] and quaternion x y z w


class JointValues(NamedTuple):
    """Named joint values."""

    names: tuple[str, ...]
    values: Floats  # (n,) rad or m


class ContactRow(NamedTuple):
    """A contact; see geomphys.proto."""

    body_a: str
    body_b: str
    point: Vector
    normal: Vector
    depth: float
    normal_impulse: float
    tangential_impulse: float


class PenetrationRow(NamedTuple):
    """A pair of bodies that overlapped at the recorded poses; see geomphys.proto."""

    body_a: str
    body_b: str
    pd: Vector
    convex_pairs: int
    largest: float
    method: str


class StageRow(NamedTuple):
    """A stage's time."""

    name: str
    ns: int
    calls: int


class LogRow(NamedTuple):
    """A line of the log; level is ``info``, ``warning`` or ``error``."""

    level: str
    text: str


def decode_transforms(data: bytes) -> Poses:
    """Poses of a foxglove.FrameTransforms; raises google.protobuf's DecodeError if `data` is none."""
    transforms = FrameTransforms.FromString(data).transforms
    vectors = [(t.translation, t.rotation) for t in transforms]
    rows = [(p.x, p.y, p.z, q.x, q.y, q.z, q.w) for p, q in vectors]
    return Poses(tuple(t.child_frame_id for t in transforms), np.array(rows, np.float64).reshape(-1, 7))


class JointStateDecoder:
    """Decodes sensor_msgs/msg/JointState in little-endian CDR; the names are parsed only when their bytes change."""

    def __init__(self) -> None:
        self._head = b""
        self._names: tuple[str, ...] = ()
        self._start = 0

    def decode(self, data: bytes) -> JointValues:
        """Names and positions; raises struct.error or ValueError if the message is none."""
        end = 12 + len(self._head)
        if not self._head or data[12:end] != self._head:
            self._parse(data)
        return JointValues(self._names, np.frombuffer(data, "<f8", len(self._names), self._start).astype(np.float64))

    def _parse(self, data: bytes) -> None:
        if data[1] != 1:
            raise ValueError("a JointState that is not little-endian CDR")
        position = 12
        (length,) = struct.unpack_from("<I", data, position)
        position = _aligned(position + 4 + length, 4)
        (count,) = struct.unpack_from("<I", data, position)
        position += 4
        names = []
        for _ in range(count):
            position = _aligned(position, 4)
            (length,) = struct.unpack_from("<I", data, position)
            names.append(data[position + 4 : position + 3 + length].decode())
            position += 4 + length
        position = _aligned(position, 4)
        (count,) = struct.unpack_from("<I", data, position)
        if count != len(names):
            raise ValueError(f"a JointState with {len(names)} names and {count} positions")
        position += 4
        self._head = data[12:position]
        self._names = tuple(names)
        self._start = _aligned(position, 8) if count else position


def decode_contacts(data: bytes) -> tuple[ContactRow, ...]:
    """Rows of geomphys.Contacts."""
    message = Contacts.FromString(data)
    return tuple(
        ContactRow(
            c.body_a,
            c.body_b,
            (c.point.x, c.point.y, c.point.z),
            (c.normal.x, c.normal.y, c.normal.z),
            c.depth,
            c.normal_impulse,
            c.tangential_impulse,
        )
        for c in message.contacts
    )


def decode_penetrations(data: bytes) -> tuple[PenetrationRow, ...]:
    """Rows of geomphys.PenetrationDepths."""
    message = PenetrationDepths.FromString(data)
    return tuple(
        PenetrationRow(p.body_a, p.body_b, (p.pd.x, p.pd.y, p.pd.z), p.convex_pairs, p.largest, p.method)
        for p in message.pairs
    )


def decode_metrics(data: bytes) -> dict[str, float]:
    """Fields of geomphys.FrameMetrics by name; `held` is 0 or 1."""
    message = FrameMetrics.FromString(data)
    return {name: getattr(message, name) for name in METRICS}


def decode_timing(data: bytes) -> tuple[StageRow, ...]:
    """Rows of geomphys.Timing."""
    message = Timing.FromString(data)
    return tuple(StageRow(s.name, s.ns, s.count) for s in message.stages)


def decode_log(data: bytes) -> LogRow:
    """A foxglove.Log line."""
    message = Log.FromString(data)
    return LogRow(Log.Level.Name(message.level).lower(), message.message)


def decode_string(data: bytes) -> str:
    """Text of a std_msgs/msg/String in little-endian CDR; raises struct.error if it is none."""
    (length,) = struct.unpack_from("<I", data, 4)
    return data[8 : 7 + length].decode()


def _aligned(position: int, size: int) -> int:
    """The next multiple of `size`, counted from after the four bytes of the header."""
    return position + -(position - 4) % size
