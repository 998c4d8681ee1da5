"""What a driven body presses, carries, drags and hits, by its coupling: closed forms, through `replay`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.laws.replayed import GRAVITY, SPACE, UPRIGHT, Run, floor, play, thing
from tests.laws.test_grasp import frictions, ramp

STIFFNESS = 1000.0  # N/m
HAND = {"mass": 0.4, "material": "human"}
HALF = 0.025  # m, of the cube
CUBE = {"box": (2 * HALF, 2 * HALF, 2 * HALF), "mass": 0.2}
WEIGHT = 0.2 * GRAVITY  # N, of the cube
RATES = pytest.mark.parametrize("rate", [30, 60, 120, 240])


def force(run: Run, a: str, b: str, frame: int = -1) -> float:
    """Normal force [N] between two bodies in a frame, its mean."""
    names, contacts = run.world.body_names, run.results[frame].contacts
    pair = {names.index(a), names.index(b)}
    on = [{int(x), int(y)} == pair for x, y in zip(contacts.body_a, contacts.body_b, strict=True)]
    return float(contacts.normal_impulse[on].sum() / (run.t[frame] - run.t[frame - 1]))


def still(run: Run, name: str, since: float) -> float:
    """Largest change of a body's pose from frame to frame since a time [m, and 1]."""
    return float(np.abs(np.diff(run.path(name)[np.searchsorted(run.t, since) :], axis=0)).max())


@RATES
@pytest.mark.parametrize(("what", "mass"), [(CUBE["box"], 0.3), (CUBE["box"], 1.0), (0.03, 0.3)])
def test_a_hand_sags_by_weight_over_stiffness_whatever_it_did_before(
    tmp_path: Path, what: object, mass: float, rate: int
) -> None:
    shape = {"sphere": what} if isinstance(what, float) else {"box": what}
    things = [thing("hand", "driven", box=(0.18, 0.1, 0.02), topic="/hand", **HAND)]
    things.append(thing("load", position=(0, 0, 0.345), mass=mass, **shape))
    lift = lambda t: (0, 0, 0.3 + ramp(t, 1, 2, 0.1), *UPRIGHT)  # noqa: E731
    run = play(tmp_path, things, 3.5, rate, pairs=frictions(0.5), paths={"/hand": lift})
    assert 0.4 - run.path("hand")[-1, 2] == pytest.approx(mass * GRAVITY / STIFFNESS, rel=0.01)
    assert force(run, "load", "hand") == pytest.approx(mass * GRAVITY, rel=0.01)


@RATES
def test_a_box_pinned_to_a_wall_stays(tmp_path: Path, rate: int) -> None:
    things = [
        thing("wall", "fixed", box=(0.1, 1, 1), position=(-0.05, 0, 0.5)),
        thing("box", position=(HALF + 2e-6, 0, 0.5), **CUBE),
        thing("hand", "driven", box=(0.02, 0.06, 0.06), topic="/hand", **HAND),
    ]
    press = lambda t: (2 * HALF + 0.01 + 4e-6 - (0.01 if t > 0 else 0), 0, 0.5, *UPRIGHT)  # noqa: E731
    run = play(tmp_path, things, 3.0, rate, pairs=frictions(0.5), paths={"/hand": press})
    assert force(run, "box", "hand") == pytest.approx(10.0, rel=0.01)
    assert abs(run.path("box")[-1, 2] - 0.5) < 1e-5
    assert still(run, "hand", 1.0) < 1e-7


@RATES
@pytest.mark.parametrize("depth", [0.005, 0.015])
def test_a_fingertip_drags_a_box(tmp_path: Path, depth: float, rate: int) -> None:
    things = [
        thing("box", position=(0, 0, 0.05), box=(0.1, 0.1, 0.1), mass=0.2),
        floor(material="metal"),
        thing("tip", "driven", sphere=0.02, topic="/tip", **HAND),
    ]
    way = lambda t: (ramp(t, 1, 2.2, 0.3), 0, 0.14 - ramp(t, 0.2, 0.7, 0.02 + depth), *UPRIGHT)  # noqa: E731
    run = play(tmp_path, things, 3.0, rate, pairs=frictions(1.0, 0.2), paths={"/tip": way})
    apart = (run.path("tip") - run.path("box"))[np.searchsorted(run.t, 0.9) :, 0]
    assert np.abs(apart - apart[0]).max() < 1e-4
    assert force(run, "box", "tip") == pytest.approx(STIFFNESS * depth, rel=0.01)
    assert force(run, "box", "floor") == pytest.approx(STIFFNESS * depth + WEIGHT, rel=0.01)
    lag = 0.3 - run.path("tip")[-1, 0]
    assert 0.0 < lag <= 0.2 * (STIFFNESS * depth + WEIGHT) / STIFFNESS + 1e-6


