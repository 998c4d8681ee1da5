"""Finds the collisions at a moment and resolves them one at a time."""

from __future__ import annotations

from geomphys.jit.kernel import kernel, outlined
from geomphys.scene.arrays import FIXED
from geomphys.simulated.contact_points import normal_speed
from geomphys.simulated.driven_paths import load_paths
from geomphys.simulated.impulse_accumulation import commit
from geomphys.simulated.impulses import collide
from geomphys.simulated.motion import load_velocities, refresh
from geomphys.simulated.resting_contact import set_limits, stop_slow_approach
from geomphys.simulated.state import Simulation, has_changed, is_disabled

MOST_HITS = 3  # collisions of a pair at one moment; beyond, all points that still approach are stopped together


@kernel
def join_collision(sim: Simulation, chosen: int) -> None:
    """Mark with `mode` = 2 the points that collide together with row `chosen`: the touching ones between the same
    bodies, and, against fixed things, all touching points of the body on fixed things.
    """
    a, b = sim.rows[chosen].a, sim.rows[chosen].b
    fixed = sim.bodies[b].role == FIXED
    for k in range(sim.counts.rows):
        r = sim.rows[k]
        other = r.b
        same = other == b or (fixed and sim.bodies[other].role == FIXED)
        on = same and r.a == a and sim.rows[k].clearance <= sim.frame.touch
        r.mode = 2 if on else 0


@kernel
def fastest_approach(sim: Simulation) -> int:
    """The touching point that approaches fastest, of those above the threshold; -1 for none."""
    worst, chosen = -sim.frame.restitution_threshold, -1
    for k in range(sim.counts.rows):
        r = sim.rows[k]
        a, pair = r.a, r.pair
        if not has_changed(sim, a) or is_disabled(sim, pair) or r.clearance > sim.frame.touch:
            continue
        v = normal_speed(sim.velocity, r, a, r.b)
        if v < worst and sim.pairs[pair].hits < MOST_HITS:
            worst, chosen = v, k
    return chosen


@outlined
def resolve(sim: Simulation, t: float, budget: int) -> tuple[int, bool]:
    """Resolve the collisions of the changed bodies' contact points at time `t` of the frame.

    The fastest goes first; each changes velocities, and points that approach after that collide again. Points that approach
    slower than the threshold are stopped together.

    Parameters
    ----------
    sim
        Its rows must be those of time `t`.
    t
        s of the frame.
    budget
        Most further collisions of the frame; beyond, nothing bounces.

    Returns
    -------
    tuple
        Number of collisions resolved; whether `budget` was too little.
    """
    load_velocities(sim)
    load_paths(sim, t)
    set_limits(sim)
    for k in range(sim.counts.pairs):
        sim.pairs[k].hits = 0
    done, full = 0, False
    while True:
        chosen = fastest_approach(sim)
        if chosen < 0:
            break
        if done >= budget:
            full = True
            break
        p = sim.pairs[sim.rows[chosen].pair]
        p.hits = p.hits + 1
        join_collision(sim, chosen)
        collide(sim, sim.velocity, 1.0)
        commit(sim)
        done += 1
    stop_slow_approach(sim)
    for s in range(len(sim.free)):
        if has_changed(sim, sim.free[s]):
            refresh(sim.motion[sim.free[s]])
    load_velocities(sim)
    return done, full
