"""Rotations as people write them: a quaternion of three digits was refused, and there was no other way to write one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.load import load_world
from geomphys.recording.check import check_log
from tests.recording.log_files import IDENTITY, pose, write_log

BOX = '[[object]]\nname = "mug"\nclass = "driven"\nbox = [0.1, 0.1, 0.1]\ntopic = "/mug"\n'
SHELF = '[[object]]\nname = "shelf"\nclass = "fixed"\nbox = [1.0, 0.5, 0.1]\n'


def scene(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("text", ["orientation = [0.707, 0.0, 0.0, 0.707]", "rpy = [90, 0, 0]", 'up = "y"'])
def test_a_box_on_its_side(tmp_path: Path, text: str) -> None:
    """However it is written, the world has the same pose of what stands still and the same offset of what is tracked."""
    world = load_world(scene(tmp_path, SHELF + text + "\n" + BOX + text + "\n"))
    half = np.sqrt(0.5)
    shelf = world.tree_names.index("shelf")
    np.testing.assert_allclose(world.scene.trees.rest[shelf], [0, 0, 0, half, 0, 0, half], atol=1e-15)
    np.testing.assert_allclose(world.roots[0].orientation, [half, 0, 0, half], atol=1e-15)


@pytest.mark.parametrize(
    ("rpy", "told"), [("[0, 0, 1.5708]", True), ("[3.14159, 0, 0.7854]", True), ("[0, 0, 2]", False)]
)
def test_radians_are_noticed(tmp_path: Path, rpy: str, told: bool) -> None:
    log = write_log(tmp_path / "log.mcap", [pose("/mug", k / 50, IDENTITY) for k in range(10)])
    world = load_world(scene(tmp_path, BOX + SHELF + f"position = [0, 0, -1]\nrpy = {rpy}\n"))
    warnings = check_log(log, world).warnings
    assert any("look like radians" in w and "'shelf'" in w for w in warnings) == told


def test_the_recorded_space_is_told(tmp_path: Path) -> None:
    log = write_log(tmp_path / "log.mcap", [pose("/mug", k / 50, (0, 100, 0, *IDENTITY[3:])) for k in range(10)])
    assert check_log(log, load_world(scene(tmp_path, BOX))).space is None
    world = load_world(scene(tmp_path, '[recording]\nup = "y"\nunit = "mm"\n' + BOX))
    report = check_log(log, world)
    assert report.warnings == ()
    assert report.space is not None
    assert (report.space.up, report.space.unit) == ("y", "mm")
    assert report.as_dict()["recording"]["space"] == "world"
