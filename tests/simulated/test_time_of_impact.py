"""When two pieces first are a distance apart, against formulas."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.motion import load_velocities
from geomphys.simulated.resting_contact import SWEEPS, solve_resting_contact
from geomphys.simulated.state import MOTION
from geomphys.simulated.time_of_impact import attached_curvature, first_touch, pose_pair, reach_along, span, swing
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

DT, GAP = 1 / 60, 2e-6


def approaching(height: float, speed: float, spin: float = 0.0) -> Stage:
    """A ball or, if it rotates, a cube that flies towards the floor without gravity."""
    shape = Box((0.05, 0.05, 0.05)) if spin else Sphere(0.05)
    thing = Thing(shape=shape, at=(0, 0, height + 0.05), v=(0.3, 0, -speed), w=(0, spin, 0))
    stage = Stage(Player([thing, floor()], gravity=(0, 0, 0), gap=GAP), DT)
    stage.call(load_velocities)
    stage.call(solve_resting_contact, 0.0, DT, SWEEPS)  # plans the motion of the span
    return stage


@pytest.mark.parametrize("target", [0.0, GAP, 1e-3, -1e-3])
@pytest.mark.parametrize("height", [0.002, 0.012])
def test_a_ball_is_a_distance_away_when_the_formula_says(height: float, target: float) -> None:
    stage = approaching(height, 1.0)
    slack = 1e-7
    found = stage.call(first_touch, 0, 0.0, DT, target, slack)
    assert found == pytest.approx(height - target, abs=1.01 * slack)


def test_what_does_not_come_so_near_in_the_span_never_does() -> None:
    stage = approaching(0.012, 1.0)
    assert stage.call(first_touch, 0, 0.0, 0.011, 0.0, 1e-7) == math.inf
    assert stage.call(first_touch, 0, 0.0, DT, 0.0, 1e-7) < math.inf


def test_what_is_as_near_already_is_at_once() -> None:
    assert approaching(0.002, 1.0).call(first_touch, 0, 0.0, DT, 0.01, 1e-7) == 0.0


@pytest.mark.parametrize("spin", [20.0, -60.0])
def test_a_cube_that_rotates_arrives_with_its_corner(spin: float) -> None:
    """The lowest corner is at height + h - h (cos φ + |sin φ|) - v t above the floor, φ = spin t."""
    height, speed, slack = 0.012, 0.5, 1e-7
    found = approaching(height, speed, spin).call(first_touch, 0, 0.0, DT, 0.0, slack)
    assert isinstance(found, float)
    assert found < DT
    angle = spin * found
    left = height + 0.05 - 0.05 * (math.cos(angle) + abs(math.sin(angle))) - speed * found
    assert 0.0 <= left + slack < 20 * slack


def test_a_corner_that_dips_in_and_out_within_the_span_is_not_missed() -> None:
    """The cube makes a quarter of a rotation: it is as high at the end as at the start, and 6 mm too low in the middle."""
    found = approaching(0.015, 0.0, 0.5 * math.pi / DT).call(first_touch, 0, 0.0, DT, 0.0, 1e-7)
    assert isinstance(found, float)
    angle = 0.5 * math.pi * found / DT
    assert angle < 0.25 * math.pi
    assert 0.065 - 0.05 * (math.cos(angle) + math.sin(angle)) == pytest.approx(0.0, abs=2e-6)


def motion_of(rng: np.random.Generator, *, turns: float, moves: float, step: float) -> np.ndarray:
    """A record of `MOTION` planned for a step: turning at about `turns` [rad/s], moving at `moves` [m/s]."""
    m = np.zeros(1, MOTION)[0]
    m["rotation_rate"], m["half_angular_acceleration"] = (
        turns * rng.normal(size=3),
        turns / step * 0.3 * rng.normal(size=3),
    )
    m["velocity"], m["acceleration"] = moves * rng.normal(size=3), 9.81 * rng.normal(size=3) * bool(moves)
    m["position"], m["orientation"], m["step_duration"] = 0.05 * rng.normal(size=3), (0, 0, 0, 1), step
    return m


def moved(m: np.ndarray, point: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Where a point, given from the reference point, is at times after the base time (n, 3)."""
    t = times[:, None]
    turn = Rotation.from_rotvec(t * m["rotation_rate"] + t * (t - m["step_duration"]) * m["half_angular_acceleration"])
    return m["position"] + t * m["velocity"] + 0.5 * t * t * m["acceleration"] + turn.apply(point)


