"""Bytes of a message to its decoded form, by the library of its encoding.

cdr with ros2msg schemas goes through ``mcap-ros2-support``, protobuf through ``mcap-protobuf-support``, json through
the standard library. ``mcap-ros2-support`` does not read schemas written in IDL (ros2idl); the standard types of ROS 2
that are used here never change, so for those, and where the schema is empty or corrupt, their known definition is used
instead. Any other ros2idl type is an error that says so.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import struct
from collections.abc import Callable
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Schema

from geomphys.errors import LogError
from geomphys.recording.naming import plain
from geomphys.recording.reader import LogChannel

Decoder = Callable[[bytes], Any]

_STAMPED = """std_msgs/Header header
{body}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_VECTORS = """================================================================================
MSG: geometry_msgs/{name}
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_POSE = """================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
""" + _VECTORS.format(name="Point")
_TRANSFORM = """================================================================================
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
""" + _VECTORS.format(name="Vector3")

STANDARD_TYPES = {
    "sensor_msgs/msg/JointState": _STAMPED.format(
        body="string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
    ),
    "geometry_msgs/msg/PoseStamped": _STAMPED.format(body="geometry_msgs/Pose pose") + _POSE,
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"
    + "=" * 80
    + "\nMSG: geometry_msgs/TransformStamped\n"
    + _STAMPED.format(body="string child_frame_id\ngeometry_msgs/Transform transform")
    + _TRANSFORM,
}
"""Definitions of the standard ROS 2 types, used where a log does not bring a ros2msg one."""


_UNCHECKED = re.compile(rb"^\s*(?:uint8|byte)\[[0-9]+\]", re.MULTILINE)
"""Fields that mcap-ros2-support reads without a look at how many bytes are left; no type that is read here has them."""


class BadMessageError(Exception):
    """A message that cannot be decoded or does not hold what its type says. Never leaves the package."""


PAYLOAD_ERRORS = (
    AttributeError,
    KeyError,
    IndexError,
    TypeError,
    ValueError,
    OverflowError,
    RecursionError,
    MemoryError,
    NotImplementedError,
    struct.error,
    McapError,
)
"""What the decoding libraries raise on a payload that does not fit its schema."""


def make_decoder(channel: LogChannel, schema_name: str) -> Decoder:
    """Make the decoder of a channel.

    Parameters
    ----------
    channel : LogChannel
        With encoding cdr, protobuf or json.
    schema_name : str
        The schema's name in its full form (``package/msg/Type``).

    Returns
    -------
    callable
        From a message's bytes to its decoded form; raises BadMessageError.

    Raises
    ------
    LogError
        The schema cannot be read.
    """
    if channel.encoding == "json":
        return _safe(json.loads)
    if channel.encoding == "protobuf":
        return _safe(_protobuf(channel))
    return _safe(_ros2(channel, schema_name))


def _safe(decode: Decoder) -> Decoder:
    """Map what a library raises on a bad payload to BadMessageError."""
    from google.protobuf.message import DecodeError

    errors = (*PAYLOAD_ERRORS, DecodeError)

    def safe(data: bytes) -> Any:
        try:
            return decode(data)
        except errors as problem:
            raise BadMessageError(f"cannot be decoded ({type(problem).__name__})") from problem

    return safe


def _protobuf(channel: LogChannel) -> Decoder:
    """Decoder from the descriptors in the schema."""
    from google.protobuf.message import DecodeError
    from mcap_protobuf.decoder import DecoderFactory

    schema = Schema(id=1, name=channel.schema_name, encoding=channel.schema_encoding, data=channel.schema_data)
    try:
        decoder: Decoder | None = DecoderFactory().decoder_for("protobuf", schema)
    except (*PAYLOAD_ERRORS, DecodeError) as problem:
        raise _unreadable(channel, "its protobuf descriptors cannot be read") from problem
    if decoder is None:
        raise _unreadable(
            channel, f"messages are protobuf, the schema is {plain(channel.schema_encoding) or 'missing'}"
        )
    return decoder


def _ros2(channel: LogChannel, schema_name: str) -> Decoder:
    """Decoder from the message definition in the schema, or from the known one of a standard type."""
    data, name, standard = channel.schema_data, channel.schema_name, STANDARD_TYPES.get(schema_name)
    if channel.schema_encoding == "ros2msg" and data.strip():
        if _UNCHECKED.search(data):
            raise _unreadable(channel, "its message definition has byte arrays of fixed size")
        decoder = _from_definition(name, data)
        if decoder is not None:
            return decoder
        why = "its message definition cannot be read"
    else:
        why = f"its schema is {plain(channel.schema_encoding) or 'missing'}; of this type only ros2msg can be read"
    decoder = _from_definition(schema_name, standard.encode()) if standard is not None else None
    if decoder is None:
        raise _unreadable(channel, why)
    return decoder


def _from_definition(name: str, definition: bytes) -> Decoder | None:
    """Decoder of a ros2msg definition; None if it cannot be read."""
    from mcap_ros2._vendor.rosidl_adapter.parser import InvalidSpecification, InvalidValue
    from mcap_ros2.decoder import DecoderFactory

    schema = Schema(id=1, name=name, encoding="ros2msg", data=definition)
    said = io.StringIO()  # the library prints what it finds wrong; the error is told once, by the caller
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            decoder: Decoder | None = DecoderFactory().decoder_for("cdr", schema)
    except (*PAYLOAD_ERRORS, NameError, AssertionError, InvalidSpecification, InvalidValue):
        return None
    return decoder


def _unreadable(channel: LogChannel, why: str) -> LogError:
    """Make the error for a channel whose schema does not serve."""
    what = f"{plain(channel.schema_name)} ({plain(channel.encoding)})"
    return LogError(f"topic {plain(channel.topic)}: {what} cannot be decoded: {why}")
