"""Frame ids of every kind of message: a pose given in `room` is brought to the world by a transform of any type."""

from __future__ import annotations

import json

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.recording.frames import FrameSource
from geomphys.recording.message_kinds import find_kind
from geomphys.recording.pose_tuples import compose
from geomphys.recording.samples import POSES
from geomphys.recording.transform_tree import TRANSFORM_TYPES
from tests.recording.log_files import Tree, make_world, turned
from tests.recording.made_messages import SEVEN, Made, S, make, pairs, part_of, write_messages

ROOM = (0.5, -0.25, 1.0, *turned(0.7, axis=1))


def posing() -> list[tuple[str, str]]:
    """Types of messages whose poses name a frame; the first Vicon messages had no header."""
    named = []
    for name, encoding in pairs():
        kind = find_kind(name, encoding)
        if (
            kind is not None
            and kind.content in POSES
            and getattr(kind.layout, "frame", "")
            and not name.startswith("vicon_msgs")
        ):
            named.append((name, encoding))
    return named


def room_in(frame: str, at: int) -> Made:
    """A transform world -> room."""
    t, q = (dict(zip("xyzw", part, strict=False)) for part in (ROOM[:3], ROOM[3:]))
    header = {"stamp": {"sec": at // S, "nanosec": at % S}, "frame_id": "world"}
    message = {
        "transforms": [{"header": header, "child_frame_id": frame, "transform": {"translation": t, "rotation": q}}]
    }
    return Made("tf2_msgs/msg/TFMessage", "jsonschema", b"{}", "json", json.dumps(message).encode())


@pytest.mark.parametrize(("name", "encoding"), posing())
def test_a_pose_of_any_kind_counts_in_its_frame(tmp_path, name, encoding):
    kind = find_kind(name, encoding)
    assert kind is not None
    messages = [("/tf_static", S, room_in("room", S))]
    messages += [("/t", S + k * S // 50, make(name, encoding, SEVEN, S + k * S // 50)) for k in range(10)]
    log = write_messages(tmp_path / "log.mcap", messages)
    with FrameSource(log, make_world(Tree(root=f"/t{part_of(kind)}")), Config()) as source:
        frames = list(source)
        assert len(source.report.transforms) == 1
    assert len(frames) == 10
    expected = np.array(compose(ROOM, tuple(SEVEN)))
    for frame in frames:
        found = frame.roots[0] * np.where(np.arange(7) < 3, 1.0, np.sign(frame.roots[0, 3:] @ expected[3:]))
        np.testing.assert_allclose(found, expected, atol=1e-12)
        assert not frame.held


@pytest.mark.parametrize(
    ("name", "encoding"), [p for p in pairs() if (k := find_kind(*p)) is not None and k.names[0] in TRANSFORM_TYPES]
)
def test_a_transform_of_any_kind_brings_poses_to_the_world(tmp_path, name, encoding):
    """Here `room` is the space, and a mug stands where the wrist is, in the wrist's frame."""
    messages = [("/any", S + k * S // 50, make(name, encoding, SEVEN, S + k * S // 50)) for k in range(10)]
    header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "wrist"}
    pose = {"position": dict.fromkeys("xyz", 0.0), "orientation": {**dict.fromkeys("xyz", 0.0), "w": 1.0}}
    data = json.dumps({"header": header, "pose": pose}).encode()
    messages += [("/mug", S, Made("geometry_msgs/msg/PoseStamped", "jsonschema", b"{}", "json", data))]
    with FrameSource(
        write_messages(tmp_path / "log.mcap", messages), make_world(Tree(root="/mug")), Config()
    ) as source:
        (frame,) = list(source)
        assert source.transforms.spaces == ("room",)
    expected = np.array(SEVEN)
    found = frame.roots[0] * np.where(np.arange(7) < 3, 1.0, np.sign(frame.roots[0, 3:] @ expected[3:]))
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "encoding"), [("vicon_receiver/msg/Position", "cdr"), ("core.Se3TrackerPoseRecord", "flatbuffer")]
)
def test_what_says_its_own_unit_is_not_scaled_by_that_of_the_log(tmp_path, name, encoding):
    messages = [("/t", S + k * S // 50, make(name, encoding, SEVEN, S + k * S // 50)) for k in range(3)]
    log = write_messages(tmp_path / "log.mcap", messages)
    with FrameSource(log, make_world(Tree(root="/t"), recording={"unit": "mm"}), Config()) as source:
        assert next(iter(source)).roots[0, :3] == pytest.approx(SEVEN[:3], abs=1e-9)
