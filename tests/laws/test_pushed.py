"""What follows a recording pushes simulated bodies: tracked things of the scene, and driven ones on their couplings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.laws.replayed import GRAVITY, SPACE, UPRIGHT, Run, floor, play, thing, turned

MU = 0.3  # wood on wood
FREE = 1e-5  # m


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_a_tracked_panel_strikes_with_its_own_velocity(tmp_path: Path, rate: int) -> None:
    things = [
        thing("ball", sphere=0.02, position=(0, 0, 0)),
        thing("panel", "fixed", box=(0.005, 1, 1), topic="/panel"),
    ]
    run = play(tmp_path, things, 0.2, rate, gravity=SPACE, paths={"/panel": lambda t: (20 * t - 1, 0, 0, *UPRIGHT)})
    assert run.velocity("ball", -2)[0] == pytest.approx(1.3 * 20, rel=1e-6)


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_a_tracked_bat_that_turns_strikes_with_the_velocity_of_where_it_hits(tmp_path: Path, rate: int) -> None:
    things = [
        thing("ball", sphere=0.02, position=(0.3, 0.3, 0)),
        thing("bat", "fixed", box=(1.0, 0.005, 1), topic="/bat"),
    ]
    run = play(
        tmp_path, things, 0.3, rate, gravity=SPACE, paths={"/bat": lambda t: (0, 0, 0, *turned(0, 0, 10 * t - 1))}
    )
    arm = np.sqrt(0.18 - 0.0225**2)
    angle = np.pi / 4 - np.arcsin(0.0225 / np.sqrt(0.18))
    n = np.array([-np.sin(angle), np.cos(angle), 0])
    assert run.velocity("ball", -2) @ n == pytest.approx(1.3 * 10 * arm, rel=1e-4)


@pytest.mark.parametrize("shape", [{"sphere": 0.05}, {"box": (0.1, 0.1, 0.1)}])
def test_a_tracked_panel_sweeps_what_stands_in_its_way_along(tmp_path: Path, shape: dict[str, object]) -> None:
    things = [
        thing("a", position=(0, 0, 0.05), **shape),
        floor(),
        thing("panel", "fixed", box=(0.02, 0.6, 0.6), topic="/panel"),
    ]
    run = play(tmp_path, things, 1.0, paths={"/panel": lambda t: (0.5 * t - 0.2, 0, 0.35, *UPRIGHT)})
    room = run.path("a")[:, 0] - run.path("panel")[:, 0] - 0.06
    assert -FREE <= room.min() <= room[-1] < 2e-5
    assert run.velocity("a", -2)[0] == pytest.approx(0.5, rel=1e-4)


def slab(**more: object) -> str:
    """A driven wall that follows `/slab`; its face towards +x is 1 cm from its middle."""
    return thing("slab", "driven", box=(0.02, 0.6, 0.6), topic="/slab", mass=0.4, material="human", **more)


def test_a_driven_slab_pushes_a_ball_the_same_at_every_frame_rate(tmp_path: Path) -> None:
    ends = {}
    for rate in (30, 60, 120, 240):
        things = [thing("ball", sphere=0.05, position=(0, 0, 0.05), density=600.0), floor(), slab()]
        run = play(
            tmp_path / str(rate), things, 2.0, rate, paths={"/slab": lambda t: (0.3 * t - 0.12, 0, 0.35, *UPRIGHT)}
        )
        assert run.overlap <= FREE
        ends[rate] = run.path("ball")[-1, 0]
        assert ends[rate] >= 0.3 * 2.0 - 0.12 + 0.06 - FREE
    for rate in (30, 60, 120):
        assert ends[rate] == pytest.approx(ends[240], rel=0.01)


def beat(t: float) -> tuple[float, ...]:
    """A slab's way that curves, sampled at 30 Hz and straight between."""
    k = np.floor(30 * t + 1e-9)
    x, y = ((1 - 30 * t + k) * f(1.5 * k / 30) + (30 * t - k) * f(1.5 * (k + 1) / 30) for f in (np.sin, np.cos))
    return (0.3 * x - 0.12, 0.1 * y, 0.35, *UPRIGHT)


