"""Virtual coupling: the damped spring from a driven body to its recorded pose.

    m A = -K x - R ẋ                                                                   (6)

governs the *offset* x of the body from its recorded pose, solved in closed form over a frame, so that the result does
not depend on the frame rate and a body without an offset keeps none.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Trees

NEGLIGIBLE_OFFSET = 1e-9  # m or rad: a smaller offset at a low rate is set to zero
NEGLIGIBLE_RATE = 1e-7  # m/s or rad/s

RIGID, CRITICAL, OSCILLATING, DECAYING = 0, 1, 2, 3  # kinds of a relaxation


class Relaxation(NamedTuple):
    """The motion of (6) over a time: every offset with the same coupling relaxes by it."""

    kind: int  # RIGID, CRITICAL, OSCILLATING or DECAYING
    square: float  # 1/s², K / m
    rate: float  # 1/s, R / 2 m
    time: float  # s
    decay: float  # CRITICAL and OSCILLATING: by which the amplitude shrinks
    from_offset: float  # coefficients of the others, which differ by their kind
    from_rate: float
    rate_from_rate: float
    scale: float


@kernel
def relaxation(mass: float, stiffness: float, damping: float, dt: float) -> Relaxation:
    """The motion of (6) over `dt` [s]; m, K and R as in `relax`."""
    if math.isinf(stiffness):
        return Relaxation(RIGID, 0.0, 0.0, dt, 0.0, 0.0, 0.0, 0.0, 1.0)
    rate = 0.5 * damping / mass
    square = stiffness / mass - rate * rate
    if abs(square) * dt * dt < 1e-12:
        return Relaxation(CRITICAL, stiffness / mass, rate, dt, math.exp(-rate * dt), 0.0, 0.0, 0.0, 1.0)
    if square > 0.0:
        omega = math.sqrt(square)
        c, s = math.cos(omega * dt), math.sin(omega * dt) / omega
        return Relaxation(
            OSCILLATING, stiffness / mass, rate, dt, math.exp(-rate * dt), c + rate * s, s, c - rate * s, 1.0
        )
    omega = math.sqrt(-square)  # the sum of two decays: cosh and sinh would overflow in a long gap
    fast = rate + omega
    slow = stiffness / mass / fast
    a, b = math.exp(-slow * dt), math.exp(-fast * dt)
    return Relaxation(
        DECAYING, stiffness / mass, rate, dt, 0.0, fast * a - slow * b, a - b, fast * b - slow * a, 2.0 * omega
    )


@kernel
def relax_by(r: Relaxation, x: float, v: float) -> tuple[float, float]:
    """Offset and its velocity after a relaxation from (x, v), as `relax`."""
    if (x == 0.0 and v == 0.0) or r.kind == RIGID:
        return 0.0, 0.0
    if r.kind == CRITICAL:
        slope = v + r.rate * x
        x1 = (x + slope * r.time) * r.decay
        v1 = (v - r.rate * slope * r.time) * r.decay
    elif r.kind == OSCILLATING:
        x1 = r.decay * (x * r.from_offset + v * r.from_rate)
        v1 = r.decay * (v * r.rate_from_rate - x * r.from_rate * r.square)
    else:
        x1 = (x * r.from_offset + v * r.from_rate) / r.scale
        v1 = (v * r.rate_from_rate - x * r.square * r.from_rate) / r.scale
    if abs(x1) < NEGLIGIBLE_OFFSET and abs(v1) < NEGLIGIBLE_RATE:
        return 0.0, 0.0
    return x1, v1


@kernel
def relax(x: float, v: float, mass: float, stiffness: float, damping: float, dt: float) -> tuple[float, float]:
    """Offset and its velocity after `dt` of (6) from (x, v).

    Parameters
    ----------
    x, v
        Offset [m or rad] and its rate.
    mass, stiffness, damping
        m [kg], K [N/m] (infinite: a rigid coupling, the offset vanishes at once) and R [N s/m].
    dt
        s.

    Returns
    -------
    tuple
        (x, v); exactly (0, 0) once both are below `NEGLIGIBLE_OFFSET` and `NEGLIGIBLE_RATE`.
    """
    return relax_by(relaxation(mass, stiffness, damping, dt), x, v)


@kernel
def relaxation_of(trees: Trees, tree: int, dt: float) -> Relaxation:
    """`relaxation` with the coupling of a tree."""
    return relaxation(trees.mass[tree], trees.stiffness[tree], trees.damping[tree], dt)
