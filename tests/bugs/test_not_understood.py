"""Types, encodings and schemas that people record and that were refused without a word of what to do."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from geomphys.authoring.scene_draft import draft_scene
from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.load import load_world
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.inspect import inspect_log
from geomphys.recording.message_kinds import KINDS
from tests.recording.log_files import Tree, make_world
from tests.recording.made_messages import STAMP, Made, make, write_messages

CASES = {
    "ros1.mcap": "scene.toml",
    "pose_types.mcap": "scene_vicon.toml",
    "manus_old_package.mcap": "scene_manus.toml",
}


HEIGHTS = (0.9, 0.780085, 0.9)
"""Of the wrist in each of these logs: first, lowest and last, m."""


def heights(frames):
    found = [float(f.roots[0][2]) for f in frames]
    return found[0], round(min(found), 6), found[-1]


@pytest.fixture
def cases(shared_dir: Path) -> Path:
    folder = shared_dir / "cases" / "not_understood"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder


@pytest.mark.parametrize(("log", "scene"), CASES.items())
def test_the_reported_logs_are_read(cases, log, scene):
    world = load_world(cases / scene)
    report = check_log(cases / log, world)
    assert report.errors == ()
    with FrameSource(cases / log, world, Config()) as source:
        frames = list(source)
    assert len(frames) == 60
    assert not any(f.held for f in frames)
    assert heights(frames) == HEIGHTS
    draft = draft_scene(cases / log, [cases / "hand.urdf"])
    assert draft.avatars[0].root is not None


def test_every_pose_of_the_reported_log_can_be_followed(cases):
    found = {t.topic: t.use for t in inspect_log(cases / "pose_types.mcap").topics}
    assert found == {
        "/glove/joint_states": "joint values",
        "/vicon/wrist": "a pose of a named frame",
        "/wrist_pose": "a pose",
        "/zed/pose_with_covariance": "a pose",
    }
    for topic in ("/vicon/wrist", "/wrist_pose", "/zed/pose_with_covariance", "/vicon/wrist#wrist"):
        with FrameSource(cases / "pose_types.mcap", make_world(Tree(root=topic)), Config()) as source:
            assert heights(source) == HEIGHTS


def test_the_reported_xcdr2_log_is_one_line_that_says_what_it_is(cases):
    with pytest.raises(
        LogError, match=r"topic '/tracker/wrist' has no readable pose: a message is written in XCDR2 .*XCDR1"
    ):
        FrameSource(cases / "xcdr2.mcap", load_world(cases / "scene.toml"), Config())
    with pytest.raises(LogError, match="XCDR2"):
        draft_scene(cases / "xcdr2.mcap", [cases / "hand.urdf"])
    assert all("XCDR2" in t.bad_reason for t in inspect_log(cases / "xcdr2.mcap").topics)


@pytest.mark.parametrize(
    ("head", "what"),
    [(b"\0\7", "XCDR2"), (b"\0\x0b", "XCDR2"), (b"\0\3", "a parameter list"), (b"x\x55", "an unknown way")],
)
def test_other_forms_of_cdr_are_never_read_as_plain_cdr(tmp_path, head, what):
    """Eight-byte numbers stand elsewhere in them: what came out was wrong, or by luck none."""
    made = make("sensor_msgs/msg/JointState", "cdr")
    path = write_messages(tmp_path / "log.mcap", [("/t", STAMP, made._replace(data=head + made.data[2:]))] * 3)
    with pytest.raises(
        LogError, match=rf"has no readable joints: a message is written in {what} \(its first bytes are {head.hex()}\)"
    ):
        FrameSource(path, make_world(Tree(topic="/t", joints=("a",))), Config())


OTHER = Made("some_msgs/msg/Wrist", "ros2msg", b"float64 x", "cdr", b"\0\1\0\0" + bytes(8))


@pytest.mark.parametrize(
    ("made", "why"),
    [
        (OTHER, "(some_msgs/msg/Wrist, cdr) is not understood; types with a pose that are: geometry_msgs/PoseStamped, "),
        (
            OTHER._replace(encoding="cbor"),
            "(some_msgs/msg/Wrist, cbor) is not understood: of the encodings cdr, ros1, protobuf, json, ",
        ),
        (OTHER._replace(schema="", encoding="json"), "(no schema, json) is not understood; types with a pose"),
        (
            make("geometry_msgs/msg/PoseStamped", "json")._replace(encoding="protobuf"),
            "(geometry_msgs/msg/PoseStamped, protobuf) is not understood: this type is read in ROS 2 (cdr) or ROS 1 (ros1) or ",
        ),
        (make("sensor_msgs/msg/JointState", "cdr"), "(sensor_msgs/msg/JointState, cdr) does not hold a pose"),
    ],
)  # fmt: skip
def test_what_is_not_understood_is_told_with_what_would_be(tmp_path, made, why):
    messages = [("/wrist", STAMP, made), ("/other", STAMP, make("geometry_msgs/msg/PoseArray", "cdr"))]
    path = write_messages(tmp_path / "log.mcap", messages)
    with pytest.raises(LogError) as found:
        FrameSource(path, make_world(Tree(root="/wrist")), Config())
    text = str(found.value)
    assert f"topic '/wrist' for the root of 'hand' {why}" in text
    assert text.endswith("; of this log /other has a pose")
    assert text.isprintable()


def test_every_type_with_a_pose_is_in_the_error(tmp_path):
    path = write_messages(tmp_path / "log.mcap", [("/wrist", STAMP, OTHER)])
    for tree, whats in (
        (Tree(root="/wrist"), {"pose", "transform", "transforms", "poses", "named_poses"}),
        (Tree(topic="/wrist", joints=("a",)), {"joints", "glove"}),
    ):
        with pytest.raises(LogError) as found:
            FrameSource(path, make_world(tree), Config())
        for kind in KINDS:
            named = kind.names[0].replace("/msg/", "/") in str(found.value)
            assert named == (kind.content in whats)
    with pytest.raises(LogError, match=re.escape("(some_msgs/msg/Wrist, cdr); types that are: sensor_msgs/JointState")):
        draft_scene(path, [])
    assert inspect_log(path).topics[0].use == "not understood"


def test_json_by_plain_schema_names_is_read(tmp_path):
    joints = make("sensor_msgs/msg/JointState", "json")._replace(
        schema="JointState", schema_encoding="", schema_data=b""
    )
    wrist = make("geometry_msgs/msg/PoseStamped", "json")._replace(
        schema="PoseStamped", schema_encoding="", schema_data=b""
    )
    value = json.loads(wrist.data)
    value["header"]["stamp"] = "1970-01-01T00:00:01.5Z"
    path = write_messages(
        tmp_path / "log.mcap", [("/j", STAMP, joints), ("/p", STAMP, wrist._replace(data=json.dumps(value).encode()))]
    )
    with FrameSource(path, make_world(Tree(root="/p", topic="/j", joints=("a", "b"))), Config()) as source:
        (frame,) = source
    assert frame.time_ns == STAMP
    assert frame.angles.tolist() == [0.5, -0.5]
