"""`shape_change_rad`: how far links of a tree in rigid mode are rotated from their recording, whatever the quaternions' signs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.engine.block_motion import BlockMotionMeter
from geomphys.engine.pipeline import Pipeline
from geomphys.load import load_world
from geomphys.results import Frame
from tests.cli.press import SCENE


@pytest.mark.parametrize("angle", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_the_largest_rotation_of_a_link(tmp_path: Path, angle: float, sign: float) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    pipeline = Pipeline(load_world(tmp_path / "scene.toml"), Config())
    block = pipeline.blocks[0]
    block.recorded[:2, :, 6] = 1.0
    block.corrected[:2, :, 3:] = sign * block.recorded[:2, :, 3:]
    block.corrected[1, 0, 3:] = sign * np.array([np.sin(angle / 2), 0.0, 0.0, np.cos(angle / 2)])
    block.corrected[:2, :, :3] += 0.7
    frames = [Frame(k, 10**7 * k, np.zeros((0, 7)), np.zeros(0), held=False) for k in range(2)]
    measured = BlockMotionMeter(pipeline.scene, block.moving).add(frames, block)
    assert measured.shape_change_rad == pytest.approx([0.0, angle], abs=1e-12)
