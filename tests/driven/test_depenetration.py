"""The search for a free position of a tree that starts inside something, by itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geomphys.collision.sweep import update_boxes
from geomphys.driven.depenetration import FARTHER, NEAREST, _direction, find_depenetration
from geomphys.driven.reachability import clear_pairs
from geomphys.driven.state import LOCKED, TRANSLATION
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.simulated.scenes import Thing, make_scene

RADIUS, HALF_THICKNESS, GAP = 0.02, 1e-3, 1e-5  # m


def freed(height: float, before: float, certified: bool, raised: float = 0.0) -> tuple[bool, np.ndarray]:
    """Whether a ball with its centre `height` [m] above that of a plate is freed, and to where; it was at `before`.

    The plate has been `raised` [m] in the step.
    """
    scene = make_scene(
        [
            Thing(shape=Sphere(RADIUS), role=s.DRIVEN, at=(0, 0, height)),
            Thing(shape=Box((0.5, 0.5, HALF_THICKNESS)), role=s.FIXED),
        ]
    )
    data = make_replay_data(scene)
    work, packed, ws = data.workspace.work, pack(scene), pack(data.workspace)
    work.mobility[:], work.ignored[:] = (TRANSLATION, LOCKED), 0
    for posture in (work.before, work.iterate, work.trial, work.start, work.best):
        posture.roots[:], posture.poses[:] = scene.trees.rest, data.recorded
    work.before.roots[0, 2] = work.before.poses[0, 2] = before
    work.before.poses[1, 2] -= raised
    clear_pairs(ws)
    for tree in range(2):
        update_boxes(packed, data.workspace.piece_frames.frames, ws.detection.boxes, tree)
    free = find_depenetration(packed, ws, GAP, certified)
    assert work.mobility.tolist() == [TRANSLATION, LOCKED]
    for posture in (work.iterate, work.trial, work.start, work.best):  # the plate stands where it was in all
        assert posture.poses[1].tolist() == data.recorded[1].tolist()
    return bool(free), work.best.roots[0, :3].copy()


@pytest.mark.parametrize("height", [0.005, -0.005])
def test_the_nearest_free_position_is_on_the_nearer_side(height: float) -> None:
    free, at = freed(height, height, certified=False)
    assert free
    assert at == pytest.approx([0.0, 0.0, math.copysign(RADIUS + HALF_THICKNESS + GAP, height)], abs=NEAREST / 100)
    assert abs(at[2]) >= RADIUS + HALF_THICKNESS + GAP  # never less than the gap


@pytest.mark.parametrize("raised", [0.0, 1e-3])
@pytest.mark.parametrize("before", [-0.03, 0.03])
def test_only_the_side_that_it_came_from_can_be_reached(before: float, raised: float) -> None:
    """A little beyond the middle, the nearer side is that behind the plate."""
    free, at = freed(-math.copysign(2e-3, before), before, certified=True, raised=raised)
    assert free
    assert at[2] == pytest.approx(math.copysign(RADIUS + HALF_THICKNESS + GAP, before), abs=1e-4)


def test_where_all_is_free_nothing_moves() -> None:
    free, at = freed(0.05, 0.05, certified=False)
    assert free
    assert at.tolist() == [0.0, 0.0, 0.05]


def test_directions_lead_to_the_faces_edges_and_corners_of_a_cube() -> None:
    directions = np.array([_direction(number) for number in range(26)])
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(26))
    assert len(np.unique(np.round(directions, 6), axis=0)) == 26
    assert np.sort((np.abs(directions) > 1e-9).sum(axis=1)).tolist() == [1] * 6 + [2] * 12 + [3] * 8
    assert FARTHER > 1.0


def stacked(thick: float, wide: float) -> tuple[float, bool, np.ndarray]:
    """A ball in the middle of a block `thick` [m], above which there is a free gap `wide` [m] more than it needs, then another.

    Returns the distance of the gap, and what `find_depenetration` finds; below there is no gap.
    """
    free = 0.5 * thick + RADIUS + GAP
    upper = free + wide + RADIUS + GAP
    slabs = [
        (Box((1.0, 1.0, 0.5 * thick + 0.5)), (0.0, 0.0, -0.5)),
        (Box((1.0, 1.0, 0.5)), (0.0, 0.0, upper + 0.5)),
    ]
    scene = make_scene([Thing(shape=Sphere(RADIUS), role=s.DRIVEN), Thing(shape=slabs, role=s.FIXED)])
    data = make_replay_data(scene)
    work, packed, ws = data.workspace.work, pack(scene), pack(data.workspace)
    work.mobility[:], work.ignored[:] = (TRANSLATION, LOCKED), 0
    for posture in (work.before, work.iterate, work.trial, work.start, work.best):
        posture.roots[:], posture.poses[:] = scene.trees.rest, data.recorded
    clear_pairs(ws)
    for tree in range(2):
        update_boxes(packed, data.workspace.piece_frames.frames, ws.detection.boxes, tree)
    found = bool(find_depenetration(packed, ws, GAP, False))
    return free, found, work.best.roots[0, :3].copy()


@pytest.mark.parametrize("thick", np.linspace(0.01, 0.1, 13))
def test_no_free_gap_is_leapt_over_that_is_as_wide_as_a_step_of_the_search(thick: float) -> None:
    """Distances grow by `FARTHER`: in a gap of that part of its distance there is one of them, wherever they begin."""
    free = 0.5 * thick + RADIUS
    distance, found, at = stacked(thick, 1.02 * (FARTHER - 1.0) * free)
    assert found
    assert at == pytest.approx([0.0, 0.0, distance], abs=2e-5)
