"""Foresight: a rigid hand that closes on a rod gives way in time, without a jump, and only where it touches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.engine.look_ahead import directions
from tests.driven.grips import gripper
from tests.driven.logs import Run, Thing, assert_free, play


def closing(folder: Path, frames: int = 140) -> Run:
    """The plates close to 3 cm on a rod 4 cm thick and open again; the wrist moves a little all the
    time. One plate touches first: the hand is pushed aside until the other does, and that is when it would be wedged."""
    t = np.arange(frames) / 60
    shut = 0.04 * np.sin(np.linspace(0, np.pi, frames)) ** 2
    wrist = np.column_stack([0.003 * np.sin(3 * t), 0.012 + 0.002 * np.cos(2 * t), 0.065 + 0.002 * np.sin(2 * t)])
    rod = Thing(name="rod", shape=("cylinder", 0.02, 0.6), turn=(0, np.sqrt(0.5), 0, np.sqrt(0.5)))
    return play(
        folder,
        [rod],
        avatars=gripper(folder, "0.04 0.2 0.02", "0.04 0.01 0.06", 1, 0.12),
        roots={"/wrist": wrist},
        angles={"/angles": (["jl", "jr"], np.column_stack([shut, shut]))},
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return closing(tmp_path_factory.mktemp("grip"))


def test_it_comes_free_without_a_jump(run: Run) -> None:
    assert run.figures("recorded_penetration_m").max() > 0.004
    assert_free(run)
    offset = run.offset("grip/palm")
    motion = np.linalg.norm(np.diff(run.recorded[..., :3], axis=0), axis=2).max(axis=1)
    size = np.linalg.norm(offset[:-1], axis=1)
    change = np.linalg.norm(np.diff(offset, axis=0), axis=1)
    assert (change <= 2 * motion + (1 - np.exp(-50 / 60)) * size + 1e-3).all()


def test_frames_before_the_touch_are_the_recording(run: Run) -> None:
    moved = run.touched()
    first = int(np.argmax((run.figures("contacts") > 0) | (run.figures("recorded_penetration_m") > 0)))
    assert first > 5
    assert not moved[:first].any()
    assert run.corrected[:first].tobytes() == run.recorded[:first].tobytes()


def test_it_rejoins_the_recording(run: Run) -> None:
    assert run.corrected[-3:].tobytes() == run.recorded[-3:].tobytes()


def test_two_replays_are_the_same(run: Run, tmp_path: Path) -> None:
    again = closing(tmp_path)
    assert again.corrected.tobytes() == run.corrected.tobytes()


def test_directions_are_the_neighbours_of_a_cube() -> None:
    found = directions()
    assert found.shape == (26, 3)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0)
    assert len(np.unique(np.round(found, 9), axis=0)) == 26
    assert np.abs(found.sum(axis=0)).max() <= 1e-12
