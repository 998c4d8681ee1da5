"""Topics whose stamps are of other clocks: refused, warned of, or agreeing, by the first messages of each."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.clock_agreement import MAX_CLOCK_OFFSET, _is_logged_live, check_clock_agreement, log_times_agree
from geomphys.recording.input_plan import make_plan
from geomphys.recording.message_times import MessageTimes
from geomphys.recording.reader import open_log
from geomphys.recording.stream_prescan import Prescan, StampOffset, prescan_streams
from tests.recording.log_files import IDENTITY, S, Tree, joints, make_world, pose, write_log

HOUR = 3600 * S


def check(folder: Path, apart: int, logged_apart: float = 0.0, span: float = 4.0) -> list[str]:
    """Warnings for a hand whose joints are stamped `apart` [ns] off its root."""
    items, count = [], round(span * 50)
    for k in range(count):
        t = 10_000 + k / 50
        items.append(pose("/wrist", t, (0.01 * k, *IDENTITY[1:])))
        items.append(joints("/glove", t + logged_apart, {"a": 0.01 * k}, stamp=round(t * S) + apart))
    items.sort(key=lambda item: item.log_time)
    world, config = make_world(Tree(root="/wrist", topic="/glove", joints=("a",))), Config()
    with open_log(write_log(folder / "log.mcap", items)) as reader:
        plan = make_plan(reader, world, config)
        prescan = prescan_streams(reader, plan, config, MessageTimes("header", reader.channels, reader.path))
        check_clock_agreement(reader, plan, prescan, config)
        return prescan.warnings


@pytest.mark.parametrize("apart", [0, S // 2, -S // 2])
def test_stamps_that_are_a_little_late_agree(tmp_path: Path, apart: int) -> None:
    assert check(tmp_path, apart) == []


@pytest.mark.parametrize(("apart", "side"), [(3 * S // 2, "after"), (-3 * S // 2, "before")])
def test_clocks_that_may_be_apart_are_warned_of(tmp_path: Path, apart: int, side: str) -> None:
    (text,) = check(tmp_path, apart)
    assert f"1.500 s {side} those of the frame clock" in text
    assert "/glove" in text


def test_clocks_that_leave_every_frame_without_samples_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="every frame would be held"):
        check(tmp_path, 10 * S)


@pytest.mark.parametrize("apart", [2 * HOUR, -2 * HOUR])
def test_other_clocks_are_an_error(tmp_path: Path, apart: int) -> None:
    assert abs(apart) > MAX_CLOCK_OFFSET
    with pytest.raises(LogError, match=r"different clocks, 7200 s apart"):
        check(tmp_path, apart)


def offsets(step: int, log_step: int) -> list[StampOffset]:
    return [StampOffset(k * step, k * (step - log_step)) for k in range(8)]


@pytest.mark.parametrize(
    ("step", "log_step", "live"),
    [(10, 10, True), (10, 3, True), (10, 39, True), (10, 41, False), (41, 10, False), (0, 10, False)],
)
def test_messages_were_logged_live_if_both_clocks_go_about_as_fast(step: int, log_step: int, live: bool) -> None:
    assert _is_logged_live(offsets(step, log_step)) == live


def test_log_times_give_the_order_if_offsets_of_all_topics_are_within_the_delay() -> None:
    prescan = Prescan()
    prescan.stamp_offsets["/a", ""] = [StampOffset(1, 100), StampOffset(2, 110)]
    prescan.stamp_offsets["/b", ""] = [StampOffset(1, 150), StampOffset(2, 160)]
    assert log_times_agree(prescan, 40)
    assert not log_times_agree(prescan, 39)
    prescan.stamp_offsets["/tf_static", ""] = [StampOffset(1, 10**6)]
    assert log_times_agree(prescan, 40)
    assert log_times_agree(Prescan(), 0)