def largest_second_derivative(values: np.ndarray, dt: float) -> float:
    """Of equally spaced values (n, ...): the norm over all axes but the first."""
    second = np.diff(values, 2, axis=0) / dt**2
    return float(np.abs(second).max() if second.ndim == 1 else np.linalg.norm(second, axis=1).max())


@pytest.mark.parametrize("seed", range(6))
def test_turning_accelerates_no_point_beyond_its_bound_and_the_bound_is_near(seed: int) -> None:
    rng, step = np.random.default_rng(seed), 1 / 240
    m = motion_of(rng, turns=30.0, moves=0.0, step=step)
    times, arms = np.linspace(0.0, step, 401), rng.normal(size=(60, 3))
    arms *= 0.1 / np.linalg.norm(arms, axis=1, keepdims=True)
    worst = max(largest_second_derivative(moved(m, arm, times), times[1]) for arm in arms)
    assert worst <= swing(m, 0.1) <= 4.0 * worst


@pytest.mark.parametrize(
    ("turns", "moves", "reach"),
    [((25, 0), (0, 0), 0.1), ((0, 25), (0, 0), 0.1), ((8, 0), (0, 5), 0.0), ((20, 30), (1, 2), 0.1)],
    ids=["reference turns", "other turns", "other passes", "all"],
)  # fmt: skip
def test_along_an_attached_direction_nothing_bends_faster_than_its_bound(
    turns: tuple[float, float], moves: tuple[float, float], reach: float
) -> None:
    """f(τ) = n(τ)·(point of the other - reference point), n carried along by the reference."""
    step = 1 / 240
    times, rng = np.linspace(0.0, step, 401), np.random.default_rng(1)
    for _ in range(40):
        reference, other = (motion_of(rng, turns=w, moves=v, step=step) for w, v in zip(turns, moves, strict=True))
        if not reach:
            other["position"] = reference["position"]
        arm, n = rng.normal(size=(2, 3))
        arm, n = reach * arm / np.linalg.norm(arm), n / np.linalg.norm(n)
        here = moved(reference, np.zeros(3), times)
        f = np.einsum("ni,ni->n", moved(reference, n, times) - here, moved(other, arm, times) - here)
        assert largest_second_derivative(f, times[1]) <= attached_curvature(reference, other, reach, 0.0, step)


@pytest.mark.parametrize("spin", [0.0, 40.0, 150.0])
def test_a_span_is_nowhere_lower_than_it_says(spin: float) -> None:
    """Two cubes pass each other; the separation along a direction fixed in the world is measured at many moments."""
    rng = np.random.default_rng(3)
    for _ in range(8):
        cubes = [
            Thing(shape=Box((0.05, 0.03, 0.04)), at=at, v=rng.normal(size=3), w=spin * rng.normal(size=3))
            for at in ((0, 0, 0), (0.13, 0.01, 0.02))
        ]
        stage = Stage(Player(cubes, gravity=(0, 0, 0), gap=GAP), DT)
        stage.call(load_velocities)
        stage.call(solve_resting_contact, 0.0, DT, SWEEPS)
        n = (1.0, 0.0, 0.0) if stage.pairs["body"][0][0] == 1 else (-1.0, 0.0, 0.0)

        def along(t: float, stage: Stage = stage, n: tuple[float, float, float] = n) -> float:
            stage.call(pose_pair, 0, t)
            return float(stage.call(reach_along, 0, n))

        end, low = stage.call(span, 0, n, along(0.0), 0.0, DT, -math.inf)
        values = [along(t) for t in np.linspace(0.0, DT, 101)]
        assert end == pytest.approx(values[-1], abs=1e-12)
        assert low <= min(values) + 1e-12
