"""The coupling's closed form against an integration of (6), and the laws it must keep."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from geomphys.driven.coupling import relax


@pytest.mark.parametrize(
    ("mass", "stiffness", "damping"), [(0.4, 1000.0, 40.0), (0.4, 1000.0, 5.0), (0.4, 1000.0, 90.0), (2.0, 50.0, 0.0)]
)
def test_follows_the_differential_equation(mass, stiffness, damping):
    truth = solve_ivp(
        lambda t, y: [y[1], -(stiffness * y[0] + damping * y[1]) / mass],
        (0, 0.05),
        [0.02, -0.3],
        rtol=1e-11,
        atol=1e-14,
    ).y[:, -1]
    assert relax(0.02, -0.3, mass, stiffness, damping, 0.05) == pytest.approx(truth, rel=1e-7, abs=1e-10)


@pytest.mark.parametrize("damping", [80.0, 4000.0, 1e9])
def test_a_strong_damper_in_a_long_gap_does_not_overflow(damping):
    """The slower of two decays is left: x' = -x K / R, where R is large."""
    for gap in (0.5, 10.0, 1e5):
        x, v = relax(0.02, 0.0, 0.4, 1000.0, damping, gap)
        rate = 0.5 * damping / 0.4
        slow = 1000.0 / 0.4 / (rate + math.sqrt(rate * rate - 1000.0 / 0.4))
        left = 0.02 * math.exp(-slow * gap)
        assert x == pytest.approx(left, rel=1.0 if damping < 1000 else 1e-3, abs=2e-9)
        assert v == pytest.approx(-slow * x, abs=2e-7)


def test_frame_rate_does_not_matter():
    x, v = 0.01, 0.0
    for _ in range(24):
        x, v = relax(x, v, 0.4, 1000.0, 40.0, 1 / 240)
    assert (x, v) == pytest.approx(relax(0.01, 0.0, 0.4, 1000.0, 40.0, 0.1), rel=1e-12)


def test_no_offset_stays_none():
    assert relax(0.0, 0.0, 0.4, 1000.0, 40.0, 0.01) == (0.0, 0.0)


def test_decays_without_overshoot_to_exactly_nothing():
    """Critically damped: m = R²/4K."""
    x, v, seen = 0.03, 0.0, [0.03]
    for _ in range(200):
        x, v = relax(x, v, 0.4, 1000.0, 40.0, 0.01)
        seen.append(x)
    assert np.all(np.diff(seen) <= 0)
    assert min(seen) >= 0.0
    assert (x, v) == (0.0, 0.0)


def test_a_rigid_coupling_keeps_no_offset():
    assert relax(0.05, 1.0, 0.4, math.inf, 40.0, 0.01) == (0.0, 0.0)
