"""Exercises of mechanics, replayed from scene files and logs, against their closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.laws.replayed import EARTH, GRAVITY, SPACE, UPRIGHT, Run, floor, play, thing, turned

LYING = turned(0, np.pi / 2, 0)


def pairs(**materials: tuple[float, float]) -> str:
    """Restitution and friction of materials with themselves, and with wood."""
    return "".join(
        f'[[material_pair]]\nmaterials = ["{name}", "{other}"]\nrestitution = {e}\nfriction = {mu}\n'
        for name, (e, mu) in materials.items()
        for other in (name, "wood")
    )


def between(a: str, b: str, e: float, mu: float) -> str:
    return f'[[material_pair]]\nmaterials = ["{a}", "{b}"]\nrestitution = {e}\nfriction = {mu}\n'


def incline(theta: float, **keys: object) -> tuple[str, np.ndarray, np.ndarray]:
    """A fixed slope through the origin, its normal and the way down."""
    turn = Rotation.from_rotvec([0, theta, 0])
    n = turn.apply([0, 0, 1])
    slope = thing(
        "slope", "fixed", **{"box": (20, 2, 0.2), "position": -0.1 * n, "orientation": turn.as_quat(), **keys}
    )
    return slope, n, turn.apply([1, 0, 0])


def first_impact(run: Run) -> int:
    return next(k for k, r in enumerate(run.results) if r.metrics.impacts)


def after_fall(run: Run, name: str, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocities [m/s, rad/s] that the first impact, after a fall from `height`, left: from the two frames after it."""
    k, p, t = first_impact(run), run.path(name), run.t
    since = 0.5 * (t[k] + t[k + 1]) - np.sqrt(2 * height / GRAVITY)
    turn = Rotation.from_quat(p[k + 1, 3:]) * Rotation.from_quat(p[k, 3:]).inv()
    return run.velocity(name, k) + np.array([0, 0, GRAVITY * since]), turn.as_rotvec() / (t[k + 1] - t[k])


TILES = [
    thing(f"tile{i}{j}", "fixed", box=(0.1, 0.1, 0.2), position=(0.1 * i, 0.1 * j, -0.1), material="rubber")
    for i in range(-2, 3)
    for j in range(-2, 3)
]
GROUNDS = {
    "floor": [floor(material="rubber")],
    "tiles": TILES,
    "mesh": [thing("floor", "fixed", mesh="slabs.stl", material="rubber", decomposition="hull")],
}
SHAPES: dict[str, tuple[dict[str, object], float, object]] = {
    "ball": ({"sphere": 0.05}, 0.05, UPRIGHT),
    "box": ({"box": (0.1, 0.08, 0.06)}, 0.03, turned(0, 0, 0.3)),
    "standing cylinder": ({"cylinder": (0.05, 0.1)}, 0.05, UPRIGHT),
    "lying cylinder": ({"cylinder": (0.05, 0.1)}, 0.05, LYING),
    "lying capsule": ({"capsule": (0.03, 0.1)}, 0.03, LYING),
    "mesh": ({"mesh": "cube.stl"}, 0.05, UPRIGHT),
}


@pytest.mark.parametrize("ground", GROUNDS)
@pytest.mark.parametrize("name", SHAPES)
def test_whatever_falls_flat_rebounds_by_a_pair_of_the_scenes_own(tmp_path: Path, name: str, ground: str) -> None:
    shape, low, turn = SHAPES[name]
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "cube.stl")
    slabs = [trimesh.creation.box(bounds=[[x, y, -0.1], [x + 0.5, y + 0.5, 0]]) for x in (-0.5, 0) for y in (-0.5, 0)]
    trimesh.util.concatenate(slabs).export(tmp_path / "slabs.stl")
    body = thing("a", position=(0.013, 0.027, low + 0.5), orientation=turn, material="rubber", **shape)
    run = play(tmp_path, [body, *GROUNDS[ground]], 0.4, 120, pairs=pairs(rubber=(0.8, 0.4)))
    v, w = after_fall(run, "a", 0.5)
    assert v[2] ** 2 == pytest.approx(0.64 * 2 * GRAVITY * 0.5, rel=1e-3)
    assert np.linalg.norm(v[:2]) < 1e-3
    assert np.linalg.norm(w) < 1e-2


