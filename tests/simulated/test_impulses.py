"""Collisions: (7) to (10) at single points by their formulas, and the laws that hold at any number of points."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.contact_points import fill_masses
from geomphys.simulated.impulses import collide, exclude_disabled, solve_friction, solve_normal, stopping_impulse
from tests.simulated.scenes import Player, Thing, floor
from tests.simulated.stages import Stage

BALLS = [
    Thing(shape=Sphere(0.05), at=(0, 0, 0), mass=0.7),
    Thing(shape=Box((0.03, 0.04, 0.05)), at=(0.08, 0, 0), mass=1.9, turn=tuple(Rotation.from_rotvec([0, 0, 0.01]).as_quat())),
]  # fmt: skip


class Collision:
    """A moment at which the points of a stage collide, with velocities (B, 6) that are set here."""

    def __init__(self, stage: Stage, velocity: np.ndarray) -> None:
        self.stage, self.before = stage, velocity
        self.velocity = velocity.copy()
        stage.contacts["mode"] = 2
        for name in ("normal_impulse", "tangent_impulse", "target_speed"):
            stage.contacts[name] = 0.0

    def resolve(self, elastic: float = 1.0) -> None:
        self.stage.call(collide, self.velocity, elastic)

    def speeds(self, velocity: np.ndarray) -> np.ndarray:
        """(n, 3) relative velocities along normal, tangent and binormal."""
        out = []
        for r in self.stage.contacts:
            va, vb = velocity[r["a"]], velocity[r["b"]]
            v = va[:3] + np.cross(va[3:], r["arm_a"]) - vb[:3] - np.cross(vb[3:], r["arm_b"])
            out.append([v @ r[name] for name in ("normal", "tangent", "binormal")])
        return np.array(out)

    def impulses(self) -> np.ndarray:
        """(n, 3) along normal, tangent and binormal."""
        return np.column_stack([self.stage.contacts["normal_impulse"], self.stage.contacts["tangent_impulse"]])

    def momentum(self, velocity: np.ndarray, bodies: int = 2) -> np.ndarray:
        """Momentum and angular momentum about the origin of the first bodies."""
        m = self.stage.motion[:bodies]
        p = m["mass"][:, None] * velocity[:bodies, :3]
        spin = np.einsum("bij,bj->bi", np.linalg.inv(m["inverse_inertia"].reshape(-1, 3, 3)), velocity[:bodies, 3:])
        return np.concatenate([p.sum(axis=0), (np.cross(m["position"], p) + spin).sum(axis=0)])

    def energy(self, velocity: np.ndarray, bodies: int = 2) -> float:
        m = self.stage.motion[:bodies]
        inertia = np.linalg.inv(m["inverse_inertia"].reshape(-1, 3, 3))
        spin = np.einsum("bi,bij,bj", velocity[:bodies, 3:], inertia, velocity[:bodies, 3:])
        return float(0.5 * (m["mass"] * (velocity[:bodies, :3] ** 2).sum(axis=1)).sum() + 0.5 * spin)


def at_one_point(seed: int, friction: float, restitution: float) -> Collision:
    """Two free bodies that approach each other at a point anywhere on them, with a normal in any direction."""
    rng = np.random.default_rng(seed)
    stage = Stage(Player(BALLS, gravity=(0, 0, 0)))
    r = stage.contacts[:1]
    stage.player.simulation.counts["contacts"] = 1
    axes = Rotation.random(random_state=int(seed)).as_matrix()
    r["normal"], r["tangent"], r["binormal"] = axes[:, 0], axes[:, 1], axes[:, 2]
    point = rng.uniform(-0.06, 0.06, 3)
    r["arm_a"], r["arm_b"] = point - stage.motion["position"][0], point - stage.motion["position"][1]
    r["friction"], r["restitution"] = friction, restitution
    fill_masses(stage.motion[0], stage.motion[1], r[0])
    made = Collision(stage, rng.normal(size=(2, 6)))
    if made.speeds(made.velocity)[0, 0] > 0.0:
        made.before *= -1.0
        made.velocity *= -1.0
    return made


def response(made: Collision) -> np.ndarray:
    """(3, 3) change of the relative velocity by a unit impulse, by (9): 1/m_a + 1/m_b + (I⁻¹ (r × n)) × r of both."""
    r, total = made.stage.contacts[0], np.zeros((3, 3))
    axes = [r[name] for name in ("normal", "tangent", "binormal")]
    for body, arm in ((r["a"], r["arm_a"]), (r["b"], r["arm_b"])):
        m = made.stage.motion[body]
        inverse = m["inverse_inertia"].reshape(3, 3)
        for j, d in enumerate(axes):
            change = d / m["mass"] + np.cross(inverse @ np.cross(arm, d), arm)
            total[:, j] += [change @ axis for axis in axes]
    return total


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("restitution", [0.0, 0.3, 1.0])
def test_a_frictionless_collision_is_equations_8_and_9(seed: int, restitution: float) -> None:
    made = at_one_point(seed, 0.0, restitution)
    v = made.speeds(made.velocity)[0, 0]
    made.resolve()
    assert made.speeds(made.velocity)[0, 0] == pytest.approx(-restitution * v, rel=1e-12, abs=1e-15)
    assert made.impulses()[0] == pytest.approx([-(1.0 + restitution) * v / response(made)[0, 0], 0, 0], rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("friction", [0.05, 0.3, 5.0])
def test_friction_is_equation_10_along_the_sliding_and_no_more_than_stops_it(seed: int, friction: float) -> None:
    made = at_one_point(seed, friction, 0.3)
    frictionless = at_one_point(seed, 0.0, 0.3)
    frictionless.resolve()
    sliding = frictionless.speeds(frictionless.velocity)[0, 1:]
    made.resolve()
    j, *tangential = made.impulses()[0]
    direction = sliding / np.linalg.norm(sliding)
    stopping = np.linalg.norm(sliding) / (direction @ response(made)[1:, 1:] @ direction)
    assert tangential == pytest.approx(-min(friction * j, stopping) * direction, rel=1e-10)
    assert np.hypot(*tangential) <= friction * j * (1.0 + 1e-12)
    along = made.speeds(made.velocity)[0, 1:] @ direction
    assert along >= -1e-12 * np.linalg.norm(sliding)


@pytest.mark.parametrize("elastic", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(8))
def test_momentum_and_angular_momentum_are_kept_and_energy_does_not_rise(seed: int, elastic: float) -> None:
    made = at_one_point(seed, 0.4, 0.9)
    made.resolve(elastic)
    assert made.momentum(made.velocity) == pytest.approx(made.momentum(made.before), abs=1e-12)
    assert made.energy(made.velocity) <= made.energy(made.before) * (1.0 + 1e-13)
    v, w = made.speeds(made.before)[0, 0], made.speeds(made.velocity)[0, 0]
    if elastic == 0.0:  # no restitution, and friction may push it on
        assert made.impulses()[0, 0] == pytest.approx(-v / response(made)[0, 0], rel=1e-12)
    assert w > v


def on_the_floor(velocity: tuple[float, ...], friction: float, restitution: float) -> Collision:
    """A cube that lands with four corners."""
    stage = Stage(Player([Thing(shape=Box((0.05, 0.03, 0.04)), at=(0, 0, 0.04 + 2e-6)), floor()]))
    assert len(stage.contacts) == 4
    stage.contacts["friction"], stage.contacts["restitution"] = friction, restitution
    return Collision(stage, np.array([velocity, np.zeros(6)], float))


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("seed", range(6))
def test_the_points_of_a_face_leave_together(seed: int, restitution: float) -> None:
    """(8) holds at each that is pressed, others leave faster, and no point pulls: the solution is that of least energy."""
    spin = np.random.default_rng(seed).normal(size=3)
    made = on_the_floor((0.1, -0.2, -1.0, *spin), 0.0, restitution)
    before = made.speeds(made.before)[:, 0]
    made.resolve()
    after, pressed = made.speeds(made.velocity)[:, 0], made.impulses()[:, 0]
    target = np.maximum(0.0, -restitution * before)
    assert (pressed >= 0.0).all()
    assert (after >= target - 1e-9).all()
    assert np.abs(pressed * (after - target)).max() < 1e-9
    m = made.stage.motion[0]
    root = np.zeros((6, 6))  # M^(1/2)
    values, vectors = np.linalg.eigh(np.linalg.inv(m["inverse_inertia"].reshape(3, 3)))
    root[:3, :3], root[3:, 3:] = math.sqrt(m["mass"]) * np.eye(3), vectors @ np.diag(np.sqrt(values)) @ vectors.T
    jacobian = np.array([[*r["normal"], *np.cross(r["arm_a"], r["normal"])] for r in made.stage.contacts])
    if restitution == 0.0:
        scaled = jacobian @ np.linalg.inv(root)
        solution, _ = nnls(scaled.T, -root @ made.before[0])
        expected = made.before[0] + np.linalg.solve(root @ root, jacobian.T @ solution)
        assert made.velocity[0] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("friction", [0.1, 0.8])
def test_friction_of_several_points_is_within_the_cone_of_each(friction: float) -> None:
    made = on_the_floor((2.0, 0.5, -1.0, 0.0, 0.0, 4.0), friction, 0.3)
    before = made.energy(made.before, 1)
    made.resolve()
    j = made.impulses()
    assert (np.hypot(j[:, 1], j[:, 2]) <= friction * j[:, 0] * (1.0 + 1e-12)).all()
    assert made.energy(made.velocity, 1) < before
    sliding = made.speeds(made.velocity)[:, 1:]
    assert (np.einsum("ij,ij->i", sliding, j[:, 1:]) <= 1e-9).all()  # it opposes


def test_only_rows_that_take_part_are_given_impulses() -> None:
    made = on_the_floor((0, 0, -1.0, 0, 0, 0), 0.3, 0.3)
    made.stage.contacts["mode"] = (2, 1, 0, 2)
    made.resolve()
    assert (made.impulses()[[1, 2]] == 0.0).all()
    assert (made.impulses()[[0, 3], 0] > 0.0).any()


def test_rows_of_disabled_pairs_are_taken_out() -> None:
    stage = Stage(Player([*(Thing(shape=Sphere(0.05), at=(0.3 * k, 0, 0.05)) for k in range(3)), floor()]))
    stage.pairs["disabled"] = 0
    stage.pairs["disabled"][int(stage.contacts["pair"][1])] = 1
    stage.contacts["mode"] = 1
    stage.call(exclude_disabled)
    assert stage.contacts["mode"].tolist() == [1, 0, 1]


@pytest.mark.parametrize("limit", [math.inf, 0.02])
def test_a_normal_impulse_is_neither_negative_nor_above_its_limit(limit: float) -> None:
    made = at_one_point(1, 0.0, 0.0)
    r, k = made.stage.contacts[0], made.stage.contacts["impulse_limit"]
    k[0] = limit
    v = made.speeds(made.velocity)[0, 0]
    mass = response(made)[0, 0]
    change = made.stage.call(solve_normal, made.velocity, 0)
    assert r["normal_impulse"] == pytest.approx(min(limit, -v / mass), rel=1e-12)
    assert change == pytest.approx(r["normal_impulse"] * mass, rel=1e-12)
    made.velocity[0] += 10.0 * np.concatenate([r["normal"], np.zeros(3)])  # it leaves by itself
    made.stage.call(solve_normal, made.velocity, 0)
    assert r["normal_impulse"] == 0.0


def test_a_visit_stops_the_sliding_where_the_cone_allows_it() -> None:
    made = at_one_point(2, 0.0, 0.0)
    made.stage.call(solve_friction, made.velocity, 0, 1e3)
    assert made.speeds(made.velocity)[0, 1:] == pytest.approx([0, 0], abs=1e-12)
    made = at_one_point(2, 0.0, 0.0)
    made.stage.call(solve_friction, made.velocity, 0, 0.01)
    assert np.hypot(*made.impulses()[0, 1:]) == pytest.approx(0.01, rel=1e-12)


def test_a_friction_impulse_that_stops_the_sliding_solves_the_two_equations() -> None:
    """K x = -v; beyond the disc the impulse is on its rim and opposes the sliding."""
    made = at_one_point(3, 0.0, 0.0)
    r, k = made.stage.contacts[0], response(made)[1:, 1:]
    v = np.array([0.4, -0.7])
    free = np.array(stopping_impulse(r, *v, 1e3))
    assert k @ free == pytest.approx(-v, rel=1e-12)
    bounded = np.array(stopping_impulse(r, *v, 0.5 * np.linalg.norm(free)))
    assert np.linalg.norm(bounded) == pytest.approx(0.5 * np.linalg.norm(free), rel=1e-12)
    assert bounded @ v == pytest.approx(-np.linalg.norm(bounded) * np.linalg.norm(v), rel=1e-12)
