"""Recorded hands that are stopped by what they meet: corrected links and joints hardly jerk more than in the recording."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from geomphys.analysis.motion_quality import MotionFigures, MotionQuality
from geomphys.config import Config
from geomphys.load import load_world
from geomphys.replays import replay
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

ROOT = Path(__file__).resolve().parents[2]

JOINTS = 2.0  # times the recorded jerk of joints, root mean square over the corrected frames
LINKS = 1.1  # times that of links


def figures(log: Path, world: World, mode: Literal["chains", "rigid"]) -> MotionFigures:
    scene, results = world.scene, list(replay(log, world, config=Config(mode=mode)))
    links = np.flatnonzero(scene.bodies.role == DRIVEN)
    joints = np.flatnonzero(scene.trees.role[scene.dofs.tree] == DRIVEN)
    quality = MotionQuality(scene.bodies.tree[links])
    quality.add(
        np.array([result.frame.time_ns for result in results]),
        np.stack([result.recorded[links] for result in results]),
        np.stack([result.corrected[links] for result in results]),
        recorded_angles=np.stack([result.frame.angles[joints] for result in results]),
        corrected_angles=np.stack([result.angles[joints] for result in results]),
    )
    return quality.figures()


@pytest.mark.parametrize(("name", "mode"), [("mug", "chains"), ("mug", "rigid"), ("ball", "chains")])
def test_joints_that_grasp_do_not_stop_in_one_frame(name: str, mode: Literal["chains", "rigid"]) -> None:
    """2.1 to 3 times where they stop one by one, and nothing goes on as in the last frame."""
    world = load_world(ROOT / f"assets/scenes/hand_{name}.toml", mode=mode)
    ratio = figures(ROOT / f"recordings/hand_{name}.mcap", world, mode).joint_jerk_rms_ratio
    assert ratio is not None
    assert ratio <= JOINTS


def test_a_hand_that_slaps_a_door_does_not_stop_in_one_frame(shared_dir: Path) -> None:
    """1.17 times without inertia."""
    (log,) = (shared_dir / "recordings").glob("adroit_door_11_*.mcap")
    ratio = figures(log, load_world(shared_dir / "checks/scenes/door_chains.toml"), "chains").jerk_rms_ratio
    assert ratio is not None
    assert ratio <= LINKS
