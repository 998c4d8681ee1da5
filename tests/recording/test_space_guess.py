"""Which axis is up in a log and in which unit it is: no false alarm on any recording, its twins are noticed."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest

from geomphys.recording.channels import JointSample, kind_of, make_message_reader
from geomphys.recording.reader import open_log
from geomphys.recording.space_guess import SAMPLES, MotionSamples, guess_space

UNITS = {"m": 1.0, "cm": 100.0, "mm": 1000.0}


def read_paths(log):
    """Topic and frame -> times and positions of a log; names of its topics."""
    paths = {}
    with open_log(log) as reader:
        reading = {
            k: make_message_reader(c, kind) for k, c in reader.channels.items() if (kind := kind_of(c)) is not None
        }
        for raw in reader.read(set(reading)):
            content = reading[raw.key](raw.data)
            for pose in () if isinstance(content, JointSample) else content:
                key = reader.channels[raw.key].topic, pose.child
                paths.setdefault(key, []).append((raw.log_time, *pose.value[:3]))
        return paths, [c.topic for c in reader.channels.values()]


def guess(paths, names, up="z", unit="m"):
    """The guess for a twin of a log, recorded with another axis up or in another unit."""
    motions, n = [], UNITS[unit]
    for path in paths.values():
        samples = MotionSamples()
        for time, x, y, z in path:
            samples.add(time, *((n * x, n * z, -n * y) if up == "y" else (n * x, n * y, n * z)))
        motions.append(samples.motion())
    return guess_space(motions, names)


def counts(logs):
    """How often a twin is noticed, by what it is: and for sure, and wrongly for sure."""
    found = Counter()
    for log in logs:
        paths, names = read_paths(log)
        for up in ("z", "y"):
            for unit in UNITS:
                space = guess(paths, names, up, unit)
                found[up, unit, "up"] += space.up == up
                found[up, unit, "unit"] += (space.unit != "m") == (unit != "m")
                found[up, unit, "wrong"] += (space.is_up_certain and space.up == "y" != up) or (
                    space.is_unit_certain and space.unit not in ("m", unit)
                )
    return found


@pytest.fixture(scope="module")
def shared_counts(shared_dir):
    return counts(sorted((shared_dir / "recordings").glob("*.mcap")))


def test_no_false_alarm_on_real_recordings_and_most_twins_are_noticed(shared_counts):
    total = 24
    assert shared_counts["z", "m", "up"] == shared_counts["z", "m", "unit"] == total
    assert shared_counts["z", "mm", "unit"] == shared_counts["y", "mm", "unit"] == total
    assert shared_counts["y", "m", "up"] >= 20
    assert shared_counts["z", "cm", "unit"] >= 21
    assert all(shared_counts[up, unit, "wrong"] == 0 for up in "zy" for unit in ("m", "mm"))


def test_no_false_alarm_on_our_recordings(root):
    with_y_up = ("robot_glove", "webxr_hand")
    logs = [p for p in sorted((root / "recordings").glob("*.mcap")) if p.stem not in with_y_up]
    found = counts(logs)
    assert found["z", "m", "up"] == found["z", "m", "unit"] == len(logs)
    assert found["z", "mm", "unit"] >= len(logs) - 1
    for name in with_y_up:
        paths, names = read_paths(root / "recordings" / f"{name}.mcap")
        assert guess(paths, names)[:3:2] == ("y", True), name


def walk(*, low=(-1, -1, 0.8), high=(1, 1, 1.2), seconds=10.0, speed=1.0):
    rng = np.random.default_rng(3)
    place, path = np.mean((low, high), axis=0), []
    for k in range(round(seconds * 60)):
        place = np.clip(place + rng.normal(0, speed / 60, 3), low, high)
        path.append((k * 10**9 // 60, *place))
    return path


def test_a_single_outlier_is_no_millimetre():
    path = walk()
    path[100] = (path[100][0], 1e6, 0.0, 0.0)
    assert guess({"a": path}, []).unit == "m"


def test_walking_far_is_no_centimetre():
    path = [(k * 10**9 // 60, 1.4 * k / 60, 30.0, 1.0) for k in range(6000)]
    assert guess({"a": path}, []).unit == "m"


def test_a_table_frame_in_which_the_hand_dips_below_zero_is_z_up():
    random = np.random.default_rng(11)
    for least in (-0.3, 0.1):
        places = random.uniform((-0.3, least, -0.04), (0.3, 0.5, 0.3), (600, 3))
        path = [(k * 10**9, *p) for k, p in enumerate(places)]
        assert guess({"a": path}, ["/optitrack/hand"]).up == "z"


def test_the_name_of_a_system_makes_a_suggestion_sure():
    path = walk(low=(-0.3, 0.1, -0.3), high=(0.3, 0.5, 0.3))
    alone, named = guess({"a": path}, ["/tracker"]), guess({"a": path}, ["/openxr/hand"])
    assert (alone.up, alone.is_up_certain, named.up, named.is_up_certain) == ("y", False, "y", True)


def test_nothing_is_said_of_nothing():
    assert guess_space([], []).up_reason == guess({"a": [(0, 0.0, 0.0, 0.0)] * 3}, []).unit_reason == ""


def test_memory_is_bounded_and_the_samples_are_even():
    samples = MotionSamples()
    for k in range(100_000):
        samples.add(k * 10**7, math.sin(k / 1000), 0.0, 1.0)
    times = [time for time, _ in samples.samples.items]
    assert len(times) < SAMPLES
    steps = np.diff(times)
    assert steps.min() == steps[:-1].max()
    assert times[-1] > 0.98e5 * 10**7
    motion = samples.motion()
    assert (motion.low[0], motion.high[0]) == pytest.approx((-1, 1), abs=0.01)
