"""A group of bodies moves as if nothing else were in the scene, bit for bit, whatever is elsewhere, before or after it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.laws.replayed import Run, floor, play, thing, turned
from tests.laws.test_grasp import CUBE, HALF, Task, frictions
from tests.simulated.scenes import Player, Thing

AWAY = 10.0  # m
FRAMES = 90
GROUND = Thing(shape=Box((40.0, 40.0, 0.1)), role=s.FIXED, at=(0.0, 0.0, -0.1))


def heap(x: float, count: int, seed: int, spin: float) -> list[Thing]:
    """Boxes that fall onto each other about `x` [m], each rotating at about `spin` [rad/s]."""
    rng = np.random.default_rng(seed)
    return [
        Thing(
            shape=Box(tuple(rng.uniform(0.03, 0.08, 3))),
            at=(x + rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), 0.15 + 0.2 * k),
            turn=Rotation.random(random_state=10 * seed + k).as_quat(),
            w=spin * rng.normal(size=3),
        )
        for k in range(count)
    ]


def boxes(x: float) -> list[Thing]:
    """A heap of four boxes."""
    return heap(x, 4, 0, 3.0)


def rolling(x: float) -> list[Thing]:
    """A ball that comes to roll, beside one that leaves it, and a cube asleep."""
    balls = [Thing(shape=Sphere(0.05), at=(x + 0.2 * k, 0, 0.0501), v=(0.4, 0.2 * k, 0)) for k in range(2)]
    return [*balls, Thing(shape=Box((0.05, 0.05, 0.05)), at=(x, 0.5, 0.05))]


def pair_that_meets(x: float) -> list[Thing]:
    """A ball so fast that it leaves the range in which its pairs were searched, and three that it hits."""
    balls = [Thing(shape=Sphere(0.05), at=(x + 0.2 + 0.1002 * k, 0, 0.05001)) for k in range(3)]
    return [Thing(shape=Sphere(0.05), at=(x, 0, 0.06), v=(6, 0.1, 0), w=(0, 90, 0), mass=3.0), *balls]


def nothing() -> list[Thing]:
    """No other bodies."""
    return []


def spinning_fast() -> list[Thing]:
    """A cube that spins at 200 rad/s on the ground, and one in the air."""
    cube = Box((0.05, 0.05, 0.05))
    return [Thing(shape=cube, at=(AWAY, y, 0.05 + y), w=(0, 0, 200.0)) for y in (0.0, 1.0)]


def falling_pile() -> list[Thing]:
    """Balls that fall onto each other, with hundreds of impacts."""
    return [
        Thing(shape=Sphere(0.03), at=(AWAY + 0.003 * (k % 5), 0.002 * (k % 3), 0.05 + 0.07 * k), material="rubber")
        for k in range(12)
    ]


def far_heap() -> list[Thing]:
    """Boxes that rotate fast as they fall onto each other."""
    return heap(AWAY, 5, 1, 40.0)


def flying() -> list[Thing]:
    """A ball in free flight, which never touches anything."""
    return [Thing(shape=Sphere(0.03), at=(AWAY, 0, 30.0), v=(1, 0, 0), w=(0, 30, 0))]


def path(group: list[Thing], before: list[Thing], after: list[Thing], rate: float, most: int = 500) -> np.ndarray:
    """Poses (n, G, 7) of a group among others."""
    player, first = Player([*before, *group, *after, GROUND]), len(before)
    poses = []
    for _ in range(FRAMES):
        player.step(1 / rate, most)
        poses.append(player.poses[first : first + len(group)].copy())
    return np.array(poses)


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0])
@pytest.mark.parametrize("others", [spinning_fast, falling_pile, far_heap, flying])
@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_bodies_elsewhere_change_not_a_bit(
    group: Callable[[float], list[Thing]], others: Callable[[], list[Thing]], rate: float
) -> None:
    alone = path(group(0.0), [], [], rate)
    np.testing.assert_array_equal(path(group(0.0), others(), [], rate), alone)
    np.testing.assert_array_equal(path(group(0.0), [], others(), rate), alone)


@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_a_bound_met_elsewhere_changes_not_a_bit(group: Callable[[float], list[Thing]]) -> None:
    """Two collisions a frame are too few for the pile, and enough for its neighbours or not as they are without it."""
    alone = path(group(0.0), [], [], 60.0, 2)
    np.testing.assert_array_equal(path(group(0.0), falling_pile(), [], 60.0, 2), alone)


@pytest.mark.parametrize("group", [boxes, rolling, pair_that_meets])
def test_a_group_placed_elsewhere_moves_the_same_way(group: Callable[[float], list[Thing]]) -> None:
    """To rounding, until impacts have amplified that of the positions."""
    here, there = path(group(0.0), [], [], 60.0), path(group(AWAY), [], [], 60.0)
    there[:, :, 0] -= AWAY
    assert np.abs(here - there)[:20].max() < 1e-9


def heap_in_a_scene(x: float, names: str, spin: float, v: float = 0.0) -> list[str]:
    """Three boxes that fall onto each other, in a scene file."""
    return [
        thing(
            f"{names}_{k}",
            box=(0.06, 0.08, 0.1 - 0.02 * k),
            position=(x + 0.01 * k, 0.005 * k, 0.1 + 0.13 * k),
            orientation=turned(0.2 * k, 0.3, 0.4),
            velocity=(v, 0, 0),
            angular_velocity=(0.3 * spin, spin, 0.1 * spin),
        )
        for k in range(3)
    ]


def balls_in_a_scene() -> list[str]:
    """Balls that fall onto each other far away."""
    at = [(AWAY + 0.003 * (k % 3), 0.002 * (k % 2), 0.05 + 0.07 * k) for k in range(6)]
    return [thing(f"ball_{k}", sphere=0.03, position=p, velocity=(0, 0, -3)) for k, p in enumerate(at)]


def jaws_in_a_scene(x: float) -> tuple[list[str], dict[str, Callable[[float], Sequence[float]]]]:
    """A cube that jaws grip and lift, and where they are recorded."""
    things, paths = [thing("cube", position=(x, 0, HALF), **CUBE)], {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        jaw = Task().jaw(side)
        things.append(thing(name, "driven", topic=f"/{name}", box=(0.02, 0.06, 0.04), mass=0.4, material="human"))
        paths[f"/{name}"] = lambda t, jaw=jaw: (jaw(t)[0] + x, *jaw(t)[1:])
    return things, paths


GROUND_FILE = floor(material="metal", box=(100, 20, 0.2))


@pytest.mark.parametrize("rate", [30.0, 60.0, 240.0])
@pytest.mark.parametrize(
    "others",
    [lambda: heap_in_a_scene(AWAY, "other", 1.0), lambda: heap_in_a_scene(AWAY, "other", 60.0), balls_in_a_scene],
    ids=["heap", "spinning", "balls"],
)
def test_bodies_elsewhere_change_not_a_bit_of_a_grip(
    tmp_path: Path, others: Callable[[], list[str]], rate: float
) -> None:
    things, paths = jaws_in_a_scene(0.0)
    orders = ([*things], [*others(), *things], [*things, *others()])
    runs = [
        play(tmp_path / str(k), [*order, GROUND_FILE], 1.8, rate, pairs=frictions(0.8), paths=paths)
        for k, order in enumerate(orders)
    ]
    assert runs[0].path("cube")[-1, 2] > HALF + 0.05
    for run in runs[1:]:
        for name in ("cube", "left", "right"):
            np.testing.assert_array_equal(run.path(name), runs[0].path(name))


@pytest.mark.parametrize("rate", [8.0, 30.0, 60.0, 90.0])
def test_a_grip_elsewhere_changes_not_a_bit_of_a_heap(tmp_path: Path, rate: float) -> None:
    """Frames in which a driven body is near a simulated one are divided; what is simulated elsewhere passes the same steps."""
    far, paths = jaws_in_a_scene(AWAY)
    alone = play(tmp_path / "alone", [*heap_in_a_scene(0.0, "box", 5.0), GROUND_FILE], 1.8, rate, pairs=frictions(0.8))
    for k, before in enumerate((True, False)):
        heap_of_three = heap_in_a_scene(0.0, "box", 5.0)
        order = [*far, *heap_of_three] if before else [*heap_of_three, *far]
        run = play(tmp_path / str(k), [*order, GROUND_FILE], 1.8, rate, pairs=frictions(0.8), paths=paths)
        assert run.path("cube")[-1, 2] > HALF + 0.05
        for i in range(3):
            np.testing.assert_array_equal(run.path(f"box_{i}"), alone.path(f"box_{i}"))


def swinging_tray(t: float) -> list[float]:
    """A tray that is swung along y, tilted and turned, smoothly from rest at 0.1 s on."""
    s = max(0.0, t - 0.1)
    swing, growth = math.sin(4.0 * s), 1.0 - math.exp(-3.0 * s)
    return [0.0, 0.15 * growth * swing, 0.3, *turned(0.1 * growth * swing, 0.05 * growth * swing, 0.6 * growth * swing)]


@pytest.mark.parametrize("rate", [8.0, 30.0, 60.0, 90.0])
def test_a_grip_elsewhere_changes_not_a_bit_of_a_load_on_a_tracked_tray(tmp_path: Path, rate: float) -> None:
    def replayed(name: str, elsewhere: list[str], more: dict[str, Callable[[float], Sequence[float]]]) -> Run:
        tray = thing("tray", "fixed", topic="/tray", box=(0.6, 0.6, 0.02), material="metal")
        load = [
            thing("box", position=(0, 0.05, 0.341), box=(0.1, 0.1, 0.06)),
            thing("ball", position=(0.1, -0.1, 0.331), sphere=0.02),
        ]
        things, paths = [tray, *load, *elsewhere, GROUND_FILE], {"/tray": swinging_tray, **more}
        return play(tmp_path / name, things, 1.8, rate, pairs=frictions(0.8), paths=paths)

    alone, beside = replayed("alone", [], {}), replayed("beside", *jaws_in_a_scene(AWAY))
    assert beside.path("cube")[-1, 2] > HALF + 0.05
    assert np.ptp(alone.path("box")[:, 1]) > 0.1
    for name in ("tray", "box", "ball"):
        np.testing.assert_array_equal(beside.path(name), alone.path(name))


@pytest.mark.parametrize("rate", [60.0, 240.0])
def test_a_grip_placed_elsewhere_holds_the_same_way(tmp_path: Path, rate: float) -> None:
    runs = []
    for x in (0.0, AWAY):
        things, paths = jaws_in_a_scene(x)
        runs.append(play(tmp_path / str(x), [*things, GROUND_FILE], 1.8, rate, pairs=frictions(0.8), paths=paths))
    for name in ("cube", "left", "right"):
        assert np.abs(runs[1].path(name) - runs[0].path(name) - [AWAY, 0, 0, 0, 0, 0, 0]).max() < 1e-9
