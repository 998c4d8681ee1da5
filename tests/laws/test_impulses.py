"""Collisions against closed forms: restitution, momentum, friction, energy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Capsule, Sphere
from tests.simulated.scenes import FRICTION, GRAVITY, MATERIALS, RESTITUTION, Player, Thing, floor

BUILT_IN = ("wood", "human", "metal")


def pair(table: np.ndarray, a: str, b: str) -> float:
    return float(table[MATERIALS.index(a), MATERIALS.index(b)])


def momenta(player: Player) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular momentum about the origin of all simulated bodies."""
    bodies = player.scene.bodies
    linear, angular = np.zeros(3), np.zeros(3)
    for b in np.flatnonzero(bodies.role == s.SIMULATED):
        turn = Rotation.from_quat(player.poses[b, 3:])
        centre = player.poses[b, :3] + turn.apply(bodies.com[b])
        axes = turn * Rotation.from_quat(bodies.principal[b])
        p = bodies.mass[b] * player.velocity[b, :3]
        linear += p
        angular += np.cross(centre, p) + axes.apply(bodies.inertia[b] * axes.inv().apply(player.velocity[b, 3:]))
    return linear, angular


def play_to_impact(player: Player, rate: float = 60.0, frames: int = 200) -> None:
    for _ in range(frames):
        if player.impacts:
            return
        player.step(1.0 / rate)
    raise AssertionError("nothing met")


@pytest.mark.parametrize(("a", "b"), list(itertools.combinations_with_replacement(BUILT_IN, 2)))
def test_a_dropped_ball_rebounds_to_the_square_of_restitution(a: str, b: str) -> None:
    height = 0.8
    player = Player([Thing(shape=Sphere(0.04), at=(0, 0, 0.04 + height), material=a), floor(b)])
    play_to_impact(player)
    apex = player.poses[0, 2] - 0.04 + player.velocity[0, 2] ** 2 / (2 * GRAVITY)
    assert apex == pytest.approx(pair(RESTITUTION, a, b) ** 2 * height, rel=1e-3)


def test_a_rebound_does_not_depend_on_the_frame_rate() -> None:
    apexes = []
    for rate in (30, 57, 60, 120, 240):
        player = Player([Thing(shape=Sphere(0.04), at=(0, 0, 0.54), material="rubber"), floor("rubber")])
        play_to_impact(player, rate)
        apexes.append(player.poses[0, 2] + player.velocity[0, 2] ** 2 / (2 * GRAVITY))
    assert np.ptp(apexes) < 1e-6


@pytest.mark.parametrize(("a", "b"), [("metal", "metal"), ("rubber", "wood"), ("human", "metal")])
def test_head_on_collision_keeps_momentum_and_obeys_restitution(a: str, b: str) -> None:
    player = Player(
        [
            Thing(shape=Sphere(0.03), at=(-0.2, 0, 0), v=(3, 0, 0), material=a),
            Thing(shape=Sphere(0.05), at=(0.2, 0, 0), v=(-1, 0, 0), material=b),
        ],
        gravity=(0, 0, 0),
    )
    m = player.scene.bodies.mass
    play_to_impact(player)
    v = player.velocity[:, 0]
    assert m @ v == pytest.approx(m @ [3, -1], rel=1e-12)
    assert v[1] - v[0] == pytest.approx(pair(RESTITUTION, a, b) * 4, rel=1e-12)
    assert np.abs(player.velocity[:, 1:]).max() == 0.0


