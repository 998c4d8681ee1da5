"""A search lists pairs as far as its steps reach, also where fingertips are drawn to contacts and the step grows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.sweep import update_boxes
from geomphys.driven.reachability import clear_pairs
from geomphys.driven.sqp import EVERY_STEP, search
from geomphys.driven.state import LOCKED, TRANSLATION
from geomphys.driven.stepping import pose_unlocked
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.simulated.scenes import Thing, make_scene

ALONG = np.ones(3) / math.sqrt(3.0)  # as far as a step goes: it is bounded along each axis
RADIUS, HALF_THICKNESS = 2e-3, 1e-3  # m


def reached(distance: float, touching: bool) -> float:
    """How far [m] along its path a ball comes that is sought 0.4 m on, behind a plate `distance` [m] ahead of it."""
    turn = Rotation.align_vectors([ALONG], [[0.0, 0.0, 1.0]])[0]
    plate = Thing(
        shape=Box((1.0, 1.0, HALF_THICKNESS)), role=s.FIXED, turn=turn.as_quat(),
        at=(distance + RADIUS + HALF_THICKNESS) * ALONG,
    )  # fmt: skip
    scene = make_scene([Thing(shape=Sphere(RADIUS), role=s.DRIVEN), plate])
    data: ReplayData = make_replay_data(scene)
    work, packed, ws = data.workspace.work, pack(scene), pack(data.workspace)
    work.mobility[:] = LOCKED
    work.mobility[0], work.ignored[:], work.deviation_limit[:] = TRANSLATION, 0, math.inf
    for posture in (work.before, work.iterate, work.trial, work.start):
        posture.roots[:], posture.poses[:] = scene.trees.rest, data.recorded
    work.target[:] = data.recorded
    work.target[0, :3] += 0.4 * ALONG
    work.counts["touches"] = int(touching)
    clear_pairs(ws)
    pose_unlocked(packed, ws, ws.work.iterate)
    for tree in range(2):
        update_boxes(packed, data.workspace.piece_frames.frames, ws.detection.boxes, tree)
    found = search(packed, ws, np.zeros(0), 2e-6, 25, touching, EVERY_STEP)
    assert found.free
    return float(work.best.poses[0, :3] @ ALONG)


@pytest.mark.parametrize("touching", [False, True])
def test_a_search_does_not_step_through_a_plate_at_any_distance(touching: bool) -> None:
    for distance in np.arange(2e-3, 0.2, 4e-3):
        assert reached(distance, touching) == pytest.approx(distance, abs=1e-5)