@RATES
def test_what_is_pressed_on_a_table_does_not_tremble(tmp_path: Path, rate: int) -> None:
    things = [
        thing("box", position=(0, 0, HALF), **CUBE),
        floor(material="metal"),
        thing("hand", "driven", box=(0.1, 0.1, 0.02), topic="/hand", **HAND),
    ]
    press = lambda t: (0, 0, 2 * HALF + 0.03 - ramp(t, 0.2, 0.8, 0.025), *UPRIGHT)  # noqa: E731
    run = play(tmp_path, things, 3.0, rate, pairs=frictions(0.5), paths={"/hand": press})
    assert force(run, "box", "hand") == pytest.approx(5.0, rel=0.01)
    assert force(run, "box", "floor") == pytest.approx(5.0 + WEIGHT, rel=0.01)
    assert max(still(run, name, 1.5) for name in ("box", "hand")) < 1e-8
    assert run.overlap < 1e-5


@RATES
def test_what_is_pressed_against_a_wall_is_pressed_by_stiffness_times_offset(tmp_path: Path, rate: int) -> None:
    things = [
        thing("wall", "fixed", box=(0.1, 1, 1), position=(-0.05, 0, 0.5)),
        floor(material="metal"),
        thing("box", position=(HALF + 0.002, 0, HALF), **CUBE),
        thing("hand", "driven", box=(0.02, 0.04, 0.04), topic="/hand", **HAND),
    ]
    push = lambda t: (2 * HALF + 0.04 - ramp(t, 0.2, 1.0, 0.04), 0, HALF + 0.001, *UPRIGHT)  # noqa: E731
    run = play(tmp_path, things, 3.0, rate, pairs=frictions(0.5), paths={"/hand": push})
    assert force(run, "box", "hand") == pytest.approx(10.0, rel=0.01)
    assert 0.0 <= run.path("box")[-1, 0] - HALF < 1e-5
    assert run.overlap < 1e-5


@RATES
def test_where_friction_is_too_small_it_slips_at_the_acceleration_that_is_left(tmp_path: Path, rate: int) -> None:
    """A = g - 2 μ N / m, for two jaws that press by N; what the box stood on is drawn away."""
    mu, top = 0.1, 0.65
    jaw = lambda side: lambda t: (side * (HALF + 0.02 - ramp(t, 0.05, 0.2, 0.015)), 0, 0.5, *UPRIGHT)  # noqa: E731
    stand = lambda t: (0, 0, top - HALF - 0.05 - 10 * max(0.0, t - 0.3) ** 2, *UPRIGHT)  # noqa: E731
    things = [
        thing("box", position=(0, 0, top), **CUBE),
        thing("stand", "fixed", box=(0.03, 0.03, 0.1), topic="/stand", material="metal"),
        *(thing(name, "driven", box=(0.02, 0.06, 0.4), topic=f"/{name}", **HAND) for name in ("left", "right")),
    ]
    run = play(
        tmp_path, things, 0.6, rate, pairs=frictions(mu), paths={"/left": jaw(-1), "/right": jaw(1), "/stand": stand}
    )  # fmt: skip
    chosen = run.t > 0.4
    fall = -2 * np.polyfit(run.t[chosen], run.path("box")[chosen, 2], 2)[0]
    assert fall == pytest.approx(GRAVITY - 2 * mu * 5.0 / 0.2, rel=0.01)


@RATES
@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_a_ball_rebounds_from_a_hand_and_the_hand_recoils(tmp_path: Path, restitution: float, rate: int) -> None:
    ball, hand, speed = 0.1, 0.4, 2.0
    things = [
        thing("hand", "driven", box=(0.1, 0.1, 0.02), topic="/hand", **HAND),
        thing("ball", sphere=0.03, position=(0, 0, 0.0537), velocity=(0, 0, -speed), mass=ball),
    ]
    pair = f'[[material_pair]]\nmaterials = ["human", "wood"]\nrestitution = {restitution}\nfriction = 0.3\n'
    run = play(tmp_path, things, 0.4, rate, gravity=SPACE, pairs=pair, paths={"/hand": lambda _: (0, 0, 0, *UPRIGHT)})
    want = (restitution * hand - ball) / (ball + hand) * speed
    given = sum(r.contacts.normal_impulse.sum() for r in run.results)
    assert given == pytest.approx((1 + restitution) * ball * hand / (ball + hand) * speed, rel=1e-6)
    if want > 0.0:  # else the hand, which comes back, meets it again
        assert run.velocity("ball", -2)[2] == pytest.approx(want, rel=1e-6)
        assert not run.path("hand")[-1, :3].any()
    assert run.path("hand")[:, 2].min() < -1e-3
