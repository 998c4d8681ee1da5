"""What becomes of recorded joint values: sign, scale and offset; names that are left out; times that are shifted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.recording.frames import FrameSource
from geomphys.scene.arrays import JOINT_PRISMATIC
from tests.recording.log_files import S, Tree, joints, make_world, pose, write_log

HAND = Tree(root="/wrist", topic="/glove", joints=("a", "b", "slide"), kinds={"slide": JOINT_PRISMATIC})


def world_of(tree=HAND, *more, root_delay=0.0, **source):
    world = make_world(tree, *more)
    roots = tuple(replace(r, delay=root_delay if r.tree == 0 else 0.0) for r in world.roots)
    return replace(world, roots=roots, joints=tuple(replace(j, **source) for j in world.joints))


def play(tmp_path, items, world, **config):
    log = write_log(tmp_path / "log.mcap", sorted(items, key=lambda item: item.log_time))
    with FrameSource(log, world, Config(**config)) as source:
        return list(source), source.report


def at(x):
    return (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def recording(count=40, names=("a", "b", "slide"), rate=50):
    items = [pose("/wrist", k / rate, at(k / rate)) for k in range(count)]
    return items + [joints("/glove", k / rate, {n: (k + i) / 100 for i, n in enumerate(names)}) for k in range(count)]


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_value_is_sign_times_scale_times_recorded_in_radians_plus_offset(tmp_path, unit):
    world = world_of(replace(HAND, unit=unit), factors={"a": -2.0, "slide": 0.5}, offsets={"a": 0.1, "b": -0.2})
    frames, _ = play(tmp_path, recording(), world)
    unit_rad = np.pi / 180 if unit == "deg" else 1.0
    for k, frame in enumerate(frames):
        expected = [-0.02 * unit_rad * k + 0.1, 0.01 * unit_rad * (k + 1) - 0.2, 0.005 * (k + 2)]  # a slide is in m
        np.testing.assert_allclose(frame.angles, expected, rtol=1e-15, atol=1e-16)


def test_a_joint_recorded_once_is_taken_by_the_same_rule(tmp_path):
    world = world_of(factors={"a": -1.0}, offsets={"a": 0.25})
    items = [pose("/wrist", k / 50, at(k)) for k in range(10)] + [joints("/glove", 0.0, {"a": 0.5, "b": 1.0})]
    frames, _ = play(tmp_path, items, world)
    assert all(tuple(f.angles[:2]) == (-0.25, 1.0) for f in frames)


def test_what_has_no_factor_and_no_offset_stays_to_the_bit(tmp_path):
    items = [pose("/wrist", k / 50, at(k)) for k in range(10)]
    items += [joints("/glove", k / 50, {"a": -0.0, "b": 0.1 * k, "slide": -0.0}) for k in range(10)]
    frames, _ = play(tmp_path, items, world_of(offsets={"b": 1.0}))
    assert all(np.signbit(f.angles[[0, 2]]).all() for f in frames)


def test_ignored_joints_feed_nothing_and_nobody_is_told(tmp_path):
    """Recorded ones that the model has and has not, and one of the model that is not recorded."""
    names = ("a", "b", "little_mcp", "little_pip")
    told, report = play(tmp_path, recording(names=names), world_of())
    assert {u.name for u in report.unmatched_recorded} == {"little_mcp", "little_pip"}
    assert {u.name for u in report.unmatched_joints} == {"slide"}
    frames, report = play(tmp_path, recording(names=names), world_of(ignore=("little_*", "b", "sl?de")))
    assert report.warnings == ()
    assert report.ignored == ("b", "little_mcp", "little_pip")
    assert (report.unmatched_recorded, report.unmatched_joints) == ((), ())
    assert [f.angles[0] for f in frames] == [f.angles[0] for f in told]
    assert all(f.angles[1] == 0.0 for f in frames)


def test_what_rename_speaks_of_is_not_ignored(tmp_path):
    items = recording(names=("x", "y", "z"))
    frames, report = play(tmp_path, items, world_of(replace(HAND, rename={"x": "a"}), ignore=("*",)))
    assert [f.angles[0] for f in frames] == [k / 100 for k in range(40)]
    assert report.ignored == ("y", "z")
    assert report.warnings == ()


def test_a_pattern_that_matches_nothing_is_told(tmp_path):
    _, report = play(tmp_path, recording(), world_of(ignore=("litle_*",)))
    assert report.warnings == ("topic /glove: `ignore` has litle_*, which no joint is called",)


@pytest.mark.parametrize("delay", [0.06, -0.06, 0.5, -0.5, 2.0, -2.0])
def test_a_delay_is_added_to_the_times_of_joints(tmp_path, delay):
    """The value recorded at t counts at t + delay."""
    world = world_of(delay=delay)
    items = [pose("/wrist", k / 50, at(k)) for k in range(300)]
    items += [joints("/glove", k / 50, {"a": k / 50, "b": 0.0, "slide": 0.0}) for k in range(300)]
    frames, _ = play(tmp_path, items, world)
    assert len(frames) == 300
    for frame in frames:
        t = frame.time_ns / S
        if not frame.held:
            assert frame.angles[0] == pytest.approx(t - delay, abs=1e-12)
        else:
            assert frame.angles[0] == (0.0 if t < delay else pytest.approx(299 / 50))
    assert sum(f.held for f in frames) == round(abs(delay) * 50)


def test_a_delay_of_the_clocks_topic_shifts_the_frames(tmp_path):
    frames, _ = play(tmp_path, recording(), world_of(root_delay=0.1))
    assert [f.time_ns for f in frames] == [round((k / 50 + 0.1) * S) for k in range(40)]
    assert [f.roots[0, 0] for f in frames] == [k / 50 for k in range(40)]
    assert [f.angles[0] for f in frames[:35]] == [(k + 5) / 100 for k in range(35)]


def test_a_delay_of_one_object_shifts_that_object_alone(tmp_path):
    mug = Tree(name="mug", root="/mug", avatar=False)
    world = make_world(HAND, mug)
    roots = tuple(replace(r, delay=0.04 * (r.topic == "/mug")) for r in world.roots)
    items = recording(60) + [pose("/mug", k / 50, at(k / 50)) for k in range(60)]
    frames, _ = play(tmp_path, items, replace(world, roots=roots))
    for frame in frames[2:]:
        assert frame.roots[0, 0] == frame.time_ns / S
        assert frame.roots[1, 0] == pytest.approx(frame.time_ns / S - 0.04, abs=1e-12)
