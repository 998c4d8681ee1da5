"""No room to turn, or to close: the last free turn and shape are held, never left through a wall, and given up smoothly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.results import FLAG_SHAPE_CHANGED
from tests.driven.grips import gripper
from tests.driven.logs import FREE, Run, Thing, assert_free, line, play, wander

CUBE = ("box", 0.1, 0.1, 0.1)
HALF = 0.06
FITS = float(np.arcsin(HALF / np.hypot(0.05, 0.05)) - np.pi / 4)
"""rad; a cube of 10 cm can turn so far between walls 12 cm apart, about an axis along them."""


def walls(thin: float, axes: tuple[int, ...], size: float = 4.0) -> list[Thing]:
    """Pairs of walls 12 cm apart."""
    return [
        Thing(
            name=f"wall{axis}{sign}",
            shape=("box", *np.where(np.arange(3) == axis, thin, size)),
            at=sign * (HALF + thin / 2) * np.eye(3)[axis],
        )
        for axis in axes
        for sign in (-1, 1)
    ]


def turning(angles: np.ndarray, axis: tuple[float, float, float] = (0, 0, 1)) -> np.ndarray:
    """Poses at the origin, turned by `angles` [rad]."""
    return np.hstack([np.zeros((len(angles), 3)), Rotation.from_rotvec(np.outer(angles, axis)).as_quat()])


def there_and_back(angle: float) -> np.ndarray:
    return np.concatenate(
        [np.linspace(0, angle, 30), np.full(20, angle), np.linspace(angle, 0, 30), np.zeros(60)]
    )  # fmt: skip


def angle_of(run: Run, body: str = "cube") -> np.ndarray:
    return np.asarray(Rotation.from_quat(run.path(body)[:, 3:]).as_rotvec()[:, 2])


def wedged(run: Run) -> np.ndarray:
    return np.asarray((run.figures("flags").astype(int) & FLAG_SHAPE_CHANGED) != 0)


@pytest.mark.parametrize("thin", [0.02, 0.001])
@pytest.mark.parametrize("axes", [(0,), (0, 1, 2)], ids=["slot", "closed box"])
def test_a_cube_that_cannot_turn_further_holds_its_turn_and_stays_in(
    tmp_path: Path, thin: float, axes: tuple[int, ...]
) -> None:
    path = turning(there_and_back(np.pi / 4))
    run = play(tmp_path, [*walls(thin, axes), Thing(name="cube", shape=CUBE, role="driven", path=path)])
    angle = angle_of(run)
    assert_free(run)
    assert np.abs(run.path("cube")[:, :3]).max() < HALF - 0.05 + FREE
    assert angle[30:50] == pytest.approx(FITS, abs=0.005)
    assert np.abs(np.diff(run.path("cube")[32:50], axis=0)).max() <= 1e-9
    assert np.abs(np.diff(angle)).max() <= 1.05 * np.pi / 4 / 29
    assert (wedged(run)[12:50]).all()
    assert not wedged(run)[:8].any()
    assert not wedged(run)[-35:].any()
    assert run.figures("correction_rad")[40] == pytest.approx(np.pi / 4 - angle[40], rel=1e-6)
    told = [text for result in run.results for _, text in result.messages]
    assert 1 <= len(told) <= 2
    assert all("yields in shape or orientation" in text for text in told)
    assert run.path("cube")[-10:].tobytes() == path[-10:].tobytes()
    assert run.path("cube")[:8].tobytes() == path[:8].tobytes()


def test_a_turn_that_was_held_goes_back_by_the_spring_when_there_is_room(tmp_path: Path) -> None:
    """The walls are drawn apart in one frame; critically damped from rest, the turn is behind by x0 (1 + wt) exp(-wt)."""
    n, opened = 120, 50
    away = np.where(np.arange(n) < opened, HALF + 0.01, 0.3)
    jaws = [
        Thing(name=f"jaw{sign}", shape=("box", 0.02, 2, 2), path=np.column_stack([sign * away, 0 * away, 0 * away]))
        for sign in (-1, 1)
    ]
    angles = np.interp(np.arange(n), [0, 30], [0.0, np.pi / 4])
    run = play(tmp_path, [*jaws, Thing(name="cube", shape=CUBE, role="driven", path=turning(angles))])
    angle = angle_of(run)
    behind = np.pi / 4 - angle[opened - 1 :]
    t = np.arange(len(behind)) / 60
    assert behind[0] > 0.5
    assert behind == pytest.approx(behind[0] * (1 + 50 * t) * np.exp(-50 * t), abs=1e-6)
    assert run.path("cube")[-10:].tobytes() == run.recorded[-10:, run.body("cube")].tobytes()
    assert_free(run)


def test_a_held_body_still_goes_along_with_its_recording(tmp_path: Path) -> None:
    n = 60
    angles = np.interp(np.arange(n), [0, 20], [0.0, np.pi / 4])
    path = turning(angles)
    path[:, 1] = np.interp(np.arange(n), [0, 20, 59], [0.0, 0.0, 0.4])
    run = play(tmp_path, [*walls(0.005, (0,)), Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert wedged(run)[30:].all()
    assert run.path("cube")[:, 1] == pytest.approx(path[:, 1], abs=1e-9)
    assert_free(run)


@pytest.mark.parametrize("thin", [0.02, 0.002])
def test_two_plates_that_close_put_a_body_beside_them_but_never_through(tmp_path: Path, thin: float) -> None:
    n = 170
    x = np.interp(np.arange(n), [10, 50, 70, 110], [0.2, 0.02, 0.02, 0.2])
    plates = [
        Thing(name=f"plate{sign}", shape=("box", thin, 0.3, 0.3), path=np.column_stack([sign * x, 0 * x, 0 * x]))
        for sign in (-1, 1)
    ]
    still = np.tile([0.0, 0.01, 0.03], (n, 1))
    run = play(tmp_path, [*plates, Thing(name="cube", shape=CUBE, role="driven", path=still)])
    assert_free(run)
    cube = run.path("cube")
    beside = np.abs(cube[:, 1:3]).max(axis=1) >= 0.2 - FREE
    between = np.abs(cube[:, 0]) + 0.05 <= x - thin / 2 + FREE
    assert (beside | between).all()
    assert beside[55:65].all()
    assert run.figures("fallbacks").sum() > 0
    assert any("yields in shape or orientation" in text for result in run.results for _, text in result.messages)
    assert cube[-3:].tobytes() == run.recorded[-3:, run.body("cube")].tobytes()


def test_fingers_that_close_round_a_plate_wider_than_they_are_held_open(tmp_path: Path) -> None:
    """A rigid hand in a box without a lid to spare: it can go nowhere, so its fingers keep the last free angle."""
    grip = gripper(tmp_path, "0.04 0.04 0.02", "0.01 0.04 0.06", 0, 0.1)
    # a floor and a lid with a post between them, and a fence around: the fingers are on either side of the post
    things = [
        Thing(name="post", shape=("box", 0.04, 0.3, 0.2), at=(0, 0, -0.12)),
        Thing(name="lid", shape=("box", 0.6, 0.6, 0.02), at=(0, 0, 0.03)),
        Thing(name="floor", shape=("box", 0.6, 0.6, 0.02), at=(0, 0, -0.11)),
        *(Thing(name=f"end{s}", shape=("box", 0.3, 0.02, 0.2), at=(0, 0.04 * s, -0.05)) for s in (-1, 1)),
    ]
    n = 150
    shut = 0.03 * np.sin(np.linspace(0, np.pi, 90)) ** 2
    shut = np.concatenate([shut, np.zeros(n - 90)])
    run = play(
        tmp_path, things, avatars=grip, roots={"/wrist": np.zeros((n, 3))},
        angles={"/angles": (["jl", "jr"], np.column_stack([shut, shut]))},
    )  # fmt: skip
    assert_free(run)
    assert wedged(run).any()
    assert np.abs(run.path("grip/palm")[:, :3]).max() < 0.03
    assert run.angles.max() == pytest.approx(0.025, abs=1e-3)
    gap = run.path("grip/r")[:, 0] - run.path("grip/l")[:, 0]
    assert gap == pytest.approx(0.1 - run.angles.sum(axis=1), abs=1e-9)
    assert run.corrected[-20:].tobytes() == run.recorded[-20:].tobytes()
    assert run.angles[-20:].tobytes() == run.recorded_angles[-20:].tobytes()


def test_a_start_inside_may_be_left_in_any_direction(tmp_path: Path) -> None:
    """Nothing is known of before the first frame: the shortest way out counts, through a wall if need be."""
    still = np.tile([0.0, 0.0, 0.0], (5, 1))
    plates = [Thing(name=f"plate{s}", shape=("box", 0.001, 1, 1), at=(0.045 * s, 0, 0)) for s in (-1, 1)]
    run = play(tmp_path, [*plates, Thing(name="cube", shape=CUBE, role="driven", path=still)])
    assert_free(run)
    assert np.linalg.norm(run.offset("cube"), axis=1) == pytest.approx(0.0955, abs=2e-3)


def test_a_slow_turn_into_a_slot_and_out_again_is_the_recording_where_it_fits(tmp_path: Path) -> None:
    angles = 0.9 * FITS * np.sin(np.linspace(0, 4 * np.pi, 120))
    run = play(
        tmp_path, [*walls(0.005, (0,)), Thing(name="cube", shape=CUBE, role="driven", path=turning(angles))]
    )  # fmt: skip
    assert run.corrected.tobytes() == run.recorded.tobytes()
    assert not run.figures("flags").any()


def test_a_body_moved_into_a_slot_turned_waits_before_it(tmp_path: Path) -> None:
    """Recorded askew in a slot it does not fit into that way: it stays before the slot, where it was free."""
    q = Rotation.from_rotvec([0, 0, np.pi / 4]).as_quat()
    jaws = [Thing(name=f"jaw{s}", shape=("box", 0.3, 0.3, 1), at=(s * (0.15 + HALF), 0.15, 0)) for s in (-1, 1)]
    path = line((0, -0.4, 0, *q), (0, 0.15, 0, *q), (0, -0.4, 0, *q), frames=[30, 30])
    path = np.vstack([path, np.tile(path[-1], (60, 1))])
    run = play(tmp_path, [*jaws, Thing(name="cube", shape=CUBE, role="driven", path=path)])
    assert_free(run)
    assert run.path("cube")[:, 1].max() <= -(np.hypot(0.05, 0.05) - HALF) + FREE
    assert not wedged(run).any()
    assert run.path("cube")[-3:].tobytes() == run.recorded[-3:, run.body("cube")].tobytes()


@pytest.mark.parametrize("seed", range(6))
def test_in_a_cell_hardly_larger_than_itself_a_body_stays_whatever_is_recorded(tmp_path: Path, seed: int) -> None:
    """Thin walls around it, standing or moved by a recording; the body is recorded to tumble about, in and out."""
    rng, n = np.random.default_rng(seed), 100
    a, b, c = map(float, rng.uniform(0.03, 0.1, 3))
    shape = [("box", a, b, c), ("capsule", a / 3, b), ("cylinder", a / 2, b)][seed % 3]
    size = np.array([(a, b, c), (2 * a / 3, 2 * a / 3, b + 2 * a / 3), (a, a, b)][seed % 3])
    half, thin = 0.5 * size * rng.uniform(1.02, 1.4, 3), float(rng.choice([0.001, 0.005]))
    moved = wander(rng, n, 0.2, 1.0)[:, :3] * (seed % 2)
    things = []
    for axis in range(3):
        for sign in (-1, 1):
            box = ("box", *np.where(np.arange(3) == axis, thin, 2 * half + 2 * thin))
            at = sign * (half + thin / 2) * np.eye(3)[axis]
            things.append(Thing(name=f"wall{axis}{sign}", shape=box, path=moved - moved[0] + at))
    path = wander(rng, n, 0.3, float(rng.uniform(0.5, 4.0)), turn=3.0)
    path[:, :3] -= path[0, :3]
    turns = Rotation.from_quat(path[:, 3:])
    path[:, 3:] = (turns * turns[0].inv()).as_quat()
    run = play(tmp_path, [*things, Thing(name="body", shape=shape, role="driven", path=path)])
    assert_free(run)
    assert (np.abs(run.path("body")[:, :3] - (moved - moved[0])) < half).all()
    assert wedged(run).any()
