"""Bodies that touch nothing: parabola, momentum, energy, and the motion of a top."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from geomphys.scene.pieces import Box, Cylinder, Sphere
from tests.simulated.scenes import GRAVITY, Player, Thing

BRICK = Box((0.1, 0.06, 0.03))  # three different moments


def spin_momentum(player: Player) -> np.ndarray:
    bodies = player.scene.bodies
    axes = Rotation.from_quat(player.poses[0, 3:]) * Rotation.from_quat(bodies.principal[0])
    return axes.apply(bodies.inertia[0] * axes.inv().apply(player.velocity[0, 3:]))


@pytest.mark.parametrize("rate", [24, 60, 240])
def test_free_flight_is_the_parabola(rate: int) -> None:
    shape = [(Box((0.1, 0.02, 0.02)), (0, 0, 0)), (Sphere(0.04), (0.15, 0.0, 0.0))]
    player = Player([Thing(shape=shape, at=(1, 2, 30), v=(1, -2, 3), w=(3, 1, -2))])
    com = player.scene.bodies.com[0]
    start = player.poses[0, :3] + com
    for _ in range(rate):
        player.step(1 / rate)
    t = player.time
    centre = player.poses[0, :3] + Rotation.from_quat(player.poses[0, 3:]).apply(com)
    np.testing.assert_allclose(
        centre, start + np.array([1, -2, 3]) * t - [0, 0, GRAVITY * t * t / 2], rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(player.velocity[0, :3], [1, -2, 3 - GRAVITY * t], rtol=0, atol=1e-12)


@pytest.mark.parametrize("rate", [30, 240])
def test_a_tumbling_brick_keeps_momentum_and_energy_for_a_minute(rate: int) -> None:
    # about the middle axis, where the motion is unstable
    player = Player([Thing(shape=BRICK, w=(0.1, 10, 0.05))], gravity=(0, 0, 0))
    momentum, energy = spin_momentum(player), player.energy()
    for _ in range(60):
        player.run(1.0, rate)
        np.testing.assert_allclose(spin_momentum(player), momentum, rtol=0, atol=1e-12 * np.linalg.norm(momentum))
        assert player.energy() == pytest.approx(energy, rel=1e-9)


def test_a_tumbling_brick_moves_as_an_independent_integrator_says() -> None:
    w = np.array([4.0, 7.0, -3.0])
    player = Player([Thing(shape=BRICK, w=w)], gravity=(0, 0, 0))
    inertia = player.scene.bodies.inertia[0]

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        """Euler's equations in the body frame, and the quaternion (x y z w)."""
        q, own = y[:4], y[4:]
        turn = np.array([own[0], own[1], own[2], 0.0])
        dq = 0.5 * np.array(
            [
                q[3] * turn[0] + q[1] * turn[2] - q[2] * turn[1],
                q[3] * turn[1] + q[2] * turn[0] - q[0] * turn[2],
                q[3] * turn[2] + q[0] * turn[1] - q[1] * turn[0],
                -q[:3] @ turn[:3],
            ]
        )
        return np.concatenate([dq, -np.cross(own, inertia * own) / inertia])

    other = solve_ivp(slope, (0, 3), [0, 0, 0, 1, *w], method="DOP853", rtol=1e-12, atol=1e-12).y[:4, -1]
    player.run(3.0)
    off = Rotation.from_quat(player.poses[0, 3:]) * Rotation.from_quat(other).inv()
    assert off.magnitude() < 1e-6


def test_a_symmetric_top_precesses_at_its_rate() -> None:
    """The axis of a free top goes round its angular momentum at the rate |L| / I_side."""
    player = Player([Thing(shape=Cylinder(0.05, 0.02), w=(1.0, 0.0, 8.0))], gravity=(0, 0, 0))
    momentum, side = spin_momentum(player), player.scene.bodies.inertia[0, 0]
    player.run(1.0)
    about = Rotation.from_rotvec(momentum / side)
    np.testing.assert_allclose(
        Rotation.from_quat(player.poses[0, 3:]).apply([0, 0, 1]), about.apply([0, 0, 1]), rtol=0, atol=1e-7
    )


def test_a_turned_body_at_rest_in_space_stays_bit_for_bit() -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.9]).as_quat()
    player = Player([Thing(shape=BRICK, at=(0.1, 0.2, 0.3), turn=turn)], gravity=(0, 0, 0))
    track = player.run(1.0)
    assert np.array_equal(track[0], track[-1])
