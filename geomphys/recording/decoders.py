"""Decodes message bytes with the library of each encoding (cdr, ros1, protobuf, json, flatbuffer).

cdr with ros2msg schemas goes through ``mcap-ros2-support``, ros1 through ``mcap-ros1-support`` (`ros1.py`), protobuf through
``mcap-protobuf-support``, json through the standard library, flatbuffer through `flatbuffer.py`. ``mcap-ros2-support`` does not
read schemas written in IDL (ros2idl); the standard types of ROS that are used here never change, so for those, and where
the schema is empty or corrupt, their known definition is used instead. Any other ros2idl type is an error that says so.
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
from geomphys.recording.display_names import printable
from geomphys.recording.reader import LogChannel
from geomphys.recording.ros_definitions import ROS1_TYPES, STANDARD_TYPES

Decoder = Callable[[bytes], Any]

_FIXED_BYTE_ARRAYS = re.compile(rb"^[^\S\n]*(?:uint8|byte)\[[0-9]+\]", re.MULTILINE)
"""Fixed-size byte arrays, which mcap-ros2-support reads without a bounds check; no supported type has them."""


ROS2_FIELD_LIMIT = 2_000
"""Fields and constants of a type of ROS 2: the library's time grows with their square."""
_SEPARATOR = re.compile(rb"^=+[ \t]*$", re.MULTILINE)


class BadMessageError(Exception):
    """A message that cannot be decoded or lacks fields of its type. Internal to the package."""


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
        With encoding cdr, ros1, protobuf, json or flatbuffer.
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
        return _guarded(_json)
    if channel.encoding == "protobuf":
        return _guarded(_protobuf(channel))
    if channel.encoding == "flatbuffer":
        return _flatbuffer(channel)
    if channel.encoding == "ros1":
        return _ros1(channel, schema_name)
    return _guarded_cdr(_ros2(channel, schema_name))


def _guarded(decode: Decoder, *more: type[Exception]) -> Decoder:
    """Map what a library raises on a bad payload to BadMessageError."""
    from google.protobuf.message import DecodeError

    errors = (*PAYLOAD_ERRORS, DecodeError, *more)

    def guarded(data: bytes) -> Any:
        try:
            return decode(data)
        except errors as problem:
            raise BadMessageError(f"cannot be decoded ({type(problem).__name__})") from problem

    return guarded


def _json(data: bytes) -> Any:
    """A message in JSON: an object."""
    message = json.loads(data)
    if not isinstance(message, dict):
        raise BadMessageError("is no JSON object")
    return message


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
            channel, f"messages are protobuf, the schema is {printable(channel.schema_encoding) or 'missing'}"
        )
    return decoder


def _ros2(channel: LogChannel, schema_name: str) -> Decoder:
    """Decoder from the message definition in the schema, or from the known one of a standard type."""
    data, name, standard = channel.schema_data, schema_name, STANDARD_TYPES.get(schema_name)
    if channel.schema_encoding == "ros2msg" and data.strip():
        if _FIXED_BYTE_ARRAYS.search(data):
            raise _unreadable(channel, "its message definition has byte arrays of fixed size")
        if any(_field_lines(part) > ROS2_FIELD_LIMIT for part in _SEPARATOR.split(data)):
            raise _unreadable(channel, f"its message definition has a type of more than {ROS2_FIELD_LIMIT} fields")
        decoder = _from_definition(name, data)
        if decoder is not None:
            return decoder
        reason = "its message definition cannot be read"
    else:
        reason = (
            f"its schema is {printable(channel.schema_encoding) or 'missing'}; of this type only ros2msg can be read"
        )
    decoder = _from_definition(schema_name, standard.encode()) if standard is not None else None
    if decoder is None:
        raise _unreadable(channel, reason)
    return decoder


def _field_lines(definition: bytes) -> int:
    """Lines of a type's definition that are neither empty nor comments."""
    return sum(bool(line.partition(b"#")[0].strip()) for line in definition.splitlines())


def _guarded_cdr(decode: Decoder) -> Decoder:
    """As `_guarded`; refuses what ``mcap-ros2-support`` would read as if it were plain CDR, and so wrongly."""

    def plain_only(data: bytes) -> Any:
        try:
            if data[1] < 2:
                return decode(data)
        except PAYLOAD_ERRORS as problem:
            raise BadMessageError(f"cannot be decoded ({type(problem).__name__})") from problem
        representation = (
            "a parameter list" if data[1] in (2, 3) else "XCDR2" if 6 <= data[1] <= 11 else "an unknown way"
        )
        raise BadMessageError(
            f"is written in {representation} (its first bytes are {data[:2].hex()}), and only plain CDR (0000 or 0001) can be "
            "read: record it with the data representation XCDR1, the default of ROS 2"
        )

    return plain_only


def _ros1(channel: LogChannel, schema_name: str) -> Decoder:
    """Decoder from the message definition in the schema, or from the known one of a standard type."""
    from geomphys.recording.ros1 import DefinitionError, make_ros1_decoder

    name, standard = schema_name.replace("/msg/", "/"), ROS1_TYPES.get(schema_name)
    text = channel.schema_data.decode("utf-8", "replace") if channel.schema_encoding == "ros1msg" else ""
    reason = (
        "its message definition" if text.strip() else f"its schema is {printable(channel.schema_encoding) or 'missing'}"
    )
    for definition in (text, standard or ""):
        if definition.strip():
            try:
                decode, short = make_ros1_decoder(name, definition)
            except DefinitionError as problem:
                reason = f"its message definition cannot be read: {problem}"
            else:
                return _guarded(decode, short)
    raise _unreadable(channel, reason)


def _flatbuffer(channel: LogChannel) -> Decoder:
    """Decoder from the compiled schema."""
    from geomphys.recording.flatbuffer import FlatBufferError, make_flatbuffer_decoder

    if channel.schema_encoding != "flatbuffer":
        reason = f"messages are FlatBuffers, the schema is {printable(channel.schema_encoding) or 'missing'}"
        raise _unreadable(channel, reason)
    try:
        return _guarded(make_flatbuffer_decoder(channel.schema_name.strip(), channel.schema_data), FlatBufferError)
    except FlatBufferError as problem:
        raise _unreadable(channel, f"its FlatBuffers schema cannot be read: {problem}") from problem


def _from_definition(name: str, definition: bytes) -> Decoder | None:
    """Decoder of a ros2msg definition; None if it cannot be read."""
    from mcap_ros2._vendor.rosidl_adapter.parser import InvalidSpecification, InvalidValue
    from mcap_ros2.decoder import DecoderFactory

    schema = Schema(id=1, name=name, encoding="ros2msg", data=definition)
    captured = io.StringIO()  # the library prints its findings; the caller reports the error once
    try:
        with contextlib.redirect_stderr(captured), contextlib.redirect_stdout(captured):
            decoder: Decoder | None = DecoderFactory().decoder_for("cdr", schema)
    except (*PAYLOAD_ERRORS, NameError, AssertionError, InvalidSpecification, InvalidValue):
        return None
    return decoder


def _unreadable(channel: LogChannel, reason: str) -> LogError:
    """Make the error for a channel whose schema cannot be used."""
    what = f"{printable(channel.schema_name)} ({printable(channel.encoding)})"
    return LogError(f"topic {printable(channel.topic)}: {what} cannot be decoded: {reason}")
