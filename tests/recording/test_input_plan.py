"""Sources of a scene looked up in a log: topics and their parts, joints by name, the frame clock; what is missing is said."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.recording.input_plan import JointInput, Plan, default_clock, is_static, make_plan, split_topic
from geomphys.recording.reader import open_log
from geomphys.scene.topic_sources import JointSource
from tests.recording.log_files import IDENTITY, Item, Tree, joints, make_world, pose, transforms, write_log

ITEMS = [
    item
    for k in range(3)
    for item in (
        pose("/wrist", 1 + k, IDENTITY), joints("/glove", 1 + k, {"a": 0.0}), transforms("/tf", 1 + k, {"palm": IDENTITY}),
    )
]  # fmt: skip


def plan(folder: Path, *trees: Tree, items: list[Item] = ITEMS, **config: object) -> Plan:
    with open_log(write_log(folder / "log.mcap", items)) as reader:
        return make_plan(reader, make_world(*trees), Config(**config))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/tf#palm", ("/tf", "palm")),
        ("/tf", ("/tf", "")),
        ("/a#b", ("/a#b", "")),
        ("/x#y#z", ("/x", "y#z")),
        ("/tf#", ("/tf", "")),
    ],
)
def test_a_part_follows_the_topic_unless_a_topic_is_named_so(name: str, expected: tuple[str, str]) -> None:
    assert split_topic(name, {"/tf", "/a#b"}) == expected


def test_static_transforms_are_told_by_their_topic() -> None:
    assert [is_static(topic) for topic in ("/tf_static", "/robot/tf_static", "tf_static", "/tf", "/my_tf_static")] == [
        True, True, True, False, False,
    ]  # fmt: skip


def column(recorded: str, **fields: object) -> int | None:
    source = {"tree": 0, "topic": "/j", "unit": None, "rename": {}, "dofs": {"a": 0, "b": 1}} | fields
    return JointInput(JointSource(**source), "/j", "", (), False).column(recorded)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("recorded", "fields", "expected"),
    [
        ("a", {}, 0),
        ("c", {}, None),
        ("c", {"rename": {"c": "b"}}, 1),
        ("b", {"rename": {"c": "b"}}, None),  # which is fed by another
        ("a", {"rename": {"a": "b"}}, 1),
        ("a", {"rename": {"a": "b", "b": "a"}}, 1),
        ("a", {"ignore": ("a*",)}, None),
        ("a", {"ignore": ("*",), "rename": {"a": "a"}}, 0),
    ],
)
def test_rename_goes_before_names_and_ignore_after_it(
    recorded: str, fields: dict[str, object], expected: int | None
) -> None:
    assert column(recorded, **fields) == expected


def test_inputs_are_found_with_their_channels(tmp_path: Path) -> None:
    found = plan(
        tmp_path, Tree(root="/tf#palm", topic="/glove", joints=("a",)), Tree(name="cup", root="/wrist", avatar=False)
    )
    assert not found.problems
    assert [(p.topic, p.child) for p in found.poses] == [("/tf", "palm"), ("/wrist", "")]
    assert found.joints[0].recorded_names() == {"a": 0}
    assert found.clock is not None
    assert (found.clock.topic, found.clock.child) == ("/tf", "palm")
    assert len(found.keys) == 3


@pytest.mark.parametrize(
    ("trees", "topic"),
    [
        ([Tree(topic="/glove", joints=("a",))], "/glove"),
        ([Tree(root="/wrist", topic="/glove", joints=("a",))], "/wrist"),
        ([Tree(), Tree(name="cup", root="/tf#palm", avatar=False)], "/tf#palm"),
        ([Tree(topic="/glove", joints=("a",)), Tree(name="cup", root="/wrist", avatar=False)], "/glove"),
        ([Tree()], None),
    ],
)
def test_the_frames_are_those_of_the_first_avatar_that_is_recorded(trees: list[Tree], topic: str | None) -> None:
    assert default_clock(make_world(*trees)) == topic


@pytest.mark.parametrize(
    ("tree", "config", "said"),
    [
        (Tree(root="/wirst"), {}, r"'/wirst' for the root of 'hand' is not in the log \(did you mean '/wrist'"),
        (Tree(root="/glove"), {}, "/glove"),
        (Tree(root="/wrist#palm"), {}, "holds a single pose"),
        (Tree(root="/tf"), {}, "must name its own as /tf#CHILD_FRAME"),
        (Tree(root="/wrist", topic="/wrist", joints=("a",)), {}, "/wrist"),
        (Tree(root="/wrist", topic="/glove#left", joints=("a",)), {}, "has no sides"),
        (Tree(root="/wrist"), {"clock": "/clock"}, "'/clock' for the frame clock is not in the log"),
        (Tree(), {}, "gives no frames"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, tree: Tree, config: dict[str, object], said: str) -> None:
    problems = plan(tmp_path, tree, **config).problems
    assert len(problems) == 1
    assert "\n" not in problems[0]
    assert re.search(said, problems[0])
