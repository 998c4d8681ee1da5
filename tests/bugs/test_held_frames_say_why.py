"""Frames were said to be held without a word on which stream, how long a gap, where, and what to do."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.recording.frames import FrameSource
from tests.recording.log_files import Item, Tree, joints, make_world, pose, transforms, write_log

HAND = Tree(root="/wrist", topic="/glove", joints=("a", "b"))
MUG = Tree(name="mug", root="/tf#mug", avatar=False)
AT = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def log(
    wrist: Callable[[float], bool] = lambda t: True,
    glove: Callable[[float], tuple[str, ...]] = lambda t: ("a", "b"),
    mug: Callable[[float], bool] = lambda t: True,
    bad: int = -1,
) -> list[Item]:
    """Four seconds at 50 Hz, of which only some messages, joints and poses are there."""
    items = []
    for k in range(200):
        t = k / 50
        if wrist(t):
            items.append(pose("/wrist", 7 + t, (math.nan, *AT[1:]) if k == bad else AT))
        items.append(joints("/glove", 7 + t, dict.fromkeys(glove(t), 0.1)))
        if mug(t):
            items.append(transforms("/tf", 7 + t, {"mug": AT}))
    return items


@pytest.mark.parametrize(
    ("items", "held", "says"),
    [
        (log(glove=lambda t: ("a",) if 1 < t < 1.5 else ("a", "b")), 24, ("/glove", "joint b", "0.500 s", "1.000 s")),
        (log(mug=lambda t: not 2 < t < 2.4), 19, ("/tf#mug", "root of mug", "0.400 s", "2.000 s")),
        (log(mug=lambda t: t >= 1.2), 60, ("/tf#mug", "root of mug", "begins 1.200 s after the first frame")),
        (
            log(glove=lambda t: ("a", "b") if t < 3 else ()),
            50,
            ("/glove", "(and 1 more)", "ends 1.000 s before the last"),
        ),
        (log(bad=120), 1, ("/wrist", "root of hand", "not finite")),
    ],
)
def test_the_line_names_stream_gap_place_and_remedy(tmp_path: Path, items: list[Item], held: int, says) -> None:
    path = write_log(tmp_path / "log.mcap", items)
    with FrameSource(path, make_world(HAND, MUG), Config()) as source:
        assert sum(f.held for f in source) == held
        told = [w for w in source.report.warnings if "held" in w]
    assert len(told) == 1
    assert told[0].startswith(f"{held} frames are held")
    assert all(part in told[0] for part in says), told[0]
    assert ("--max-gap" in told[0]) == ("longest gap" in told[0])


def test_the_gap_that_it_names_is_interpolated_with_that_max_gap(tmp_path: Path) -> None:
    path = write_log(tmp_path / "log.mcap", log(mug=lambda t: not 2 < t < 2.4))
    with FrameSource(path, make_world(HAND, MUG), Config(max_gap=0.4)) as source:
        assert not any(f.held for f in source)
        assert source.report.warnings == ()


def test_out_of_order_and_repeated_messages_name_topic_and_size(tmp_path: Path) -> None:
    items = log()
    for item in items:
        item.stamp = item.log_time
        if item.topic == "/tf" and item.log_time % 10**9 == 0:
            item.log_time += 400_000_000
    for k, item in enumerate(items):
        if item.topic == "/glove" and k > 30:
            item.stamp = items[31].log_time
    path = write_log(tmp_path / "log.mcap", items)
    with FrameSource(path, make_world(HAND, MUG), Config()) as source:
        list(source)
        warnings = source.report.warnings
    assert any("out of order" in w and "0.380 s behind, on topic /tf" in w for w in warnings), warnings
    assert any("repeat a time" in w and "of topic /glove" in w and "--time log" in w for w in warnings), warnings
