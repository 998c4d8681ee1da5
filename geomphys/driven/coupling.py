"""Virtual coupling: the damped spring from a driven body to its recorded pose.

    m A = -K x - R ẋ                                                                   (6)

governs the *offset* x of the body from its recorded pose, solved in closed form over a frame, so that the result does
not depend on the frame rate and a body without an offset keeps none.
"""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import Trees

NEGLIGIBLE_OFFSET = 1e-9  # m or rad: a smaller offset at a low rate is set to zero
NEGLIGIBLE_RATE = 1e-7  # m/s or rad/s


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
    if x == 0.0 and v == 0.0:
        return 0.0, 0.0
    if math.isinf(stiffness):
        return 0.0, 0.0
    rate = 0.5 * damping / mass
    square = stiffness / mass - rate * rate
    if abs(square) * dt * dt < 1e-12:
        decay = math.exp(-rate * dt)
        slope = v + rate * x
        x1 = (x + slope * dt) * decay
        v1 = (v - rate * slope * dt) * decay
    elif square > 0.0:
        decay, omega = math.exp(-rate * dt), math.sqrt(square)
        c, s = math.cos(omega * dt), math.sin(omega * dt) / omega
        x1 = decay * (x * (c + rate * s) + v * s)
        v1 = decay * (v * (c - rate * s) - x * s * (stiffness / mass))
    else:  # the sum of two decays: cosh and sinh would overflow in a long gap
        omega = math.sqrt(-square)
        fast = rate + omega
        slow = stiffness / mass / fast
        a, b = math.exp(-slow * dt), math.exp(-fast * dt)
        x1 = (x * (fast * a - slow * b) + v * (a - b)) / (2.0 * omega)
        v1 = (v * (fast * b - slow * a) - x * (stiffness / mass) * (a - b)) / (2.0 * omega)
    if abs(x1) < NEGLIGIBLE_OFFSET and abs(v1) < NEGLIGIBLE_RATE:
        return 0.0, 0.0
    return x1, v1


@kernel
def relax_offset(trees: Trees, tree: int, x: float, v: float, dt: float) -> tuple[float, float]:
    """`relax` with the coupling of a tree."""
    return relax(x, v, trees.mass[tree], trees.stiffness[tree], trees.damping[tree], dt)
