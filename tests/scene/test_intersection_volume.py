"""Volumes in common against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.scene.intersection_volume import intersection_volume

SCENE = """
[[object]]
name = "plate"
class = "fixed"
box = [0.4, 0.4, 0.1]

[[object]]
name = "cube"
class = "fixed"
box = [0.2, 0.2, 0.2]
position = [1.0, 0.0, 0.0]
"""


@pytest.mark.parametrize(
    ("offset", "quarter_turns", "volume"),
    [
        ((0.0, 0.0, 0.12), 0.0, 0.2 * 0.2 * 0.03),
        ((0.2, 0.0, 0.0), 0.0, 0.1 * 0.2 * 0.1),
        ((0.0, 0.0, 0.0), 0.5, 0.2 * 0.2 * 0.1),
        ((0.0, 0.0, 0.2), 0.0, 0.0),
    ],
)
def test_boxes(tmp_path: Path, offset: tuple[float, ...], quarter_turns: float, volume: float) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    world = geomphys.load_world(tmp_path / "scene.toml")
    bodies = (world.body_names.index("plate"), world.body_names.index("cube"))
    half = 0.25 * np.pi * quarter_turns
    place = np.array([500.0, -300.0, 20.0])  # far from the origin, where single precision is coarse
    poses = np.array([[*place, 0.0, 0.0, 0.0, 1.0], [*(place + offset), 0.0, 0.0, np.sin(half), np.cos(half)]])
    assert intersection_volume(world, bodies, poses) == pytest.approx(volume, rel=1e-5, abs=1e-12)
