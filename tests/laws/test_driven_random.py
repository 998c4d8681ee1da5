"""Random scenes: never an overlap, never a number that is none, never through a thin panel, always the same bits."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tests.driven.logs import Engine, Run, Thing, assert_free, play, wander
from tests.laws.between_frames import Between
from tests.scene.models import link, urdf


def shape(rng: np.random.Generator, size: float) -> tuple[str | float, ...] | np.ndarray:
    """A box, ball, capsule, cylinder or hull of about `size` m."""
    a, b, c = map(float, size * rng.uniform(0.3, 1.0, 3))
    kind = rng.integers(5)
    if kind == 4:
        return (rng.normal(size=(16, 3)) * size * 0.4).astype(np.float32).astype(float)
    return [("box", a, b, c), ("sphere", a / 2), ("capsule", a / 3, b), ("cylinder", a / 2, b)][kind]


def random_scene(seed: int, frames: int, driven: int = 3) -> list[Thing]:
    """Fixed things scattered about, some of them moving by a recording; driven ones that wander through them all."""
    rng = np.random.default_rng(seed)
    things = [Thing(name="floor", shape=("box", 3, 3, 0.1), at=(0, 0, -0.3))]
    for k in range(8):
        turn = Rotation.random(rng=rng).as_quat()
        at = rng.uniform(-0.3, 0.3, 3)
        if k < 2:
            path = wander(rng, frames, 0.1, 0.4) + np.array([*at, 0, 0, 0, 0])
            things.append(Thing(name=f"mover{k}", shape=shape(rng, 0.15), path=path))
        else:
            things.append(Thing(name=f"thing{k}", shape=shape(rng, 0.2), at=at, turn=turn))
    for k in range(driven):
        path = wander(rng, frames, 0.35, rng.uniform(0.5, 2.0), turn=1.5) + np.array([0.2 * k - 0.2, 0, 0, 0, 0, 0, 0])
        things.append(Thing(name=f"driven{k}", shape=shape(rng, 0.12), role="driven", path=path))
    return things


def plank(x: float, y: float, z: float, at: tuple[float, float, float]) -> str:
    """A box of a link."""
    place = " ".join(map(str, at))
    return f'<origin xyz="{place}"/><geometry><box size="{x} {y} {z}"/></geometry>'


def ell(a: float, t: float) -> list[str]:
    return [plank(a, t, t, (a / 2, 0, 0)), plank(t, a, t, (0, a / 2, 0))]


def fork(a: float, t: float) -> list[str]:
    return [plank(a, t, t, (0, 0, 0)), *(plank(t, a, t, (s * a / 2, a / 2, 0)) for s in (-1, 1))]


def ring(a: float, t: float) -> list[str]:
    return [
        *(plank(a + t, t, t, (0, s * a / 2, 0)) for s in (-1, 1)),
        *(plank(t, a + t, t, (s * a / 2, 0, 0)) for s in (-1, 1)),
    ]


def thin_shape(rng: np.random.Generator, size: float) -> tuple[str | float, ...]:
    """A panel, rod, disc or bar of 1 to 5 mm, or a box or capsule."""
    a, b, c = map(float, size * rng.uniform(0.3, 1.0, 3))
    t = float(rng.choice([0.001, 0.002, 0.005]))
    shapes: list[tuple[str | float, ...]] = [
        ("box", t, 2 * b, 2 * c),
        ("capsule", t, 2 * b),
        ("cylinder", a / 2, t),
        ("box", a, t, t),
        ("box", a, b, c),
        ("capsule", a / 3, b),
    ]
    return shapes[int(rng.integers(6))]


def play_thin(folder: Path, seed: int, frames: int) -> Run:
    """Panels, rods, rings and forks of 1 to 5 mm, fixed, moved by a recording and driven."""
    rng = np.random.default_rng(seed)
    things = [Thing(name="floor", shape=("box", 3, 3, 0.001), at=(0, 0, -0.3))]
    for k in range(8):
        at, turn = rng.uniform(-0.3, 0.3, 3), Rotation.random(rng=rng).as_quat()
        if k < 2:
            path = wander(rng, frames, 0.1, 0.4) + np.array([*at, 0, 0, 0, 0])
            things.append(Thing(name=f"mover{k}", shape=thin_shape(rng, 0.15), path=path))
        else:
            things.append(Thing(name=f"thing{k}", shape=thin_shape(rng, 0.2), at=at, turn=turn))
    speed = rng.uniform(0.5, 3.0)
    for k in range(1 + seed % 2):
        path = wander(rng, frames, 0.35, speed, turn=1.5) + np.array([0.2 * k - 0.2, 0, 0, 0, 0, 0, 0])
        things.append(Thing(name=f"driven{k}", shape=thin_shape(rng, 0.12), role="driven", path=path))
    models, roots, text = (ell, fork, ring), {}, ""
    for k, name in enumerate(("hook", "frame")):
        model = models[int(rng.integers(3))]
        urdf(
            folder / f"{name}.urdf",
            link("bar", *model(float(rng.uniform(0.06, 0.15)), float(rng.uniform(0.002, 0.01)))),
        )
        roots[f"/{name}"] = wander(rng, frames, 0.3, speed if k == 0 else 0.3, turn=1.5) + np.array(
            [0, 0.3 * k, 0, 0, 0, 0, 0]
        )
    text = '[[avatar]]\nname="hook"\nurdf="hook.urdf"\nmaterial="human"\nroot={topic="/hook"}\n'
    text += '[[object]]\nname="frame"\nclass="fixed"\nurdf="frame.urdf"\nmaterial="wood"\ntopic="/frame"\n'
    return play(folder, things, avatars=text, roots=roots)


@pytest.mark.parametrize("seed", range(8))
def test_random_scenes_are_free_in_every_frame(tmp_path: Path, seed: int) -> None:
    run = play(tmp_path, random_scene(seed, 100))
    assert run.figures("recorded_penetration_m").max() > 0.01
    assert len(run.results) == 100
    assert_free(run, every=2)


def assert_free_in_between(run: Run, frames: int) -> None:
    """A result for every frame, no overlap in any, and at 1 kHz between them nothing that is on its way through anything."""
    assert len(run.results) == frames
    assert_free(run, every=4)
    assert Between(run).tunnels() == {}


def test_what_is_put_through_a_panel_is_found(tmp_path: Path) -> None:
    """By whatever way it may take near it; past the panel's edge it is let."""
    panel = Thing(name="panel", shape=("box", 0.01, 0.6, 0.6), at=(0.0, 0.0, 0.0))
    path = np.tile([-0.2, 0.0, 0.0], (2, 1))
    run = play(tmp_path, [panel, Thing(name="bar", shape=("box", 0.04, 0.1, 0.02), role="driven", path=path)])
    bar = run.body("bar")
    run.corrected[1, bar] = [0.2, 0.0, 0.0, *Rotation.from_rotvec([0, 0, 0.4]).as_quat()]
    assert list(Between(run).tunnels()) == [0]
    run.corrected[:, bar, 1] = 0.36
    assert Between(run).tunnels() == {}


