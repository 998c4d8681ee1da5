"""The same motion in messages of every family gives the same result."""

from __future__ import annotations

import math

import pytest

import geomphys
from tests.cli.press import SCENE
from tests.recording.made_messages import S, kind, make, part_of, write_messages

FAMILIES = [
    ("geometry_msgs/msg/PoseStamped", "ros1"),
    ("geometry_msgs/msg/PoseWithCovarianceStamped", "cdr"),
    ("geometry_msgs/msg/Pose", "cdr"),
    ("geometry_msgs/msg/TransformStamped", "json"),
    ("nav_msgs/msg/Odometry", "ros1"),
    ("tf2_msgs/msg/TFMessage", "ros1"),
    ("geometry_msgs/msg/PoseArray", "cdr"),
    ("mocap4r2_msgs/msg/RigidBodies", "cdr"),
    ("motion_capture_tracking_interfaces/msg/NamedPoseArray", "cdr"),
    ("teleop_ros2_interfaces/msg/NamedPoseArray", "cdr"),
    ("vicon_receiver/msg/Position", "cdr"),
    ("foxglove.PosesInFrame", "protobuf"),
    ("foxglove.FrameTransform", "flatbuffer"),
    ("core.Se3TrackerPoseRecord", "flatbuffer"),
    ("core.HandPoseRecord", "flatbuffer"),
]


def replayed(folder, name, encoding):
    """Heights recorded and corrected, depths, and times of a sphere that is pressed on a table."""
    messages = []
    for k in range(30):
        at = S + k * S // 60
        height = round(1024 * (0.05 + 0.02 * math.cos(2 * math.pi * k / 29))) / 1024
        messages.append(("/t", at, make(name, encoding, (0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0), at)))
    log = write_messages(folder / "log.mcap", messages)
    scene = folder / "scene.toml"
    scene.write_text(SCENE.replace("/tracker/finger", f"/t{part_of(kind(messages[0][2]))}"))
    results = list(geomphys.replay(log, scene))
    return [
        (r.frame.time_ns, *(float(x) for x in r.recorded[-1].ravel()), *(float(x) for x in r.corrected[-1].ravel()))
        for r in results
    ]


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    found = replayed(tmp_path_factory.mktemp("cdr"), "geometry_msgs/msg/PoseStamped", "cdr")
    assert len(found) == 30
    return found


@pytest.mark.parametrize(("name", "encoding"), FAMILIES)
def test_replays_are_the_same(tmp_path, expected, name, encoding):
    found = replayed(tmp_path, name, encoding)
    assert len(found) == len(expected)
    for mine, theirs in zip(found, expected, strict=True):
        assert mine[0] == theirs[0]
        assert mine[1:] == pytest.approx(theirs[1:], abs=1e-12)
