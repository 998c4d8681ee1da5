"""Inputs that the log cannot feed, told in a line each: poses that never come, joints of other names, the other hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.recording.input_plan import Plan, make_plan
from geomphys.recording.input_problems import input_problems, without_lost_points
from geomphys.recording.message_times import MessageTimes
from geomphys.recording.reader import open_log
from geomphys.recording.stream_prescan import Prescan, StreamInfo, prescan_streams
from tests.recording.log_files import IDENTITY, Tree, glove, joints, make_world, pose, transforms, write_log

LOST = (math.nan, *IDENTITY[1:])


def problems(folder: Path, tree: Tree) -> list[str]:
    items = []
    for k in range(20):
        t = 1 + k / 30
        items += [
            pose("/wrist", t, (0.1 * k, *IDENTITY[1:])), pose("/lost", t, LOST),
            transforms("/tf", t, {"palm": (0.1 * k, *IDENTITY[1:]), "cup": IDENTITY}),
            joints("/j", t, {"left_a": 0.1, "left_b": 0.2}), glove("/manus", t, {"a": 1.0}, side="left"),
        ]  # fmt: skip
    config, world = Config(), make_world(tree)
    with open_log(write_log(folder / "log.mcap", items)) as reader:
        plan = make_plan(reader, world, config)
        assert not plan.problems
        prescan = prescan_streams(reader, plan, config, MessageTimes("header", reader.channels, reader.path))
        return list(input_problems(reader, plan, prescan))


@pytest.mark.parametrize(
    ("tree", "said"),
    [
        (Tree(root="/lost"), "'/lost' has no good pose"),
        (Tree(root="/tf#plam"), "no pose of the frame 'plam' (did you mean 'palm'?); it has cup, palm"),
        (
            Tree(root="/wrist", topic="/j", joints=("x",)),
            "none of the joints x; it has left_a, left_b; map them by `rename`",
        ),
        (Tree(root="/wrist", topic="/j", joints=("right_a",)), "choose the topic or the URDF of the same side"),
        (Tree(root="/wrist", topic="/manus#right", joints=("a",)), "no glove of the side 'right'; it has left"),
    ],
)
def test_each_has_its_line(tmp_path: Path, tree: Tree, said: str) -> None:
    (line,) = problems(tmp_path, tree)
    assert said in line
    assert "\n" not in line


@pytest.mark.parametrize(
    "tree",
    [
        Tree(root="/wrist", topic="/j", joints=("left_a", "right_a")),  # one of them is enough
        Tree(root="/tf#palm", topic="/manus#left", joints=("a",)),
        Tree(root="/wrist", topic="/j", joints=("x",), rename={"left_a": "x"}),
    ],
)
def test_what_can_be_fed_is_no_problem(tmp_path: Path, tree: Tree) -> None:
    assert problems(tmp_path, tree) == []


def test_nothing_is_lost_where_there_are_no_points() -> None:
    plan, prescan = Plan(), Prescan(streams={("/a", ""): StreamInfo()})
    without_lost_points(plan, prescan)
    assert (plan.poses, plan.keypoints) == ([], [])
