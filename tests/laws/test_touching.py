"""Things placed so that they just touch: nothing lifts them, nothing gives them energy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.laws.replayed import GRAVITY, Run, floor, play, thing

GAP = 2e-6  # m: clearance that the program keeps of its own accord
NOTHING = 1e-11  # m of height: rounding

Shape = dict[str, object]
SHAPES: dict[str, tuple[Shape, float]] = {
    "box": ({"box": (0.22, 0.14, 0.09)}, 0.045),
    "ball": ({"sphere": 0.037}, 0.037),
    "cylinder": ({"cylinder": (0.043, 0.17)}, 0.085),
}


def bodies(run: Run) -> list[str]:
    return [name for name in run.world.body_names if len(name) == 1]


def rise(run: Run) -> float:
    """By how much the common centre of mass is ever above where it was in an earlier frame [m]."""
    heights = np.array([run.mass(name) * run.path(name)[:, 2] for name in bodies(run)]).sum(axis=0)
    heights = heights / sum(run.mass(name) for name in bodies(run))
    return float((heights - np.minimum.accumulate(heights)).max())


@pytest.mark.parametrize("above", [-0.5 * GAP, 0.0, 0.4 * GAP, GAP])
@pytest.mark.parametrize("name", SHAPES)
def test_what_is_placed_touching_the_floor_is_not_lifted(tmp_path: Path, name: str, above: float) -> None:
    shape, low = SHAPES[name]
    run = play(tmp_path, [thing("a", position=(0.3, 0.1, low + above), **shape), floor()], 60.0, 30)
    assert rise(run) <= NOTHING
    assert run.drift("a")[0] <= NOTHING
    assert run.overlap <= max(0.0, -above) + NOTHING


def test_what_is_placed_touching_a_tracked_table_is_not_lifted(tmp_path: Path) -> None:
    """Neither while the table stands still nor while it is moved aside below what lies on it."""
    table = thing("table", "fixed", box=(2, 2, 0.1), topic="/table")
    paths = {"/table": lambda t: (0.1 * max(0.0, t - 1.0) ** 2, 0, -0.05, 0, 0, 0, 1)}
    run = play(tmp_path, [thing("a", box=(0.1, 0.1, 0.1), position=(0, 0, 0.05)), table], 3.0, 60, paths=paths)
    assert np.abs(run.path("a")[:, 2] - 0.05).max() <= NOTHING
    assert run.drift("a")[0] > 0.1


def test_a_stack_placed_touching_is_not_lifted(tmp_path: Path) -> None:
    sizes, z, things = [(0.21, 0.17, 0.11), (0.13, 0.16, 0.07), (0.17, 0.09, 0.05)], 0.0, [floor()]
    for name, size in zip("abc", sizes, strict=True):
        things.append(thing(name, box=size, position=(0.003, -0.002, z + 0.5 * size[2])))
        z += size[2]
    run = play(tmp_path, things, 60.0, 30)
    assert rise(run) <= NOTHING
    assert max(run.drift(name)[0] for name in "abc") <= NOTHING
    assert run.overlap <= NOTHING


@pytest.mark.parametrize("theta", [0.07, np.arctan(0.99 * 0.3)])
@pytest.mark.parametrize("name", ["box", "cylinder"])
def test_what_is_placed_touching_a_slope_that_holds_it_is_not_lifted(tmp_path: Path, name: str, theta: float) -> None:
    shape, low = SHAPES[name]
    low = min(low, 0.045)
    shape = {"cylinder": (0.05, 2 * low)} if name == "cylinder" else shape
    slope = Rotation.from_rotvec([0, theta, 0])
    n, own = slope.apply([0, 0, 1]), (slope * Rotation.from_rotvec([0, 0, 0.3])).as_quat()
    ground = thing("slope", "fixed", box=(4, 2, 0.2), position=-0.1 * n, orientation=slope.as_quat())
    run = play(tmp_path, [thing("a", position=low * n, orientation=own, **shape), ground], 60.0, 30)
    assert rise(run) <= NOTHING
    assert run.drift("a", since=1)[0] <= 1e-8
    assert run.overlap <= 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_a_scene_written_with_six_digits_lifts_nothing(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    slope = Rotation.from_rotvec([0, rng.uniform(0.02, 0.28), 0])
    n, own = slope.apply([0, 0, 1]), slope * Rotation.from_rotvec([0, 0, rng.uniform(0, 3)])
    ground = {"position": np.round(-0.1 * n, 6), "orientation": np.round(slope.as_quat(), 6)}
    box = {"position": np.round(0.02 * n, 6), "orientation": np.round(own.as_quat(), 6)}
    things = [thing("a", box=(0.23, 0.11, 0.04), **box), thing("slope", "fixed", box=(4, 2, 0.2), **ground)]
    run = play(tmp_path, things, 20.0, 30)
    assert rise(run) <= 1e-9
    assert run.drift("a")[0] <= 2 * GAP
    assert run.overlap <= GAP


@pytest.mark.parametrize("rate", [30, 240])
def test_a_ball_placed_touching_rolls_on_with_the_energy_it_has(tmp_path: Path, rate: int) -> None:
    shape, radius = SHAPES["ball"]
    ball = thing("a", position=(-4, 0, radius), velocity=(0.5, 0, 0), angular_velocity=(0, 0.5 / radius, 0), **shape)
    run = play(tmp_path, [ball, floor()], 10.0, rate)
    p, t = run.path("a"), run.t
    v = np.diff(p[:, :3], axis=0) / np.diff(t)[:, None]
    energy = 0.7 * (v**2).sum(axis=1) + GRAVITY * 0.5 * (p[1:, 2] + p[:-1, 2])  # of a kilogram that rolls
    assert (energy - np.minimum.accumulate(energy)).max() <= 1e-9
    assert energy[0] - energy[-1] <= 1e-6 * energy[0]


@pytest.mark.parametrize("deep", [2e-6, 1e-5, 1e-4, 1e-2])
@pytest.mark.parametrize("name", SHAPES)
def test_what_is_placed_inside_the_floor_comes_out_and_no_farther(tmp_path: Path, name: str, deep: float) -> None:
    shape, low = SHAPES[name]
    run = play(tmp_path, [thing("a", position=(0, 0, low - deep), **shape), floor()], 1.0, 60)
    heights = run.path("a")[1:, 2] - low
    assert heights.min() >= -1e-9
    assert heights.max() <= GAP
    assert run.overlap <= 1e-9
    assert np.ptp(heights) <= 1e-9


@pytest.mark.parametrize("speed", [0.01, 0.02, 0.03, 0.038])
@pytest.mark.parametrize("rate", [60, 240])
def test_a_little_hop_goes_no_higher_than_its_speed_takes_it(tmp_path: Path, speed: float, rate: int) -> None:
    """v²/2g: micrometres, and within a step of the solver."""
    run = play(tmp_path, [thing("a", sphere=0.037, position=(0, 0, 0.037), velocity=(0, 0, speed)), floor()], 0.1, rate)
    flight = np.minimum(run.t, 2 * speed / GRAVITY)
    want = speed * flight - 0.5 * GRAVITY * flight**2
    assert np.abs(run.path("a")[:, 2] - 0.037 - want).max() <= 2 * GAP
    assert run.path("a")[:, 2].max() - 0.037 <= speed**2 / (2 * GRAVITY)


@pytest.mark.parametrize("deep", [1e-5, 1e-3, 5e-3])
def test_what_is_lifted_out_of_the_floor_keeps_its_velocity(tmp_path: Path, deep: float) -> None:
    """Whoever put it there pays for the lift, not its motion."""
    rolling = {"velocity": (0.4, 0, 0), "angular_velocity": (0, 0.4 / 0.05, 0)}
    run = play(tmp_path, [thing("a", sphere=0.05, position=(0, 0, 0.05 - deep), **rolling), floor()], 0.1, 60)
    assert run.path("a")[-1, 0] == pytest.approx(0.4 * run.t[-1], rel=1e-6)
