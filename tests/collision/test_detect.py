"""Near pairs: complete against brute force, in a fixed order, and remembered directions change nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.collision.detect import (
    BOXES_SUFFICE,
    MOTION_BOUND,
    Detection,
    append_bound,
    append_pair,
    find_near,
    find_overlaps_with_simulated,
    make_axes,
    make_near,
    measure_near,
    pair_separation,
    separation_bound,
)
from geomphys.collision.penetration import make_scratch
from geomphys.collision.support import pose_pieces
from geomphys.collision.sweep import make_boxes, update_boxes
from geomphys.engine.state import make_replay_data
from geomphys.engine.step import measure_recorded, pose_recording
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import DRIVEN, FIXED, SIMULATED
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Shape, Sphere
from tests.driven.logs import Engine, Run, play
from tests.laws.test_driven_random import random_scene
from tests.simulated.scenes import Thing, make_scene


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return play(tmp_path_factory.mktemp("detect"), random_scene(21, 40, driven=4))


def near_of(run: Run, data: object, frame: int) -> dict[tuple[int, int], float]:
    """Overlapping pairs of pieces in a recorded frame and their separations [m]."""
    packed, f = pack(data), run.results[frame].frame
    pose_recording(pack(run.world.scene), packed, f.roots, f.angles)
    measure_recorded(pack(run.world.scene), packed)
    near = data.workspace.near
    return {(int(near.a[k]), int(near.b[k])): float(near.separation[k]) for k in range(near.counts["filled"])}


def test_no_overlap_is_missed_and_none_invented(run: Run) -> None:
    engine, data = Engine(run.world), make_replay_data(run.world.scene)
    total = 0
    for frame in range(len(run.results)):
        found = {tuple(sorted(pair)): s for pair, s in near_of(run, data, frame).items()}
        frames = engine.frames(run.recorded[frame])
        for i, j in engine.pairs:
            gap = engine.gap(i, j, frames)
            if gap < -1e-6:
                assert found[i, j] == pytest.approx(gap, abs=2e-6)
                total += 1
            elif gap > 1e-6:
                assert (i, j) not in found
    assert total > 50


def test_pairs_of_fixed_things_are_not_looked_at(run: Run) -> None:
    data = make_replay_data(run.world.scene)
    role = run.world.scene.bodies.role[run.world.scene.pieces.body]
    for frame in range(0, 40, 4):
        assert not any(role[a] == FIXED and role[b] == FIXED for a, b in near_of(run, data, frame))


def test_losing_remembered_directions_costs_no_answer(run: Run) -> None:
    warm = make_replay_data(run.world.scene)
    for frame in range(40):
        with_memory = near_of(run, warm, frame)
        without = near_of(run, make_replay_data(run.world.scene), frame)
        assert list(with_memory) == list(without)  # the same order too
        assert list(with_memory.values()) == pytest.approx(list(without.values()), abs=1e-9)


def rows_of_balls(count: int) -> tuple[Any, Any, np.ndarray]:
    """Driven balls in a row, 1 cm from each other: scene and detection packed, frames of the pieces."""
    scene = make_scene([Thing(shape=Sphere(0.05), role=DRIVEN, at=(0.11 * k, 0, 0)) for k in range(count)])
    frames, still = np.zeros((count, 12)), scene.trees.rest
    pose_pieces(pack(scene.pieces), still, frames)
    detection = Detection(make_boxes(scene, frames), make_axes(64), make_scratch(), np.zeros(count, np.int64))
    return pack(scene), pack(detection), frames


@pytest.mark.parametrize(("size", "lost"), [(9, 0), (8, 1), (3, 6)])
def test_pairs_beyond_the_table_are_counted_and_the_first_ones_are_there(size: int, lost: int) -> None:
    scene, detection, frames = rows_of_balls(10)
    near = make_near(size)
    for _ in range(2):  # what is there is replaced; lost ones add up until the caller clears them
        find_near(scene, frames, np.zeros(10, MOTION_BOUND), 0.02, math.inf, pack(near), detection)
    assert near.counts["filled"] == size
    assert near.counts["lost"] == 2 * lost
    assert [(int(a), int(b)) for a, b in zip(near.a, near.b, strict=True)] == [(k, k + 1) for k in range(size)]
    assert near.separation == pytest.approx(0.01, abs=1e-12)


@pytest.mark.parametrize(
    ("reach", "margin", "found"), [(0.0, 0.009, 0), (0.0, 0.011, 9), (0.004, 0.0, 0), (0.006, 0.0, 9)]
)
def test_pairs_are_listed_as_far_as_both_may_move_and_the_margin(reach: float, margin: float, found: int) -> None:
    scene, detection, frames = rows_of_balls(10)
    near = make_near(64)
    find_near(scene, frames, np.full(10, reach, MOTION_BOUND), margin, math.inf, pack(near), detection)
    assert near.counts["filled"] == found


@pytest.mark.parametrize(("apart", "measured"), [(1.01, False), (0.99, True)])
def test_what_boxes_part_far_enough_is_bounded_without_a_direction(apart: float, measured: bool) -> None:
    scene, detection, frames = rows_of_balls(3)
    gap = apart * BOXES_SUFFICE
    frames[:, 9] = np.arange(3) * (0.1 + gap)
    for tree in range(3):
        update_boxes(scene, frames, detection.boxes, tree)
    near = make_near(64)
    find_near(scene, frames, np.zeros(3, MOTION_BOUND), 2.0 * gap, 0.0, pack(near), detection)
    assert near.counts["filled"] == 2
    assert near.exact[:2].tolist() == [measured, measured]
    assert near.normal[:2].any() == measured
    assert near.separation[:2] == pytest.approx(gap, abs=1e-12)


def test_boxes_that_overlap_prove_nothing() -> None:
    scene, detection, frames = rows_of_balls(2)
    frames[1, 9] = 0.07
    for tree in (0, 1):
        update_boxes(scene, frames, detection.boxes, tree)
    near = make_near(64)
    find_near(scene, frames, np.zeros(2, MOTION_BOUND), 0.0, 0.0, pack(near), detection)
    assert near.counts["filled"] == near.exact[0] == 1
    assert near.separation[0] == pytest.approx(-0.03, abs=1e-12)


def test_what_a_remembered_direction_parts_is_bounded_and_not_measured() -> None:
    scene, detection, frames = rows_of_balls(3)
    near = make_near(64)
    find_near(scene, frames, np.zeros(3, MOTION_BOUND), 0.2, math.inf, pack(near), detection)
    assert near.exact[: near.counts["filled"]].all()
    frames[:, 10] += (0.0, 0.03, 0.0)  # the middle one goes aside: the remembered directions are a bit off
    find_near(scene, frames, np.zeros(3, MOTION_BOUND), 0.2, 0.005, pack(near), detection)
    count = int(near.counts["filled"])
    assert count == 3
    assert not near.exact[:count].any()
    true = np.linalg.norm(frames[near.a[:count], 9:] - frames[near.b[:count], 9:], axis=1) - 0.1
    assert (near.separation[:count] <= true + 1e-12).all()
    assert (near.separation[:count] > 0.005).all()
    for k in range(count):
        found = measure_near(scene.pieces, frames, k, 1.0, pack(near), detection.axes, detection.scratch)
        assert found == pytest.approx(true[k], abs=1e-9)
    assert near.exact[:count].all()


def test_a_pair_beyond_the_table_is_counted_and_changes_none_that_is_in_it() -> None:
    near = make_near(2)
    packed, nothing = pack(near), (0.0, 0.0, 0.0)
    append_pair(packed, 0, 5, 0, 1, (0.0, nothing, nothing, nothing))
    append_bound(packed, 1, 5, 0, 1, 0.01, nothing)
    append_bound(packed, 2, 5, 0, 1, 0.02, nothing)
    append_pair(packed, 3, 5, 0, 1, (0.03, nothing, nothing, nothing))
    assert (int(near.counts["filled"]), int(near.counts["lost"])) == (2, 2)
    assert (near.a.tolist(), near.exact.tolist(), near.separation.tolist()) == ([0, 1], [1, 0], [0.0, 0.01])


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.2, 0.3)),
        Capsule(0.02, 0.1),
        Cylinder(0.1, 0.05),
        Hull(np.array([(0.1, 0, 0), (0, 0.2, 0), (0, 0, 0.15), (-0.1, -0.1, -0.1)])),
    ],
)
def test_a_remembered_direction_turns_with_the_pair_and_bounds_its_separation(shape: Shape) -> None:
    turns = Rotation.random(2, random_state=3).as_quat()
    scene = make_scene([Thing(shape=shape, at=(0.8 * k, -0.2 * k, 0.1), turn=turns[k]) for k in range(2)])
    pieces, axes, scratch, frames = pack(scene.pieces), pack(make_axes(64)), pack(make_scratch()), np.zeros((2, 12))
    pose_pieces(pieces, scene.trees.rest, frames)
    assert separation_bound(pieces, frames, 0, 1, axes)[0] == -math.inf
    s, n, _, _ = pair_separation(pieces, frames, 0, 1, math.inf, axes, scratch)
    for turn in Rotation.random(20, random_state=1):
        turned = np.hstack(
            [(turn.as_matrix() @ frames[:, :9].reshape(2, 3, 3)).reshape(2, 9), turn.apply(frames[:, 9:])]
        )
        bound, along = separation_bound(pieces, turned, 0, 1, axes)
        assert bound == pytest.approx(s, abs=1e-9)
        assert along == pytest.approx(turn.apply(n), abs=1e-12)
        turned[0, 9:] += (0.05, -0.03, 0.08)
        bound, _ = separation_bound(pieces, turned, 0, 1, axes)
        assert 0.0 < bound <= pair_separation(pieces, turned, 0, 1, math.inf, pack(make_axes(64)), scratch)[0] + 1e-12


def test_overlaps_with_simulated_bodies_are_of_these_alone() -> None:
    """A driven ball is in a simulated and in a fixed one, and another driven one in it; it touches none of the others."""
    at = [(0, 0, 0), (0.09, 0, 0), (0, 0.08, 0), (0, 0, 0.07), (0.2, 0, 0)]
    roles = [DRIVEN, SIMULATED, FIXED, DRIVEN, SIMULATED]
    scene = make_scene([Thing(shape=Sphere(0.05), role=r, at=x) for r, x in zip(roles, at, strict=True)])
    data = make_replay_data(scene)
    near = data.workspace.near
    frames = data.workspace.piece_frames.frames
    find_overlaps_with_simulated(pack(scene), frames, pack(near), pack(data.detection))
    pieces = scene.bodies.role[scene.pieces.body]
    assert near.counts["filled"] == 1
    assert (pieces[near.a[0]], pieces[near.b[0]]) == (DRIVEN, SIMULATED)
    assert near.separation[0] == pytest.approx(-0.01, abs=1e-12)