@pytest.mark.parametrize("shape", [{"sphere": 0.05}, {"box": (0.1, 0.1, 0.1)}])
def test_the_same_way_of_a_slab_sampled_at_any_rate_does_the_same(tmp_path: Path, shape: dict[str, object]) -> None:
    ends = []
    for rate in (60, 120, 240):
        things = [thing("a", position=(0, 0, 0.05), density=600.0, **shape), floor(), slab()]
        run = play(tmp_path / str(rate), things, 1.5, rate, paths={"/slab": beat})
        ends.append(run.path("a")[:: rate // 30, :3])
        assert run.overlap <= FREE
    way = np.linalg.norm(np.diff(ends[-1], axis=0), axis=1).sum()
    for end in ends[:-1]:
        assert np.linalg.norm(end - ends[-1], axis=1).max() < 0.01 * way


WAYS = {
    "swing": lambda t: (0.5 * (1 - np.cos(2 * t)) - 0.12, 0.0, 0.35, *UPRIGHT),
    "arc": lambda t: (0.3 * np.sin(1.5 * t) - 0.12, 0.1 * np.cos(1.5 * t), 0.35, *turned(0, 0, 0.3 * np.sin(2 * t))),
    "hit": lambda t: (0.12 * np.sin(4 * t) - 0.12, 0.0, 0.35, *UPRIGHT),
}


BALL = thing("a", sphere=0.05, position=(0, 0, 0.05), density=600.0)
CYLINDER = thing("a", cylinder=(0.04, 0.1), position=(0, 0.02, 0.05), density=600.0)


def pushed(folder: Path, role: str, name: str, what: str, rate: float, times: list[float] | None = None) -> Run:
    """A slab follows one of the `WAYS` for two seconds and meets something."""
    things = [what, floor(), thing("slab", role, box=(0.02, 0.6, 0.6), topic="/slab", material="human")]
    return play(folder, things, 2.0, rate, paths={"/slab": WAYS[name]}, times=times)


@pytest.mark.parametrize("what", [BALL, CYLINDER])
@pytest.mark.parametrize("name", WAYS)
@pytest.mark.parametrize(("role", "off"), [("fixed", 0.002), ("driven", 0.005)])
def test_a_curving_way_does_the_same_at_every_frame_rate(
    tmp_path: Path, role: str, off: float, name: str, what: str
) -> None:
    """Sampled at a rate of its own each: what lies between two frames must be guessed well."""
    ends = [
        pushed(tmp_path / str(rate), role, name, what, rate).path("a")[:: rate // 30, :3] for rate in (30, 60, 120, 240)
    ]
    way = np.linalg.norm(np.diff(ends[-1], axis=0), axis=1).sum()
    for end in ends[:-1]:
        assert np.linalg.norm(end - ends[-1], axis=1).max() < off * way


@pytest.mark.parametrize("name", WAYS)
def test_a_curving_way_does_the_same_where_frames_are_unevenly_spaced(tmp_path: Path, name: str) -> None:
    uneven = [(k + 0.2 * math.sin(5.0 * k)) / 30 for k in range(60)]
    fine = pushed(tmp_path / "fine", "fixed", name, BALL, 240.0)
    run = pushed(tmp_path / "uneven", "fixed", name, BALL, 30.0, uneven)
    want = np.stack([np.interp(run.t, fine.t, fine.path("a")[:, i]) for i in range(3)], axis=1)
    way = np.linalg.norm(np.diff(want, axis=0), axis=1).sum()
    assert np.linalg.norm(run.path("a")[:, :3] - want, axis=1).max() < 0.005 * way


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_a_panel_that_stops_short_of_a_ball_never_touches_it(tmp_path: Path, rate: int) -> None:
    """No guess of the way between frames goes on where the recording stopped, or rings."""
    things = [
        thing("a", sphere=0.05, position=(0.061, 0, 0)),
        thing("panel", "fixed", box=(0.02, 1, 1), topic="/panel"),
    ]
    ways = {
        "braked": lambda t: (-0.4 * max(0.0, 0.5 - t) ** 2, 0, 0, *UPRIGHT),
        "halted": lambda t: (-max(0.0, 0.5 - t), 0, 0, *UPRIGHT),
        "hurried": lambda t: (-1.5 * max(0.0, 0.25 - t * t), 0, 0, *UPRIGHT),
    }
    for name, way in ways.items():
        run = play(tmp_path / name, things, 1.0, rate, gravity=SPACE, paths={"/panel": way})
        assert run.drift("a") == (0.0, 0.0)


def test_a_slab_that_pushes_a_box_lags_by_what_its_coupling_has_to_hold(tmp_path: Path) -> None:
    """Friction over stiffness, K x = μ m g, and what impacts at the start of each turn add to it."""
    things = [thing("a", box=(0.1, 0.1, 0.1), position=(0, 0, 0.05), density=500.0), floor(), slab()]
    run = play(tmp_path, things, 3.0, paths={"/slab": lambda t: (0.2 * t - 0.12, 0, 0.35, *UPRIGHT)})
    assert (run.path("a")[-1, 0] - run.path("a")[-61, 0]) == pytest.approx(0.2, rel=5e-3)
    lag = 0.2 * run.t[-1] - 0.12 - run.path("slab")[-1, 0]
    hold = MU * run.mass("a") * GRAVITY / 1000
    assert 0.95 * hold < lag < 1.6 * hold


@pytest.mark.parametrize("rate", [60, 240])
def test_a_box_stands_on_a_platform_that_swings_until_friction_fails(tmp_path: Path, rate: int) -> None:
    for w, holds in ((5.0, True), (9.0, False)):
        things = [thing("a", box=(0.1, 0.1, 0.1), position=(0, 0, 0.05))]
        things.append(thing("platform", "fixed", box=(2, 2, 0.1), topic="/platform"))
        paths = {"/platform": lambda t, w=w: (0.05 * (1 - np.cos(w * t)), 0, -0.05, *UPRIGHT)}
        run = play(tmp_path / str(w), things, 2.0, rate, paths=paths)
        assert (0.05 * w * w < MU * GRAVITY) == holds
        slip = np.abs(run.path("a")[:, 0] - run.path("platform")[:, 0]).max()
        assert (slip < 2e-4) == holds


def test_a_lift_pushes_by_the_weight_and_the_acceleration(tmp_path: Path) -> None:
    things = [
        thing("a", box=(0.1, 0.1, 0.1), position=(0, 0, 0.05)),
        thing("lift", "fixed", box=(2, 2, 0.1), topic="/lift"),
    ]
    run = play(tmp_path, things, 1.0, paths={"/lift": lambda t: (0, 0, -0.05 + t * t, *UPRIGHT)})
    for r in run.results[5:-1]:
        assert r.contacts.normal_impulse.sum() == pytest.approx(run.mass("a") * (GRAVITY + 2) / 60, rel=1e-4)


@pytest.mark.parametrize("rate", [30, 240])
def test_a_paddle_that_comes_to_meet_a_ball_adds_its_velocity(tmp_path: Path, rate: int) -> None:
    """v' = v + (1 + ε) (V - v)."""
    things = [
        thing("a", sphere=0.03, position=(0.3, 0, 0), velocity=(-2, 0, 0)),
        thing("paddle", "fixed", box=(0.02, 0.4, 0.4), topic="/paddle"),
    ]
    run = play(tmp_path, things, 0.5, rate, gravity=SPACE, paths={"/paddle": lambda t: (1.5 * t - 0.3, 0, 0, *UPRIGHT)})
    assert run.velocity("a", -2)[0] == pytest.approx(-2 + 1.3 * 3.5, rel=1e-6)


@pytest.mark.parametrize("rate", [30, 240])
def test_what_a_slab_gives_a_ball_is_in_the_contacts(tmp_path: Path, rate: int) -> None:
    things = [thing("ball", sphere=0.05, position=(0, 0.1, 0), density=600.0), slab()]
    run = play(
        tmp_path,
        things,
        0.5,
        rate,
        gravity=SPACE,
        paths={"/slab": lambda t: (0.3 * t - 0.12, 0, 0, *turned(0, 0, 0.3))},
    )
    given = sum(
        (r.contacts.normal * r.contacts.normal_impulse[:, None]).sum(axis=0)
        for r in run.results
        if len(r.contacts.depth)
    )
    rubbed = sum(r.contacts.tangential_impulse.sum() for r in run.results)
    got = run.mass("ball") * run.velocity("ball", -2)
    assert np.linalg.norm(got) > 0.05
    n = np.array([np.cos(0.3), np.sin(0.3), 0])
    assert got @ n == pytest.approx(given @ n, rel=1e-9)
    assert np.linalg.norm(got - given) <= rubbed + 1e-12


@pytest.mark.parametrize("rate", [30, 60])
def test_a_ball_that_is_squeezed_against_a_wall_stays_in_the_room_and_the_slab_is_held(
    tmp_path: Path, rate: int
) -> None:
    wall = thing("wall", "fixed", box=(0.02, 1, 1), position=(0.3, 0, 0.5))
    things = [thing("ball", sphere=0.05, position=(0, 0.01, 0.05), density=600.0), floor(), wall, slab()]
    run = play(
        tmp_path, things, 2.0, rate, paths={"/slab": lambda t: (0.5 * np.sin(np.pi * t / 2) - 0.15, 0, 0.31, *UPRIGHT)}
    )
    p, v = run.path("ball"), np.linalg.norm(np.diff(run.path("ball")[:, :3], axis=0), axis=1) * rate
    assert p[:, 0].max() <= 0.24 + FREE
    assert p[:, 2].min() >= 0.05 - FREE
    assert (p[:, 0] - run.path("slab")[:, 0]).min() >= 0.06 - FREE
    assert v.max() < 3.0
    assert run.overlap <= FREE
