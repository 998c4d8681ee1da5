"""Every kind of message, in every encoding, by its official writer: what it holds is read back to the bit."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from google.protobuf import json_format

from geomphys.authoring.scene_draft import pose_candidates
from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.channels import JointSample, Pose, kind_of, make_message_reader
from geomphys.recording.decoders import BadMessageError
from geomphys.recording.frames import FrameSource
from geomphys.recording.inspect import inspect_log
from geomphys.recording.message_kinds import HAND_JOINTS, KINDS, canonical_type_name, find_kind
from geomphys.recording.reader import LogChannel
from tests.recording.log_files import Tree, make_world
from tests.recording.made_messages import (
    OTHER,
    SEVEN,
    STAMP,
    Made,
    S,
    content,
    hand_record,
    joint_record,
    kind,
    make,
    pairs,
    part_of,
    protobuf_message,
    ros2_data,
    tracker_record,
    write_messages,
)

SINGLE = {"core.HeadPoseRecord", "core.Se3TrackerPoseRecord", "core.HandPoseRecord", "core.JointStateOutputRecord"}
"""Types of single precision."""


def channel_of(made: Made) -> LogChannel:
    return LogChannel(0, "/t", made.schema, made.schema_encoding, made.schema_data, made.encoding, 1, 0, 0)


def read(made: Made, **more):
    channel = channel_of(made)
    return make_message_reader(channel, kind_of(channel), **more)(made.data)


def single(v):
    return tuple(float(np.float32(x)) for x in v)


@pytest.mark.parametrize(("name", "encoding"), pairs())
def test_every_kind_is_read_to_the_bit(name, encoding):
    made = make(name, encoding)
    message_type = kind(made)
    found = read(made)
    stamp = (
        STAMP
        if (message_type.has_stamp and not name.startswith("vicon_msgs"))
        or (message_type.has_stamp and encoding == "json")
        else None
    )
    if isinstance(found, JointSample):
        assert found.stamp == stamp
        assert list(found.names) == ["a", "b"]
        assert list(found.values) == [0.5, -0.5]
        assert found.side == ("left" if message_type.content == "glove" else "")
        return
    first = found[1] if name == "core.HandPoseRecord" else found[0]
    expected = single(SEVEN) if name in SINGLE else SEVEN
    if message_type.in_metres and encoding != "json" and name.startswith("vicon"):
        expected = (*SEVEN[:3], *single(SEVEN[3:]))
    assert first.value == expected
    assert first.stamp == stamp
    assert first.child == {"pose": "", "poses": "0"}.get(message_type.content, "wrist")
    assert first.frame == ("room" if stamp is not None else "")


def test_all_names_of_the_table_have_a_writer_here():
    assert {n for n, _ in pairs()} == {n for k in KINDS for n in k.names}
    assert {e for _, e in pairs()} == {"cdr", "ros1", "protobuf", "json", "flatbuffer"}


@pytest.mark.parametrize(("name", "encoding"), [p for p in pairs() if p[1] != "json" or "msg" in p[0]])
def test_every_kind_moves_what_follows_it(tmp_path, name, encoding):
    """Through the reader of logs to frames: the table is all that is to be known of a type."""
    messages = []
    for k in range(6):
        at = S + k * S // 60
        messages.append(("/t", at, make(name, encoding, (0.01 * k, *SEVEN[1:]), at, 0.01 * k)))
    path = write_messages(tmp_path / "log.mcap", messages)
    message_type = kind(messages[0][2])
    joints = message_type.content in ("joints", "glove")
    tree = Tree(topic="/t", joints=("a", "b"), unit="rad") if joints else Tree(root=f"/t{part_of(message_type)}")
    with FrameSource(path, make_world(tree), Config()) as source:
        frames = list(source)
    assert [f.time_ns for f in frames] == [S + k * S // 60 for k in range(6)]
    assert not any(f.held for f in frames)
    got = [float(f.angles[0] if joints else f.roots[0][0]) for f in frames]
    assert got == pytest.approx([0.01 * k for k in range(6)], abs=1e-8)
    log = inspect_log(path)
    (topic,) = log.topics
    assert joints or f"/t{part_of(message_type)}" in {c.name for c in pose_candidates(log)}
    assert topic.kind == message_type.content
    assert topic.use not in ("", "not understood")
    assert topic.bad_messages == topic.bad_samples == 0 or name in (
        "core.HandPoseRecord",
        "teleop_ros2_interfaces/msg/NamedPoseArray",
    )
    assert topic.problem == ""


@pytest.mark.parametrize("package", ["manus_ros2_msgs", "manus_ros2"])
@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json"])
def test_raw_nodes_of_a_glove_are_poses(package, encoding):
    assert read(make(f"{package}/msg/ManusGlove", encoding), points=True) == [Pose(None, "left/3/Index/MCP", SEVEN, "")]


def test_a_position_of_vicon_is_in_millimetres_and_named_by_subject_and_segment():
    value = content("vicon_receiver/msg/Position") | {"subject_name": "arm"}
    made = make("vicon_receiver/msg/Position", "json")._replace(data=json.dumps(value).encode())
    (pose,) = read(made)
    assert pose.child == "arm/wrist"
    assert pose.value[:3] == pytest.approx(SEVEN[:3], abs=1e-15)


# --- names


@pytest.mark.parametrize(
    ("spelled", "full"),
    [
        ("sensor_msgs/JointState", "sensor_msgs/msg/JointState"),
        ("sensor_msgs.msg.JointState", "sensor_msgs/msg/JointState"),
        ("sensor_msgs::msg::JointState", "sensor_msgs/msg/JointState"),
        ("sensor_msgs::msg::dds_::JointState_", "sensor_msgs/msg/JointState"),
        ("foxglove.PoseInFrame", "foxglove.PoseInFrame"),
        ("foxglove/PoseInFrame", "foxglove.PoseInFrame"),
        ("foxglove_msgs/PoseInFrame", "foxglove_msgs/msg/PoseInFrame"),
        ("a.b.c.d", "a.b.c.d"),
        ("Image", "Image"),
        ("", ""),
        ("/", "/"),
    ],
)
def test_spellings_of_a_name(spelled, full):
    assert canonical_type_name(spelled) == full


def test_plain_names_are_understood_in_json_only_and_only_if_one_type_has_them():
    assert find_kind("JointState", "json") is find_kind("sensor_msgs/JointState", "json")
    assert find_kind("PoseInFrame", "json") is find_kind("foxglove.PoseInFrame", "json")
    assert find_kind("JointState", "cdr") is None
    assert find_kind("NamedPoseArray", "json") is None
    assert find_kind("Position", "json") is None
    assert find_kind("Image", "json") is None


def test_json_needs_no_schema_text(tmp_path):
    made = make("sensor_msgs/msg/JointState", "json")._replace(schema="JointState", schema_encoding="", schema_data=b"")
    assert read(made) == JointSample(STAMP, ["a", "b"], [0.5, -0.5], "")


# --- JSON


@pytest.mark.parametrize("name", [n for n, e in pairs() if e == "protobuf"])
def test_protobufs_own_json_is_read(name):
    """It spells names otherwise, writes times as text, and leaves out what is zero."""
    seven = (0.0, -1.5, 0.0, 0.0, 0.6, 0.0, 0.8)
    message = protobuf_message(name, content(name, seven))
    text = json_format.MessageToJson(message)
    assert "Z" in text
    assert "_id" not in text
    found = read(make(name, "json")._replace(data=text.encode()))
    if isinstance(found, JointSample):
        assert found == JointSample(STAMP, ["a", "b"], [0.5, -0.5], "")
    else:
        assert found[0] == read(make(name, "protobuf", seven))[0]


@pytest.mark.parametrize(
    "time",
    [
        {"sec": 1, "nsec": 500_000_000}, {"sec": 1, "nanosec": 500_000_000}, {"secs": 1, "nsecs": 500_000_000},
        {"seconds": "1", "nanos": 500_000_000}, {"nanoseconds": 1_500_000_000}, {"sec": 1.5}, 1.5, "1970-01-01T00:00:01.5Z",
        "1970-01-01T00:00:01.500000000000Z", "1970-01-01T02:00:01.5+02:00", "1969-12-31T23:30:01.5-00:30",
        "1970-01-01t00:00:01.5z",
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["geometry_msgs/msg/PoseStamped", "foxglove.PoseInFrame"])
def test_shapes_of_a_time_in_json(name, time):
    value = content(name)
    (value.get("header") or value)["stamp" if "header" in value else "timestamp"] = time
    assert read(make(name, "json")._replace(data=json.dumps(value).encode()))[0].stamp == STAMP


def test_times_in_json_are_kept_to_the_nanosecond():
    for time, ns in (
        ("2025-10-09T10:53:20.123456789Z", 1760007200123456789),
        ("2016-12-31T23:59:60Z", 1483228800 * S),
        (1760007200123456789, 1760007200123456789),
        ("1760007200123456789", 1760007200123456789),
        (1760007200, 1760007200 * S),
        ({"sec": 1760007200}, 1760007200 * S),
        ({}, 0),
        (None, None),
    ):
        value = content("foxglove.PoseInFrame") | {"timestamp": time}
        made = make("foxglove.PoseInFrame", "json")._replace(data=json.dumps(value).encode())
        assert read(made)[0].stamp == ns


HOSTILE = [
    b'{"header": {"stamp": ' + b"[" * 200_000,
    b'{"a":' * 50_000 + b"1" + b"}" * 50_000,
    b"[" * 3000 + b"]" * 3000,
    b'{"pose": 1' + b"0" * 5000 + b"}",
    b"[]",
    b"7",
    b"null",
    b"\xff\xfe{}",
]
for bad_time in (True, [], "yesterday", "1970-13-01T00:00:00Z", "1970-01-01T00:00:75Z", 1e300, 10**40,
                 {"sec": None, "nsec": "x"}, {"sec": [], "nsec": 0}, {"minutes": 1}, -1, "9" * 30):  # fmt: skip
    for shape in ("geometry_msgs/msg/PoseStamped", "foxglove.PoseInFrame"):
        bad_value = content(shape)
        (bad_value.get("header") or bad_value)["stamp" if "header" in bad_value else "timestamp"] = bad_time
        HOSTILE.append(json.dumps(bad_value).encode())


@pytest.mark.parametrize("number", range(len(HOSTILE)))
def test_hostile_json_is_a_bad_message(number):
    data = HOSTILE[number]
    names = [n for n, e in pairs() if e == "json"]
    if b"frame_id" in data:
        names = ["geometry_msgs/msg/PoseStamped"] if b"header" in data else ["foxglove.PoseInFrame"]
    for name in names:
        with pytest.raises(BadMessageError, match=r"^\S[ -~]+$"):
            read(make(name, "json")._replace(data=data))


@pytest.mark.parametrize("bad", ["true", '"1.0"', '"nan"', "[]", "{}", "1" + "0" * 400])
def test_what_is_no_number_makes_a_bad_message(bad):
    for name in ("geometry_msgs/msg/PoseStamped", "foxglove.PoseInFrame"):
        text = json.dumps(content(name)).replace("-1.5", bad)
        with pytest.raises(BadMessageError):
            read(make(name, "json")._replace(data=text.encode()))


@pytest.mark.parametrize("gone", ["null", "NaN", '"NaN"', "1e400", "-Infinity", '"Infinity"'])
@pytest.mark.parametrize("name", ["geometry_msgs/msg/PoseStamped", "foxglove.PoseInFrame"])
def test_null_and_numbers_that_are_none_are_a_bad_sample(name, gone):
    text = json.dumps(content(name)).replace("-1.5", gone)
    (pose,) = read(make(name, "json")._replace(data=text.encode()))
    assert not math.isfinite(pose.value[1])
    assert pose.value[0] == SEVEN[0]


def test_a_foxglove_message_of_another_shape_is_a_bad_message_not_zeros():
    with pytest.raises(BadMessageError):
        read(make("foxglove.PoseInFrame", "json")._replace(data=b'{"position": {"x": 1.0}}'))


def test_a_null_in_a_list_of_poses_is_missing():
    value = content("geometry_msgs/msg/PoseArray")
    value["poses"][0] = None
    first, second = read(make("geometry_msgs/msg/PoseArray", "json")._replace(data=json.dumps(value).encode()))
    assert all(map(math.isnan, first.value))
    assert (second.child, second.value) == ("1", OTHER)


# --- what is said to be no pose


def test_what_is_not_valid_is_missing(tmp_path):
    made = make("core.HandPoseRecord", "flatbuffer")
    found = read(made)
    assert [p.child for p in found] == list(HAND_JOINTS)
    assert found[0].value == single(OTHER)
    assert all(math.isnan(x) for p in found[2:] for x in p.value)
    nothing = read(made._replace(data=hand_record(None)))
    assert [p.child for p in nothing] == list(HAND_JOINTS)
    assert all(math.isnan(x) for p in nothing for x in p.value)
    tracker = make("core.Se3TrackerPoseRecord", "flatbuffer")
    assert math.isnan(read(tracker._replace(data=tracker_record(SEVEN, valid=False)))[0].value[0])
    joints = make("core.JointStateOutputRecord", "flatbuffer")
    found = read(joints._replace(data=joint_record({"a": 1.0, "b": None})))
    assert found.names == ["a", "b"]
    assert found.values[0] == 1.0
    assert math.isnan(found.values[1])
    teleop = read(make("teleop_ros2_interfaces/msg/NamedPoseArray", "cdr"))
    assert [p.child for p in teleop] == ["wrist", "lost"]
    assert all(map(math.isnan, teleop[1].value))


def test_a_hand_that_is_lost_holds_its_frames_and_joints_go_by_name_or_number(tmp_path):
    made = make("core.HandPoseRecord", "flatbuffer")
    here, gone = (0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), None
    messages = [
        ("/hand", k * S // 60, made._replace(data=hand_record(None if 4 <= k < 20 else [gone, here, *[gone] * 24])))
        for k in range(24)
    ]
    path = write_messages(tmp_path / "log.mcap", messages)
    for part in ("wrist", "1", "WRIST"):
        with FrameSource(path, make_world(Tree(root=f"/hand#{part}")), Config()) as source:
            frames = list(source)
        assert len(frames) == 24
        assert [f.held for f in frames] == [4 <= k < 20 for k in range(24)]
        assert all(f.roots[0][0] == 0.5 for f in frames)


# --- frames and parts


def test_a_topic_of_one_frame_needs_no_part_and_one_of_several_must_name_it(tmp_path):
    def stamped(child, k):
        value = content("geometry_msgs/msg/TransformStamped", (k, *SEVEN[1:]), S + k * S // 60) | {
            "child_frame_id": child
        }
        return make("geometry_msgs/msg/TransformStamped", "json")._replace(data=json.dumps(value).encode())

    path = write_messages(tmp_path / "two.mcap", [("/t", S + k * S // 60, stamped("ab"[k % 2], k)) for k in range(20)])
    with pytest.raises(LogError, match=re.escape("poses of several frames, a, b: name the one to follow as /t#a")):
        FrameSource(path, make_world(Tree(root="/t")), Config())
    with FrameSource(path, make_world(Tree(root="/t#b")), Config()) as source:
        assert [f.roots[0][0] for f in source] == list(range(1, 20, 2))
    late = [("/t", S + k * S // 60, stamped("a" if k < 200 else "ab"[k % 2], k)) for k in range(300)]
    path = write_messages(tmp_path / "late.mcap", late)
    with FrameSource(path, make_world(Tree(root="/t")), Config()) as source:
        assert [f.roots[0][0] for f in source] == [*range(200), *range(200, 300, 2)]
        assert any("topic /t: 50 poses of other frames than 'a' are not used" in w for w in source.report.warnings)


def test_a_part_that_comes_late_is_found_though_its_name_is_not_in_the_messages(tmp_path):
    def array(k):
        value = content("geometry_msgs/msg/PoseArray", (0.25 * k, *SEVEN[1:]))
        value["poses"] = [value["poses"][0]] * (8 if k >= 12 else 2)
        data = ros2_data("geometry_msgs/msg/PoseArray", value)
        assert b"7" not in data
        return make("geometry_msgs/msg/PoseArray", "cdr")._replace(data=data)

    path = write_messages(tmp_path / "log.mcap", [("/t", STAMP + k * S // 60, array(k)) for k in range(20)])
    with FrameSource(path, make_world(Tree(root="/t#7")), Config(time="log")) as source:
        assert source.prescan.streams["/t", "7"].varies  # else its gaps would not be held
        assert [f.roots[0][0] for f in source] == [0.25 * k for k in range(12, 20)]


def test_a_part_that_is_not_there_is_told_with_those_that_are(tmp_path):
    path = write_messages(tmp_path / "log.mcap", [("/t", STAMP, make("geometry_msgs/msg/PoseArray", "cdr"))] * 3)
    with pytest.raises(LogError, match=r"topic '/t' has no pose with the index '7'; it has 0, 1$"):
        FrameSource(path, make_world(Tree(root="/t#7")), Config())
    with pytest.raises(LogError, match=r"holds poses by index; .* as /t#INDEX"):
        FrameSource(path, make_world(Tree(root="/t")), Config())
    path = write_messages(tmp_path / "named.mcap", [("/t", STAMP, make("mocap4r2_msgs/msg/RigidBodies", "cdr"))] * 3)
    with pytest.raises(LogError, match=r"has no pose named 'wrst' \(did you mean 'wrist'\?\); it has wrist$"):
        FrameSource(path, make_world(Tree(root="/t#wrst")), Config())
