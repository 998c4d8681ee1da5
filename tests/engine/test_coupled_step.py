"""The recording within a frame, on lines and parabolas; substeps; what is laid out before driven and simulated bodies move."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from geomphys.config import Config
from geomphys.driven.coupling import relax
from geomphys.driven.state import PRESCRIBED, WAS_PRESCRIBED
from geomphys.engine.coupled_step import (
    MAX_SUBSTEPS,
    NEAR,
    SUBSTEP,
    curve_path,
    fit_recorded_paths,
    is_pressed,
    move_together,
    predict_end_poses,
    recorded_motion,
    recording_between,
    relax_temporarily,
    restore_offsets,
    separate_from_simulated,
    simulate_rest,
    substeps_of,
    write_corrected_poses,
    write_simulated_poses,
)
from geomphys.engine.state import Method, StepParameters, make_replay_data
from geomphys.engine.step import pose_recording
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.driven.paper.test_descent import planar_arm
from tests.engine.coupled_stages import GAP, HALF, RADIUS, STEP, Substep, ball_over_plate
from tests.simulated.scenes import GRAVITY, Thing, make_scene

DT = 1 / 30


def apart(distance: float = 1.0, **ball: object) -> Substep:
    """A driven cube and a ball beside it, surfaces so far from each other."""
    cube = Thing(shape=Box((0.05, 0.05, 0.05)), role=s.DRIVEN)
    at = (0.05 + RADIUS + distance, 0, 0)
    return Substep(make_scene([cube, Thing(shape=Sphere(RADIUS), at=at, **ball)]), DT)  # type: ignore[arg-type]


@pytest.mark.parametrize("w", [0.0, 0.25, 1.0])
def test_the_recording_between_two_frames_is_on_the_line_and_the_great_circle(w: float) -> None:
    stage = apart()
    last = stage.data.driven.recorded.roots
    a, b = Rotation.from_rotvec([0.3, 0, 0.1]), Rotation.from_rotvec([-0.2, 0.9, 0.1])
    last[0], stage.roots[0] = (1, 2, 3, *a.as_quat()), (2, 0, 3.5, *b.as_quat())
    stage.call(recording_between, stage.roots, stage.angles, w)
    found = stage.data.roots[0]
    assert found[:3] == pytest.approx((1 - w) * np.array([1, 2, 3]) + w * np.array([2, 0, 3.5]), abs=1e-15)
    expected = Slerp([0, 1], Rotation.concatenate([a, b]))(w)
    assert (Rotation.from_quat(found[3:]) * expected.inv()).magnitude() <= 1e-12
    assert stage.data.recorded[0] == pytest.approx(found, abs=1e-15)


def test_joint_values_between_two_frames_are_on_a_line_and_pose_the_links(tmp_path: Path) -> None:
    world = planar_arm(tmp_path)
    data = make_replay_data(world.scene)
    scene, packed = pack(world.scene), pack(data)
    data.driven.recorded.angles[:] = (0.2, -0.4)
    recording_between(scene, packed, world.scene.trees.rest.copy(), np.array([0.6, 0.4]), 0.25)
    assert data.angles == pytest.approx([0.3, -0.2])
    lower = data.recorded[2]
    assert lower[:2] == pytest.approx([0.3 * math.cos(0.3), 0.3 * math.sin(0.3)], abs=1e-12)
    assert 2.0 * math.atan2(lower[5], lower[6]) == pytest.approx(0.3 - 0.2, abs=1e-12)


def record(stage: Substep, path: list[tuple[float, ...]], dts: list[float]) -> np.ndarray:
    """Frames of the driven cube's recorded positions; returns the acceleration in the last."""
    for k, (position, dt) in enumerate(zip(path, dts, strict=True)):
        stage.roots[0, :3] = position
        stage.call(fit_recorded_paths, stage.roots, dt, k == 0)
    return np.array(stage.data.recorded_path["acceleration"][0])


