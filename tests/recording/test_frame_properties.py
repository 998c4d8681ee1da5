"""Laws of the frames of a recording, for any stream of samples: in order, finite, within what was recorded, repeatable."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.frames import FrameSource
from geomphys.results import FLAG_HELD, Frame
from tests.recording.log_files import Item, Tree, joints, make_world, pose, turned, write_log

WORLD = make_world(Tree(root="/wrist", topic="/glove", joints=("a", "b")))
bounded = settings(max_examples=50, deadline=None, derandomize=True)

ns = st.integers(0, 3_000_000_000)
number = st.one_of(
    st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.sampled_from([math.nan, math.inf, 1e308, -0.0, 5e-324])
)
wrist = st.builds(
    lambda t, x, y, angle: pose("/wrist", t / 1e9, (x, y, 0.0, *turned(angle))),
    ns,
    number,
    number,
    st.floats(-3.0, 3.0),
)
glove = st.builds(
    lambda t, a, b: joints("/glove", t / 1e9, {k: v for k, v in (("a", a), ("b", b)) if v is not None}),
    ns, st.one_of(st.none(), number), st.one_of(st.none(), number),
)  # fmt: skip
streams = st.lists(st.one_of(wrist, glove), min_size=1, max_size=40)


def frames_of(items: list[Item], config: Config) -> list[Frame] | None:
    """The frames; None where the log is refused."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_log(Path(folder, "log.mcap"), items, encoding="json-ros")
        try:
            with FrameSource(path, WORLD, config) as source:
                frames = list(source)
                assert source.report.frames == len(frames)
                return frames
        except LogError:
            return None


def good(items: list[Item], topic: str) -> list[Item]:
    return [i for i in items if i.topic == topic and all(abs(v) < 1e9 for v in i.value)]


@bounded
@given(streams, st.sampled_from(["header", "log", "publish"]), st.sampled_from([None, 30.0]))
def test_frames_are_in_order_finite_and_repeatable(items: list[Item], time: str, rate: float | None) -> None:
    config = Config(time=time, rate=rate)
    frames, again = frames_of(items, config), frames_of(items, config)
    if frames is None:
        assert again is None
        return
    assert again is not None
    times = [frame.time_ns for frame in frames]
    assert times == sorted(set(times))
    assert [frame.index for frame in frames] == list(range(len(frames)))
    for one, other in zip(frames, again, strict=True):
        assert one.roots.tobytes() == other.roots.tobytes()
        assert one.angles.tobytes() == other.angles.tobytes()
        assert np.isfinite(one.roots).all()
        assert np.isfinite(one.angles).all()
        assert abs(np.linalg.norm(one.roots[0, 3:]) - 1.0) < 1e-9
        assert one.held == bool(one.flags & FLAG_HELD)


@bounded
@given(streams)
def test_a_frame_has_what_was_recorded_at_its_time_and_lies_within_the_recorded(items: list[Item]) -> None:
    frames = frames_of(items, Config())
    if frames is None:
        return
    samples = good(items, "/wrist")
    times = {item.log_time for item in items if item.topic == "/wrist"}
    assert {frame.time_ns for frame in frames} == times
    xs = [item.value[0] for item in samples]
    for frame in frames:
        here = [item.value[:2] for item in samples if item.log_time == frame.time_ns]
        if here:
            assert tuple(frame.roots[0, :2]) in here
        assert min(xs) - 1e-9 <= frame.roots[0, 0] <= max(xs) + 1e-9
    values = {
        k: [i.value[k] for i in items if i.topic == "/glove" and abs(i.value.get(k, math.nan)) < 1e9] for k in "ab"
    }
    for column, k in enumerate("ab"):
        if values[k]:
            assert all(min(values[k]) - 1e-9 <= f.angles[column] <= max(values[k]) + 1e-9 for f in frames)
        else:
            assert all(f.angles[column] == 0.0 for f in frames)


@bounded
@given(streams, st.randoms(use_true_random=False))
def test_the_order_in_the_file_and_repeated_messages_change_nothing(items: list[Item], chance) -> None:
    """Of messages within the second that one may come late, each of a time of its own."""
    unique = {(i.topic, i.log_time): i for i in items if i.log_time < 900_000_000}
    kept = [unique[key] for key in sorted(unique, key=lambda key: (key[1], key[0]))]
    if not any(i.topic == "/wrist" for i in kept):
        return
    mixed = [*kept, *chance.sample(kept, k=len(kept) // 3)]
    chance.shuffle(mixed)
    one, other = frames_of(kept, Config()), frames_of(mixed, Config())
    assert (one is None) == (other is None)
    if one is not None and other is not None:
        assert [f.time_ns for f in one] == [f.time_ns for f in other]
        assert all(a.roots.tobytes() == b.roots.tobytes() for a, b in zip(one, other, strict=True))
        assert all(a.angles.tobytes() == b.angles.tobytes() for a, b in zip(one, other, strict=True))
