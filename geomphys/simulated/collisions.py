"""Finds the collisions at a moment and resolves them one at a time."""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.scene.arrays import FIXED
from geomphys.simulated.contact_points import normal_speed
from geomphys.simulated.contact_solver import HEAP
from geomphys.simulated.driven_paths import load_paths
from geomphys.simulated.impulse_accumulation import commit
from geomphys.simulated.impulses import collide
from geomphys.simulated.motion import load_velocities, refresh
from geomphys.simulated.resting_contact import set_limits, stop_slow_approach
from geomphys.simulated.state import IMPACTING, INACTIVE, Contact, Simulation, is_disabled

EARLY = 2e-4  # s: in a heap, what would touch within this time collides with what touches now
MAX_HITS = 3  # collisions of a pair at one moment; beyond, all points that still approach are stopped together


@kernel
def touches(sim: Simulation, r: Contact, v: float) -> bool:
    """Whether contact `r`, whose normal velocity is `v` [m/s], collides if it approaches: it touches, or does `EARLY` in a heap.

    The bodies of a layer that falls onto another would else collide one after the other, each at a moment of its own.
    """
    early = EARLY if sim.counts.contacts > HEAP else 0.0
    return bool(r.clearance <= sim.frame.touch + early * max(0.0, -v))


@kernel
def join_collision(sim: Simulation, chosen: int) -> None:
    """Mark as IMPACTING the points that collide together with contact `chosen`: the touching ones between the same
    bodies, and, against fixed things, all touching points of the body on fixed things.
    """
    a, b = sim.contacts[chosen].a, sim.contacts[chosen].b
    fixed = sim.bodies[b].role == FIXED
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        other = r.b
        same = other == b or (fixed and sim.bodies[other].role == FIXED)
        on = same and r.a == a and touches(sim, r, normal_speed(sim.velocity, r, a, other))
        r.mode = IMPACTING if on else INACTIVE


@kernel
def fastest_approach(sim: Simulation) -> int:
    """The touching point that approaches fastest, of those above the threshold; -1 for none."""
    worst, chosen = -sim.frame.restitution_threshold, -1
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        a, pair = r.a, r.pair
        if is_disabled(sim, pair):
            continue
        v = normal_speed(sim.velocity, r, a, r.b)
        if v < worst and sim.pairs[pair].hits < MAX_HITS and touches(sim, r, v):
            worst, chosen = v, k
    return chosen


@noinline
def resolve(sim: Simulation, t: float, budget: int) -> tuple[int, bool]:
    """Resolve the collisions of the changed bodies' contact points at time `t` of the frame.

    The fastest goes first; each changes velocities, and points that approach after that collide again. Points that approach
    slower than the threshold are stopped together.

    Parameters
    ----------
    sim
        Its contacts must be those of time `t`.
    t
        s of the frame.
    budget
        Most further collisions of these bodies in the frame; beyond, nothing bounces.

    Returns
    -------
    tuple
        Number of collisions resolved; whether `budget` was too little.
    """
    load_velocities(sim)
    load_paths(sim, t)
    set_limits(sim)
    for i in range(sim.counts.concerned):
        sim.pairs[sim.concerned[i]].hits = 0
    done, full = 0, False
    while True:
        chosen = fastest_approach(sim)
        if chosen < 0:
            break
        if done >= budget:
            full = True
            break
        p = sim.pairs[sim.contacts[chosen].pair]
        p.hits = p.hits + 1
        join_collision(sim, chosen)
        collide(sim, sim.velocity, 1.0)
        commit(sim)
        done += 1
    stop_slow_approach(sim)
    for s in range(sim.counts.changed):
        refresh(sim.motion[sim.changed[s]])
    load_velocities(sim)
    return done, full