def test_the_acceleration_of_a_recorded_parabola_is_found() -> None:
    stage, a, v = apart(), np.array([2.0, -1.0, 0.5]), np.array([0.3, 0.2, -0.1])
    path = [tuple(v * k * DT + 0.5 * a * (k * DT) ** 2) for k in range(5)]
    assert record(stage, path, [DT] * 5) == pytest.approx(a, rel=1e-9)


@pytest.mark.parametrize("dts", [[DT] * 2, [DT] * 3, [DT, DT, DT, 5 * DT]])
def test_a_beginning_and_uneven_frames_give_no_acceleration(dts: list[float]) -> None:
    path = [(0.5 * (k * DT) ** 2, 0.0, 0.0) for k in range(len(dts))]
    assert record(apart(), path, dts).tolist() == [0, 0, 0]


def test_a_path_that_turns_round_is_straight() -> None:
    path = [(0.0, 0, 0), (0.1, 0, 0), (0.3, 0, 0), (0.4, 0, 0), (0.6, 0, 0)]
    assert record(apart(), path, [DT] * 5).tolist() == [0, 0, 0]


@pytest.mark.parametrize("parts", [2, 5, 8])
def test_ends_of_substeps_are_on_the_parabola_and_the_last_is_the_recorded_pose(parts: int) -> None:
    """p + v u + a u (u - dt) / 2 at u = dt k / parts."""
    stage = apart()
    m, a = stage.data, np.array([2.0, -1.0, 0.5])
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.15, 0.1, 0.35])
    m.recorded_path["acceleration"][0] = a
    m.driven.recorded.roots[0, :3], stage.roots[0, :3] = start, end
    for part in range(parts - 1):
        stage.call(recording_between, stage.roots, stage.angles, 1.0 / (parts - part))
        stage.call(curve_path, DT, part, parts)
        u = DT * (part + 1) / parts
        expected = start + (end - start) * u / DT + 0.5 * a * u * (u - DT)
        assert m.roots[0, :3] == pytest.approx(expected, abs=1e-14)
        assert m.recorded[0, :3] == pytest.approx(expected, abs=1e-14)
        m.driven.recorded.roots[0] = m.roots[0]
    stage.call(recording_between, stage.roots, stage.angles, 1.0)
    stage.call(curve_path, DT, parts - 1, parts)
    assert m.roots[0, :3].tolist() == end.tolist()


@pytest.mark.parametrize(
    ("distance", "moved", "speed", "offset", "divided"),
    [
        (0.9 * NEAR, 0.0, 0.0, 0.0, True),
        (1.1 * NEAR, 0.0, 0.0, 0.0, False),
        (0.1, 0.1, 0.0, 0.0, True),
        (0.1, 0.09, 0.0, 0.0, False),
        (0.1, 0.0, 3.0, 0.0, True),
        (0.1, 0.0, 2.5, 0.0, False),
        (0.1, 0.0, 0.0, 0.06, True),  # twice: as motion from where the cube is, and as an offset
    ],
)
def test_a_frame_is_divided_where_driven_and_simulated_bodies_may_touch(
    distance: float, moved: float, speed: float, offset: float, divided: bool
) -> None:
    stage = apart(distance, v=(0, speed, 0))
    stage.roots[0, 0] = moved
    m = stage.data
    pose_recording(stage.scene, stage.packed, m.start[:, :].copy(), stage.angles)
    m.recorded[0, 0] = moved
    m.driven.offset[0, 0] = offset
    assert stage.call(recorded_motion, 0) == pytest.approx(moved + offset, abs=1e-15)
    assert stage.call(substeps_of, DT) == (math.ceil(DT / SUBSTEP) if divided else 1)


@pytest.mark.parametrize(
    ("dt", "count"), [(SUBSTEP, 1), (1.009 * SUBSTEP, 1), (1.02 * SUBSTEP, 2), (1 / 60, 4), (0.5, MAX_SUBSTEPS)]
)
def test_substeps_are_no_longer_than_they_may_be_and_bounded(dt: float, count: int) -> None:
    assert apart(0.0).call(substeps_of, dt) == count