@pytest.mark.parametrize("seed", range(1000, 1006))
def test_nothing_passes_through_thin_things_between_frames(tmp_path: Path, seed: int) -> None:
    assert_free_in_between(play_thin(tmp_path, seed, 50), 50)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 200))
def test_many_random_scenes_are_free_in_every_frame_and_between(tmp_path: Path, seed: int) -> None:
    assert_free_in_between(play(tmp_path, random_scene(seed, 50, driven=1 + seed % 4)), 50)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200, 300))
def test_many_random_scenes_of_thin_things_are_free_in_every_frame_and_between(tmp_path: Path, seed: int) -> None:
    assert_free_in_between(play_thin(tmp_path, seed, 50), 50)


def in_between(run: Run, name: str, times: int) -> np.ndarray:
    """(n, 7) corrected poses of a body, `times` as many a second, on straight lines between frames."""
    path = run.path(name)
    t = np.arange((len(path) - 1) * times + 1) / times
    at = np.column_stack([np.interp(t, np.arange(len(path)), path[:, k]) for k in range(3)])
    return np.hstack([at, Slerp(np.arange(len(path)), Rotation.from_quat(path[:, 3:]))(t).as_quat()])


@pytest.mark.parametrize("seed", range(4))
def test_no_thin_panel_is_passed_between_frames(tmp_path: Path, seed: int) -> None:
    """Closed cells of 3 mm panels: who starts in one stays in it, checked at 1 kHz by the side its centre is on, and no
    instant has it as deep in a panel as it would have to be to pass."""
    rng = np.random.default_rng(seed)
    half, thin = 0.25, 0.003
    panels = [
        Thing(
            name=f"panel{axis}{sign}",
            shape=("box", *np.where(np.arange(3) == axis, thin, 2 * half)),
            at=sign * half * np.eye(3)[axis],
        )
        for axis in range(3)
        for sign in (-1, 1)
    ]
    path = wander(rng, 100, 0.6, 5.0, turn=3.0)
    path[:, :3] -= path[0, :3]
    run = play(tmp_path, [*panels, Thing(name="hand", shape=shape(rng, 0.1), role="driven", path=path)])
    assert np.abs(run.recorded[:, run.body("hand"), :3]).max() > half + 0.1
    assert np.abs(run.path("hand")[:, :3]).max() < half
    assert_free(run)
    engine, poses = Engine(run.world), run.corrected[0].copy()
    deepest = 0.0
    for pose in in_between(run, "hand", 16):  # 960 Hz
        poses[run.body("hand")] = pose
        assert np.abs(pose[:3]).max() < half
        deepest = max(deepest, engine.deepest(poses))
    assert deepest < 0.02  # a straight line between two free frames may cut a corner that the turning body does not


def test_two_runs_are_equal_in_bits(tmp_path: Path) -> None:
    one, two = (play(tmp_path / n, random_scene(3, 80)) for n in "ab")
    assert one.corrected.tobytes() == two.corrected.tobytes()
    for a, b in zip(one.results, two.results, strict=True):
        assert a.metrics == b.metrics
        for x, y in zip((*a.contacts, *a.penetrations), (*b.contacts, *b.penetrations), strict=True):
            assert x.tobytes() == y.tobytes()
