"""What driven jaws grip is held, lifted, carried, turned and released: closed forms, through `replay`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.laws.replayed import GRAVITY, Path7, Run, floor, play, thing, turned

HALF = 0.025  # m, of the cube and of the ball
CUBE = {"box": (2 * HALF, 2 * HALF, 2 * HALF), "mass": 0.2}
BALL = {"sphere": HALF, "mass": 0.1}
STIFFNESS = 1000.0  # N/m
SLIP = 1e-4  # m


def ramp(t: float, begin: float, end: float, to: float) -> float:
    """From 0 to `to` between two moments, at rest at both (quintic)."""
    s = min(max((t - begin) / (end - begin), 0.0), 1.0)
    return to * s**3 * (10 - 15 * s + 6 * s * s)


def frictions(grip: float, table: float = 0.4) -> str:
    """Friction of driven jaws ("human") on what they grip, and of that on a "metal" table."""
    return "".join(
        f'[[material_pair]]\nmaterials = ["{a}", "{b}"]\nrestitution = 0.0\nfriction = {mu}\n'
        for a, b, mu in (("human", "wood", grip), ("metal", "wood", table), ("human", "metal", 0.3))
    )


@dataclass(frozen=True, kw_only=True)
class Task:
    """Jaws close along x by 1 s, deeper than the surface by `squeeze`; lift 20 cm by 2.3 s; then carry, turn, or release."""

    squeeze: float = 0.005  # m
    along: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, carried from `LIFTED` on
    about: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad, turned likewise
    takes: float = 0.6  # s
    opens: float = math.inf  # s, when the jaws let go

    def jaw(self, side: float) -> Path7:
        """The way of one of the jaws."""

        def path(t: float) -> tuple[float, ...]:
            share = ramp(t, LIFTED, LIFTED + self.takes, 1.0)
            turn = Rotation.from_rotvec(np.array(self.about) * share)
            reach = HALF + 0.01 + 0.03 - ramp(t, 0.3, 1.0, 0.03 + self.squeeze)
            if t > self.opens:
                reach += ramp(t, self.opens, self.opens + 0.3, 0.03 + self.squeeze)
            up = ramp(t, 1.3, 2.3, 0.2)
            at = np.array(self.along) * share + (0, 0, HALF + up) + turn.apply([side * reach, 0, 0])
            return (*at, *turn.as_quat())

        return path


GRIPPED, LIFTED = 1.25, 2.5  # s


@dataclass(frozen=True)
class Grasp:
    """A grasp that is over."""

    run: Run
    rate: float
    left: str = "left"
    right: str = "right"

    def frame(self, t: float) -> int:
        """Index of the frame at a time."""
        return round(t * self.rate)

    def force(self, jaw: str, t: float) -> float:
        """Normal force [N] of a jaw on what it grips."""
        names, contacts = self.run.world.body_names, self.run.results[self.frame(t)].contacts
        pair = (contacts.body_a == names.index("thing")) & (contacts.body_b == names.index(jaw))
        return float(contacts.normal_impulse[pair].sum() * self.rate)

    def slip(self, since: float, until: float) -> float:
        """How far what is gripped moves at most in the frame of the jaws [m]."""
        left, right, held = (self.run.path(name) for name in (self.left, self.right, "thing"))
        middle = 0.5 * (left[:, :3] + right[:, :3])
        inside = Rotation.from_quat(left[:, 3:]).inv().apply(held[:, :3] - middle)
        span = inside[self.frame(since) : self.frame(until) + 1]
        return float(np.linalg.norm(span - span[0], axis=1).max())


def grasp(
    folder: Path, task: Task, seconds: float, rate: float = 60, *, what: dict[str, object] | None = None, friction: float = 0.8,
    coupling: tuple[float, float] = (STIFFNESS, 40.0), noise: float = 0.0,
) -> Grasp:  # fmt: skip
    """Replay a task."""
    spring = f"coupling = {{ stiffness = {coupling[0]}, damping = {coupling[1]} }}\n"
    jaw = {"box": (0.02, 0.06, 0.04), "mass": 0.4, "material": "human"}
    things = [thing("thing", position=(0, 0, HALF), **(what or CUBE)), floor(material="metal")]
    things += [thing(name, "driven", topic=f"/{name}", **jaw) + spring for name in ("left", "right")]
    tremble, paths = np.random.default_rng(5), {}
    for name, side in (("left", -1.0), ("right", 1.0)):
        way = task.jaw(side)
        paths[f"/{name}"] = lambda t, way=way: (*(np.array(way(t)[:3]) + tremble.normal(0, noise, 3)), *way(t)[3:])
    return Grasp(play(folder, things, seconds, rate, pairs=frictions(friction), paths=paths), rate)


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
@pytest.mark.parametrize(("what", "friction"), [(CUBE, 0.8), (CUBE, 0.5), (BALL, 0.5)])
def test_jaws_press_by_stiffness_times_depth_and_hold_what_they_lift(
    tmp_path: Path, what: dict[str, object], friction: float, rate: int
) -> None:
    end = 5.5 if rate == 60 else 3.0
    done = grasp(tmp_path, Task(), end, rate, what=what, friction=friction)
    for t in (GRIPPED, LIFTED, end):
        for jaw in ("left", "right"):
            assert done.force(jaw, t) == pytest.approx(STIFFNESS * 0.005, rel=0.01)
    assert done.slip(GRIPPED, end) < SLIP
    height = done.run.path("thing")[-1, 2]
    sag = what["mass"] * GRAVITY / (2 * STIFFNESS)  # type: ignore[operator]
    assert height == pytest.approx(HALF + 0.2 - sag, abs=2e-5)
    assert done.run.overlap < 1e-5


@pytest.mark.parametrize("rate", [30, 60, 240])
@pytest.mark.parametrize("along", [(0.3, 0.0, 0.0), (0.0, 0.3, 0.0)])
def test_what_is_gripped_is_carried_along_and_across_the_jaws(
    tmp_path: Path, along: tuple[float, float, float], rate: int
) -> None:
    done = grasp(tmp_path, Task(along=along), 3.5, rate)
    assert done.slip(GRIPPED, 3.5) < SLIP
    np.testing.assert_allclose(done.run.path("thing")[-1, :2], along[:2], atol=1e-4)


@pytest.mark.parametrize("about", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)])
def test_what_is_gripped_turns_with_the_jaws(tmp_path: Path, about: tuple[float, float, float]) -> None:
    done = grasp(tmp_path, Task(about=tuple(0.5 * math.pi * x for x in about), takes=1.3), 4.2)
    assert done.slip(GRIPPED, 4.2) < SLIP
    held, jaw = (Rotation.from_quat(done.run.path(name)[-1, 3:]) for name in ("thing", "left"))
    assert np.degrees((jaw.inv() * held).magnitude()) < 0.01


def test_what_is_let_go_falls_freely_and_comes_to_rest(tmp_path: Path) -> None:
    done = grasp(tmp_path, Task(opens=3.0), 4.2)
    z, first = done.run.path("thing")[:, 2], done.frame(3.12)
    assert np.diff(z[first : first + 5], 2) == pytest.approx(-GRAVITY / 60**2, rel=1e-6)
    assert z[-1] == pytest.approx(HALF, abs=2e-5)


def test_a_tracker_that_trembles_does_not_shake_it_loose(tmp_path: Path) -> None:
    done = grasp(tmp_path, Task(), 5.0, noise=3e-4)
    assert done.run.path("thing")[-1, 2] > HALF + 0.19
    assert done.slip(GRIPPED, 5.0) < 1e-3


def test_something_light_between_stiff_jaws_is_held(tmp_path: Path) -> None:
    light = {**CUBE, "mass": 0.02}
    done = grasp(tmp_path, Task(along=(0.3, 0, 0)), 3.5, what=light, coupling=(20_000.0, 178.9))
    assert done.force("left", 3.5) == pytest.approx(100.0, rel=0.01)
    assert done.slip(GRIPPED, 3.5) < SLIP


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_turntable_keeps_its_load_below_the_limit_of_friction(tmp_path: Path, share: float) -> None:
    rate = math.sqrt(share * 0.5 * GRAVITY / 0.2)
    angle = lambda t: rate * (0.5 * min(t, 1.0) ** 2 + max(0.0, t - 1.0))  # noqa: E731
    things = [
        thing("load", position=(0.2, 0, 0.01), box=(0.02, 0.02, 0.02), mass=0.05),
        thing("disc", "fixed", box=(0.8, 0.8, 0.1), topic="/disc", material="metal"),
    ]
    run = play(
        tmp_path, things, 6.0, pairs=frictions(0.8, 0.5), paths={"/disc": lambda t: (0, 0, -0.05, *turned(0, 0, angle(t)))}
    )  # fmt: skip
    disc = Rotation.from_quat(run.path("disc")[:, 3:])
    on_disc = disc.inv().apply(run.path("load")[:, :3])
    assert (np.linalg.norm(on_disc[-1] - on_disc[0]) < 1e-3) == (share < 1)