def test_offsets_are_relaxed_for_now_and_taken_back_to_the_bit() -> None:
    stage = apart()
    c, x = stage.packed.coupled, stage.data.coupled.unknowns
    x["offset"][:3], x["rate"][:3], x["mass"][2] = (0.01, -0.02, 0.03), (0.0, 0.5, 0.1), 0.0
    before = x["offset"].tobytes()
    relax_temporarily(c, 0, 3, DT)
    for k, (offset, rate) in enumerate(((0.01, 0.0), (-0.02, 0.5))):
        assert x["offset"][k] == pytest.approx(relax(offset, rate, 0.4, 1000.0, 40.0, DT)[0], rel=1e-12)
    assert x["offset"][2] == 0.03  # it follows the recording
    restore_offsets(c, 0, 3)
    assert x["offset"].tobytes() == before


def test_paths_are_laid_to_the_relaxed_poses_of_driven_bodies() -> None:
    stage = apart()
    stage.roots[0, :3] = (0.2, 0.1, 0.0)
    x = stage.data.coupled.unknowns
    pose_recording(stage.scene, stage.packed, stage.roots, stage.angles)
    x["offset"][0] = 0.01
    stage.call(predict_end_poses, stage.roots, stage.angles, DT)
    left = relax(0.01, 0.0, 0.4, 1000.0, 40.0, DT)[0]
    assert stage.data.corrected[0, :3] == pytest.approx([0.2 + left, 0.1, 0.0], abs=1e-14)
    assert x["offset"][0] == 0.01


def test_poses_are_handed_from_loop_to_loop() -> None:
    """Of driven bodies to the corrected ones, of simulated ones to the driven loop; nothing else changes."""
    stage = apart()
    m = stage.data
    for k, poses in enumerate((m.corrected, m.recorded, m.driven.last.poses)):
        poses[:] = k + 1.0
    stage.call(write_corrected_poses)
    assert m.corrected[:, 0].tolist() == [3.0, 1.0]
    stage.call(write_simulated_poses)
    assert m.driven.last.poses[:, 0].tolist() == [3.0, 1.0]


def test_a_pressed_plate_gets_its_posture_prescribed_until_the_rest_has_moved() -> None:
    stage = ball_over_plate(GAP, 0.5)
    impacts = stage.call(move_together, stage.roots, stage.angles, STEP, GAP, False)
    m = stage.data
    assert impacts == 1
    assert stage.call(is_pressed)
    assert m.driven.prescription[0] == PRESCRIBED
    assert m.driven.prescribed_posture.roots[0, 2] == pytest.approx(float(stage.unknown(0)["offset"]), abs=1e-15)
    assert m.driven.prescribed_posture.roots[0, 2] < 0.0
    stage.call(simulate_rest, 100)
    assert m.driven.prescription[0] == WAS_PRESCRIBED
    assert np.array_equal(m.recorded[1], m.corrected[1])


def test_bodies_in_no_group_are_moved_by_the_simulated_loop() -> None:
    stage = apart(1.0)
    height = float(stage.data.corrected[1, 2])
    assert stage.call(move_together, stage.roots, stage.angles, STEP, GAP, False) == 0
    assert stage.data.corrected[1, 2] == height  # not yet
    assert not stage.call(is_pressed)
    assert stage.call(simulate_rest, 100) == (0, 0)
    assert stage.data.corrected[1, 2] == pytest.approx(height - 0.5 * GRAVITY * STEP**2, abs=1e-12)
    assert stage.data.driven.prescription[0] == 0


@pytest.mark.parametrize(("overlap", "iterations"), [(3e-3, True), (1e-8, False), (-1e-3, False)])
def test_a_driven_body_is_moved_out_of_a_simulated_one_that_ended_inside_it(overlap: float, iterations: bool) -> None:
    stage = ball_over_plate(-overlap)
    m = stage.data
    params = StepParameters(Config().gap, 100, Method(Config().gap, None))
    moved = stage.call(separate_from_simulated, params)
    assert (moved > 0) == iterations
    assert m.corrected[0, 2] == pytest.approx(-(overlap + Config().gap) if iterations else 0.0, abs=1e-6)
    assert m.corrected[1, 2] == pytest.approx(HALF + RADIUS - overlap, abs=1e-15)
