"""The resampler against a plain reading of its rules, on made-up streams of every kind of trouble."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from geomphys.recording.clock import RateClock, TopicClock
from geomphys.recording.message_times import Watermark
from geomphys.recording.streams import JointStream, PoseStream, interpolate_poses, validated_pose

MS = 10**6
GAP = 10 * MS

# a sample: time [ms], value or NaN (bad) or None (missing)
times = st.integers(0, 60)
values = st.one_of(st.floats(-5, 5), st.just(math.nan), st.none())
samples = st.lists(st.tuples(times, values), min_size=1, max_size=12)
frame_times = st.lists(times, min_size=1, max_size=15, unique=True).map(sorted)


def plain(stream: list[tuple[int, float | None]], t: int) -> tuple[float, bool, bool]:
    """Value, held, before of a stream of scalars at t [ms], by the rules alone."""
    good: dict[int, float] = {}
    for when, value in stream:
        if value is not None and not math.isnan(value):
            good.setdefault(when, value)
    behind = [w for w in good if w <= t]
    ahead = [w for w in good if w > t]
    if not behind:
        return (good[min(ahead)] if ahead else math.nan), True, True
    a = max(behind)
    if a == t:
        return good[a], False, False
    if ahead and (min(ahead) - a) * MS <= GAP:
        b = min(ahead)
        return good[a] + (t - a) / (b - a) * (good[b] - good[a]), False, False
    return good[a], True, False


@settings(max_examples=300, deadline=None)
@given(st.lists(samples, min_size=1, max_size=3), frame_times)
@example([[(0, 1.0), (10, 2.0)], [(0, 1.0), (5, math.nan), (10, 3.0)]], [0, 5, 10, 11])
def test_joints_follow_the_rules_each_by_itself(streams, frames):
    joints = JointStream(len(streams), GAP)
    merged = sorted({t for s in streams for t, _ in s})
    for t in merged:
        firsts = [[v for w, v in s if w == t and v is not None] for s in streams]
        for k in range(max(len(f) for f in firsts)):
            given_values = [f[k] if k < len(f) else None for f in firsts]
            row = np.array([math.nan if v is None else v for v in given_values])
            bad = np.array([v is not None and math.isnan(v) for v in given_values])
            joints.add(t * MS, row, bad if bad.any() else None)
    for t in frames:
        expected = [plain(s, t) for s in streams]
        got = joints.at(t * MS)
        np.testing.assert_allclose(got.value, [e[0] for e in expected], atol=1e-12)
        assert got.held == any(e[1] for e in expected)
        assert got.before_first == any(e[2] for e in expected)


@settings(max_examples=200, deadline=None)
@given(samples, frame_times, st.randoms(use_true_random=False))
def test_the_order_of_arrival_does_not_matter(stream, frames, random):
    unique = list({t: (t, v) for t, v in reversed(stream) if v is not None}.values())
    shuffled = unique[:]
    random.shuffle(shuffled)
    results = []
    for order in (unique, shuffled):
        pose, joint = PoseStream(GAP), JointStream(1, GAP)
        for t, v in order:
            pose.add(t * MS, (v, 0, 0, 0, 0, 0, 1))
            joint.add(t * MS, np.array([v]), np.array([True]) if math.isnan(v) else None)
        results.append([(str(pose.at(t * MS)), str(joint.at(t * MS))) for t in frames])
    assert results[0] == results[1]


@settings(max_examples=200, deadline=None)
@given(samples, frame_times, st.integers(0, 60))
def test_samples_may_come_while_frames_are_asked_for(stream, frames, delay):
    """What arrives before the frames around it are made counts just as if it had been there from the beginning."""
    whole, live = PoseStream(GAP), PoseStream(GAP)
    rows = sorted((t, (math.nan if v is None else v, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)) for t, v in stream)
    for t, row in rows:
        whole.add(t * MS, row)
    waiting = list(rows)
    for t in frames:
        while waiting and waiting[0][0] <= t + 10 + delay:
            when, row = waiting.pop(0)
            live.add(when * MS, row)
        expected, got = whole.at(t * MS), live.at(t * MS)
        if not expected.before_first:
            assert str(got) == str(expected)


quaternions = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: sum(x * x for x in q) > 0.01)


@settings(max_examples=300, deadline=None)
@given(quaternions, quaternions, st.floats(0, 1))
@example([0, 0, 0, 1], [0, 0, 0, -1], 0.3)
@example([0, 0, 0, 1], [0, 0, 1e-9, 1], 0.7)
def test_rotations_are_blended_by_slerp(a, b, w):
    qa, qb = (tuple(x / math.hypot(*q) for x in q) for q in (a, b))
    out = interpolate_poses((0, 0, 0, *qa), (1, 2, 3, *qb), w)
    assert out[:3] == (w, 2 * w, 3 * w)
    assert abs(math.hypot(*out[3:]) - 1) < 1e-15
    turn = (Rotation.from_quat(qa).inv() * Rotation.from_quat(qb)).magnitude()
    if turn > math.pi - 1e-6:
        return  # both ways round are as short
    expected = Slerp([0, 1], Rotation.from_quat([qa, qb]))(w)
    assert (expected.inv() * Rotation.from_quat(out[3:])).magnitude() < 1e-12


def test_only_unit_quaternions_and_sane_lengths_are_good():
    unit = (1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)
    assert validated_pose(unit) is unit
    for k in range(7):
        for wrong in (math.nan, math.inf, -math.inf, 1e200):
            assert validated_pose((*unit[:k], wrong, *unit[k + 1 :])) is None
    assert validated_pose((0, 0, 0, 0, 0, 0, 0)) is None
    assert validated_pose((0, 0, 0, 0, 0, 0, 1.0101)) is None
    assert validated_pose((0, 0, 0, 0, 0, 0, 0.9899)) is None
    assert validated_pose((0, 0, 0, 0, 0, 0, -1.009)) == (0, 0, 0, 0, 0, 0, -1)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 50), min_size=1, max_size=40), st.integers(0, 20))
def test_a_topic_clock_gives_each_time_once_in_order_whatever_the_limits(beats, step):
    clock, given_times, lost = TopicClock(), [], set()
    for k, beat in enumerate(beats):
        if not clock.add(beat):
            lost.add(beat)
        given_times += clock.until(k * step // 8)
    given_times += clock.until(10**9)
    assert given_times == sorted(set(given_times))
    assert set(given_times) | lost == set(beats)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.integers(0, 10**10), min_size=1, max_size=20), st.floats(0.5, 200))
def test_a_rate_clock_gives_an_even_grid_over_the_clocks_span(beats, rate):
    clock = RateClock(rate)
    for beat in beats:
        clock.add(beat)
    first, last = min(beats), max(beats)
    got = [t for limit in (first, (first + last) // 2, last, 2 * 10**10) for t in clock.until(limit)]
    assert got == [first + round(k * 1e9 / rate) for k in range(len(got))]
    assert got[-1] <= last < first + round(len(got) * 1e9 / rate)


def test_the_watermark_follows_the_third_latest_time():
    mark = Watermark()
    seen = []
    for time in (5, 10**18, 6, 7, 8, 7, 9):
        mark.add(time)
        seen.append(mark.time)
    assert seen[2:] == [5, 6, 7, 7, 8]


def test_memory_does_not_grow_with_the_length_of_a_stream():
    pose, joints = PoseStream(GAP), JointStream(2, GAP)
    for k in range(20_000):
        pose.add(k * MS, (0, 0, 0, 0, 0, 0, 1))
        joints.add(k * MS, np.zeros(2))
        if k > 100:
            pose.at((k - 100) * MS)
            joints.at((k - 100) * MS)
        assert len(pose.times) <= 102
        assert len(joints.rows) <= 102
