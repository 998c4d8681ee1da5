"""The frame of the published method: limits, attraction by (6), what offsets and free states are kept for the next frame."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.driven.coupling import relax
from geomphys.driven.paper.state import PaperWorkspace, make_paper_workspace
from geomphys.driven.paper.update import (
    attract,
    separate_as_published,
    store_tree_offsets,
    take_recording,
    update_driven_as_published,
)
from geomphys.driven.state import STARTED_FREE, DrivenState
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from geomphys.scene.world import World
from tests.driven.paper.test_descent import planar_arm
from tests.simulated.scenes import Thing, floor, make_scene

GAP, DT = 2e-6, 1 / 60
HALF = 0.05
CUBE = Box((HALF, HALF, HALF))
M, K, R = 0.4, 1000.0, 40.0  # of the coupling of the cubes


class Frames:
    """A scene that is updated frame by frame by the published method."""

    def __init__(self, scene: s.Scene) -> None:
        self.made = scene
        data = make_replay_data(scene)
        self.state: DrivenState = data.driven
        self.w: PaperWorkspace = make_paper_workspace(scene, data.workspace, Config(gap=GAP))
        self.scene, self.packed_state, self.packed = pack(scene), pack(self.state), pack(self.w)
        self.roots, self.poses = scene.trees.rest.copy(), data.driven.last.poses.copy()
        self.angles = np.zeros(len(scene.dofs.lower))

    def update(self, *position: float) -> tuple[int, int, bool, bool]:
        """A frame in which the first tree, of one body, is recorded at `position`."""
        self.roots[0, :3] = self.poses[0, :3] = position
        done = update_driven_as_published(
            self.scene, self.packed_state, self.packed, self.roots, self.angles, self.poses, DT
        )
        return (done.iterations, done.fallbacks, done.converged, done.shape_changed)

    @property
    def corrected(self) -> np.ndarray:
        return np.asarray(self.state.last.roots[0, :3])


def cube_and_floor() -> Frames:
    return Frames(make_scene([Thing(shape=CUBE, role=s.DRIVEN, at=(0, 0, 0.2)), floor()]))


def test_a_pressed_box_stands_on_the_floor_and_its_offset_relaxes_by_the_coupling_when_it_is_lifted() -> None:
    frames = cube_and_floor()
    frames.update(0, 0, 0.2)
    assert frames.update(0, 0, HALF - 0.02)[0] == 1
    assert frames.corrected == pytest.approx([0, 0, HALF + GAP], abs=1e-9)
    x, v = 0.02 + GAP, 0.0
    for _ in range(5):
        assert frames.update(0, 0, 0.2) == (0, 0, True, False)
        x, v = relax(x, v, M, K, R, DT)
        assert frames.corrected[2] - 0.2 == pytest.approx(x, abs=1e-9)
    assert frames.state.offset_velocity[0, 2] == pytest.approx(v, abs=1e-7)
    for _ in range(60):
        frames.update(0.1, 0, 0.2)
    assert frames.corrected.tolist() == [0.1, 0, 0.2]


def test_a_correction_against_the_rate_of_an_offset_sets_it_to_zero_across_alone() -> None:
    """The offset moves on along the floor, and no longer into it."""
    frames = cube_and_floor()
    w, state = frames.w, frames.state
    state.offset_velocity[0] = (0.3, 0.0, -0.2)
    w.target.roots[0, :3], w.iterate.roots[0, :3] = (0.01, 0.0, 0.04), (0.01, 0.0, 0.05)
    store_tree_offsets(frames.scene, frames.packed_state, frames.packed, 0, frames.roots, frames.angles)
    assert state.offset_velocity[0] == pytest.approx([0.3, 0.0, 0.0], abs=1e-15)
    assert state.offset[0] == pytest.approx([0.01, 0.0, 0.05 - 0.2], abs=1e-15)
    state.offset_velocity[0] = (0.3, 0.0, 0.2)  # which the correction goes along with
    store_tree_offsets(frames.scene, frames.packed_state, frames.packed, 0, frames.roots, frames.angles)
    assert state.offset_velocity[0].tolist() == [0.3, 0.0, 0.2]


def test_the_last_free_state_is_that_of_the_last_free_frame() -> None:
    """Between two walls nothing frees the cube, but what it came from."""
    jaws = [(CUBE, (sign * (2 * HALF - 0.005), 0.0, 0.0)) for sign in (1.0, -1.0)]
    scene = [Thing(shape=CUBE, role=s.DRIVEN, at=(0, 0, 0.3)), Thing(shape=jaws, role=s.FIXED)]
    frames = Frames(make_scene(scene))
    assert frames.update(0, 0, 0) == (1, 1, False, False)  # a first frame inside has none
    assert frames.w.has_free[0] == 0
    frames.update(0, 0, 0.4)
    assert frames.w.has_free[0] == 1
    free = frames.w.free.roots[0, :3].copy()
    passes, interpolated, converged, _ = frames.update(0, 0, 0)
    assert (interpolated, converged) == (1, True)
    assert frames.corrected[2] == pytest.approx(2 * HALF, abs=1e-4)
    assert frames.corrected[2] < free[2]
    assert frames.state.progress["start"] == STARTED_FREE
    assert frames.state.progress["updates"] == 3
    assert passes == 1


def arm_frames(world: World) -> Frames:
    return Frames(world.scene)


def test_limits_are_widened_to_what_was_recorded(tmp_path: Path) -> None:
    frames = arm_frames(planar_arm(tmp_path))
    angles = np.array([-3.5, 3.25])
    take_recording(frames.scene, frames.packed_state, frames.packed, angles, frames.poses)
    assert (frames.w.lower[0], frames.w.upper[0]) == (-3.5, 3.0)
    assert (frames.w.lower[1], frames.w.upper[1]) == (-3.0, 3.25)


@pytest.mark.parametrize("dt", [0.0, DT])
def test_joints_are_attracted_to_their_recorded_angles_by_the_coupling(tmp_path: Path, dt: float) -> None:
    frames = arm_frames(planar_arm(tmp_path))
    state, w = frames.state, frames.w
    trees = frames.made.trees
    state.last.angles[:], state.recorded.angles[:], w.joint_rate[:] = (0.5, 0.1), (0.3, 0.1), (0.7, 0.0)
    angles = np.array([-0.2, 0.4])
    take_recording(frames.scene, frames.packed_state, frames.packed, angles, frames.poses)
    attract(frames.scene, frames.packed_state, frames.packed, 0, frames.roots, angles, dt)
    x, v = relax(0.2, 0.7, float(trees.mass[0]), float(trees.stiffness[0]), float(trees.damping[0]), dt)
    assert w.iterate.angles[0] == pytest.approx(-0.2 + x, abs=1e-12)
    assert w.iterate.angles[1] == 0.4
    assert w.joint_rate[0] == pytest.approx(v, abs=1e-12)
    a, b = w.iterate.angles  # the links are posed there
    tip = w.iterate.poses[3]
    assert tip[:2] == pytest.approx([0.3 * math.cos(a), 0.3 * math.sin(a)], abs=1e-12)
    assert 2.0 * math.atan2(tip[5], tip[6]) == pytest.approx(a + b, abs=1e-12)


def test_a_joint_offset_stays_within_the_limits_and_a_rate_that_is_none_is_forgotten(tmp_path: Path) -> None:
    frames = arm_frames(planar_arm(tmp_path))
    frames.state.last.angles[:], frames.w.joint_rate[:] = (0.5, 0.0), (math.inf, math.nan)
    angles = np.array([2.9, 0.0])
    take_recording(frames.scene, frames.packed_state, frames.packed, angles, frames.poses)
    attract(frames.scene, frames.packed_state, frames.packed, 0, frames.roots, angles, 0.0)
    assert frames.w.iterate.angles.tolist() == [3.0, 0.0]
    assert frames.w.joint_rate.tolist() == [0.0, 0.0]


def test_a_driven_box_is_moved_out_of_what_has_moved_into_it_since() -> None:
    scene = [
        Thing(shape=CUBE, role=s.DRIVEN, at=(0, 0, 0.2)),
        Thing(shape=CUBE, role=s.FIXED, at=(0, 0, 0), moving=True),
    ]
    frames = Frames(make_scene(scene))
    frames.update(0, 0, 0.2)
    frames.poses[1, 2] = 0.11  # 1 cm in it
    assert separate_as_published(frames.scene, frames.packed_state, frames.packed, frames.poses) == 1
    assert frames.corrected == pytest.approx([0, 0, 0.11 + 2 * HALF + GAP], abs=1e-9)
    assert frames.state.offset[0, 2] == pytest.approx(0.01 + GAP, abs=1e-9)
    assert frames.state.recorded.roots[0, 2] == 0.2
