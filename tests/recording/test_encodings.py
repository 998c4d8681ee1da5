"""Every encoding of the same data gives the same frames; what a message does not say is missing, not zero."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.channels import JointSample, kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.frames import FrameSource
from geomphys.recording.reader import open_log
from tests.recording.log_files import GLOVE_TYPE, Item, S, Tree, glove, joints, make_world, pose, transforms, write_log
from tests.recording.made_messages import make, pairs


def some_motion(seed: int = 3) -> list[Item]:
    rng = np.random.default_rng(seed)
    items = []
    for k in range(40):
        q = rng.normal(size=4)
        tracked = (*rng.normal(size=3), *(q / np.linalg.norm(q)))
        items.append(pose("/wrist", 10 + k / 30, tracked))
        items.append(transforms("/tf", 10 + k / 30, {"mug": tracked, "lamp": tracked}))
        values = {n: float(rng.normal()) for n in "abc" if not (n == "b" and k % 5 == 2)}
        items.append(joints("/glove", 10 + k / 30 + 0.007, values))
    return items


WORLD = make_world(
    Tree(root="/wrist", topic="/glove", joints=("a", "b", "c")), Tree(name="mug", root="/tf#mug", avatar=False)
)


def read(path: Path, world=WORLD, **config):
    with FrameSource(path, world, Config(**config)) as source:
        return [(f.time_ns, f.roots.tobytes(), f.angles.tobytes(), f.held) for f in source], source.report


@pytest.mark.parametrize("encoding", ["protobuf", "json", "json-ros"])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4])
def test_all_encodings_give_the_same_frames_to_the_bit(tmp_path, encoding, compression):
    expected, _ = read(write_log(tmp_path / "ros2.mcap", some_motion()))
    other = write_log(
        tmp_path / "other.mcap", some_motion(), encoding=encoding, compression=compression, chunk_size=2000
    )
    assert read(other)[0] == expected
    assert len(expected) == 40


def test_logs_without_chunks_are_read_alike(tmp_path):
    expected, _ = read(write_log(tmp_path / "a.mcap", some_motion()))
    assert read(write_log(tmp_path / "b.mcap", some_motion(), use_chunking=False))[0] == expected


def test_single_transforms_are_read_like_lists_of_them(tmp_path):
    world = make_world(Tree(root="/t#a"), Tree(name="b", root="/t#b"))
    rng = np.random.default_rng(5)
    single, listed = [], []
    for k in range(10):
        values = {n: (*rng.normal(size=3), 0.0, 0.6, 0.0, 0.8) for n in "ab"}
        listed.append(Item("/t", "transforms", values, k * S))
        single += [Item("/t", "transform", {n: v}, k * S) for n, v in values.items()]
    expected = read(write_log(tmp_path / "listed.mcap", listed, encoding="protobuf"), world)[0]
    for encoding in ("protobuf", "json"):
        assert read(write_log(tmp_path / f"{encoding}.mcap", single, encoding=encoding), world)[0] == expected


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_a_position_that_is_not_set_is_missing_not_zero(tmp_path, encoding):
    items = [joints("/glove", k / 100, {"a": 1.0, "b": None if 1 <= k <= 3 else 2.0, "c": None}) for k in range(6)]
    frames, report = read(
        write_log(tmp_path / "log.mcap", items, encoding=encoding),
        make_world(Tree(topic="/glove", joints=("a", "b", "c"))),
    )
    assert all(np.frombuffer(angles)[:2].tolist() == [1.0, 2.0] and not held for _, _, angles, held in frames)
    assert [u.name for u in report.unmatched_joints] == ["c"]


def test_json_null_counts_as_nan(tmp_path):
    items = [joints("/glove", k / 10, {"a": 1.0 + k, "b": 0.5}) for k in range(4)]
    items[2].value["a"] = math.nan
    path = write_log(tmp_path / "log.mcap", items, encoding="json-ros", compression=CompressionType.NONE)
    content = path.read_bytes()
    assert content.count(b"[NaN, 0.5]") == 1
    nulled = tmp_path / "null.mcap"
    nulled.write_bytes(content.replace(b"[NaN, 0.5]", b"[null,0.5]").replace(crc_of(content), bytes(4)))
    for log in (path, nulled):
        frames, report = read(log, make_world(Tree(topic="/glove", joints=("a", "b"))))
        assert [f[3] for f in frames] == [False, False, True, False]
        assert report.bad_samples == 1


def crc_of(log: bytes) -> bytes:
    """The checksum of the first chunk as it stands in a log."""
    at = 8
    while log[at] != 6:
        at += 9 + int.from_bytes(log[at + 1 : at + 9], "little")
    return log[at + 33 : at + 37]


def test_gloves_are_in_degrees_and_have_no_stamp_of_their_own(tmp_path):
    world = make_world(Tree(topic="/manus_glove_0", joints=("flex",), rename={"IndexMCPStretch": "flex"}))
    items = [glove("/manus_glove_0", 5 + k / 10, {"IndexMCPStretch": 45.0}) for k in range(4)]
    frames, report = read(write_log(tmp_path / "log.mcap", items), world)
    assert [f[0] for f in frames] == [m.log_time for m in items]
    assert all(np.frombuffer(f[2])[0] == pytest.approx(math.pi / 4) for f in frames)
    assert report.warnings == (
        f"topic /manus_glove_0: messages ({GLOVE_TYPE}) carry no time stamp; their log times are used",
    )
    radians = make_world(Tree(topic="/manus_glove_0", joints=("IndexMCPStretch",), unit="rad"))
    frames, report = read(tmp_path / "log.mcap", radians)
    assert np.frombuffer(frames[0][2])[0] == 45.0
    assert any("degrees" in w for w in report.warnings)


def test_the_side_of_a_glove_can_be_named(tmp_path):
    items = []
    for k in range(6):
        side = "Left" if k % 2 else "Right"
        items.append(glove("/glove", k / 10, {"a": 30.0 if k % 2 else 60.0}, side=side))
    path = write_log(tmp_path / "log.mcap", items)
    for side, value, count in (("left", 30.0, 3), ("right", 60.0, 3)):
        frames, report = read(path, make_world(Tree(topic=f"/glove#{side}", joints=("a",))))
        assert len(frames) == count
        assert all(np.frombuffer(f[2])[0] == pytest.approx(math.radians(value)) for f in frames)
    _, report = read(path, make_world(Tree(topic="/glove", joints=("a",))))
    assert any("several sides" in w for w in report.warnings)
    left_only = write_log(tmp_path / "left.mcap", [m for m in items if m.side == "Left"])
    with pytest.raises(LogError, match=r"no glove of the side 'right'; it has left"):
        read(left_only, make_world(Tree(topic="/glove#right", joints=("a",))))


def test_channels_of_one_topic_are_decoded_each_by_its_own_schema(tmp_path):
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        proto = write_log(tmp_path / "p.mcap", [pose("/wrist", 0.0, (1, 0, 0, 0, 0, 0, 1))], encoding="protobuf")
        as_json = write_log(tmp_path / "j.mcap", [pose("/wrist", 0.1, (2, 0, 0, 0, 0, 0, 1))], encoding="json")
        for source in (proto, as_json):
            reader = open_log(source)
            (channel,) = reader.channels.values()
            schema = writer.register_schema(channel.schema_name, channel.schema_encoding, channel.schema_data)
            copy = writer.register_channel(channel.topic, channel.encoding, schema)
            for raw in reader.read():
                writer.add_message(copy, raw.log_time, raw.data, raw.publish_time)
        writer.finish()
    frames, _ = read(tmp_path / "log.mcap", make_world(Tree(root="/wrist")))
    assert [np.frombuffer(f[1])[0] for f in frames] == [1.0, 2.0]


def channel_of(tmp_path: Path, name: str, schema_encoding: str, schema: bytes, encoding: str, data: bytes = b""):
    with (tmp_path / "one.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/t", encoding, writer.register_schema(name, schema_encoding, schema))
        writer.add_message(channel, 0, data, 0)
        writer.finish()
    (channel,) = open_log(tmp_path / "one.mcap").channels.values()
    return channel


def cdr_joints(tmp_path: Path) -> bytes:
    path = write_log(tmp_path / "joints.mcap", [joints("/t", 1.5, {"a": 1.0})])
    return next(open_log(path).read()).data


@pytest.mark.parametrize(
    ("schema_encoding", "schema"),
    [("ros2idl", b"module sensor_msgs {};"), ("ros2msg", b""), ("ros2msg", b"] corrupt")],
)
def test_standard_ros_types_need_no_ros2msg_schema(tmp_path, schema_encoding, schema):
    channel = channel_of(tmp_path, "sensor_msgs/msg/JointState", schema_encoding, schema, "cdr")
    read_message = make_message_reader(channel, kind_of(channel))
    assert read_message(cdr_joints(tmp_path)) == JointSample(1_500_000_000, ["a"], [1.0], "")


def test_other_ros_types_in_idl_are_an_error_that_says_so(tmp_path):
    channel = channel_of(tmp_path, GLOVE_TYPE, "ros2idl", b"module m {};", "cdr")
    with pytest.raises(LogError, match=r"/t.*ros2idl.*only ros2msg"):
        make_message_reader(channel, kind_of(channel))


@pytest.mark.parametrize(
    ("name", "schema_encoding", "schema", "encoding"),
    [
        ("foxglove.PoseInFrame", "protobuf", b"\xff\xff not descriptors", "protobuf"),
        ("foxglove.PoseInFrame", "protobuf", b"", "protobuf"),
        ("foxglove.PoseInFrame", "jsonschema", b"{}", "protobuf"),
        (GLOVE_TYPE, "ros2msg", b"this is ] no definition", "cdr"),
        (GLOVE_TYPE, "ros2msg", b"float64 W", "cdr"),
        (GLOVE_TYPE, "ros2msg", b"\xff\xfe", "cdr"),
    ],
)
def test_schemas_that_cannot_be_read_are_an_error_with_the_topic(
    tmp_path, capfd, name, schema_encoding, schema, encoding
):
    channel = channel_of(tmp_path, name, schema_encoding, schema, encoding)
    with pytest.raises(LogError, match=f"topic /t: {name}"):
        make_message_reader(channel, kind_of(channel))
    assert capfd.readouterr() == ("", "")


NO_MESSAGES = [b"", b"\0", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 40, b"[" * 100_000, b"null", b'"x"', b"\xff\xfe"]
for stamp in (True, {"sec": 10**30, "nsec": 0}, {"sec": -5, "nsec": 0}):
    NO_MESSAGES.append(json.dumps({"timestamp": stamp, "joints": 1, "transforms": 1, "poses": 1}).encode())


@pytest.mark.parametrize("data", NO_MESSAGES)
@pytest.mark.parametrize(("name", "encoding"), [p for p in pairs() if p[1] != "protobuf"])
def test_bytes_that_hold_no_message_are_bad_messages(tmp_path, name, encoding, data):
    if encoding == "ros1" and len(data) >= 56:
        pytest.skip("numbers alone: any bytes that are enough are a message")
    made = make(name, encoding)
    channel = channel_of(tmp_path, made.schema, made.schema_encoding, made.schema_data, encoding)
    with pytest.raises(BadMessageError):
        make_message_reader(channel, kind_of(channel))(data)


@pytest.mark.parametrize("data", [b"\xff\xff\xff", b"\x0a\x7f", b"\x12" * 50])
def test_bytes_that_are_no_protobuf_message_are_bad_messages(tmp_path, data):
    path = write_log(tmp_path / "log.mcap", [pose("/t", 0.0, (0, 0, 0, 0, 0, 0, 1))], encoding="protobuf")
    (channel,) = open_log(path).channels.values()
    with pytest.raises(BadMessageError):
        make_message_reader(channel, kind_of(channel))(data)


def test_a_definition_whose_elements_take_no_bytes_is_refused(tmp_path):
    """Else a message of a few bytes could claim four thousand million of them."""
    schema = f"m/E[] transforms\n{'=' * 80}\nMSG: m/E\nuint8[8] a".encode()
    channel = channel_of(tmp_path, "tf2_msgs/msg/TFMessage", "ros2msg", schema, "cdr")
    with pytest.raises(LogError, match="byte arrays of fixed size"):
        make_message_reader(channel, kind_of(channel))


def test_messages_that_cannot_be_decoded_are_counted_and_the_rest_replayed(tmp_path):
    items = [Item("/wrist", "pose", (k, 0, 0, 0, 0, 0, 1), k * S // 10) for k in range(10)]
    path = write_log(tmp_path / "log.mcap", items, encoding="json", compression=CompressionType.NONE, enable_crcs=False)
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"x": 4', b'"x" 44'))
    frames, report = read(path, make_world(Tree(root="/wrist")))
    assert len(frames) == 9
    assert report.bad_messages == 1
    assert any("could not be decoded" in w for w in report.warnings)
