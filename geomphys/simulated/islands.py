"""Finds the bodies that an impact changes: the two that touch, and all that are connected to them through contact points."""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.simulated.contact_points import NEAR
from geomphys.simulated.state import AWAKE, Simulation, has_changed, is_disabled, is_simulated
from geomphys.simulated.time_of_impact import measure_pair


@kernel
def concerns_changed(sim: Simulation, pair: int) -> bool:
    """Whether the motion of one of a pair's bodies has changed."""
    p = sim.pairs[pair]
    b = p.body[1]
    return has_changed(sim, p.body[0]) or (is_simulated(sim, b) and has_changed(sim, b))


@kernel
def are_connected(sim: Simulation, pair: int, t: float) -> bool:
    """Whether the bodies of a pair have contact points with each other, or will have when they are measured at `t`."""
    if is_disabled(sim, pair):
        return False
    if sim.pairs[pair].point_count > 0:
        return True
    if sim.pairs[pair].measured_at != t:
        measure_pair(sim, pair, t)
    return sim.pairs[pair].distance <= NEAR


@noinline
def mark_connected(sim: Simulation, pair: int, t: float) -> None:
    """Mark as changed the bodies, and no others, that the impact of a pair at time `t` of the frame concerns."""
    for s in range(len(sim.free)):
        sim.bodies[sim.free[s]].changed = 0
    for side in range(2):
        body = sim.pairs[pair].body[side]
        if is_simulated(sim, body):
            sim.bodies[body].changed = 1
    grows = True
    while grows:
        grows = False
        for k in range(sim.counts.pairs):
            a, b = sim.pairs[k].body[0], sim.pairs[k].body[1]
            if is_simulated(sim, b) and has_changed(sim, a) != has_changed(sim, b) and are_connected(sim, k, t):
                for body in (a, b):
                    sim.bodies[body].changed = 1 if sim.bodies[body].activation == AWAKE else 0
                grows = grows or has_changed(sim, a) == has_changed(sim, b)
