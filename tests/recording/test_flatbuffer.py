"""FlatBuffers by their schema: what is there, what is not, and bytes that lead astray."""

from __future__ import annotations

import random
import struct
from contextlib import suppress

import flatbuffers
import pytest

from geomphys.errors import LogError
from geomphys.recording.channels import kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.flatbuffer import (
    VALUE_LIMIT,
    FlatBufferDecoder,
    FlatBufferError,
    make_flatbuffer_decoder,
    read_schema,
)
from geomphys.recording.reader import LogChannel
from tests.recording.made_messages import SCHEMAS, SEVEN, hand_record, joint_record, make, tracker_record

ISAAC = (SCHEMAS / "isaac.bfbs").read_bytes()
FOXGLOVE = (SCHEMAS / "foxglove.bfbs").read_bytes()


def test_the_compilers_schema_is_read():
    names, objects = read_schema(ISAAC)
    hand = objects[names["core.HandJointPose"]]
    assert hand.is_struct
    assert hand.size == 36
    assert {f.name: f.offset for f in hand.fields} == {"pose": 0, "is_valid": 28, "radius": 32}
    assert {f.name: f.default for f in objects[names["core.JointState"]].fields}["valid"] is True
    names, objects = read_schema(FOXGLOVE)
    assert {f.name: f.default for f in objects[names["foxglove.JointState"]].fields}["position"] is None


def test_a_message_becomes_dictionaries_with_defaults_and_none():
    decode = make_flatbuffer_decoder("core.JointStateOutputRecord", ISAAC)
    found = decode(joint_record({"a": 0.5, "b": None}))
    assert (
        found["timestamp"]["sample_time_raw_device_clock"] - found["timestamp"]["available_time_local_common_clock"]
        == 2000
    )
    a, b = found["data"]["joints"]
    assert a == {"name": "a", "position": 0.5, "velocity": 0.0, "effort": 0.0, "valid": True}
    assert b["valid"] is False
    assert found["data"]["ee_pose"] is None
    assert found["data"]["device_id"] is None
    assert make_flatbuffer_decoder("core.HandPoseRecord", ISAAC)(hand_record(None))["data"] is None


def test_every_cut_and_every_changed_byte_is_read_or_a_bad_message():
    chance = random.Random(1)
    for name in (
        "core.HandPoseRecord",
        "core.Se3TrackerPoseRecord",
        "core.JointStateOutputRecord",
        "foxglove.PosesInFrame",
    ):
        made = make(name, "flatbuffer")
        channel = LogChannel(0, "/t", name, "flatbuffer", made.schema_data, "flatbuffer", 1, 0, 0)
        read = make_message_reader(channel, kind_of(channel))
        tries = [made.data[:n] for n in range(0, len(made.data), 3)]
        for _ in range(300):
            data = bytearray(made.data)
            for _ in range(chance.randint(1, 4)):
                data[chance.randrange(len(data))] = chance.choice((0, 1, 4, 0x7F, 0x80, 0xFF, chance.randrange(256)))
            tries.append(bytes(data))
        for data in tries:
            with suppress(BadMessageError):
                read(data)


def test_every_changed_byte_of_a_schema_is_read_or_an_error():
    chance = random.Random(2)
    for _ in range(400):
        data = bytearray(ISAAC)
        for _ in range(chance.randint(1, 3)):
            data[chance.randrange(len(data))] = chance.choice((0, 1, 4, 0x7F, 0x80, 0xFF, chance.randrange(256)))
        with suppress(FlatBufferError):
            decode = make_flatbuffer_decoder("core.HandPoseRecord", bytes(data))
            with suppress(struct.error, ValueError):
                decode(hand_record([SEVEN] * 26))


@pytest.mark.parametrize(
    ("encoding", "schema", "why"),
    [
        ("flatbuffer", b"", "no compiled FlatBuffers schema"),
        ("flatbuffer", b"table X {}", "no compiled"),
        ("flatbuffer", ISAAC[:200], "cannot be read"),
        ("flatbuffer", FOXGLOVE, "does not have the table"),
        ("", b"", "the schema is missing"),
    ],
)
def test_a_schema_that_does_not_serve_is_an_error_of_one_line(encoding, schema, why):
    channel = LogChannel(0, "/t", "core.HandPoseRecord", encoding, schema, "flatbuffer", 1, 0, 0)
    with pytest.raises(LogError, match=f"^topic /t: core.HandPoseRecord \\(flatbuffer\\) cannot be decoded: .*{why}"):
        make_message_reader(channel, kind_of(channel))


def test_tables_that_are_shared_cannot_claim_endless_values():
    """A list of many offsets to one table, each with a list of as many: a few thousand bytes, thousands of millions of values."""
    b = flatbuffers.Builder(0)
    found = 0
    for level in range(6):
        b.StartVector(4, 300, 4)
        for _ in range(300):
            b.PrependUOffsetTRelative(found) if level else b.PrependUint32(0)
        vector = b.EndVector()
        b.StartObject(1)
        b.PrependUOffsetTRelativeSlot(0, vector, 0)
        found = b.EndObject()
    b.Finish(found)
    names, objects = read_schema(FOXGLOVE)
    transforms = names["foxglove.FrameTransforms"]
    (field,) = objects[transforms].fields
    looped = [*objects]
    looped[transforms] = type(objects[0])("x", (field._replace(type=field.type._replace(object=transforms)),), False, 0)
    decode = FlatBufferDecoder(looped, transforms)
    with pytest.raises(FlatBufferError, match=f"more than {VALUE_LIMIT} values|without end"):
        decode(bytes(b.Output()))


def test_single_precision_is_kept_as_it_is():
    decode = make_flatbuffer_decoder("core.Se3TrackerPoseRecord", ISAAC)
    pose = decode(tracker_record((0.1, *SEVEN[1:])))["data"]["pose"]
    assert pose["position"]["x"] == struct.unpack("<f", struct.pack("<f", 0.1))[0]
