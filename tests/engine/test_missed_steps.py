"""Motion that a recording missed is caught up with at a bounded speed: frame by frame, without a replay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.engine.missed_motion import MIN_JUMP, MOST, SLOWEST, MissedMotion
from geomphys.results import FLAG_CATCHING_UP, Frame
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.simulated.scenes import Thing, floor, make_scene

DT = 1 / 60
HAND, BALL = Thing(shape=Sphere(0.05), role=s.DRIVEN), Thing(shape=Sphere(0.05), at=(1, 0, 1))


def correct(
    x: np.ndarray, held: np.ndarray, chunk: int, things: list[Thing], turns: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions along x (n,), angles about z (n,) and flags (n,) of a hand recorded at `x` [m] and `turns` [rad]."""
    scene, out, flags = make_scene(things), [], []
    missed = MissedMotion(scene)
    turns = np.zeros(len(x)) if turns is None else turns
    for start in range(0, len(x), chunk):
        rows = range(start, min(start + chunk, len(x)))
        roots = np.tile(scene.trees.rest, (len(rows), 1, 1))
        roots[:, 0, 0] = x[rows.start : rows.stop]
        roots[:, 0, 3:] = Rotation.from_rotvec(np.outer(turns[rows.start : rows.stop], [0, 0, 1])).as_quat()
        frames = [Frame(k, round(k * DT * 1e9), roots[k - start], np.zeros(0), bool(held[k]), 0) for k in rows]
        dts = np.array([DT if k else 0.0 for k in rows])
        flags += missed.correct(frames, roots, np.zeros((len(rows), 0)), dts)
        out.append(roots[:, 0])
    poses = np.concatenate(out)
    return poses[:, 0], Rotation.from_quat(poses[:, 3:]).as_rotvec()[:, 2], np.array(flags)


def after_a_gap(speed: float) -> tuple[np.ndarray, np.ndarray]:
    """A hand that moves at `speed`, is held for half a second, and is then where it has gone meanwhile."""
    t = np.arange(300) * DT
    held = (t > 1.0) & (t < 1.5)
    x = speed * t
    x[held] = x[np.flatnonzero(held)[0] - 1]
    return x, held


@pytest.mark.parametrize("chunk", [1, 7, 300])
@pytest.mark.parametrize("speed", [0.2, 1.0])
def test_after_a_gap_the_path_has_no_jump_and_ends_on_the_recording(speed: float, chunk: int) -> None:
    x, held = after_a_gap(speed)
    found, _, flags = correct(x, held, chunk, [HAND, BALL, floor()])
    first = int(np.flatnonzero(held)[-1]) + 1
    assert np.array_equal(found[:first], x[:first])
    assert found[-1] == x[-1]
    steps = np.diff(found) / DT
    assert steps.max() <= MOST * speed * 1.001
    assert (steps >= -1e-9).all()
    behind = flags == FLAG_CATCHING_UP
    assert behind[first]
    assert np.array_equal(behind, found != x)


def test_chunks_do_not_matter() -> None:
    x, held = after_a_gap(0.7)
    paths = [correct(x, held, chunk, [HAND, BALL, floor()])[0] for chunk in (1, 13, 300)]
    assert paths[0] == pytest.approx(paths[1], abs=1e-12)
    assert paths[0] == pytest.approx(paths[2], abs=1e-12)


@pytest.mark.parametrize("case", ["nothing simulated", "no gap", "held at rest"])
def test_otherwise_the_recording_is_not_touched(case: str) -> None:
    x, held = after_a_gap(1.0)
    if case == "no gap":
        x, held = np.arange(300) * DT, np.zeros(300, bool)
    if case == "held at rest":
        x = np.full(300, 0.3)
    things = [HAND, floor()] if case == "nothing simulated" else [HAND, BALL, floor()]
    found, _, flags = correct(x, held, 300, things)
    assert found.tobytes() == x.tobytes()
    assert not flags.any()


def test_a_rotation_that_was_missed_is_caught_up_with_too() -> None:
    x, held = after_a_gap(0.0)
    turns = np.where(np.arange(300) * DT >= 1.5, 1.0, 0.0)
    _, found, flags = correct(x, held, 300, [HAND, BALL, floor()], turns)
    rates = np.diff(found) / DT
    assert rates.max() <= SLOWEST[1] * 1.001
    assert rates.min() >= -1e-9
    assert flags.sum() > 0
    assert found[-1] > 0.3


@pytest.mark.parametrize(("jump", "spread"), [(0.2, True), (0.5 * MIN_JUMP * DT**2, False)])
def test_a_jump_of_the_tracker_is_spread_once_its_noise_is_known(jump: float, spread: bool) -> None:
    x = np.where(np.arange(300) < 150, 0.0, jump) + 1e-5 * np.sin(np.arange(300.0))
    found, _, flags = correct(x, np.zeros(300, bool), 300, [HAND, BALL, floor()])
    assert (flags[150] == FLAG_CATCHING_UP) == spread
    assert (abs(np.diff(found)[149]) < 0.01 * jump) == spread
