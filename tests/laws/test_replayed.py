"""The laws that simulated bodies obey, each by replaying a small scene: what an outsider can check from poses alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import geomphys
from geomphys.config import Config
from geomphys.output.output_log import open_output
from geomphys.results import FLAG_IMPACT_BOUND
from tests.laws.replayed import GRAVITY, SPACE, Run, floor, play, thing, turned

RESTITUTION = {
    ("wood", "wood"): 0.3,
    ("wood", "human"): 0.2,
    ("wood", "metal"): 0.2,
    ("human", "human"): 0.1,
    ("human", "metal"): 0.2,
    ("metal", "metal"): 0.3,
}
MU = 0.3
FREE = 1e-5  # m


@pytest.mark.parametrize("rate", [30, 120])
@pytest.mark.parametrize(("ball", "ground"), RESTITUTION)
def test_a_dropped_ball_rebounds_to_the_square_of_restitution(
    tmp_path: Path, ball: str, ground: str, rate: int
) -> None:
    height, falling = 0.7, np.sqrt(2 * 0.7 / GRAVITY)
    run = play(
        tmp_path, [thing("ball", sphere=0.04, position=(0, 0, 0.74), material=ball), floor(material=ground)], 0.5, rate
    )
    z, t, e = run.path("ball")[:, 2] - 0.04, run.t, RESTITUTION[ball, ground]
    up = np.flatnonzero((t > falling + 1e-3) & (t < falling + 2 * e * GRAVITY * falling / GRAVITY - 1e-3))
    i, j = up[0], up[-1]
    start = (z[j] - z[i]) / (t[j] - t[i]) + GRAVITY * (t[j] - t[i]) / 2  # the parabola through two points
    assert z[i] + start**2 / (2 * GRAVITY) == pytest.approx(e**2 * height, rel=1e-3)


@pytest.mark.parametrize("rate", [30, 60, 240])
@pytest.mark.parametrize("offset", [0.0, 0.02, 0.06])
def test_balls_that_collide_keep_momentum_and_part_by_restitution(tmp_path: Path, offset: float, rate: int) -> None:
    run = play(
        tmp_path,
        [
            thing(
                "a", sphere=0.03, position=(-0.3, offset, 0.01 * offset), velocity=(2, 0, 0), angular_velocity=(1, 2, 5)
            ),
            thing("b", sphere=0.05, position=(0, 0, 0), velocity=(-0.3, 0.05, 0), material="metal"),
        ],
        0.4,
        rate,
        gravity=SPACE,
    )
    ma, mb = run.mass("a"), run.mass("b")
    before, after = ([run.velocity(body, k) for body in "ab"] for k in (0, -2))
    np.testing.assert_allclose(
        ma * after[0] + mb * after[1], ma * before[0] + mb * before[1], rtol=0, atol=1e-9 * 2 * ma
    )
    hit = next(r for r in run.results if r.metrics.impacts)
    n, j = hit.contacts.normal[0], hit.contacts.normal_impulse[0]
    approach, parting = (before[0] - before[1]) @ n, (after[0] - after[1]) @ n
    assert parting == pytest.approx(-0.2 * approach, rel=1e-9)
    change = ma * (after[0] - before[0])
    assert change @ n == pytest.approx(j, rel=1e-9)
    rubbed = np.linalg.norm(change - j * n)
    assert rubbed == pytest.approx(hit.contacts.tangential_impulse[0], rel=1e-9, abs=1e-12)
    assert rubbed <= 0.1 * j * (1 + 1e-9)


def on_slope(folder: Path, theta: float, rate: float, yaw: float = 0.0, **more: object) -> tuple[Run, float]:
    """A block on a slope for a second, and how far it slid down."""
    slope = Rotation.from_rotvec([0, theta, 0])
    n, own = slope.apply([0, 0, 1]), (slope * Rotation.from_rotvec([0, 0, yaw])).as_quat()
    run = play(
        folder,
        [
            thing("block", position=0.03 * n, orientation=own, **{"box": (0.16, 0.12, 0.06), **more}),
            thing("slope", "fixed", box=(40, 2, 0.2), position=-0.1 * n, orientation=slope.as_quat()),
        ],
        1.0,
        rate,
    )
    p = run.path("block")
    return run, float((p[-1, :3] - p[0, :3]) @ slope.apply([1, 0, 0]))


@pytest.mark.parametrize("rate", [30, 60, 120, 240])
def test_a_block_on_a_slope_slides_only_beyond_the_angle_of_friction(tmp_path: Path, rate: int) -> None:
    run, _ = on_slope(tmp_path / "holds", np.arctan(0.99 * MU), rate, yaw=0.4)
    assert run.drift("block", since=1)[0] < 1e-5
    for theta in (np.arctan(1.01 * MU), 0.6):
        _, way = on_slope(tmp_path / "slides", theta, rate, yaw=0.4)
        assert way == pytest.approx(GRAVITY * (np.sin(theta) - MU * np.cos(theta)) / 2, rel=0.01)


@pytest.mark.parametrize("rate", [30, 60, 240])
def test_a_ball_that_slides_ends_up_rolling(tmp_path: Path, rate: int) -> None:
    run = play(tmp_path, [thing("ball", sphere=0.05, position=(-4, 0, 0.05), velocity=(4, 0, 0)), floor()], 0.8, rate)
    assert run.velocity("ball", -2)[0] == pytest.approx(5 / 7 * 4, rel=1e-3)


LYING = turned(0, np.pi / 2, 0)
ACROSS = turned(np.pi / 2, 0, 0)


def plank(name: str, tilt: float) -> str:
    """A fixed plank whose top goes through the origin."""
    n = Rotation.from_rotvec([0, tilt, 0]).apply([0, 0, 1])
    return thing(name, "fixed", box=(1, 1, 0.1), position=-0.05 * n, orientation=turned(0, tilt, 0))


GROOVE = [plank("left", np.pi / 4), plank("right", -np.pi / 4)]


def at_rest(name: str, above: float) -> list[str]:
    """Things left to themselves, every two surfaces `above` apart; those to watch have names of one letter."""
    e = above
    scenes = {
        "box": [thing("a", box=(0.2, 0.16, 0.1), position=(0.2, -0.1, 0.05 + e), orientation=turned(0, 0, 0.3)), floor()],
        "ball": [thing("a", sphere=0.05, position=(0.2, -0.1, 0.05 + e)), floor()],
        "standing cylinder": [thing("a", cylinder=(0.05, 0.16), position=(0, 0, 0.08 + e)), floor()],
        "lying cylinder": [thing("a", cylinder=(0.05, 0.16), position=(0, 0, 0.05 + e), orientation=LYING), floor()],
        "capsule": [thing("a", capsule=(0.03, 0.16), position=(0, 0, 0.03 + e), orientation=LYING), floor()],
        "stack": [
            *(thing(c, box=(0.2, 0.2, 0.1), position=(0.01 * k, 0, 0.05 + 0.1 * k + e * (k + 1))) for k, c in enumerate("abc")),
            floor(),
        ],
        "bridge": [
            thing("a", box=(0.1, 0.1, 0.1), position=(-0.1, 0, 0.05 + e)),
            thing("b", box=(0.1, 0.1, 0.1), position=(0.1, 0, 0.05 + e)),
            thing("c", box=(0.32, 0.1, 0.04), position=(0.03, 0.01, 0.12 + 2 * e)),
            floor(),
        ],
        "groove": [thing("a", sphere=0.05, position=(0, 0, 0.05 * np.sqrt(2) + e)), *GROOVE],
        "ball on box": [
            thing("a", box=(0.2, 0.2, 0.1), position=(0, 0, 0.05 + e)),
            thing("b", sphere=0.04, position=(0, 0, 0.14 + 2 * e)),
            floor(),
        ],
    }  # fmt: skip
    return scenes[name]


RESTING = ("box", "ball", "standing cylinder", "lying cylinder", "capsule", "stack", "bridge", "groove", "ball on box")


@pytest.mark.parametrize("above", [0.0, 1e-6, -1e-6])
@pytest.mark.parametrize("name", RESTING)
def test_what_rests_stays_for_a_minute(tmp_path: Path, name: str, above: float) -> None:
    run = play(tmp_path, at_rest(name, above), 60.0, 30)
    for body in run.world.body_names:
        if len(body) == 1:
            far, turn = run.drift(body)
            assert far <= 1e-4
            assert turn <= 0.1
            p = run.path(body)
            assert np.array_equal(p[-1], p[-300])
    assert run.overlap <= FREE
    assert run.flags == 0


@pytest.mark.parametrize("room", [1e-6, 0.0, -1e-6])
@pytest.mark.parametrize("shape", [{"box": (0.1, 0.1, 0.1)}, {"sphere": 0.05}])
def test_what_fits_exactly_between_walls_stays_and_takes_no_time(
    tmp_path: Path, shape: dict[str, object], room: float
) -> None:
    """There is no room for the clearance that is kept elsewhere."""
    walls = [
        thing(name, "fixed", box=(0.1, 0.5, 0.5), position=(side * (0.1 + room), 0, 0.25))
        for name, side in (("left", -1), ("right", 1))
    ]
    run = play(tmp_path, [thing("a", position=(0, 0, 0.05), **shape), floor(), *walls], 2.0)
    assert run.drift("a")[0] < 1e-5
    assert run.drift("a")[1] < 1e-2
    assert run.overlap <= FREE
    assert run.flags == 0


SIXTY_SECONDS_OF_SPIN = [(0.1, 10.0, 0.05), (1.0, 0.2, 20.0)]


@pytest.mark.parametrize("spin", SIXTY_SECONDS_OF_SPIN)
def test_a_free_spinning_box_keeps_momentum_and_energy(tmp_path: Path, spin: tuple[float, float, float]) -> None:
    run = play(tmp_path, [thing("a", box=(0.2, 0.12, 0.06), angular_velocity=spin)], 60.0, gravity=SPACE)
    inertia = np.array([0.12**2 + 0.06**2, 0.2**2 + 0.06**2, 0.2**2 + 0.12**2])
    turns, h = Rotation.from_quat(run.path("a")[:, 3:]), 1 / 60

    def state(k: int) -> tuple[np.ndarray, float]:
        """Angular momentum and energy per mass/12, the angular velocity by a central difference of sixth order."""
        r = {m: (turns[k + m] * turns[k].inv()).as_rotvec() for m in (-3, -2, -1, 1, 2, 3)}
        w = (45 * (r[1] - r[-1]) - 9 * (r[2] - r[-2]) + (r[3] - r[-3])) / (60 * h)
        own = turns[k].inv().apply(w)
        return turns[k].apply(inertia * own), float(own @ (inertia * own))

    momentum, energy = state(3)
    for k in range(40, len(turns) - 3, 97):
        now = state(k)
        assert np.linalg.norm(now[0] - momentum) <= 1e-4 * np.linalg.norm(momentum)
        assert now[1] == pytest.approx(energy, rel=1e-4)


@pytest.mark.parametrize("rate", [30, 240])
@pytest.mark.parametrize(
    ("shape", "speed", "angle", "spin"),
    [
        ({"sphere": 0.02}, 50.0, 0.0, 0.0),
        ({"sphere": 0.0005}, 200.0, 1.2, 0.0),
        ({"capsule": (0.005, 0.3)}, 50.0, 0.5, 100.0),
        ({"capsule": (0.005, 0.3)}, 200.0, 0.3, 60.0),
        ({"box": (0.03, 0.02, 0.001)}, 200.0, 1.4, 300.0),
        ({"cylinder": (0.01, 0.002)}, 1000.0, 0.2, 100.0),
    ],
)
def test_nothing_goes_through_a_thin_panel(
    tmp_path: Path, shape: dict[str, object], speed: float, angle: float, spin: float, rate: int
) -> None:
    v = speed * np.array([np.cos(angle), np.sin(angle), 0])
    panel = thing("panel", "fixed", box=(0.005, 10, 10))
    ball = thing(
        "a", position=-0.5 * v / speed, velocity=v, angular_velocity=(0.2 * spin, -0.4 * spin, 0.9 * spin), **shape
    )
    run = play(tmp_path, [ball, panel], 0.2, rate, gravity=SPACE)
    assert run.path("a")[:, 0].max() < -0.0025
    assert sum(r.metrics.impacts for r in run.results) > 0
    assert run.flags == 0
    if angle == 0.0:
        np.testing.assert_allclose(run.velocity("a", -2), [-0.3 * speed, 0, 0], rtol=1e-9, atol=1e-9)


def tumbling() -> list[str]:
    return [thing("a", box=(0.1, 0.06, 0.04), position=(0, 0, 0.5), orientation=turned(0.4, 0.3, 0.2)), floor()]


def rolling() -> list[str]:
    return [thing("a", sphere=0.05, position=(0, 0, 0.5), velocity=(1, 0.2, 0)), floor()]


def pool() -> list[str]:
    spots = {"b": (0.0, 0.0), "c": (0.054, -0.031), "d": (0.054, 0.031)}
    balls = [thing(name, sphere=0.03, position=(x, y, 0.03)) for name, (x, y) in spots.items()]
    return [thing("a", sphere=0.03, position=(-0.3, 0.01, 0.03), velocity=(2, 0, 0)), *balls, floor()]


@pytest.mark.parametrize("things", [tumbling, rolling, pool])
def test_the_frame_rate_is_no_physical_parameter(tmp_path: Path, things) -> None:  # type: ignore[no-untyped-def]
    runs = {rate: play(tmp_path / str(rate), things(), 1.5, rate) for rate in (30, 60, 120, 240)}
    names = [name for name in runs[30].world.body_names if len(name) == 1]
    way = max(np.linalg.norm(np.diff(runs[240].path(name)[:, :3], axis=0), axis=1).sum() for name in names)
    for rate in (30, 60, 120):
        for name in names:
            off = runs[rate].path(name)[:: rate // 30, :3] - runs[240].path(name)[::8, :3]
            assert np.linalg.norm(off, axis=1).max() < 0.01 * way


def test_hitting_the_bound_on_impacts_is_in_metrics_and_log(tmp_path: Path) -> None:
    balls = [thing(f"b{k}", sphere=0.02, position=(0.05 * k, 0, 0), velocity=(2.0 - k, 0, 0)) for k in range(5)]
    play(tmp_path, balls, 0.2, gravity=SPACE)
    for most in (1, 500):
        out = tmp_path / f"{most}.mcap"
        geomphys.run(
            tmp_path / "log.mcap", tmp_path / "scene.toml", out=out, config=Config(clock="/marker", max_impacts=most)
        )
        frames = list(open_output(out).frames())
        flagged = [frame.index for frame in frames if int(frame.metrics["flags"]) & FLAG_IMPACT_BOUND]
        told = [frame.index for frame in frames if any("max_impacts" in str(entry) for entry in frame.log)]
        assert bool(flagged) == (most == 1)
        assert bool(told) == (most == 1)


def test_a_repetition_has_the_same_bits(tmp_path: Path) -> None:
    a, b = (play(tmp_path / str(k), pool(), 1.0) for k in range(2))
    for x, y in zip(a.results, b.results, strict=True):
        assert np.array_equal(x.corrected, y.corrected)
        assert np.array_equal(x.contacts.normal_impulse, y.contacts.normal_impulse)


def test_what_starts_inside_is_told_and_comes_out(tmp_path: Path) -> None:
    run = play(tmp_path, [thing("a", box=(0.1, 0.1, 0.1), position=(0, 0, 0.04)), floor()], 0.2)
    assert run.results[0].metrics.residual_penetration_m == pytest.approx(0.01, rel=1e-6)
    assert run.overlap == 0.0


def test_many_balls_that_fall_into_a_box_come_to_rest_in_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    walls = [
        thing(f"wall{k}", "fixed", box=box, position=place)
        for k, (box, place) in enumerate(
            [((0.02, 0.3, 0.4), (x, 0, 0.2)) for x in (-0.13, 0.13)]
            + [((0.3, 0.02, 0.4), (0, y, 0.2)) for y in (-0.13, 0.13)]
        )
    ]
    balls = [
        thing(f"b{k}", sphere=0.025, position=(*rng.uniform(-0.09, 0.09, 2), 0.05 + 0.06 * k), density=600.0)
        for k in range(24)
    ]
    run = play(tmp_path, [*balls, *walls, floor()], 3.0, 30)
    for k in range(24):
        p = run.path(f"b{k}")
        assert np.abs(p[:, :2]).max() <= 0.12 - 0.025 + FREE
        assert p[:, 2].min() >= 0.025 - FREE
        assert np.linalg.norm(p[-1, :3] - p[-2, :3]) * 30 < 0.2
    assert run.overlap <= FREE
    assert run.flags == 0
