"""Points of messages: a position is enough, an orientation is none unless something follows the pose as a pose."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import LogError
from geomphys.recording.point_reader import make_point_reader
from geomphys.recording.reader import open_log
from tests.recording.log_files import IDENTITY, joints, transforms, write_log

NO_ROTATION = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0)
GOOD = (0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8)
LOST = (math.nan, 0.2, 0.3, *IDENTITY[3:])


def read(folder: Path, values: dict[str, tuple[float, ...]], **options: object) -> dict[str, list[float]]:
    log = write_log(folder / "log.mcap", [transforms("/points", 1, values), joints("/glove", 1, {"a": 1.0})])
    with open_log(log) as reader:
        (channel,) = reader.of_topic("/points")
        points = make_point_reader(channel, **options)  # type: ignore[arg-type]
        (raw,) = reader.read({channel.key})
        return {pose.child: list(pose.value) for pose in points(raw.data)}


def test_a_point_without_an_orientation_has_none(tmp_path: Path) -> None:
    found = read(tmp_path, {"a": NO_ROTATION, "b": GOOD, "c": LOST})
    assert found["a"] == [0.1, 0.2, 0.3, *IDENTITY[3:]]
    assert found["b"] == list(GOOD)
    assert math.isnan(found["c"][0])


def test_a_pose_that_is_followed_as_one_stays_as_it_is(tmp_path: Path) -> None:
    found = read(tmp_path, {"a": NO_ROTATION, "b": NO_ROTATION}, whole=("b",))
    assert found["a"][3:] == list(IDENTITY[3:])
    assert found["b"] == list(NO_ROTATION)


def test_a_topic_without_points_is_refused(tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.mcap", [joints("/glove", 1, {"a": 1.0})])
    with open_log(log) as reader:
        (channel,) = reader.of_topic("/glove")
        with pytest.raises((LogError, AssertionError)):
            make_point_reader(channel)(next(iter(reader.read({channel.key}))).data)


def test_absurd_positions_are_no_points(tmp_path: Path) -> None:
    found = read(tmp_path, {"a": (1e300, 0, 0, 0, 0, 0, 0)})
    assert np.array_equal(found["a"][3:], [0, 0, 0, 0])
