"""Stamps that start over, are unset, in a wrong unit or of another clock were mixed, held or stretched without a word."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from geomphys_cli.main import run

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.load import load_world
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.report import RecordingReport
from geomphys.results import Frame
from geomphys.scene.world import World
from tests.recording.log_files import Item, S, Tree, joints, make_world, pose, transforms, write_log

EPOCH = 1_760_000_000
HAND = make_world(Tree(root="/wrist", topic="/glove", joints=("a",)))
RATE = 60


def take(count: int, *, begin: float = 0.0, stamped: float | None = None, aside: float = 0.0) -> list[Item]:
    """Poses and joints at 60 Hz, logged from `begin` (s after the epoch) and stamped from `stamped` on."""
    made = []
    for k in range(count):
        at, stamp = EPOCH + begin + k / RATE, None if stamped is None else round((stamped + k / RATE) * S)
        made.append(pose("/wrist", at, (aside + 0.001 * k, 0, 0, 0, 0, 0, 1), stamp=stamp))
        made.append(joints("/glove", at, {"a": 0.001 * k}, stamp=stamp))
    return made


def restamped(items: list[Item], change) -> list[Item]:
    return [replace(item, stamp=change(k, item)) for k, item in enumerate(items)]


def replay(folder: Path, items: list[Item], world: World = HAND, **options) -> tuple[list[Frame], RecordingReport]:
    path = write_log(folder / "log.mcap", sorted(items, key=lambda m: m.log_time))
    with FrameSource(path, world, Config(**options)) as source:
        return list(source), source.report


def refused(folder: Path, items: list[Item], world: World = HAND, **options) -> str:
    with pytest.raises(LogError) as caught:
        replay(folder, items, world, **options)
    text = str(caught.value)
    assert "\n" not in text
    assert "--time log" in text
    return text


def by_log_times(folder: Path, items: list[Item], world: World = HAND) -> None:
    """With ``--time log`` every message of the clock gives its frame, of its own pose."""
    frames, _ = replay(folder, items, world, time="log")
    wrist = sorted((m for m in items if m.topic == "/wrist"), key=lambda m: m.log_time)
    assert [(f.time_ns, f.roots[0, 0]) for f in frames] == [(m.log_time, m.value[0]) for m in wrist]


# --- stamps that start over


@pytest.mark.parametrize("pause", [0.0, 0.2, 30.0])
@pytest.mark.parametrize("seconds", [1.5, 5.0, 20.0])
def test_two_takes_in_a_log_are_an_error_that_says_where(tmp_path: Path, seconds: float, pause: float) -> None:
    count = round(seconds * RATE)
    items = take(count, stamped=1.0) + take(count, begin=seconds + pause, stamped=1.0, aside=0.3)
    text = refused(tmp_path, items)
    assert "'/wrist'" in text or "'/glove'" in text
    assert f"back by {(count - 1) / RATE:.3f} s" in text
    assert f"{seconds + pause:.3f} s into the log" in text
    by_log_times(tmp_path, items)


def test_one_topic_of_several_may_start_over(tmp_path: Path) -> None:
    items = take(600)
    again = [m for m in items if m.topic == "/glove" and m.log_time > (EPOCH + 5) * S]
    items = [replace(m, stamp=m.log_time - 4 * S) if m in again else m for m in items]
    assert "'/glove'" in refused(tmp_path, items)


def test_a_slow_topic_of_few_messages_may_start_over(tmp_path: Path) -> None:
    world = make_world(Tree(root="/wrist", joints=()), Tree(name="mug", root="/mug", avatar=False))
    items = [m for m in take(600) if m.topic == "/wrist"]
    items += [pose("/mug", EPOCH + k, (k, 0, 0, 0, 0, 0, 1), stamp=(EPOCH + k % 5) * S) for k in range(9)]
    assert "'/mug'" in refused(tmp_path, items, world)


def test_two_hosts_that_stamp_one_topic_by_clocks_apart(tmp_path: Path) -> None:
    items = restamped(take(300), lambda k, m: m.log_time - (3 * S if k % 4 == 2 else 0))
    assert "'/wrist'" in refused(tmp_path, items)


def test_of_transforms_each_frame_is_watched_by_itself(tmp_path: Path) -> None:
    """Of one topic, a frame 5 s behind all the time is no fault of the one that is followed."""
    items = []
    for k in range(300):
        items.append(transforms("/tf", EPOCH + k / RATE, {"hand": (k / 128, 0, 0, 0, 0, 0, 1)}))
        late = EPOCH * S + k * S // RATE - 5 * S
        items.append(transforms("/tf", EPOCH + (k + 0.5) / RATE, {"other": (0, 0, 0, 0, 0, 0, 1)}, stamp=late))
    frames, report = replay(tmp_path, items, make_world(Tree(root="/tf#hand")))
    assert len(frames) == 300
    assert report.warnings == ()


def test_a_message_gone_astray_now_and_then_is_late_as_before(tmp_path: Path) -> None:
    items = restamped(take(900), lambda k, m: m.log_time - (2 * S if k % 200 == 150 else 0))
    frames, report = replay(tmp_path, items)
    assert len(frames) > 890
    assert report.late > 3


# --- unset stamps


@pytest.mark.parametrize("first", [EPOCH + 3.0, 12.38, 3.0, 0.4])
@pytest.mark.parametrize("unset", [range(5), range(40, 45), [0, 1, 30, 90], range(0, 118, 2)])
def test_stamps_of_zero_among_others_take_the_log_time_on_the_clock_of_the_others(
    tmp_path: Path, first: float, unset
) -> None:
    stamps = dict.fromkeys(unset, 0)
    items = restamped(take(120), lambda k, m: stamps.get(k // 2, round((first + k // 2 / RATE) * S)))
    frames, report = replay(tmp_path, items)
    # those before the clock's own zero cannot have a time on it and are left out
    first_set = next(k for k in range(120) if k not in stamps)
    left_out = max(0, first_set - 1 - round(first * RATE)) if first < 1 else 0
    assert len(frames) == pytest.approx(120 - left_out, abs=1)
    times = np.array([f.time_ns for f in frames]) / S - first
    assert np.diff(times).max() < 0.1
    assert times[-1] == pytest.approx(119 / RATE, abs=0.02)
    assert not any(f.held for f in frames)
    xs = np.array([f.roots[0, 0] for f in frames])
    assert np.allclose(xs, 0.001 * RATE * times, atol=2e-3)
    count = len(stamps)
    for topic in ("/wrist", "/glove"):
        assert any(
            f"topic {topic}: {count} messages" in w and "zero" in w and "log times" in w for w in report.warnings
        )


def test_a_clock_that_begins_at_zero_has_its_zero(tmp_path: Path) -> None:
    frames, report = replay(tmp_path, take(120, stamped=0.0))
    assert [f.time_ns for f in frames] == [round(k / RATE * S) for k in range(120)]
    assert report.warnings == ()


def test_very_many_unset_stamps_before_a_clock_of_its_own_are_told(tmp_path: Path) -> None:
    items = restamped(take(1500), lambda k, m: 0 if k < 2600 else round((5 + k / 2 / RATE) * S))
    assert "stamped zero" in refused(tmp_path, items)
    by_log_times(tmp_path, items)


# --- wrong units, jumps ahead


@pytest.mark.parametrize("factor", [1e3, 1e6])
@pytest.mark.parametrize("count", [30, 600])
def test_milliseconds_in_the_field_for_seconds(tmp_path: Path, factor: float, count: int) -> None:
    items = restamped(take(count), lambda k, m: round((100 + k // 2 / RATE * factor) * S))
    text = refused(tmp_path, items)
    assert "milliseconds" in text
    by_log_times(tmp_path, items)


@pytest.mark.parametrize("unit", [1, 10**3])
def test_stamps_that_hardly_go_on(tmp_path: Path, unit: int) -> None:
    items = restamped(take(100), lambda k, m: 5 * S + unit * (k // 2) * 1000 // RATE)
    assert "slower than the log times" in refused(tmp_path, items)
    by_log_times(tmp_path, items)


def test_a_clock_that_is_set_while_it_records(tmp_path: Path) -> None:
    items = restamped(take(600), lambda k, m: m.log_time if k >= 500 else m.log_time - EPOCH * S)
    text = refused(tmp_path, items)
    assert "jump ahead" in text
    assert "s into the log" in text
    by_log_times(tmp_path, items)
    few = restamped(take(600), lambda k, m: m.log_time + (5 * S if k >= 500 else 0))
    _, report = replay(tmp_path, few)
    told = [w for w in report.warnings if "jump ahead by 5.000 s" in w]
    assert len(told) == 2
    assert all("--time log" in w for w in told)


# --- clocks apart


@pytest.mark.parametrize("apart", [-3.0, 3.0])
def test_topics_whose_clocks_are_apart(tmp_path: Path, apart: float) -> None:
    def moved(count: int) -> list[Item]:
        return restamped(take(count), lambda k, m: m.log_time + (round(apart * S) if m.topic == "/glove" else 0))

    text = refused(tmp_path, moved(90))
    assert all(part in text for part in ("'/glove'", "'/wrist'", "3.000 s", "held"))
    by_log_times(tmp_path, moved(90))
    _, report = replay(tmp_path, moved(900))
    told = [w for w in report.warnings if "3.000 s" in w and "--time log" in w]
    assert len(told) == 1
    assert all(part in told[0] for part in ("'/glove'", "'/wrist'"))


def test_clocks_that_drift_apart(tmp_path: Path) -> None:
    items = restamped(
        take(1200), lambda k, m: m.log_time + ((m.log_time - EPOCH * S) // 20 if m.topic == "/glove" else 0)
    )
    _, report = replay(tmp_path, items)
    assert any("topic /glove: its time stamps drift" in w and "--time log" in w for w in report.warnings)


# --- what is no fault


@pytest.mark.parametrize(
    "change",
    [
        lambda k, m: m.log_time,
        lambda k, m: m.log_time - EPOCH * S + 7 * S,  # another epoch
        lambda k, m: m.log_time + 400 * S,  # the future
        lambda k, m: m.log_time - 300_000_000,  # a tracker that takes its time
        lambda k, m: (m.log_time - EPOCH * S) // 50 + 9 * S,  # a simulation slower than the wall
        lambda k, m: (m.log_time - EPOCH * S) * 4 + 9 * S,  # and a quicker one
    ],
)
@pytest.mark.parametrize("pause", [0.0, 500.0])
def test_what_the_log_times_bear_out_is_told_of_in_no_word(tmp_path: Path, change, pause: float) -> None:
    items = restamped(take(200) + take(200, begin=200 / RATE + pause), change)
    frames, report = replay(tmp_path, items)
    assert len(frames) == 400
    assert report.warnings == ()


@pytest.mark.parametrize("logged", [lambda k: 0, lambda k: k * 10_000, lambda k: k * 200_000])
def test_a_program_that_wrote_the_log_later_is_no_fault(tmp_path: Path, logged) -> None:
    """Log times that are not set, or those of a converter that took milliseconds over it: the stamps are right."""
    items = take(60, stamped=20.0) + take(60, stamped=90.0)
    items = [replace(m, log_time=logged(k)) for k, m in enumerate(items)]
    frames, report = replay(tmp_path, items)
    assert len(frames) == 120
    assert report.warnings == ()


def test_a_slow_log(tmp_path: Path) -> None:
    world = make_world(Tree(root="/wrist"))
    items = [pose("/wrist", EPOCH + 30 * k, (k, 0, 0, 0, 0, 0, 1)) for k in range(40)]
    frames, report = replay(tmp_path, items, world)
    assert len(frames) == 40
    assert report.warnings == ()


# --- the cases


@pytest.mark.parametrize(
    ("name", "says", "frames"),
    [
        ("reset", ("/tracker/wrist", "start over", "back by 4.975 s"), 600),
        ("hosts_apart", ("/glove/joint_states", "/tracker/wrist", "3.000 s", "2.017 s"), 60),
        ("ms", ("/tracker/wrist", "milliseconds"), 60),
    ],
)
def test_the_cases(shared_dir: Path, name: str, says: tuple[str, ...], frames: int) -> None:
    folder = shared_dir / "cases" / "times_that_jump"
    world, log = load_world(folder / "scene.toml"), folder / f"{name}.mcap"
    (error,) = check_log(log, world).errors
    with pytest.raises(LogError) as caught, FrameSource(log, world, Config()) as source:
        list(source)
    assert str(caught.value) == error
    assert all(part in error for part in (*says, "--time log"))
    report = check_log(log, world, Config(time="log"))
    assert report.errors == ()
    assert report.recording is not None
    assert report.recording.frames == frames


def test_the_case_of_unset_stamps(shared_dir: Path) -> None:
    folder = shared_dir / "cases" / "times_that_jump"
    report = check_log(folder / "first_zero.mcap", load_world(folder / "scene.toml")).recording
    assert report is not None
    assert report.first_ns is not None
    assert report.last_ns is not None
    assert (report.frames, report.held_frames, report.duplicates) == (60, 0, 0)
    assert (report.last_ns - report.first_ns) / S == pytest.approx(59 / 60, abs=0.02)
    assert any("/tracker/wrist: 5 messages" in w and "zero" in w for w in report.warnings)


def test_check_replay_and_batch_agree(shared_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = shared_dir / "cases" / "times_that_jump"
    log, scene = str(folder / "ms.mcap"), ["-s", str(folder / "scene.toml")]
    said = []
    for words in (["check", log, *scene], ["replay", log, *scene, "-o", str(tmp_path / "out.mcap")]):
        assert run(words) == 1
        said.append(capsys.readouterr().err.splitlines()[-1].partition(": ")[2])
    assert said[1].startswith(said[0])  # and tells where the finished part is
    assert not (tmp_path / "out.mcap").exists()
    assert run(["batch", log, *scene, "-O", str(tmp_path / "out"), "-j", "1", "--json"]) == 3
    (entry,) = json.loads(capsys.readouterr().out)["entries"]
    assert entry["status"] == "failed"
    assert "milliseconds" in entry["error"]
    assert "--time log" in entry["error"]
    assert run(["replay", log, *scene, "-o", str(tmp_path / "out.mcap"), "--time", "log"]) == 0
