"""Which frame is the recorded space, and by which transforms a pose gets there: found in small logs of two arms."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.errors import LogError
from geomphys.recording.input_plan import make_plan
from geomphys.recording.message_times import MessageTimes
from geomphys.recording.reader import open_log
from geomphys.recording.stream_prescan import prescan_streams
from geomphys.recording.transform_plan import TransformPlan, plan_transforms
from tests.recording.log_files import IDENTITY, Item, Tree, make_world, pose, transforms, write_log

CHAIN = {"base": "room", "camera": "base"}  # child -> parent


def plan(
    folder: Path, frame: str, edges: dict[str, str], spaces: tuple[str, ...] = (), static: bool = False
) -> TransformPlan:
    """The plan for a wrist given in a frame, in a log with these transforms."""
    items: list[Item] = []
    for k in range(20):
        t = 1 + k / 30
        for child, parent in edges.items():
            topic = "/tf_static" if static else "/tf"
            items.append(transforms(topic, t, {child: (0.01 * k, *IDENTITY[1:])}, frame=parent))
        items.append(pose("/wrist", t, (0.01 * k, *IDENTITY[1:]), frame=frame))
    config, world = Config(), make_world(Tree(root="/wrist"))
    with open_log(write_log(folder / "log.mcap", items)) as reader:
        inputs = make_plan(reader, world, config)
        prescan = prescan_streams(reader, inputs, config, MessageTimes("header", reader.channels, reader.path))
        return plan_transforms(reader, inputs, prescan, spaces)


def steps(found: TransformPlan, frame: str) -> list[tuple[str, str, bool]]:
    return [(*step.edge, step.inverse) for step in found.steps("/wrist", frame)]


def test_the_space_is_the_root_of_the_tree_and_the_path_goes_up_to_it(tmp_path: Path) -> None:
    found = plan(tmp_path, "camera", CHAIN)
    assert found.spaces == ("room",)
    assert steps(found, "camera") == [("base", "camera", False), ("room", "base", False)]
    assert len(found.edges) == 2
    (use,) = found.uses
    assert (use.frame, use.space, use.through, use.moving) == ("camera", "room", ("/tf",), True)


def test_a_leading_slash_does_not_count(tmp_path: Path) -> None:
    found = plan(tmp_path, "/camera", CHAIN)
    assert steps(found, "/camera") == steps(found, "camera") != []


def test_a_space_that_the_scene_names_may_be_below(tmp_path: Path) -> None:
    """Then the path goes down in part, by inverse transforms."""
    edges = CHAIN | {"marker": "room"}
    found = plan(tmp_path, "camera", edges, ("marker",))
    assert steps(found, "camera") == [("base", "camera", False), ("room", "base", False), ("room", "marker", True)]


def test_of_several_spaces_the_nearest_is_taken(tmp_path: Path) -> None:
    assert steps(plan(tmp_path, "camera", CHAIN, ("room", "base")), "camera") == [("base", "camera", False)]
    assert steps(plan(tmp_path, "camera", CHAIN, ("camera", "room")), "camera") == []


def test_static_transforms_do_not_move(tmp_path: Path) -> None:
    (use,) = plan(tmp_path, "camera", CHAIN, static=True).uses
    assert not use.moving
    assert use.through == ("/tf_static",)


def test_without_transforms_the_first_frame_is_the_space(tmp_path: Path) -> None:
    found = plan(tmp_path, "camera", {})
    assert found.spaces == ("camera",)
    assert found.uses == ()
    assert plan(tmp_path, "", {}).spaces == ()


def test_what_leads_nowhere_is_an_error_that_names_both(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"gives poses in 'camera'.*and nothing in the log leads"):
        plan(tmp_path, "camera", {"tool": "arm"}, ("room",))
    with pytest.raises(LogError, match="did you mean"):
        plan(tmp_path, "rooms", {"tool": "arm"}, ("room",))
