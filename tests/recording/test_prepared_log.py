"""A log opened for a scene: the topics it uses, which joints are lengths, and the first thing wrong as the error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.prepared_log import PreparedLog, prismatic_columns
from geomphys.scene.arrays import JOINT_PRISMATIC
from geomphys.scene.world import World
from tests.recording.log_files import IDENTITY, Tree, joints, make_world, pose, transforms, write_log


def world(root: str = "/wrist") -> World:
    return make_world(
        Tree(root=root, topic="/glove", joints=("a", "slide", "b"), kinds={"slide": JOINT_PRISMATIC}),
    )


def log(folder: Path, frame: str = "world", good: bool = True) -> Path:
    items = []
    for k in range(20):
        t = 1 + k / 30
        items.append(transforms("/tf", t, {"camera": (0.01 * k, *IDENTITY[1:])}))
        items.append(pose("/wrist", t, (0.01 * k if good else np.nan, *IDENTITY[1:]), frame=frame))
        items.append(joints("/glove", t, {"a": 0.01 * k, "slide": 0.1, "b": 0.2}))
        items.append(joints("/other", t, {"c": 0.0}))
    return write_log(folder / "log.mcap", items)


def test_lengths_are_the_prismatic_joints() -> None:
    assert prismatic_columns(world()).tolist() == [False, True, False]


def test_a_joint_that_follows_another_does_not_say_what_its_column_is() -> None:
    """A prismatic joint of a column that a revolute one is recorded for."""
    made = world()
    bodies = made.scene.bodies
    bodies.dof[2], bodies.multiplier[2] = 0, 0.01  # the slide follows a
    assert prismatic_columns(made).tolist() == [False, False, False]
    bodies.multiplier[1] = 2.0  # both follow: the first of them
    assert prismatic_columns(made).tolist() == [False, False, False]


@pytest.mark.parametrize(
    ("frame", "topics"), [("world", ("/glove", "/wrist")), ("camera", ("/glove", "/tf", "/wrist"))]
)
def test_topics_are_those_of_the_inputs_and_of_transforms_that_are_needed(
    tmp_path: Path, frame: str, topics: tuple[str, ...]
) -> None:
    prepared = PreparedLog(log(tmp_path, frame), world(), Config())
    assert prepared.topics == topics
    prepared.reader.close()


def test_the_first_problem_is_the_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="'/hand' for the root of 'hand' is not in the log"):
        PreparedLog(log(tmp_path), world("/hand"), Config())
    with pytest.raises(LogError, match="no good pose"):
        PreparedLog(log(tmp_path, good=False), world(), Config())