@pytest.mark.parametrize("tilt", [0.3, 0.7])
@pytest.mark.parametrize(("e", "mu"), [(0.8, 0.05), (0.5, 0.1), (0.3, 5.0), (1.0, 0.0)])
def test_a_ball_bounces_off_a_slope_with_coulombs_friction(tmp_path: Path, tilt: float, e: float, mu: float) -> None:
    slope, n, _ = incline(tilt, material="m")
    ball = thing("a", sphere=0.05, position=0.05 * n + [0, 0, 0.3], material="m")
    run = play(tmp_path, [ball, slope], 0.4, 240, pairs=pairs(m=(e, mu)))
    before = np.array([0, 0, -np.sqrt(2 * GRAVITY * 0.3)])
    vn = before @ n
    vt = before - vn * n
    rubbed = min(-mu * (1 + e) * vn, 2 / 7 * np.linalg.norm(vt))
    after, spin = after_fall(run, "a", 0.3)
    np.testing.assert_allclose(after, vt - e * vn * n - rubbed * vt / np.linalg.norm(vt), rtol=0, atol=2e-3)
    assert np.linalg.norm(spin) == pytest.approx(2.5 * rubbed / 0.05, rel=1e-3, abs=1e-9)


def test_a_box_that_falls_on_an_edge_without_friction_turns_as_it_must(tmp_path: Path) -> None:
    x, z, e, angle = 0.1, 0.06, 0.6, 0.6
    corners = Rotation.from_rotvec([0, angle, 0]).apply([[i * x / 2, 0, k * z / 2] for i in (-1, 1) for k in (-1, 1)])
    low = corners[corners[:, 2].argmin()]
    box = thing("a", box=(x, 0.08, z), position=(0, 0, 0.4 - low[2]), orientation=turned(0, angle, 0), material="m")
    run = play(tmp_path, [box, floor(material="m")], 0.32, 240, pairs=pairs(m=(e, 0.0)))
    speed, inertia = np.sqrt(2 * GRAVITY * 0.4), (x * x + z * z) / 12
    j = (1 + e) * speed / (1 + low[0] ** 2 / inertia)
    v, w = after_fall(run, "a", 0.4)
    assert v[2] == pytest.approx(j - speed, rel=2e-3)
    assert w[1] == pytest.approx(-low[0] * j / inertia, rel=2e-3)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