@pytest.mark.parametrize(
    ("offset", "materials"), [(0.02, ("wood", "wood")), (0.05, ("metal", "wood")), (0.06, ("rubber", "rubber"))]
)
def test_oblique_collision_of_balls_is_the_textbooks(offset: float, materials: tuple[str, str]) -> None:
    """Normal impulse by restitution; friction μ j, or what stops the sliding of the surfaces: 2/7 of the reduced mass."""
    ra, rb = 0.03, 0.05
    player = Player(
        [
            Thing(shape=Sphere(ra), at=(-0.3, offset, 0), v=(2, 0, 0), w=(0, 0, 5), material=materials[0]),
            Thing(shape=Sphere(rb), at=(0, 0, 0), material=materials[1]),
        ],
        gravity=(0, 0, 0),
    )
    ma, mb = player.scene.bodies.mass
    ia, ib = player.scene.bodies.inertia[:, 0]
    play_to_impact(player)
    apart = ra + rb + player.gap
    n = np.array([-np.sqrt(apart**2 - offset**2), offset, 0]) / apart  # out of b into a
    v_ab = np.array([2.0, 0, 0]) + np.cross([0, 0, 5], -ra * n)
    vn = n @ v_ab
    vt = v_ab - vn * n
    j = -(1 + pair(RESTITUTION, *materials)) * vn / (1 / ma + 1 / mb)
    stop = np.linalg.norm(vt) / (1 / ma + 1 / mb + ra**2 / ia + rb**2 / ib)
    total = j * n - min(pair(FRICTION, *materials) * j, stop) * vt / np.linalg.norm(vt)
    expected = np.array(
        [
            [*(np.array([2.0, 0, 0]) + total / ma), *(np.array([0, 0, 5]) + np.cross(-ra * n, total) / ia)],
            [*(-total / mb), *(np.cross(rb * n, -total) / ib)],
        ]
    )
    # the bodies halt with between one and one and a quarter gaps between them, which turns n by as much
    np.testing.assert_allclose(player.velocity, expected, rtol=1e-4, atol=1e-4)
    linear, angular = momenta(player)
    np.testing.assert_allclose(linear, [2 * ma, 0, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(angular, [0, 0, -offset * 2 * ma + 5 * ia], rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(6))
def test_colliding_bodies_keep_momentum_and_lose_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shapes = [
        Box(tuple(rng.uniform(0.02, 0.08, 3))),
        Capsule(0.03, 0.06),
        # two boxes at a right angle: the centre of mass lies off the body's origin, the axes are turned
        [(Box((0.08, 0.02, 0.02)), (0, 0, 0)), (Box((0.02, 0.05, 0.02)), (0.06, 0.07, 0.01))],
    ]
    things = [
        Thing(
            shape=shape,
            at=0.25 * np.array([k - 1.0, rng.uniform(-0.2, 0.2), rng.uniform(-0.2, 0.2)]),
            turn=Rotation.random(random_state=10 * seed + k).as_quat(),
            v=(2.0 * (1 - k), *rng.uniform(-0.2, 0.2, 2)),
            w=rng.normal(size=3) * 4,
            material=("rubber", "wood", "metal")[k],
        )
        for k, shape in enumerate(shapes)
    ]
    player = Player(things, gravity=(0, 0, 0))
    before, energy = momenta(player), player.energy()
    for _ in range(40):
        player.step(1 / 60)
        after = player.energy()
        assert after <= energy * (1 + 1e-9)
        energy = after
        linear, angular = momenta(player)
        np.testing.assert_allclose(linear, before[0], rtol=0, atol=1e-12)
        # keeping surfaces a gap apart moves them micrometres
        np.testing.assert_allclose(angular, before[1], rtol=0, atol=2e-4)
        assert player.overlap() < 1e-5
    assert player.impacts > 0
    assert player.flags == 0


@pytest.mark.parametrize("material", ["rubber", "metal"])
@pytest.mark.parametrize("seed", range(3))
def test_a_corner_that_hits_the_floor_gets_the_textbooks_impulse(seed: int, material: str) -> None:
    """With K = 1/m - [r] I⁻¹ [r]: j by (9), then μ j against the sliding, or what stops it along its direction."""
    rng = np.random.default_rng(seed)
    half, turn = np.array([0.06, 0.04, 0.03]), Rotation.random(random_state=seed)
    corners = turn.apply([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)] * half)
    r = corners[corners[:, 2].argmin()]
    v, w = np.array([*rng.uniform(-2, 2, 2), -3.0]), 3 * rng.normal(size=3)
    box = Thing(shape=Box(tuple(half)), at=(0, 0, 1e-5 - r[2]), turn=turn.as_quat(), v=v, w=w, material=material)
    player = Player([box, floor(material)], gravity=(0, 0, 0))
    m, spread = (
        player.scene.bodies.mass[0],
        turn.as_matrix() @ np.diag(1 / player.scene.bodies.inertia[0]) @ turn.as_matrix().T,
    )
    cross = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    response, n = np.eye(3) / m - cross @ spread @ cross, np.array([0, 0, 1])
    at = v + np.cross(w, r)
    j = -(1 + pair(RESTITUTION, material, material)) * at[2] / response[2, 2]
    sliding = (at + response @ n * j) * [1, 1, 0]
    along = -sliding / np.linalg.norm(sliding)
    rub = min(pair(FRICTION, material, material) * j, np.linalg.norm(sliding) / (along @ response @ along))
    total = j * n + rub * along
    player.step(1e-5)
    assert player.impacts == 1
    np.testing.assert_allclose(player.velocity[0, :3], v + total / m, rtol=0, atol=2e-3)
    np.testing.assert_allclose(player.velocity[0, 3:], w + spread @ np.cross(r, total), rtol=0, atol=0.1)


def test_a_box_that_lands_flat_while_it_slides_is_slowed_by_friction_times_the_impulse() -> None:
    player = Player([Thing(shape=Box((0.1, 0.07, 0.03)), at=(0, 0, 0.33), v=(2, 1, 0), material="wood"), floor()])
    play_to_impact(player)
    fall = np.sqrt(2 * 0.3 / GRAVITY)
    pushed = GRAVITY * fall + player.velocity[0, 2] + GRAVITY * (player.time - fall)
    slowed = np.hypot(2, 1) - np.hypot(*player.velocity[0, :2])
    assert pushed >= 1.3 * GRAVITY * fall * (1 - 1e-3)
    assert slowed == pytest.approx(pair(FRICTION, "wood", "wood") * pushed, rel=2e-3)


def test_a_flat_fall_does_not_turn_a_box() -> None:
    player = Player([Thing(shape=Box((0.1, 0.07, 0.03)), at=(0, 0, 0.53)), floor()])
    play_to_impact(player)
    assert np.abs(player.velocity[0, 3:]).max() < 1e-9
    apex = player.poses[0, 2] - 0.03 + player.velocity[0, 2] ** 2 / (2 * GRAVITY)
    assert apex == pytest.approx(0.09 * 0.5, rel=1e-3)


def test_a_fall_across_a_seam_does_not_turn_a_box() -> None:
    halves = [Thing(shape=Box((1.0, 1.0, 0.1)), role=s.FIXED, at=(x, 0, -0.1)) for x in (-1.0, 1.0)]
    player = Player([Thing(shape=Box((0.1, 0.07, 0.03)), at=(0.02, 0, 0.33)), *halves])
    play_to_impact(player)
    assert np.abs(player.velocity[0, 3:]).max() < 1e-9


def test_the_ball_at_the_end_of_a_row_takes_the_motion_along() -> None:
    """Elastic collisions pass the motion on, one at a time; nearly elastic ones nearly."""
    contact = [Thing(shape=Sphere(0.05), at=(0.1 * k + 2e-6 * k, 0, 0), material="rubber") for k in range(4)]
    player = Player(
        [Thing(shape=Sphere(0.05), at=(-0.5, 0, 0), v=(1, 0, 0), material="rubber"), *contact], gravity=(0, 0, 0)
    )
    play_to_impact(player)
    v = player.velocity[:, 0]
    assert v[-1] == pytest.approx(0.95**4, rel=1e-9)
    assert player.scene.bodies.mass @ v == pytest.approx(player.scene.bodies.mass[0], rel=1e-12)
