"""A link called as another frame of the output was refused after all meshes were cut: it gets a frame id of its own now."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.analysis.diff.compare import compare_outputs
from geomphys.output.output_log import open_output
from tests.cli.press import command_line
from tests.scene.models import ball, joint, urdf
from tests.zoo import Outcome, through_all


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    folder = tmp_path_factory.mktemp("world")
    return through_all(urdf(folder / "hand.urdf", ball("world"), ball("tip"), joint("j", "world", "tip")), folder)


def test_the_link_has_one_frame_id_wherever_frames_are_named(outcome: Outcome) -> None:
    output = open_output(outcome.out)
    frame = next(iter(output.frames()))
    assert "world" not in frame.tf.names
    assert {"hand/world", "tip"} <= set(frame.tf.names)
    assert {"recorded/hand/world", "recorded/tip"} <= set(frame.recorded.names)
    description = output.descriptions()["/robot_description"]
    assert '<link name="hand/world"' in description
    assert '<parent link="hand/world"' in description
    assert 'name="world"' not in description


def test_it_is_said_once_and_is_no_warning(outcome: Outcome) -> None:
    (renamed,) = outcome.check["findings"]["renamed_frames"]
    assert renamed == {"body": "hand/world", "link": "world", "frame": "hand/world"}
    assert outcome.check["warnings"] == []
    told = [message for message in outcome.replay["messages"] if "'hand/world'" in message["text"]]
    assert [(message["level"], message["count"]) for message in told] == [("info", 1)]


def test_a_comparison_knows_it(outcome: Outcome) -> None:
    assert compare_outputs(outcome.out, outcome.out).equal


def test_the_corrected_motion_is_that_of_the_link_by_another_name(outcome: Outcome, tmp_path: Path) -> None:
    model = urdf(tmp_path / "hand.urdf", ball("palm"), ball("tip"), joint("j", "palm", "tip"))
    plain = open_output(through_all(model, tmp_path).out)
    for one, other in zip(open_output(outcome.out).frames(["/tf"]), plain.frames(["/tf"]), strict=True):
        names = [name.replace("hand/world", "palm") for name in one.tf.names]
        assert names == list(other.tf.names)
        assert np.array_equal(one.tf.values, other.tf.values)


def test_the_shared_case(shared_dir: Path, tmp_path: Path) -> None:
    case, scene, out = shared_dir / "cases" / "root_link_world", tmp_path / "a.toml", tmp_path / "a.mcap"
    for words in (
        ("init", case / "ok.mcap", "--urdf", case / "hand.urdf", "-o", scene),
        ("check", case / "ok.mcap", "-s", scene),
        ("replay", case / "ok.mcap", "-s", scene, "-o", out, "--rrd", tmp_path / "a.rrd"),
        ("audit", out),
    ):
        done = command_line(*words)
        assert done.returncode == 0, done.stderr
        assert done.stdout.count("hand/world") == (words[0] in ("check", "replay"))