@pytest.mark.parametrize(("ra", "rb", "va", "vb"), [(0.03, 0.03, 2, 0), (0.03, 0.05, 2, -1), (0.05, 0.02, 1, 0)])
def test_balls_meet_head_on(tmp_path: Path, e: float, ra: float, rb: float, va: float, vb: float) -> None:
    balls = [
        thing(name, sphere=r, position=(x, 0, 0), velocity=(v, 0, 0), material="m")
        for name, r, x, v in (("a", ra, -0.3, va), ("b", rb, 0.0, vb))
    ]
    run = play(tmp_path, balls, 0.4, gravity=SPACE, pairs=pairs(m=(e, 0.3)))
    a, b = run.mass("a"), run.mass("b")
    mean = (a * va + b * vb) / (a + b)
    assert run.velocity("a", -2)[0] == pytest.approx(mean - e * b * (va - vb) / (a + b), rel=1e-9, abs=1e-9)
    assert run.velocity("b", -2)[0] == pytest.approx(mean + e * a * (va - vb) / (a + b), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("gravity", [SPACE, EARTH])
@pytest.mark.parametrize("room", [0.0, 1e-3])
@pytest.mark.parametrize("strikers", [1, 2])
def test_as_many_balls_leave_a_row_as_strike_it(
    tmp_path: Path, strikers: int, room: float, gravity: tuple[float]
) -> None:
    contact = [thing(f"b{k}", sphere=0.05, position=(k * (0.1 + room), 0, 0.05), material="m") for k in range(4)]
    contact += [
        thing(f"s{k}", sphere=0.05, position=(-0.5 - 0.1 * k, 0, 0.05), velocity=(1, 0, 0), material="m")
        for k in range(strikers)
    ]
    smooth = pairs(m=(1.0, 0.0), f=(0.0, 0.0)) + between("m", "f", 0.0, 0.0)
    run = play(tmp_path, [*contact, floor(material="f")], 0.7, gravity=gravity, pairs=smooth)
    speeds = [run.velocity(f"b{k}", -2)[0] for k in range(4)] + [run.velocity(f"s{k}", -2)[0] for k in range(strikers)]
    np.testing.assert_allclose(speeds, [*[0] * (4 - strikers), *[1] * strikers, *[0] * strikers], rtol=0, atol=1e-6)


@pytest.mark.parametrize(("theta", "mu"), [(0.2, 0.3), (0.5, 0.3), (0.8, 0.2), (0.3, 0.05)])
@pytest.mark.parametrize(("shape", "k"), [({"sphere": 0.05}, 2 / 5), ({"cylinder": (0.05, 0.2)}, 1 / 2)])
def test_what_is_round_rolls_down_a_slope_or_slips(
    tmp_path: Path, shape: dict[str, object], k: float, theta: float, mu: float
) -> None:
    """By g sin θ / (1 + k) while tan θ ≤ μ (1 + 1/k), else as if it did not turn; k is the inertia by m r²."""
    slope, n, down = incline(theta, material="m")
    turn = Rotation.from_rotvec([0, theta, 0]) * Rotation.from_rotvec([np.pi / 2, 0, 0])
    body = thing("a", position=0.05 * n, orientation=turn.as_quat(), material="m", **shape)
    run = play(tmp_path, [body, slope], 1.0, 30, pairs=pairs(m=(0.2, mu)))
    a = GRAVITY * np.sin(theta) / (1 + k)
    if np.tan(theta) > mu * (1 + 1 / k):
        a = GRAVITY * (np.sin(theta) - mu * np.cos(theta))
    assert (run.path("a")[-1, :3] - run.path("a")[0, :3]) @ down == pytest.approx(a / 2, rel=1e-3)


@pytest.mark.parametrize("mu", [0.1, 0.9])
def test_a_box_knows_the_angle_of_friction_to_half_a_percent(tmp_path: Path, mu: float) -> None:
    for share in (0.995, 1.005):
        theta = np.arctan(share * mu)
        slope, n, down = incline(theta, material="m")
        box = thing("a", box=(0.2, 0.12, 0.04), position=0.02 * n, orientation=turned(0, theta, 0), material="m")
        run = play(tmp_path / str(share), [box, slope], 2.0, 30, pairs=pairs(m=(0.2, mu)))
        way = (run.path("a")[-1, :3] - run.path("a")[1, :3]) @ down
        if share < 1:
            assert abs(way) < 1e-6
        else:
            assert way == pytest.approx(2 * GRAVITY * (np.sin(theta) - mu * np.cos(theta)), rel=0.035)


@pytest.mark.parametrize("spin", [-60.0, 100.0])
def test_a_ball_with_spin_ends_up_rolling(tmp_path: Path, spin: float) -> None:
    ball = thing("a", sphere=0.05, position=(-3, 0, 0.05), velocity=(3, 0, 0), angular_velocity=(0, spin, 0))
    run = play(tmp_path, [ball, floor()], 1.6, 30)
    assert run.velocity("a", -2)[0] == pytest.approx((5 * 3 + 2 * 0.05 * spin) / 7, rel=1e-3)


def test_a_box_on_a_plank_that_slides_comes_along(tmp_path: Path) -> None:
    things = [
        thing("plank", box=(2, 0.4, 0.05), position=(0, 0, 0.025), velocity=(1.5, 0, 0), material="m", mass=4.0),
        thing("a", box=(0.1, 0.1, 0.05), position=(0.5, 0, 0.075), material="m", mass=1.0),
        floor(material="ice"),
    ]
    given = pairs(m=(0.0, 0.25), ice=(0.0, 0.0)) + between("m", "ice", 0.0, 0.0)
    run = play(tmp_path, things, 1.5, pairs=given)
    for name in ("plank", "a"):
        assert run.velocity(name, -2)[0] == pytest.approx(1.2, rel=1e-4)
    slid = run.path("plank")[-1, 0] - (run.path("a")[-1, 0] - 0.5)
    assert slid == pytest.approx(1.5**2 / (2 * 0.25 * GRAVITY * (1 + 1 / 4)), rel=1e-3)


def test_a_ball_on_a_turntable_goes_round_at_two_sevenths_of_its_rate(tmp_path: Path) -> None:
    rate, speed = 3.0, 0.3
    spin = np.cross([0, 0, 1], [0, speed - 0.5 * rate, 0]) / 0.05
    things = [
        thing("a", sphere=0.05, position=(0.5, 0, 0.05), velocity=(0, speed, 0), angular_velocity=spin, material="m"),
        thing("table", "fixed", cylinder=(3, 0.1), topic="/table", material="m"),
    ]
    paths = {"/table": lambda t: (0, 0, -0.05, *turned(0, 0, rate * t))}
    run = play(tmp_path, things, 2.0, paths=paths, pairs=pairs(m=(0.0, 1.0)))
    w = 2 / 7 * rate
    want = [0.5 - speed / w + speed / w * np.cos(w * run.t[-1]), speed / w * np.sin(w * run.t[-1])]
    np.testing.assert_allclose(run.path("a")[-1, :2], want, rtol=0, atol=0.01 * speed / w)


def test_a_tall_box_falls_over_its_edge_in_its_time(tmp_path: Path) -> None:
    b, h, lean = 0.05, 0.3, 0.02
    at = np.arctan(b / h) + lean
    edge = Rotation.from_rotvec([0, at, 0]).apply([b / 2, 0, -h / 2])
    box = thing("a", box=(b, 0.1, h), position=-edge, orientation=turned(0, at, 0), material="m")
    run = play(tmp_path, [box, floor(material="m")], 0.75, 240, pairs=pairs(m=(0.0, 5.0)))
    k = GRAVITY * 0.5 * np.hypot(b, h) / ((b * b + h * h) / 3)
    fall = solve_ivp(
        lambda _, y: [y[1], k * np.sin(y[0])], (0, 0.75), [lean, 0], rtol=1e-9, atol=1e-12, dense_output=True
    )
    own = (Rotation.from_quat(run.path("a")[:, 3:]) * Rotation.from_rotvec([0, at - lean, 0]).inv()).as_rotvec()[:, 1]
    for angle in (0.2, 0.8):
        t = np.interp(angle, own, run.t)
        assert t == pytest.approx(np.interp(angle, *(fall.sol(run.t)[0], run.t)), rel=0.01)


@pytest.mark.parametrize(("theta", "mu", "tips", "slides"), [(0.25, 0.6, 1, 1), (0.15, 0.6, 0, 0), (0.25, 0.15, 0, 1)])
def test_a_box_on_a_slope_tips_slides_or_holds(tmp_path: Path, theta: float, mu: float, tips: int, slides: int) -> None:
    """It tips where tan θ is above width by height, if friction holds it for that."""
    slope, n, _ = incline(theta, material="m")
    box = thing("a", box=(0.06, 0.2, 0.3), position=0.15 * n, orientation=turned(0, theta, 0), material="m")
    run = play(tmp_path, [box, slope], 0.6, 30, pairs=pairs(m=(0.0, mu)))
    far, turn = run.drift("a")
    assert (turn > 45) == bool(tips)
    assert (far > 0.01) == bool(slides)
    assert turn > 45 or turn < 1e-3


def test_dominoes_fall_one_after_the_other(tmp_path: Path) -> None:
    stones = [thing(f"d{k}", box=(0.02, 0.06, 0.12), position=(0.06 * k, 0, 0.06)) for k in range(1, 7)]
    first = thing(
        "d0", box=(0.02, 0.06, 0.12), position=(0, 0, 0.06), velocity=(0.36, 0, 0), angular_velocity=(0, 6, 0)
    )
    run = play(tmp_path, [first, *stones, floor()], 1.2)
    turn = [np.degrees(Rotation.from_quat(run.path(f"d{k}")[:, 3:]).magnitude()) for k in range(7)]
    times = [run.t[np.flatnonzero(angle > 20)[0]] for angle in turn]
    assert np.all(np.diff(times) > 0)
    assert min(angle[-1] for angle in turn) > 60
    assert run.overlap <= 1e-5


def test_a_top_precesses(tmp_path: Path) -> None:
    """Steadily, a rate W about the vertical keeps  (I₃ w - I₁ W cos θ) W = g l  for a cone that stands on its tip."""
    radius, height, spin, tilt = 0.05, 0.08, 200.0, 0.3
    cone = trimesh.creation.cone(radius=radius, height=height, sections=48)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    cone.apply_translation([0, 0, height])
    cone.export(tmp_path / "top.stl")
    arm, side, own = 0.75 * height, 3 / 80 * (4 * radius**2 + height**2), 0.3 * radius**2
    roots = np.roots([-(side + arm * arm) * np.cos(tilt), own * spin, -GRAVITY * arm])
    rate = float(roots[np.abs(roots).argmin()].real)
    turn = Rotation.from_rotvec([0, tilt, 0])
    w = rate * np.array([0, 0, 1]) + (spin - rate * np.cos(tilt)) * turn.apply([0, 0, 1])
    v = np.cross(w, turn.apply([0, 0, arm]))
    top = thing(
        "top", mesh="top.stl", decomposition="hull", position=(0, 0, 2e-6), orientation=turn.as_quat(), velocity=v,
        angular_velocity=w, material="m",
    )  # fmt: skip
    run = play(tmp_path, [top, floor(material="m")], 1.0, pairs=pairs(m=(0.0, 3.0)))
    axis = Rotation.from_quat(run.path("top")[:, 3:]).apply([0, 0, 1])
    round_ = np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
    assert round_[-1] / run.t[-1] == pytest.approx(rate, rel=0.01)
    assert np.abs(np.arccos(axis[:, 2]) - tilt).max() < 0.02
