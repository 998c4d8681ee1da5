"""No state survives in scratch: with every workspace of the driven loop spoiled before each frame, the results are the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geomphys
from geomphys import replays
from geomphys.driven.postures import Posture
from geomphys.engine.pipeline import Pipeline
from geomphys.engine.state import Machine
from geomphys.scene.arrays import DRIVEN

ROOT = Path(__file__).resolve().parents[2]
CONSTANT = {"unit", "passes"}
"""Of the search's workspace: not scratch."""
OF_PIECES = {"motion", "drift", "travel", "from_goal"}
"""Zero for ever in pieces that are not driven, but for what a moving object does in a step."""
CASES = {
    "gallery_hand": ("gallery", 34.5, 35.0),  # rigid, in the table
    "avatar_box": ("avatar_box", 2.0, 2.5),  # limbs with reach cones
    "gripper_cube": ("gripper_cube", 1.0, 1.5),  # with a simulated body
}


def spoil(values: Any, rows: Any = slice(None)) -> None:
    """Overwrite arrays and records: NaN for numbers, 1 for whole ones, which are flags and indices."""
    if isinstance(values, np.ndarray) and values.dtype.names:
        for name in values.dtype.names:
            spoil(values[name], rows if values.ndim else ...)
    elif isinstance(values, np.ndarray) and values.dtype.kind == "f":
        values[rows] = np.nan
    elif isinstance(values, np.ndarray):
        values[rows] = 1
    elif isinstance(values, tuple):
        for value in values:
            spoil(value, rows)


def spoil_workspace(machine: Machine, moving: Any) -> None:
    """Spoil the driven loop's; what never moves keeps its poses in the postures of a search, as they are constant data."""
    ws = machine.workspace
    trees, bodies, pieces = moving
    for name, value in ws.work._asdict().items():
        if isinstance(value, Posture):
            value.roots[trees], value.poses[bodies], value.angles[:] = np.nan, np.nan, np.nan
        elif name in OF_PIECES:
            spoil(value, pieces)
        elif name not in CONSTANT:
            spoil(value)
    spoil(ws.problem)
    spoil(ws.near._replace(counts=np.zeros(0)))
    spoil(ws.listed)
    spoil(ws.piece_frames.moved)
    spoil(ws.row_state)
    machine.workspace.listed.counts["filled"] = 0
    machine.workspace.near.counts["filled"] = 0


@pytest.mark.parametrize("name", CASES)
def test_what_is_left_in_scratch_is_of_no_effect(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene_name, start, end = CASES[name]
    world = geomphys.load_world(ROOT / f"assets/scenes/{scene_name}.toml")
    config = geomphys.Config(start=start, end=end)
    log = ROOT / f"recordings/{name}.mcap"
    monkeypatch.setattr(replays, "FRAMES", 1)
    usual = list(geomphys.replay(log, world, config=config))
    scene = world.scene
    trees = scene.trees.moving == 1
    moving = trees, trees[scene.bodies.tree], scene.bodies.role[scene.pieces.body] == DRIVEN
    before = Pipeline.run

    def run(self: Pipeline, *arguments: Any) -> int:
        spoil_workspace(self.machine, moving)
        return before(self, *arguments)

    monkeypatch.setattr(Pipeline, "run", run)
    spoiled = list(geomphys.replay(log, world, config=config))
    assert any(result.metrics.recorded_penetration_m > 0.0 or result.metrics.contacts > 0 for result in usual)
    assert len(usual) == len(spoiled)
    for one, other in zip(usual, spoiled, strict=True):
        assert np.array_equal(one.corrected, other.corrected), one.frame.index
        assert np.array_equal(one.angles, other.angles)
        assert one.metrics == other.metrics
