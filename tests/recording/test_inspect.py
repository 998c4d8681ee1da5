"""What is told of a log, and of a log in a scene."""

from __future__ import annotations

import json
import math

import pytest

from geomphys.config import Config
from geomphys.errors import DamagedLogError, LogError
from geomphys.recording.inspect import check_log, inspect_log
from tests.recording.log_files import Item, S, Tree, glove, joints, make_world, pose, transforms, write_log


def some_items() -> list[Item]:
    items = []
    for k in range(50):
        if not 20 <= k < 27:
            items.append(pose("/wrist", 3 + k / 50, (k if k != 4 else math.nan, 0, 0, 0, 0, 0, 1)))
        items.append(joints("/joints", 3 + k / 50, {"a": 0.1 * k, "b": math.nan if k == 7 else 0.0}))
        items.append(
            transforms("/tf", 3 + k / 50, {"mug": (0, 0, 0, 0, 0, 0, 1 if k else 2), "lid": (0, 0, 0, 0, 0, 0, 1)})
        )
        items.append(glove("/glove", 3 + k / 50, {"Thumb": 1.0}, side="Left" if k % 2 else "Right"))
    items.append(Item("/camera", "raw", b"\0\1\0\0", 4 * S))
    return items


def test_a_log_is_described_topic_by_topic(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), metadata={"source": {"who": "me"}})
    info = inspect_log(path)
    assert (info.messages, info.duration_s, info.damage, info.profile) == (194, 1.0, "", "ros2")
    assert info.metadata == {"source": {"who": "me"}}
    assert info.size_bytes == path.stat().st_size
    topics = {t.topic: t for t in info.topics}
    assert list(topics) == ["/camera", "/glove", "/joints", "/tf", "/wrist"]
    wrist = topics["/wrist"]
    assert (wrist.kind, wrist.schema, wrist.encoding) == ("pose", "geometry_msgs/msg/PoseStamped", "cdr")
    assert (wrist.messages, wrist.bad_samples, wrist.longest_gap_s) == (43, 1, pytest.approx(0.16))
    assert wrist.rate_hz == pytest.approx(42 / 0.98)
    assert (topics["/joints"].joints, topics["/joints"].bad_samples) == (("a", "b"), 1)
    assert (topics["/tf"].frames, topics["/tf"].bad_samples) == (("lid", "mug"), 1)
    assert (topics["/glove"].sides, topics["/glove"].joints) == (("left", "right"), ("Thumb",))
    assert (topics["/camera"].kind, topics["/camera"].rate_hz, topics["/camera"].longest_gap_s) == ("", None, None)
    assert json.loads(json.dumps(info.as_dict()))["topics"][4]["rate_hz"] == wrist.rate_hz


def test_of_a_damaged_log_what_is_intact_is_described_if_asked(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), use_chunking=False)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(DamagedLogError):
        inspect_log(path)
    info = inspect_log(path, recover=True)
    assert 0 < info.messages < 194
    assert info.damage
    assert info.bytes_lost < 400


def test_an_empty_log_is_described(tmp_path):
    info = inspect_log(write_log(tmp_path / "log.mcap", []))
    assert (info.messages, info.first_ns, info.duration_s, info.topics) == (0, None, 0.0, ())


WORLD = make_world(
    Tree(root="/wrist", topic="/joints", joints=("a", "b", "c"), limits=(-1.0, 2.0)),
    Tree(name="mug", root="/tf#mug", avatar=False),
)


def test_a_check_tells_what_feeds_what_and_what_will_be_held(tmp_path):
    report = check_log(write_log(tmp_path / "log.mcap", some_items()), WORLD)
    assert report.errors == ()
    assert report.clock == "/wrist"
    assert [(p.tree, p.topic, p.messages) for p in report.poses] == [("hand", "/wrist", 43), ("mug", "/tf#mug", 50)]
    assert [(j.joint, j.recorded, j.unit) for j in report.joints] == [("a", "a", "rad"), ("b", "b", "rad")]
    recording = report.recording
    assert recording is not None
    assert recording.frames == 43
    assert recording.held_frames == 2  # the bad pose of the clock; the mug before its first good pose
    assert [(o.joint, o.frames) for o in recording.outside_limits] == [("a", 23)]
    assert [u.name for u in recording.unmatched_joints] == ["c"]
    for said in ("c", "held", "outside of their limits", "not finite"):
        assert any(said in w for w in report.warnings), said
    json.dumps(report.as_dict())


def test_a_check_lists_every_problem_where_a_replay_names_the_first(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items())
    world = make_world(Tree(root="/wirst", topic="/jonts", joints=("a",)), Tree(name="mug", root="/tf", avatar=False))
    report = check_log(path, world)
    assert len(report.errors) == 3
    assert report.recording is None
    wrong_names = make_world(Tree(root="/wrist", topic="/joints", joints=("x",)))
    assert any("none of the joints x" in e for e in check_log(path, wrong_names).errors)
    with pytest.raises(LogError):
        check_log(tmp_path / "no.mcap", world)


def test_a_check_goes_through_what_is_intact_of_a_damaged_log(tmp_path):
    path = write_log(tmp_path / "log.mcap", some_items(), use_chunking=False)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    report = check_log(path, WORLD)
    assert len(report.errors) == 1
    assert "--recover" in report.errors[0]
    assert report.recording is not None
    assert report.recording.frames > 10
    assert check_log(path, WORLD, Config(recover=True)).errors == ()
