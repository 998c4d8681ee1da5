"""A JointState without positions, or with fewer than names, froze its joints for the rest of the log, without a word."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.recording.frames import FrameSource
from geomphys.recording.inspect import inspect_log
from geomphys.recording.report import RecordingReport
from geomphys.results import Frame
from tests.recording.log_files import Item, Tree, joints, make_world, pose, write_log

WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b", "c")))
COUNT = 60


def values(k: int) -> dict[str, float]:
    return {"a": 0.01 * k, "b": 0.5 - 0.01 * k, "c": 0.02 * k}


def items(odd: dict[int, dict[str, float | None]]) -> list[Item]:
    made = []
    for k in range(COUNT):
        made += [pose("/wrist", 1 + k / 60, (k, 0, 0, 0, 0, 0, 1)), joints("/glove", 1 + k / 60, odd.get(k, values(k)))]
    return made


def replay(path: Path) -> tuple[list[Frame], RecordingReport]:
    with FrameSource(path, WORLD, Config()) as source:
        return list(source), source.report


def ros(path: Path, odd: dict[int, tuple[list[str], list[float]]], encoding: str) -> Path:
    """A log in which some messages have other names and positions, not as many of the one as of the other."""
    made = items({})
    for k, lists in odd.items():
        made[2 * k + 1].value = lists
    return write_log(path, made, encoding=encoding)


def expect_all_but(frames: list[Frame], odd: int) -> None:
    """All frames are as recorded; that of the odd message lies between its neighbours."""
    assert len(frames) == COUNT
    for k, frame in enumerate(frames):
        if k != odd:
            assert tuple(frame.angles) == tuple(values(k).values()), k
            assert not frame.held
    if odd > 0:
        assert not frames[odd].held
        assert frames[odd].angles == pytest.approx(tuple(values(odd).values()), abs=1e-8)
    else:
        assert frames[odd].held


@pytest.mark.parametrize("encoding", ["ros2", "json-ros"])
@pytest.mark.parametrize("at", [0, 20, 59])
@pytest.mark.parametrize("positions", [0, 1, 2])
def test_a_message_with_fewer_positions_than_names_is_no_sample_and_harms_no_other(
    tmp_path: Path, encoding: str, at: int, positions: int
) -> None:
    odd = {at: (["a", "b", "c"], [9.0, 9.0, 9.0][:positions])}
    frames, report = replay(ros(tmp_path / "log.mcap", odd, encoding))
    if at == COUNT - 1:
        assert frames[-1].held
        assert [f.held for f in frames[:-1]] == [False] * (COUNT - 1)
    else:
        expect_all_but(frames, at)
    what = "have no positions" if positions == 0 else "have fewer positions than names"
    told = [w for w in report.warnings if "samples of its joints" in w]
    assert len(told) == 1
    assert told[0].startswith(f"topic /glove: of {COUNT} messages 1 {what}")


@pytest.mark.parametrize("encoding", ["ros2", "json-ros"])
def test_of_more_positions_than_names_those_of_the_names_count(tmp_path: Path, encoding: str) -> None:
    odd = {20: (["a", "b", "c"], [*values(20).values(), 7.0, 8.0])}
    frames, report = replay(ros(tmp_path / "log.mcap", odd, encoding))
    assert [tuple(f.angles) for f in frames] == [tuple(values(k).values()) for k in range(COUNT)]
    assert any("more positions than names" in w and "/glove" in w for w in report.warnings)


@pytest.mark.parametrize("encoding", ["ros2", "json-ros"])
def test_no_names_no_sample_and_other_lists_of_names_are_each_taken_as_they_are(tmp_path: Path, encoding: str) -> None:
    lists = {k: (["c", "a", "b"], [0.02 * k, 0.01 * k, 0.5 - 0.01 * k]) for k in range(10, 30)}
    lists |= {20: ([], [])} | {40: ([], [1.0, 2.0])}
    frames, _ = replay(ros(tmp_path / "log.mcap", lists, encoding))
    for k, frame in enumerate(frames):
        assert frame.angles == pytest.approx(tuple(values(k).values()), abs=1e-8)
        assert not frame.held


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
@pytest.mark.parametrize("at", [0, 20])
def test_foxglove_joints_that_have_no_position_are_no_sample(tmp_path: Path, encoding: str, at: int) -> None:
    path = write_log(tmp_path / "log.mcap", items({at: dict.fromkeys("abc")}), encoding=encoding)
    frames, report = replay(path)
    expect_all_but(frames, at)
    assert any(f"of {COUNT} messages 1 have no positions" in w for w in report.warnings)


@pytest.mark.parametrize("encoding", ["ros2", "json-ros", "protobuf", "json"])
def test_nan_is_missing_of_its_joint_alone(tmp_path: Path, encoding: str) -> None:
    if encoding == "json":
        pytest.skip("null is no position there")
    path = write_log(tmp_path / "log.mcap", items({20: values(20) | {"b": math.nan}}), encoding=encoding)
    frames, report = replay(path)
    expect_all_but(frames, 20)
    assert (frames[20].angles[0], frames[20].angles[2]) == (values(20)["a"], values(20)["c"])
    assert report.bad_samples == 1


def test_velocities_without_the_key_for_positions_are_no_sample(tmp_path: Path) -> None:
    def content(k: int) -> bytes:
        message = {"header": {"stamp": {"sec": 1, "nanosec": 10**7 * k}}, "name": ["a", "b", "c"]}
        message |= {"velocity": [1.0, 1.0, 1.0]} if k == 5 else {"position": list(values(k).values())}
        return json.dumps(message).encode()

    made = [Item("/glove", "joints", content(k), (100 + k) * 10**7) for k in range(20)]
    path = write_log(tmp_path / "log.mcap", made, encoding="json-ros")
    with FrameSource(path, make_world(Tree(topic="/glove", joints=("a", "b", "c"))), Config()) as source:
        frames = list(source)
        assert source.report.bad_messages == 0
    for k, frame in enumerate(frames):
        assert frame.angles == pytest.approx(tuple(values(k).values()), abs=1e-8)
        assert not frame.held
    assert inspect_log(path).topics[0].bad_messages == 0


@pytest.mark.parametrize(("name", "at"), [("log", 20), ("log_fewer", 20), ("log_first", 0)])
def test_the_case(shared_dir: Path, name: str, at: int) -> None:
    folder = shared_dir / "cases" / "joint_state_without_positions"
    world = load_world(folder / "scene.toml")
    with FrameSource(folder / f"{name}.mcap", world, Config()) as source:
        frames = list(source)
        report = source.report
    index = world.dof_names.index("index_mcp")
    assert frames[35].angles[index] == pytest.approx(0.917, abs=5e-4)
    assert [f.index for f in frames if f.held] == ([0] if at == 0 else [])
    assert len({tuple(f.angles) for f in frames[20:]}) > 30
    assert any("/glove/joint_states: of 60 messages 1 have" in w for w in report.warnings)
