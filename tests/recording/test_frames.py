"""Frame clock, interpolation, holding, order: what frames a log must give."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.frames import FrameSource
from geomphys.results import FLAG_BEFORE_FIRST, FLAG_CLAMPED, FLAG_HELD, FLAG_OUTSIDE_LIMITS, Frame
from geomphys.scene.arrays import JOINT_PRISMATIC
from geomphys.scene.world import World
from tests.recording.log_files import (
    IDENTITY,
    Item,
    S,
    Tree,
    joints,
    make_world,
    pose,
    transforms,
    turned,
    write_log,
)

HAND = Tree(root="/wrist", topic="/glove", joints=("a", "b"))


def at(x: float, q=IDENTITY[3:]) -> tuple[float, ...]:
    return (x, 0.0, 0.0, *q)


def frames_of(
    path: Path, world: World, items: list[Item], *, encoding: str = "ros2", **config
) -> tuple[list[Frame], FrameSource]:
    write_log(path / "log.mcap", items, encoding=encoding)
    with FrameSource(path / "log.mcap", world, Config(**config)) as source:
        frames = list(source)
    times = [f.time_ns for f in frames]
    assert times == sorted(set(times))
    assert [f.index for f in frames] == list(range(len(frames)))
    assert all(np.isfinite(f.roots).all() and np.isfinite(f.angles).all() for f in frames)
    assert all(abs(np.linalg.norm(f.roots[:, 3:], axis=1) - 1).max() < 1e-6 for f in frames)
    return frames, source


def test_a_sample_at_a_frames_time_is_taken_bit_for_bit(tmp_path):
    rng = np.random.default_rng(1)
    quaternions = rng.normal(size=(20, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    poses = [(*rng.normal(size=3), *q) for q in quaternions]
    angles = rng.normal(size=(20, 2))
    items = [
        m
        for k in range(20)
        for m in (pose("/wrist", k / 50, poses[k]), joints("/glove", k / 50, dict(zip("ab", angles[k], strict=True))))
    ]
    frames, _ = frames_of(tmp_path, make_world(HAND), items)
    assert [tuple(f.roots[0]) for f in frames] == poses
    assert [tuple(f.angles) for f in frames] == [tuple(a) for a in angles]
    assert not any(f.held or f.flags for f in frames)


def test_streams_are_interpolated_up_to_the_gap_and_held_from_the_first_missing_frame(tmp_path):
    wrist = [pose("/wrist", k / 100, at(0.0)) for k in range(51)]
    glove = [joints("/glove", t, {"a": 10 * t, "b": -t}) for t in (0.0, 0.1, 0.301, 0.35)]
    frames, source = frames_of(tmp_path, make_world(HAND), sorted(wrist + glove, key=lambda m: m.log_time))
    for f in frames:
        t = f.time_ns / S
        held = 0.1 < t < 0.301 or t > 0.35
        assert f.held == held
        expected = t if not held else (0.1 if t < 0.301 else 0.35)
        np.testing.assert_allclose(f.angles, [10 * expected, -expected], atol=1e-12)
        assert f.flags == (FLAG_HELD if held else 0)
    assert source.report.held_frames == sum(f.held for f in frames) == 35
    a = next(s for s in source.report.streams if s.name == "a")
    assert (a.gaps, a.longest_gap_s, a.held_frames) == (1, pytest.approx(0.201), 35)


def test_rotations_take_the_short_way_at_constant_speed(tmp_path):
    tracker = Tree(name="clock", root="/clock")
    moving = Tree(name="moving", root="/moving")
    q1 = turned(1.0)
    items = [pose("/clock", k / 100, at(0)) for k in range(11)]
    items += [pose("/moving", 0.0, at(0, turned(0.2))), pose("/moving", 0.1, at(1, tuple(-x for x in q1)))]
    frames, _ = frames_of(tmp_path, make_world(tracker, moving), items)
    for f in frames[:-1]:
        w = f.time_ns / S / 0.1
        np.testing.assert_allclose(f.roots[1], at(w, turned(0.2 + w * 0.8)), atol=1e-14)
    assert tuple(frames[-1].roots[1]) == at(1.0, tuple(-x for x in q1))


def test_before_its_first_sample_a_stream_has_its_value_and_the_frame_is_held(tmp_path):
    items = [pose("/wrist", k / 10, at(k)) for k in range(60)]
    items += [joints("/glove", t, {"a": t, "b": 1.0}) for t in (3.0, 3.05, 3.1)]
    frames, _ = frames_of(tmp_path, make_world(HAND), sorted(items, key=lambda m: m.log_time))
    early = [f for f in frames if f.time_ns < 3 * S]
    assert len(early) == 30
    assert all(f.held and f.flags == FLAG_HELD | FLAG_BEFORE_FIRST and f.angles[0] == 3.0 for f in early)
    assert frames[30].flags == 0


def test_a_stream_with_one_message_is_constant_and_never_held(tmp_path):
    door = Tree(name="door", root="/door", topic="/latch", joints=("latch",), avatar=False)
    items = [pose("/wrist", k / 10, at(k)) for k in range(30)]
    items += [joints("/glove", k / 10, {"a": 0.0, "b": 0.0}) for k in range(30)]
    items += [pose("/door", 2.5, at(7.0)), joints("/latch", 1.0, {"latch": 0.5})]
    frames, source = frames_of(tmp_path, make_world(HAND, door), items)
    assert all(f.roots[1, 0] == 7.0 and f.angles[2] == 0.5 and not f.held for f in frames)
    assert {s.name for s in source.report.streams if s.constant} == {"door", "latch"}


def test_static_transforms_are_constant_however_often_they_come(tmp_path):
    world = make_world(Tree(root="/tf#hand"), Tree(name="table", root="/tf_static#table", avatar=False))
    items = [transforms("/tf", k / 10, {"hand": at(k), "other": at(-k)}) for k in range(40)]
    items += [transforms("/tf_static", t, {"table": at(v)}) for t, v in ((1.0, 5.0), (2.0, 6.0))]
    frames, _ = frames_of(tmp_path, world, sorted(items, key=lambda m: m.log_time))
    assert not any(f.held for f in frames)
    assert [f.roots[1, 0] for f in frames] == [5.0] * 20 + [6.0] * 20
    assert [f.roots[0, 0] for f in frames] == list(range(40))


def test_each_joint_is_a_stream_of_its_own(tmp_path):
    items = [pose("/wrist", k / 100, at(0)) for k in range(41)]
    for k in range(41):
        lost = 10 < k < 15 or 20 < k < 35
        items.append(joints("/glove", k / 100, {"a": float(k)} if lost else {"a": float(k), "b": -float(k)}))
    frames, _ = frames_of(tmp_path, make_world(HAND), sorted(items, key=lambda m: m.log_time))
    assert [f.angles[0] for f in frames] == list(range(41))
    held = [k for k, f in enumerate(frames) if f.held]
    assert held == list(range(21, 35))
    for k, f in enumerate(frames):
        assert f.angles[1] == pytest.approx(-20 if k in held else -k, abs=1e-12)


def test_two_messages_of_a_time_that_hold_different_joints_make_one_sample(tmp_path):
    items = []
    for k in range(10):
        items += [pose("/wrist", k / 10, at(k)), joints("/glove", k / 10, {"a": 1.0 * k})]
        items += [joints("/glove", k / 10, {"b": 2.0 * k})]
    frames, source = frames_of(tmp_path, make_world(HAND), items)
    assert [tuple(f.angles) for f in frames] == [(k, 2 * k) for k in range(10)]
    assert source.report.duplicates == 0
    assert not any(f.held for f in frames)


def test_nan_and_bad_quaternions_are_missing_and_a_bad_clock_sample_keeps_its_frame_held(tmp_path):
    nan = math.nan
    bad = {
        3: (nan, 0, 0, 0, 0, 0, 1),
        5: (5, 0, 0, 0, 0, 0, 0),
        7: (7, 0, 0, 0, 0, 0, 1.02),
        9: (1e300, 0, 0, 0, 0, 0, 1),
    }
    items = []
    for k in range(12):
        items.append(pose("/wrist", k / 50, bad.get(k, at(k))))
        items.append(joints("/glove", k / 50, {"a": nan if k == 4 else 1.0 * k, "b": math.inf if k == 6 else 0.0}))
    frames, source = frames_of(tmp_path, make_world(HAND), items)
    assert len(frames) == 12
    assert [k for k, f in enumerate(frames) if f.held] == [3, 5, 7, 9]
    assert [f.roots[0, 0] for f in frames] == [0, 1, 2, 2, 4, 4, 6, 6, 8, 8, 10, 11]
    np.testing.assert_allclose([f.angles[0] for f in frames], range(12), atol=1e-12)
    assert source.report.bad_samples == 6


def test_joints_that_keep_the_clock_hold_their_bad_samples(tmp_path):
    world = make_world(Tree(topic="/glove", joints=("a", "b")))
    items = [joints("/glove", k / 50, {"a": math.nan if k == 2 else 1.0 * k, "b": 1.0 * k}) for k in range(5)]
    items += [joints("/glove", 5 / 50, {"a": math.nan, "b": math.nan})]
    frames, _ = frames_of(tmp_path, world, items)
    assert [tuple(f.angles) for f in frames] == [(0, 0), (1, 1), (1, 2), (3, 3), (4, 4), (4, 4)]
    assert [f.held for f in frames] == [False, False, True, False, False, True]


def test_a_joint_that_is_never_good_is_zero_and_held(tmp_path):
    items = [pose("/wrist", k / 50, at(k)) for k in range(5)]
    items += [joints("/glove", k / 50, {"a": math.nan, "b": 1.0}) for k in range(5)]
    frames, _ = frames_of(tmp_path, make_world(HAND), items)
    assert all(f.held and f.angles[0] == 0 and f.angles[1] == 1 for f in frames)


def test_quaternions_a_little_off_are_normalised_and_unit_ones_are_not_touched(tmp_path):
    near = (0.1, 0.2, 0.3, math.sqrt(1 - 0.14) * (1 + 3e-10))
    off = tuple(1.005 * x for x in turned(0.4))
    items = [pose("/wrist", 0.0, at(0, near)), pose("/wrist", 0.1, at(0, off))]
    frames, _ = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert tuple(frames[0].roots[0, 3:]) == near
    np.testing.assert_allclose(frames[1].roots[0, 3:], turned(0.4), atol=1e-15)


@pytest.mark.parametrize("late", [0.05, 0.9])
def test_messages_up_to_a_second_late_are_put_in_their_place(tmp_path, late):
    ordered = []
    for k in range(400):
        ordered += [pose("/wrist", k / 100, at(k)), joints("/glove", k / 100, {"a": k, "b": 0.0})]
    delayed = [m.log_time + (round(late * S) if m.log_time // 10**7 % 7 == 0 else 0) for m in ordered]
    shuffled = [replace(m, stamp=m.log_time, log_time=t) for t, m in zip(delayed, ordered, strict=True)]
    (tmp_path / "x").mkdir()
    expected, _ = frames_of(tmp_path / "x", make_world(HAND), ordered)
    frames, source = frames_of(tmp_path, make_world(HAND), shuffled)
    assert [(f.time_ns, tuple(f.roots[0]), tuple(f.angles), f.held) for f in frames] == [
        (f.time_ns, tuple(f.roots[0]), tuple(f.angles), f.held) for f in expected
    ]
    assert source.report.late == 0
    assert source.report.out_of_order > 50


def test_a_log_may_be_written_topic_by_topic(tmp_path):
    wrist = [pose("/wrist", k / 100, at(k)) for k in range(1000)]
    glove = [joints("/glove", k / 100, {"a": k, "b": 0.0}) for k in range(1000)]
    for chunk_size in (1000, 10**6):
        write_log(tmp_path / "log.mcap", wrist + glove, chunk_size=chunk_size)
        with FrameSource(tmp_path / "log.mcap", make_world(HAND), Config()) as source:
            assert [(f.roots[0, 0], f.angles[0], f.held) for f in source] == [(k, k, False) for k in range(1000)]


def test_a_message_that_comes_too_late_is_counted_and_gives_no_frame(tmp_path):
    items = [pose("/wrist", k / 100, at(k)) for k in range(500) if k != 50]
    items.insert(400, pose("/wrist", 4.005, at(50), stamp=S // 2))
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert len(frames) == 499
    assert (source.report.late, source.report.lost_frames) == (1, 1)
    assert any("late" in w for w in source.report.warnings)


def test_what_comes_too_late_is_at_least_held_from_then_on(tmp_path):
    items = [pose("/wrist", k / 100, at(k)) for k in range(800)]
    items += [joints("/glove", 0.0, {"a": 0.0, "b": 0.0}), joints("/glove", 5.5, {"a": 3.0, "b": 1.0}, stamp=3 * S)]
    items += [joints("/glove", 6.0, {"a": 2.0}, stamp=2 * S)]
    tracker = pose("/late", 0.0, at(0)), pose("/late", 5.5, at(3), stamp=3 * S), pose("/late", 6.0, at(2), stamp=2 * S)
    world = make_world(HAND, Tree(name="mug", root="/late", avatar=False))
    frames, source = frames_of(tmp_path, world, sorted([*items, *tracker], key=lambda m: m.log_time))
    assert source.report.late == 4
    values = [(f.roots[1, 0], *f.angles) for f in frames]
    assert values == sorted(values)
    assert set(values) == {(0.0, 0.0, 0.0), (3.0, 3.0, 1.0)}
    assert values.index((3.0, 3.0, 1.0)) == pytest.approx(440, abs=3)


def test_of_samples_of_the_same_time_the_first_good_one_counts(tmp_path):
    items = []
    for k in range(5):
        items += [pose("/wrist", k / 10, at(math.nan if k == 2 else k)), pose("/wrist", k / 10, at(100 + k))]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert [f.roots[0, 0] for f in frames] == [0, 1, 102, 3, 4]
    assert not any(f.held for f in frames)
    assert source.report.duplicates == 5


def test_a_corrupt_time_far_ahead_costs_no_other_frame(tmp_path):
    items = [pose("/wrist", k / 100, at(k)) for k in range(300)]
    items.insert(20, pose("/wrist", 0.205, at(0.5), stamp=10**18))
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert [f.time_ns for f in frames] == [k * 10**7 for k in range(300)] + [10**18]
    assert source.report.late == 0


def test_clocks_that_do_not_count_from_1970_are_fine(tmp_path):
    items = [pose("/wrist", k / 100, at(k), stamp=k * 10**7) for k in range(10)]
    for item in items:
        item.log_time += 1_700_000_000 * S
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert [f.time_ns for f in frames] == [k * 10**7 for k in range(10)]
    assert source.report.warnings == ()


@pytest.mark.parametrize(("time", "first"), [("header", 1), ("log", 2), ("publish", 3)])
def test_the_time_of_a_message_is_the_one_asked_for(tmp_path, time, first):
    items = [pose("/wrist", 2 + k, at(k), stamp=(1 + k) * S, publish_time=(3 + k) * S) for k in range(3)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items, time=time)
    assert [f.time_ns for f in frames] == [(first + k) * S for k in range(3)]
    assert source.report.warnings == ()


def test_stamps_of_zero_are_no_times_unless_the_clock_counts_from_zero(tmp_path):
    unset = [pose("/wrist", 1000 + k / 10, at(k), stamp=0) for k in range(5)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), unset)
    assert [f.time_ns for f in frames] == [m.log_time for m in unset]
    assert [w for w in source.report.warnings if "/wrist" in w and "log times" in w] == list(source.report.warnings)
    late_start = [pose("/wrist", 1000 + k / 10, at(k), stamp=0 if k < 2 else None) for k in range(5)]
    frames, _ = frames_of(tmp_path, make_world(Tree(root="/wrist")), late_start)
    assert [f.time_ns for f in frames] == [m.log_time for m in late_start]


def test_topics_of_different_clocks_are_an_error_that_names_both(tmp_path):
    items = [pose("/wrist", 10**9 + k / 10, at(k), stamp=k * 10**8) for k in range(5)]
    items += [joints("/glove", 10**9 + k / 10, {"a": 0.0, "b": 0.0}) for k in range(5)]
    with pytest.raises(LogError, match=r"/glove.*/wrist.*different clocks.*--time log"):
        frames_of(tmp_path, make_world(HAND), items)
    assert len(frames_of(tmp_path, make_world(HAND), items, time="log")[0]) == 5


def test_log_times_that_were_not_set_do_no_harm(tmp_path):
    items = []
    for k in range(500):
        items.append(pose("/wrist", 10**9 + k / 100, at(k)))
        items.append(joints("/glove", 0.0, {"a": k, "b": 0.0}, stamp=items[-1].log_time))
    frames, source = frames_of(tmp_path, make_world(HAND), items)
    assert [(f.roots[0, 0], f.angles[0], f.held) for f in frames] == [(k, k, False) for k in range(500)]
    assert source.report.late == 0


# --- the frame clock


def test_the_clock_is_the_first_avatars_root_then_its_joints_then_the_first_objects_topic(tmp_path):
    first, second = Tree(name="l", root="/l", topic="/lj", joints=("a",)), Tree(name="r", root="/r")
    mug = Tree(name="mug", root="/mug", avatar=False)
    items = []
    for topic, count in (("/l", 5), ("/r", 7), ("/mug", 9)):
        items += [pose(topic, k / count, at(k)) for k in range(count)]
    items += [joints("/lj", k / 6, {"a": 0.0}) for k in range(6)]
    assert len(frames_of(tmp_path, make_world(first, second, mug), items)[0]) == 5
    rootless = Tree(name="l", topic="/lj", joints=("a",))
    assert len(frames_of(tmp_path, make_world(rootless, second, mug), items)[0]) == 6
    assert len(frames_of(tmp_path, make_world(mug), items)[0]) == 9
    assert len(frames_of(tmp_path, make_world(first, second, mug), items, clock="/r")[0]) == 7


def test_any_topic_can_be_the_clock_even_one_that_is_not_understood(tmp_path):
    items = [pose("/wrist", k / 10, at(k)) for k in range(11)]
    items += [Item("/camera", "raw", b"\0\1\0\0", k * S // 4) for k in range(5)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items, clock="/camera")
    assert [f.time_ns for f in frames] == [k * S // 4 for k in range(5)]
    np.testing.assert_allclose([f.roots[0, 0] for f in frames], [0, 2.5, 5, 7.5, 10], atol=1e-12)
    assert any("/camera" in w and "log times" in w for w in source.report.warnings)


def test_a_rate_gives_frames_from_the_first_to_the_last_time_of_the_clock(tmp_path):
    items = [pose("/wrist", 5 + k / 7, at(k / 7)) for k in range(15)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items, rate=30.0, max_gap=0.2)
    first, last = items[0].log_time, items[-1].log_time
    assert [f.time_ns for f in frames] == [first + round(k * S / 30) for k in range(61)]
    assert frames[-1].time_ns <= last
    np.testing.assert_allclose([f.roots[0, 0] for f in frames], [(f.time_ns - first) / S for f in frames], atol=1e-8)
    assert source.expected_frames == 61


def test_a_rate_over_a_corrupt_time_is_an_error_not_an_endless_run(tmp_path):
    items = [pose("/wrist", k / 10, at(0)) for k in range(10)] + [pose("/wrist", 1.0, at(0), stamp=10**18)]
    with pytest.raises(LogError, match="jumps"):
        frames_of(tmp_path, make_world(Tree(root="/wrist")), items, rate=60.0)


def test_a_scene_without_topics_needs_a_rate_or_a_clock(tmp_path):
    world = make_world(Tree(name="ball", avatar=False))
    items = [pose("/wrist", 3 + k / 10, at(k)) for k in range(11)]
    with pytest.raises(LogError, match=r"--rate HZ.*--clock TOPIC"):
        frames_of(tmp_path, world, items)
    assert [f.time_ns for f in frames_of(tmp_path, world, items, clock="/wrist")[0]] == [m.log_time for m in items]
    frames, _ = frames_of(tmp_path, world, items, rate=4.0)
    assert [f.time_ns for f in frames] == [3 * S + k * S // 4 for k in range(5)]


def test_start_and_end_are_seconds_since_the_first_frame(tmp_path):
    items = [pose("/wrist", 100 + k / 10, at(k)) for k in range(100)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items, start=2.0, end=3.0)
    assert [f.roots[0, 0] for f in frames] == list(range(20, 31))
    assert abs(source.expected_frames - 11) <= 1
    frames, _ = frames_of(tmp_path, make_world(Tree(root="/wrist")), items, start=1000.0)
    assert frames == []


def test_a_source_can_be_run_through_twice(tmp_path):
    items = [pose("/wrist", k / 10, at(k)) for k in range(10)]
    write_log(tmp_path / "log.mcap", items)
    with FrameSource(tmp_path / "log.mcap", make_world(Tree(root="/wrist")), Config()) as source:
        assert source.report.frames == 0
        assert [f.time_ns for f in source] == [f.time_ns for f in source]
        assert source.report.frames == 10
        assert source.topics == ("/wrist",)


# --- what feeds what


def test_trees_without_a_source_stand_still(tmp_path):
    rest = (1.0, 2.0, 3.0, *turned(0.5))
    world = make_world(Tree(root="/wrist"), Tree(name="table", avatar=False, rest=rest))
    frames, _ = frames_of(tmp_path, world, [pose("/wrist", 0.0, at(1)), pose("/wrist", 0.1, at(2))])
    assert all(tuple(f.roots[1]) == rest for f in frames)


def test_the_offset_is_the_roots_pose_in_the_trackers_frame(tmp_path):
    offset = (0.1, -0.2, 0.3, *turned(0.7, axis=0))
    tracked = (1.0, 2.0, 3.0, *turned(-1.1, axis=1))
    world = make_world(Tree(root="/wrist", offset=offset))
    frames, _ = frames_of(tmp_path, world, [pose("/wrist", 0.0, tracked), pose("/wrist", 0.1, tracked)])
    from scipy.spatial.transform import Rotation

    a, b = Rotation.from_quat(tracked[3:]), Rotation.from_quat(offset[3:])
    np.testing.assert_allclose(frames[0].roots[0, :3], tracked[:3] + a.apply(offset[:3]), atol=1e-15)
    np.testing.assert_allclose(frames[0].roots[0, 3:], (a * b).as_quat(), atol=1e-15)


def test_joints_are_matched_by_name_and_renamed(tmp_path):
    world = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b"), rename={"x": "a"}))
    items = [pose("/wrist", k / 10, at(k)) for k in range(4)]
    items += [joints("/glove", k / 10, {"b": 2.0, "zz": 9.0, "x": 1.0, "a": 7.0}) for k in range(4)]
    frames, source = frames_of(tmp_path, world, items)
    assert all(tuple(f.angles) == (1.0, 2.0) for f in frames)
    assert [u.name for u in source.report.unmatched_recorded] == ["a", "zz"]


def test_of_a_name_that_comes_twice_in_a_message_the_first_counts(tmp_path):
    items = [joints("/glove", k / 10, {"a": 1.0 + k, "x": 2.0}) for k in range(3)]
    path = write_log(
        tmp_path / "log.mcap", items, encoding="json-ros", compression=CompressionType.NONE, enable_crcs=False
    )
    path.write_bytes(path.read_bytes().replace(b'"name": ["a", "x"]', b'"name": ["a", "a"]'))
    with FrameSource(path, make_world(Tree(topic="/glove", joints=("a",))), Config()) as source:
        assert [f.angles[0] for f in source] == [1.0, 2.0, 3.0]


def test_channels_of_another_kind_on_a_topic_are_warned_of(tmp_path):
    items = [pose("/wrist", k / 10, at(k)) for k in range(3)] + [Item("/wrist", "raw", b"\0\1\0\0", 5)]
    frames, source = frames_of(tmp_path, make_world(Tree(root="/wrist")), items)
    assert len(frames) == 3
    assert source.report.warnings == (
        "topic /wrist: 1 messages (some/msg/Image, cdr) of another kind than the rest are not used",
    )


def test_unmatched_names_are_listed_on_both_sides_with_suggestions(tmp_path):
    world = make_world(Tree(topic="/glove", joints=("index_mcp", "thumb_ip", "wrist"), mimics=("index_dip",)))
    values = {"index_mpc": 1.0, "thumb_ip": 2.0, "index_dip": 3.0, "unknown": 4.0}
    frames, source = frames_of(tmp_path, world, [joints("/glove", k / 10, values) for k in range(4)])
    report = source.report
    assert [(u.name, u.suggestion) for u in report.unmatched_recorded] == [("index_mpc", "index_mcp"), ("unknown", "")]
    assert [(u.name, u.suggestion) for u in report.unmatched_joints] == [("index_mcp", "index_mpc"), ("wrist", "")]
    assert report.ignored_mimics == ("index_dip",)
    assert all(tuple(f.angles) == (0, 2, 0) for f in frames)
    assert not any(f.held for f in frames)


def test_two_hands_can_share_a_joint_topic(tmp_path):
    left, right = (Tree(name=n, topic="/glove", joints=(f"{n}_a", f"{n}_b")) for n in "lr")
    values = {"r_b": 4.0, "l_a": 1.0, "r_a": 3.0, "l_b": 2.0}
    frames, source = frames_of(tmp_path, make_world(left, right), [joints("/glove", k / 10, values) for k in range(3)])
    assert all(tuple(f.angles) == (1, 2, 3, 4) for f in frames)
    assert source.report.unmatched_recorded == ()


def test_degrees_are_converted_but_not_of_prismatic_joints(tmp_path):
    tree = Tree(topic="/glove", joints=("a", "slide"), unit="deg", kinds={"slide": JOINT_PRISMATIC})
    frames, _ = frames_of(
        tmp_path, make_world(tree), [joints("/glove", k / 10, {"a": 90.0, "slide": 0.5}) for k in range(3)]
    )
    assert all(tuple(f.angles) == (math.pi / 2, 0.5) for f in frames)


def test_angles_that_look_like_degrees_are_warned_of(tmp_path):
    items = [joints("/glove", k / 10, {"a": 45.0, "b": 0.1}) for k in range(3)]
    _, source = frames_of(tmp_path, make_world(Tree(topic="/glove", joints=("a", "b"))), items)
    assert any("degrees" in w and "/glove" in w for w in source.report.warnings)
    _, source = frames_of(tmp_path, make_world(Tree(topic="/glove", joints=("a", "b"), unit="deg")), items)
    assert source.report.warnings == ()


def test_angles_in_degrees_that_look_like_radians_are_warned_of(tmp_path):
    items = [joints("/glove", k / 10, {"a": 0.5 * k}) for k in range(3)]
    _, source = frames_of(tmp_path, make_world(Tree(topic="/glove", joints=("a",), unit="deg")), items)
    assert any("radians" in w and "/glove" in w for w in source.report.warnings)


def test_angles_outside_their_limits_are_kept_and_counted_or_clamped(tmp_path):
    world = make_world(Tree(topic="/glove", joints=("a", "b"), limits=(-0.5, 1.0)))
    items = [joints("/glove", k / 10, {"a": 0.3 * k, "b": -0.2}) for k in range(6)]
    frames, source = frames_of(tmp_path, world, items)
    assert [f.angles[0] for f in frames] == [0.3 * k for k in range(6)]
    assert [f.flags for f in frames] == [0] * 4 + [FLAG_OUTSIDE_LIMITS] * 2
    (outside,) = source.report.outside_limits
    assert (outside.joint, outside.frames, outside.amount) == ("a", 2, pytest.approx(0.5))
    frames, source = frames_of(tmp_path, world, items, clamp_limits=True)
    assert [f.angles[0] for f in frames] == [0.0, 0.3, 0.6, 0.3 * 3, 1.0, 1.0]
    assert [f.flags for f in frames] == [0] * 4 + [FLAG_CLAMPED] * 2
    assert source.report.outside_limits[0].clamped


# --- errors


def test_a_missing_topic_is_named_with_those_that_are_there(tmp_path):
    items = [pose("/wrist", 0.0, at(0)), joints("/glove", 0.0, {"a": 0.0})]
    with pytest.raises(LogError, match=r"log\.mcap.*'/wirst'.*did you mean '/wrist'.*it has /glove, /wrist"):
        frames_of(tmp_path, make_world(Tree(root="/wirst")), items)


@pytest.mark.parametrize(
    ("tree", "pattern"),
    [
        (Tree(root="/glove"), r"/glove.*does not hold a pose"),
        (Tree(topic="/wrist", joints=("a",)), r"/wrist.*does not hold joint values"),
        (Tree(root="/camera"), r"/camera.*some/msg/Image.*not understood"),
        (Tree(root="/tf"), r"/tf.*CHILD_FRAME"),
        (Tree(root="/tf#hnad"), r"no pose of the frame 'hnad' \(did you mean 'hand'\?\); it has hand"),
        (Tree(root="/wrist#hand"), r"single pose"),
        (Tree(root="/nan"), r"/nan.*no good pose"),
        (Tree(topic="/glove", joints=("x", "y")), r"none of the joints x, y; it has a"),
        (Tree(topic="/glove#left", joints=("a",)), r"no sides"),
    ],
)
def test_topics_that_cannot_serve_are_named(tmp_path, tree, pattern):
    items = []
    for k in range(3):
        items += [pose("/wrist", k, at(0)), joints("/glove", k, {"a": 0.0}), pose("/nan", k, at(math.nan))]
        items += [transforms("/tf", k, {"hand": at(0)}), Item("/camera", "raw", b"\0\1\0\0", k * S)]
    with pytest.raises(LogError, match=pattern):
        frames_of(tmp_path, make_world(tree), items)
