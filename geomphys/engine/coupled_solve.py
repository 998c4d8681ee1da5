"""The coupled contact solve of driven and simulated bodies.

Every contact has a normal impulse p >= 0, which keeps the normal velocity at or above its target, and a friction impulse
within the disc μ p, which takes the sliding velocity to its target or else opposes it. A solution is judged by the residual of
these conditions. Proximal steps by Newton's method come first; sweeps follow where they leave a residual, and take the place of
them in groups with too many bodies.
"""

from __future__ import annotations

from geomphys.engine.coupled_newton import natural_residual, proximal_step
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_sweeps import make_sweeps, residual_of
from geomphys.engine.coupled_system import apply_solution, include_nearly_pressed, include_violated, make_system
from geomphys.jit.kernel import kernel, noinline
from geomphys.simulated.state import Simulation

PROXIMAL_STEPS = 4  # of the solve of a step; up to twice as many where these leave a residual above `CREEPS`
IMPACT_STEPS = 16  # of that of an impact
YIELDS = 10.0  # times the effective mass: change of impulse by velocity with which contacts yield in the first of them
YIELD_GROWTH = 3.0  # of that from one to the next; what it is divided by after one that Newton's method does not solve
MOST_YIELDS = 1000.0
EXACT = 0.1  # of the residual before it, or of the precision: a proximal step is solved to this
ROUNDS = 4  # of proximal steps and sweeps
SWEEPS = 400  # of a round
MANY_SWEEPS = 200  # instead of all rounds, where there are too many bodies for the tables
PRECISION = 1e-7  # m/s: of a step; at 1e-6 what is pressed on a table trembles by 0.05 um a frame
SWEPT_PRECISION = 2e-5  # m/s: the sweeps of a step end when none changes a velocity by more
IMPACT_PRECISION = 1e-10  # m/s
CREEPS = 1e-4  # m/s: sweeps follow on a larger residual; a solve that ends with one has not converged
REPEATED = 1e-3  # m/s: another round follows on a larger residual


@kernel
def make_proximal_steps(c: Coupled, steps: int, precision: float) -> float:
    """Make so many proximal steps, or until the residual is no more than `precision` [m/s]; returns the residual [m/s].

    As many follow, while it is more than `CREEPS`.
    """
    residual, s = natural_residual(c), YIELDS
    for step in range(2 * steps):
        if residual <= (precision if step < steps else CREEPS):
            break
        if proximal_step(c, s, EXACT * max(precision, residual)):
            residual, s = natural_residual(c), min(MOST_YIELDS, YIELD_GROWTH * s)
        else:
            s /= YIELD_GROWTH
    return residual


@noinline
def solve_contacts(sim: Simulation, c: Coupled, steps: int, precision: float, swept_precision: float) -> float:
    """Solve the ACTIVE contacts and all inequalities together, from their impulses, which are part of the velocities.

    Done when the residual is no more than `precision` [m/s], or after so many proximal `steps`. Where that leaves more than
    `CREEPS`, sweeps follow until none changes a velocity by more than `swept_precision` [m/s]. Returns the residual [m/s].
    """
    include_nearly_pressed(sim, c)
    residual = 0.0
    for _ in range(ROUNDS):
        if not make_system(sim, c):
            make_sweeps(sim, c, MANY_SWEEPS, swept_precision)
            residual = residual_of(sim, c)
            break
        residual = make_proximal_steps(c, steps, precision)
        apply_solution(sim, c)
        done = not include_violated(sim, c, precision)
        if residual > CREEPS:
            make_sweeps(sim, c, SWEEPS, swept_precision)
            residual = residual_of(sim, c)
            include_nearly_pressed(sim, c)
            done = residual <= REPEATED
        if done:
            break
    if residual > CREEPS:
        c.solve.unconverged += 1
    return residual
