"""Bounds on what a step of a search does, and the choice between equivalent angles: each by itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geomphys.collision.detect import pair_separation
from geomphys.collision.penetration import separation
from geomphys.driven.constraints import number_unknowns
from geomphys.driven.goals import choose_branch
from geomphys.driven.starts import JUMP, unwrapped_change
from geomphys.driven.state import GENERAL_MOTION, LOCKED, TRANSLATION, TRAVEL
from geomphys.driven.stepping import (
    apply_solution,
    gap_along_normal,
    is_within,
    measure_motion,
    measure_near_pairs,
    measure_travel,
    pair_travel,
    update_separations,
)
from geomphys.driven.targets import _set_rate_along
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from tests.driven.compound import NOTCHED, shoulder

Table = tuple[Any, Any, ReplayData]


def one_free(data: ReplayData) -> None:
    """The first ball is solved for, everything else stays."""
    data.workspace.work.mobility[:] = LOCKED
    data.workspace.work.mobility[0] = TRANSLATION
    data.workspace.work.ignored[:] = 0


@pytest.mark.parametrize("down", [0.0, 0.004, 0.009, 0.012])
def test_separations_after_a_step_are_never_more_than_they_are(table: Table, down: float) -> None:
    """The first ball, 1 cm above the floor, moves down; what is nearer than `enough` is measured, the rest bounded."""
    scene, ws, data = table
    one_free(data)
    measure_near_pairs(scene, ws, 0.5, math.inf)
    near, frames = data.workspace.near, data.workspace.piece_frames.frames
    count, enough = int(near.counts["filled"]), 3e-3
    data.workspace.work.motion[:] = 0
    data.workspace.work.motion[0]["translation"] = (0.0, 0.0, -down)
    frames[0, 11] -= down
    least = update_separations(scene, ws, 0.05, enough)
    scratch = pack(data.detection.scratch)
    true = [
        separation(scene.pieces, frames, int(a), int(b), 1.0, (0.0, 0.0, 0.0), scratch)[0]
        for a, b in zip(near.a[:count], near.b[:count], strict=True)
    ]
    involved = (near.a[:count] == 0) | (near.b[:count] == 0)
    assert (near.separation[:count] <= np.array(true) + 1e-12)[involved].all()
    measured = involved & (np.array(true) < enough)
    assert near.separation[:count][measured] == pytest.approx(np.array(true)[measured], abs=1e-12)
    if measured.any():
        assert least == pytest.approx(0.01 - down, abs=1e-12)


@pytest.mark.parametrize("certified", [False, True])
def test_what_the_certification_of_a_step_has_measured_is_not_measured_again(table: Table, certified: bool) -> None:
    """The first ball, 1 cm above the floor, moves down by 9 mm; the certification says something else."""
    scene, ws, data = table
    one_free(data)
    measure_near_pairs(scene, ws, 0.5, math.inf)
    near, at_trial, work = data.workspace.near, data.workspace.at_trial, data.workspace.work
    work.motion[:] = 0
    work.motion[0]["translation"] = (0.0, 0.0, -0.009)
    data.workspace.piece_frames.frames[0, 11] -= 0.009
    at_trial.exact[0], at_trial.separation[0], at_trial.normal[0] = int(certified), 0.0015, (0.0, 0.6, 0.8)
    least = update_separations(scene, ws, 0.05, 3e-3)
    assert near.exact[0] == 1
    assert least == near.separation[0] == pytest.approx(0.0015 if certified else 0.001, abs=1e-12)
    assert near.normal[0].tolist() == ([0.0, 0.6, 0.8] if certified else [0.0, 0.0, 1.0])


@pytest.mark.parametrize(("angle", "motion", "sure"), [(0.0, 0.5, True), (0.1, 1e-3, True), (0.1, 0.05, False)])
def test_a_direction_says_nothing_of_a_path_with_much_rotation(
    table: Table, angle: float, motion: float, sure: bool
) -> None:
    scene, ws, data = table
    one_free(data)
    measure_near_pairs(scene, ws, 0.02, math.inf)
    work = data.workspace.work
    work.iterate.poses[:] = work.trial.poses[:] = data.recorded
    work.trial.poses[0, 3:] = (0.0, 0.0, math.sin(0.5 * angle), math.cos(0.5 * angle))
    measure_motion(scene, ws, ws.work.iterate, ws.work.trial)
    gap = gap_along_normal(scene, ws, 0, motion)
    assert gap == pytest.approx(0.01, abs=1e-12) if sure else gap == -math.inf


@pytest.mark.parametrize(
    ("direction", "sure"), [((0.0, 0.0, 1.0), True), ((1.0, 0.0, 0.0), False), ((0.0, 0.0, 0.0), False)]
)
def test_a_cached_direction_is_taken_only_if_it_separates_the_pair_at_the_iterate(
    table: Table, direction: tuple[float, ...], sure: bool
) -> None:
    scene, ws, data = table
    one_free(data)
    near, axes = data.workspace.near, data.detection.axes
    axes.rows["pair"] = -1
    measure_near_pairs(scene, ws, 0.018, 0.0)
    assert near.exact[0] == 0
    assert not near.normal[0].any()
    cache_direction(scene, data)
    axes.rows["direction"] = direction
    work = data.workspace.work
    work.iterate.poses[:] = work.trial.poses[:] = data.recorded
    gap = gap_along_normal(scene, ws, 0, 1e-3)
    assert gap == pytest.approx(0.01, abs=1e-12) if sure else gap == -math.inf
    assert near.normal[0].tolist() == list(direction if sure else (0.0, 0.0, 0.0))


def cache_direction(scene: Any, data: ReplayData) -> None:
    """Measure the first near pair, which caches a direction, and leave the pair as it was."""
    near, detection = data.workspace.near, pack(data.detection)
    frames, a, b = data.workspace.piece_frames.frames, int(near.a[0]), int(near.b[0])
    pair_separation(scene.pieces, frames, a, b, 1.0, detection.axes, detection.scratch)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.5])
def test_steps_in_geometric_series_are_within_what_is_left_of_their_sum(ratio: float) -> None:
    step = 1e-3
    left = step * ratio / (1.0 - ratio)
    if ratio > 0.0:
        assert not is_within(0.99 * left, step, step / ratio)
        assert is_within(1.01 * left, step, step / ratio)
    assert not is_within(0.5 * step, step, 0.0)  # there was no step before
    assert not is_within(0.5 * step, step, step)  # steps that do not get shorter lead nowhere
    assert is_within(2.0 * step, step, step)


def test_two_pieces_come_nearer_by_no_more_than_their_travel(table: Table) -> None:
    scene, _, data = table
    rng, poses = np.random.default_rng(2), data.recorded
    for _ in range(30):
        after, travel = poses.copy(), np.zeros(4, TRAVEL)
        for body in (0, 1):
            after[body, :3] += 0.1 * rng.normal(size=3)
            q = rng.normal(size=4)
            after[body, 3:] = q / np.linalg.norm(q)
            measure_travel(scene, poses, after, body, travel)
        points = 0.05 * rng.normal(size=(2, 3))
        points /= np.maximum(1.0, np.linalg.norm(points, axis=1, keepdims=True) / 0.05)
        shifts = [placed(after[b], points[b]) - placed(poses[b], points[b]) for b in (0, 1)]
        assert np.linalg.norm(shifts[0] - shifts[1]) <= pair_travel(travel, 0, 1) + 1e-12
        assert pair_travel(travel, 0, 1) == pytest.approx(pair_travel(travel, 1, 0), rel=1e-15)
        both = np.linalg.norm(after[0, :3] - after[1, :3] - poses[0, :3] + poses[1, :3])
        assert pair_travel(travel, 0, 1) == pytest.approx(both + travel["rotation"][:2].sum(), rel=1e-12)


def placed(pose: np.ndarray, point: np.ndarray) -> np.ndarray:
    """A point of a body in the world."""
    u, w = pose[3:6], pose[6]
    return pose[:3] + point + 2.0 * np.cross(u, np.cross(u, point) + w * point)


@pytest.mark.parametrize(
    ("rate", "moved", "after"),
    [
        ((0.3, 0.0, -2.0), (0.5, 0.0, 0.0), (0.3, 0.0, 0.0)),
        ((0.3, 0.0, 2.0), (0.0, 0.0, 0.01), (0.3, 0.0, 2.0)),
        ((0.3, 0.0, 0.0), (0.0, 0.5, 0.01), (0.3, 0.0, 1.0)),
        ((0.3, 0.0, 2.0), (0.0, 0.0, -0.01), (0.3, 0.0, -1.0)),
    ],
    ids=["against the contact", "faster away from it", "slower away from it", "with an offset that shrinks"],
)
def test_a_contact_gives_an_offset_the_rate_along_it_of_its_motion(
    rate: tuple[float, ...], moved: tuple[float, ...], after: tuple[float, ...]
) -> None:
    values, by_contacts = np.array(rate), np.ones(3)
    _set_rate_along(values, by_contacts, (0.0, 0.0, 0.0), moved, 100.0)
    assert values.tolist() == list(rate)
    assert by_contacts.tolist() == [0.0, 0.0, 0.0]
    _set_rate_along(values, by_contacts, (0.0, 0.0, 0.01), moved, 100.0)
    assert values == pytest.approx(after, abs=1e-15)
    assert by_contacts == pytest.approx((0.0, 0.0, after[2] if after != rate else 0.0), abs=1e-15)
    values[:] = rate
    _set_rate_along(values, by_contacts, (0.0, 0.0, 0.01), moved, 0.0)
    assert values == pytest.approx((rate[0], rate[1], max(rate[2], 0.0)), abs=1e-15)


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Table:
    """An arm of four revolute joints: its scene and workspace, packed, and the replay data that they are of."""
    scene = shoulder(tmp_path_factory.mktemp("arm"), NOTCHED).scene
    data = make_replay_data(scene)
    return pack(scene), pack(data.workspace), data


@pytest.mark.parametrize(
    ("goal", "recorded", "taken"),
    [(-3.1, 3.1, -3.1 + 2 * math.pi), (0.2, 0.1, 0.2), (-2.0, 2.5, -2.0), (3.0, -3.1, 3.0)],
    ids=["other side", "same branch", "near half a revolution", "beyond its limit"],
)
def test_of_equal_angles_the_one_nearest_to_the_recording_is_taken(
    arm: Table, goal: float, recorded: float, taken: float
) -> None:
    scene, ws, data = arm
    work = data.workspace.work
    work.low[:], work.high[:] = -3.05, 4.0
    work.iterate.angles[:] = goal
    choose_branch(scene, ws, 0, np.full(4, recorded), ws.work.iterate)
    assert work.iterate.angles == pytest.approx(np.full(4, taken), abs=1e-12)


@pytest.mark.parametrize(
    ("change", "steady"),
    [(0.1, 0.1), (2 * math.pi - 0.1, -0.1), (-4 * math.pi + 0.2, 0.2), (1.01 * JUMP, 0.0), (3.0, 0.0)],
)
def test_a_change_of_branch_is_no_motion_and_a_jump_none_either(arm: Table, change: float, steady: float) -> None:
    assert unwrapped_change(arm[1], 0, change) == pytest.approx(steady, abs=1e-12)


@pytest.mark.parametrize(
    ("before", "solution", "step_length", "after"),
    [
        (0.02, 0.05, 1.0, 0.07), (0.02, 0.05, 3.0, 0.1), (-0.02, -0.05, 3.0, -0.1), (0.15, -0.05, 2.0, 0.05),
        (0.15, -0.01, 3.0, 0.12),
    ],
    ids=["within", "beyond the upper", "beyond the lower", "back into them", "on the way back"],
)  # fmt: skip
def test_an_extrapolated_step_keeps_joints_within_their_limits(
    tmp_path: Path, before: float, solution: float, step_length: float, after: float
) -> None:
    """Limits of ±0.1 rad; what was beyond one goes no farther."""
    world = shoulder(tmp_path, NOTCHED)
    scene, data = pack(world.scene), make_replay_data(world.scene)
    ws, work = pack(data.workspace), data.workspace.work
    work.mobility[0] = GENERAL_MOTION
    work.low[:], work.high[:], work.iterate.angles[:] = -0.1, 0.1, before
    number_unknowns(scene, ws)
    data.workspace.problem.x[:] = 0.0
    data.workspace.problem.x[work.column[:3]] = solution
    apply_solution(scene, ws, step_length)
    assert work.trial.angles[:3] == pytest.approx(after, abs=1e-15)
