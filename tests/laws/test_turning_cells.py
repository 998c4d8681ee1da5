"""What is round a body turns by a recording: the body is taken along where it has to be, and never put through a wall."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.results import FLAG_SHAPE_CHANGED
from tests.driven.logs import FREE, Run, assert_free
from tests.laws.between_frames import Between
from tests.laws.turning_cells import CLOSED, HALF, ROOM, crossings, jumps, play_cube, play_turning, turning_frame

SLACK = float(np.arcsin(ROOM / (HALF * np.sqrt(2))) - np.pi / 4)
"""rad; so far can the cube turn in the cell about one of its axes."""


def in_cell(run: Run, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the cube is in the cell's frame (n, 3) [m] and how it is turned there about z (n,) [rad]."""
    turns, path = Rotation.from_quat(frame[:, 3:]), run.path("cube")
    turn = (turns.inv() * Rotation.from_quat(path[:, 3:])).as_rotvec()[:, 2]
    return turns.inv().apply(path[:, :3] - frame[:, :3]), turn


@pytest.mark.parametrize("whole", [True, False], ids=["one object", "six objects"])
@pytest.mark.parametrize("centre", [(0, 0, 0), (0.3, -0.1, 0.2)], ids=["about itself", "off-centre"])
def test_a_turning_cell_takes_a_cube_along_that_it_leaves_no_room_to_stay(
    tmp_path: Path, whole: bool, centre: tuple[float, float, float]
) -> None:
    """Once round and back: the cube is behind the cell by no more than the room in it, and rejoins its recording."""
    angles = np.concatenate([2 * np.pi * np.sin(np.linspace(0, np.pi, 120)) ** 2, np.zeros(40)])
    frame = turning_frame(angles, centre)
    run = play_cube(tmp_path, frame, whole)
    at, turn = in_cell(run, frame)
    assert_free(run, every=4)
    assert np.abs(at).max() <= ROOM - HALF + FREE
    assert np.abs(turn).max() <= SLACK + 1e-6
    assert jumps(60.0, run) == {}
    wedged = (run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED) != 0
    assert wedged[10:110].any()
    assert not wedged[-25:].any()  # told until the offset is gone
    assert run.path("cube")[-10:].tobytes() == run.recorded[-10:, run.body("cube")].tobytes()


@pytest.mark.parametrize("seed", [1, 8, 10, 18, 24, 152])
def test_who_is_in_a_closed_cell_stays_in_it_however_it_turns(tmp_path: Path, seed: int) -> None:
    turning, run = play_turning(tmp_path, seed, 30)
    assert turning.kind in CLOSED
    assert_free(run, every=3)
    assert crossings(turning, run) == []
    assert jumps(turning.rate, run) == {}


@pytest.mark.parametrize("seed", [67, 123, 127])
def test_nothing_passes_through_walls_that_turn(tmp_path: Path, seed: int) -> None:
    turning, run = play_turning(tmp_path, seed)
    assert_free(run, every=3)
    assert Between(run, turning.rate).tunnels() == {}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1000, 1040))
def test_nothing_passes_through_walls_that_turn_in_many_scenes(tmp_path: Path, seed: int) -> None:
    turning, run = play_turning(tmp_path, seed)
    assert_free(run, every=3)
    if turning.kind in CLOSED:
        assert crossings(turning, run) == []
    assert Between(run, turning.rate).tunnels() == {}
