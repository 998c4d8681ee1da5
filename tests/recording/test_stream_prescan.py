"""What is known before the first frame: first good values, what is constant, whose stamps are unset."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.recording.input_plan import make_plan
from geomphys.recording.message_times import MessageTimes
from geomphys.recording.reader import open_log
from geomphys.recording.stream_prescan import OFFSET_MESSAGES, Prescan, StreamInfo, joint_key, prescan_streams
from tests.recording.log_files import IDENTITY, Item, S, Tree, joints, make_world, pose, write_log

HAND = Tree(root="/wrist", topic="/glove", joints=("a", "b"))


def at(x: float) -> tuple[float, ...]:
    return (x, *IDENTITY[1:])


def prescan(path: Path, items: list[Item], time: str = "header") -> tuple[Prescan, MessageTimes]:
    config, world = Config(time=time), make_world(HAND)  # type: ignore[arg-type]
    with open_log(write_log(path / "log.mcap", items)) as reader:
        plan = make_plan(reader, world, config)
        assert not plan.problems
        times = MessageTimes(config.time, reader.channels, reader.path)
        return prescan_streams(reader, plan, config, times), times


def test_the_earliest_good_sample_counts_in_whatever_order_they_come() -> None:
    info = StreamInfo()
    for time, value in ((5, None), (7, (0.7,)), (3, (0.3,)), (9, (0.9,)), (1, None)):
        info.add(time, value, f"frame{time}")
    assert (info.first_time, info.value, info.frame) == (3, (0.3,), "frame3")
    assert info.varies


def test_samples_of_one_time_do_not_vary() -> None:
    info = StreamInfo()
    for _ in range(3):
        info.add(5, (0.1,))
    assert not info.varies


def test_first_values_of_poses_and_joints_are_found(tmp_path: Path) -> None:
    items = []
    for k in range(30):
        value = (math.nan, *IDENTITY[1:]) if k < 2 else at(0.1 * k)
        items += [
            pose("/wrist", 1 + k / 30, value),
            joints("/glove", 1 + k / 30, {"a": k, "b": math.nan if k < 3 else 2 * k}),
        ]
    found, _ = prescan(tmp_path, items)
    assert found.streams["/wrist", ""].value == pytest.approx(at(0.2))
    assert found.streams["/glove", "a"].value == (0.0,)
    assert found.streams["/glove", "b"].value == (6.0,)
    assert all(info.varies for info in found.streams.values())
    assert found.names["/glove"] == {"a", "b"}


def test_a_joint_that_comes_late_or_once_is_found_too(tmp_path: Path) -> None:
    items = [pose("/wrist", 1 + k / 30, at(k)) for k in range(200)]
    items += [joints("/glove", 1 + k / 30, {"a": 0.5} | ({"b": 0.25} if k == 150 else {})) for k in range(200)]
    found, _ = prescan(tmp_path, sorted(items, key=lambda item: item.log_time))
    assert found.streams["/glove", "b"].value == (0.25,)
    assert not found.streams["/glove", "b"].varies
    assert found.streams["/glove", "a"].varies


def test_offsets_of_stamps_are_those_of_the_first_messages(tmp_path: Path) -> None:
    items = [pose("/wrist", 100 + k / 30, at(k), stamp=round((5 + k / 30) * S)) for k in range(40)]
    items += [joints("/glove", 100 + k / 30, {"a": k, "b": k}) for k in range(40)]
    found, _ = prescan(tmp_path, sorted(items, key=lambda item: item.log_time))
    offsets = found.stamp_offsets["/wrist", ""]
    assert len(offsets) == OFFSET_MESSAGES
    assert [o.offset for o in offsets] == pytest.approx([-95 * S] * OFFSET_MESSAGES, abs=2)
    assert {o.offset for o in found.stamp_offsets["/glove", ""]} == {0}


@pytest.mark.parametrize(("zeros", "is_time"), [(1, True), (5, False)])
def test_a_zero_stamp_is_a_time_only_if_it_is_one_and_the_clock_begins_there(
    tmp_path: Path, zeros: int, is_time: bool
) -> None:
    items = [pose("/wrist", 100 + k / 30, at(k), stamp=0 if k < zeros else round(k / 30 * S)) for k in range(40)]
    items += [joints("/glove", 100 + k / 30, {"a": k, "b": k}, stamp=round(k / 30 * S)) for k in range(40)]
    _, times = prescan(tmp_path, sorted(items, key=lambda item: item.log_time))
    (key,) = [key for key, channel in times.channels.items() if channel.topic == "/wrist"]
    assert (key in times.zero_stamp_times) == is_time
    assert times.offsets[key] == pytest.approx(-100 * S, abs=2)


def test_sides_of_gloves_have_streams_of_their_own() -> None:
    assert joint_key("a", "") == "a"
    assert len({joint_key("a", side) for side in ("", "left", "right")}) == 3
