"""No state survives in scratch: with every workspace of the three loops spoiled before each frame, the results are the same.

What is not spoiled is constant or state, and listed here by name; caches are emptied.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geomphys
from geomphys import replays
from geomphys.driven.postures import Posture
from geomphys.engine.pipeline import Pipeline
from geomphys.engine.state import ReplayData
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene

ROOT = Path(__file__).resolve().parents[2]
CONSTANT = {"unit", "iterations"}
"""Of the search's workspace: not scratch."""
OF_PIECES = {"motion", "drift", "travel", "from_goal"}
"""Zero for ever in pieces that are not driven, but for what a moving object does in a step."""
CASES = {
    "gallery_hand": ("gallery", 34.5, 35.0),  # rigid, in the table
    "avatar_box": ("avatar_box", 2.0, 2.5),  # limbs with reach cones
    "gripper_cube": ("gripper_cube", 1.0, 1.5),  # with a simulated body, at last asleep
    "finger_snip": ("finger_snip", 1.2, 2.0),  # which is hit
    "mug_lift": ("mug_lift", 1.5, 2.2),  # or held by fingers
}
MOTION_CONSTANT = {"inverse_mass", "reach", "centre", "inertia", "principal", "mass"}
MOTION_STATE = {
    "position",
    "orientation",
    "travelled",
    "slow_from",
    "angular_momentum",
    "quiet_time",
    "slow_time",
    "reported_angular_velocity",
    "reported_pose",
    "rest_pose",
}
MOTION_STATE |= {"path_velocity", "path_acceleration", "path_duration"}
MOTION_STATE |= {"rotation_rate", "half_angular_acceleration", "step_duration"}
"""The last three are those of the last step: where pairs are searched, they bound the rotation until a step is planned."""
BODY_SCRATCH = {"changed", "island_activation", "fresh", "touched", "disturbed", "contact_group"}
BODY_SCRATCH |= {"island", "contact_count", "contact_end"}
BODY_SCRATCH |= {"substep_end", "moments", "all_moments", "collisions", "bound"}
PAIR_SCRATCH = {"encounters", "resting", "queue_index", "hits", "disabled", "measured_at", "due"}
SLOT_SCRATCH = {"normal_impulse", "friction_impulse", "normal_impulses", "since", "normal"}
SIMULATION_SCRATCH = (
    "frame",
    "old_pairs",
    "old_pair_slots",
    "contacts",
    "order",
    "islands",
    "members",
    "island_pairs",
    "changed",
    "concerned",
    "energy",
    "queue",
    "found",
)
UNKNOWN_SCRATCH = {"new_rate", "recorded_before", "inverse_mass", "moments", "yielding"}
TREE_SCRATCH = {"solved", "group", "rotation_offset"}
SOLVE_SCRATCH = {"effects", "inequalities", "lost", "unconverged", "any_awake"}


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


def spoil_workspace(data: ReplayData, moving: Any) -> None:
    """Spoil the driven loop's; what never moves keeps its poses in the postures of a search, as they are constant data."""
    ws = data.workspace
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
    data.workspace.listed.counts["filled"] = 0
    data.workspace.near.counts["filled"] = 0


def spoil_fields(records: Any, names: set[str], rows: Any = slice(None)) -> None:
    """Spoil these fields of records."""
    for name in names:
        spoil(records[name], rows if records.ndim else ...)


def spoil_simulated(data: ReplayData, scene: Scene) -> None:
    """Spoil the simulated loop's; of what never moves boxes, frames and motions are constant."""
    sim = data.simulated
    bodies = scene.trees.moving[scene.bodies.tree] == 1
    pieces = bodies[scene.pieces.body]
    of_motion = set(sim.motion.dtype.names or ()) - MOTION_CONSTANT - MOTION_STATE
    spoil_fields(sim.motion, of_motion, np.asarray(sim.free))
    spoil_fields(sim.motion, of_motion - {"acceleration"}, bodies)  # of driven bodies it is zero, always
    spoil_fields(sim.bodies, BODY_SCRATCH, bodies)
    spoil_fields(sim.pairs, PAIR_SCRATCH)
    spoil_fields(sim.slots, SLOT_SCRATCH)
    spoil_fields(sim.counts, {"contacts", "queued", "lost", "old_pairs", "changed", "concerned"})
    for name in SIMULATION_SCRATCH:
        spoil(getattr(sim, name))
    spoil(sim.old_slots)
    spoil(sim.scratch)
    for values, rows in ((sim.frames, pieces), (sim.boxes, pieces), (sim.body_boxes, bodies)):
        spoil(values, rows)
    for velocities in (sim.velocity, sim.displacement):  # zero for what never moves
        spoil(velocities, bodies)


def spoil_coupled(data: ReplayData, scene: Scene) -> None:
    """Spoil the coupled solve's."""
    c, trees = data.coupled, scene.trees.moving == 1
    spoil_fields(c.unknowns, UNKNOWN_SCRATCH)
    spoil_fields(c.trees, TREE_SCRATCH)
    spoil_fields(c.solve, SOLVE_SCRATCH)
    spoil(c.effects)
    spoil(c.inequalities)
    for posture in (c.begin, c.now, c.after):
        spoil(posture.roots, trees)
        spoil(posture.poses, trees[scene.bodies.tree])
        spoil(posture.angles)


def spoil_frame(data: ReplayData, scene: Scene) -> None:
    """Spoil the frame's own; the poses, boxes and frames of simulated trees are where the last frame left them."""
    trees = (scene.trees.moving == 1) & (scene.trees.role != SIMULATED)
    bodies = trees[scene.bodies.tree]
    pieces, boxes = bodies[scene.pieces.body], data.detection.boxes
    spoil(data.recorded, bodies)
    spoil(data.start, scene.trees.moving[scene.bodies.tree] == 1)
    for rows, names in (
        (pieces, ("piece_low", "piece_high")),
        (bodies, ("body_low", "body_high")),
        (trees, ("tree_low", "tree_high")),
    ):
        for name in names:
            spoil(getattr(boxes, name), rows)
    spoil((data.roots, data.angles, tuple(data.depths), data.detection.found))
    spoil((tuple(data.fingertips.recorded), tuple(data.fingertips.corrected), data.fingertips.is_retained))
    for detection in (data.detection, data.tip_detection):
        detection.axes.rows["pair"] = -1


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
        spoil_workspace(self.data, moving)
        spoil_frame(self.data, scene)
        if (scene.trees.role == SIMULATED).any():
            spoil_simulated(self.data, scene)
            spoil_coupled(self.data, scene)
        return before(self, *arguments)

    monkeypatch.setattr(Pipeline, "run", run)
    spoiled = list(geomphys.replay(log, world, config=config))
    assert any(result.metrics.recorded_penetration_m > 0.0 or result.metrics.contacts > 0 for result in usual)
    assert len(usual) == len(spoiled)
    for one, other in zip(usual, spoiled, strict=True):
        assert np.array_equal(one.corrected, other.corrected), one.frame.index
        assert np.array_equal(one.angles, other.angles)
        assert one.metrics == other.metrics
