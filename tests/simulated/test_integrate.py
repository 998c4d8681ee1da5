"""Free rotation of a rigid body against an independent integrator, and the tensors it goes by."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from geomphys.simulated.integrate import angular_momentum, angular_velocity, inverse_inertia, rotate_freely

Vec = tuple[float, float, float]
INERTIA: Vec = (1.0e-3, 2.0e-3, 3.5e-3)
BALL: Vec = (2.0e-3, 2.0e-3, 2.0e-3)


def some(seed: int) -> tuple[Rotation, Vec]:
    """An orientation and a vector."""
    rng = np.random.default_rng(seed)
    x, y, z = rng.normal(size=3).tolist()
    return Rotation.random(random_state=rng), (x, y, z)


def plain(q: Rotation) -> tuple[float, ...]:
    """A quaternion as floats, x y z w."""
    return tuple(q.as_quat().tolist())


@pytest.mark.parametrize("seed", range(5))
def test_momentum_is_the_tensor_times_the_angular_velocity(seed: int) -> None:
    q, spin = some(seed)
    tensor = q.as_matrix() @ np.diag(INERTIA) @ q.as_matrix().T
    momentum = angular_momentum(plain(q), INERTIA, spin)
    assert momentum == pytest.approx(tensor @ spin, rel=1e-12)
    assert angular_velocity(plain(q), INERTIA, momentum) == pytest.approx(spin, rel=1e-12)
    inverse = np.reshape(inverse_inertia(plain(q), INERTIA), (3, 3))
    np.testing.assert_allclose(inverse, np.linalg.inv(tensor), rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("twist", [0.0, 0.02])
@pytest.mark.parametrize("inertia", [INERTIA, BALL])
@pytest.mark.parametrize("step", [1 / 240, 1 / 30])
def test_a_body_turns_as_euler_says(seed: int, twist: float, inertia: Vec, step: float) -> None:
    """World frame: dL/dt = torque, dq/dt = ½ ω q."""
    q, spin = some(seed)
    momentum = np.array(angular_momentum(plain(q), inertia, spin))
    torque = twist * np.array(some(seed + 50)[1])

    def change(time: float, state: np.ndarray) -> np.ndarray:
        unit = state / np.linalg.norm(state)
        r = Rotation.from_quat(unit).as_matrix()
        w = r @ ((r.T @ (momentum + time * torque)) / inertia)
        x, y, z, s = state
        return 0.5 * np.array(
            [
                w[0] * s + w[1] * z - w[2] * y,
                w[1] * s + w[2] * x - w[0] * z,
                w[2] * s + w[0] * y - w[1] * x,
                -w[0] * x - w[1] * y - w[2] * z,
            ]
        )

    exact = solve_ivp(change, (0.0, step), q.as_quat(), rtol=1e-12, atol=1e-14).y[:, -1]
    turned = rotate_freely(plain(q), inertia, tuple(momentum.tolist()), tuple(torque.tolist()), step)
    assert np.linalg.norm(turned) == pytest.approx(1.0, abs=1e-12)
    off = (Rotation.from_quat(turned) * Rotation.from_quat(exact).inv()).magnitude()
    assert off < 1e-7
    assert (Rotation.from_quat(turned) * q.inv()).magnitude() > 1e-4
