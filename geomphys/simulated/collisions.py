"""Which collisions there are at a moment, and their resolution one at a time."""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_int
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import FIXED
from geomphys.simulated.contact_points import normal_speed
from geomphys.simulated.driven_paths import load_paths
from geomphys.simulated.driven_targets import follow_paths, follow_wishes, take_recoil
from geomphys.simulated.impulse_accumulation import commit
from geomphys.simulated.impulses import collide
from geomphys.simulated.motion import load_velocities, refresh
from geomphys.simulated.resting_contact import set_limits, stop_slow_approach
from geomphys.simulated.state import (
    AT_COUNT,
    AT_THRESHOLD,
    AT_TOUCH,
    AT_VELOCITY,
    CLEARANCE,
    HITS,
    N_PAIRS,
    N_ROWS,
    ROLE,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    entry,
    free_body,
    has_changed,
    has_yielded,
    how_many,
    kind_of,
    knob,
    motion_of,
    owner,
    pair_at,
    row,
)

MOST_HITS = 3  # of a pair at one moment: what then still approaches is stopped, all of it together


@kernel
def join_collision(sim: int, chosen: int) -> None:
    """Mark with `ROW_ON` = 2 the points that collide together with row `chosen`: the touching ones between the same
    bodies, and, against fixed things, all touching points of the body on fixed things.
    """
    a, b = int_at(owner(sim, chosen), ROW_A), int_at(owner(sim, chosen), ROW_B)
    fixed = int_at(kind_of(sim, b), ROLE) == FIXED
    for k in range(how_many(sim, N_ROWS)):
        o = owner(sim, k)
        other = int_at(o, ROW_B)
        same = other == b or (fixed and int_at(kind_of(sim, other), ROLE) == FIXED)
        on = same and int_at(o, ROW_A) == a and float_at(row(sim, k), CLEARANCE) <= knob(sim, AT_TOUCH)
        set_int(o, ROW_ON, 2 if on else 0)


@kernel
def fastest_approach(sim: int) -> int:
    """The touching point that approaches fastest, of those above the threshold; -1 for none."""
    worst, chosen = -knob(sim, AT_THRESHOLD), -1
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        a, pair = int_at(o, ROW_A), int_at(o, ROW_PAIR)
        if not has_changed(sim, a) or has_yielded(sim, pair) or float_at(r, CLEARANCE) > knob(sim, AT_TOUCH):
            continue
        v = normal_speed(entry(sim, AT_VELOCITY), r, a, int_at(o, ROW_B))
        if v < worst and int_at(pair_at(sim, pair), HITS) < MOST_HITS:
            worst, chosen = v, k
    return chosen


@kernel
def resolve(sim: int, t: float, room: int) -> tuple[int, bool]:
    """Resolve the collisions of the changed bodies' contact points at time `t` of the frame.

    The fastest goes first; each changes velocities, and what then approaches is a collision again. What approaches
    slower than the threshold is stopped, all of it together.

    Parameters
    ----------
    sim
        Its rows must be those of time `t`.
    t
        s of the frame.
    room
        Collisions the frame still has room for; beyond, nothing bounces.

    Returns
    -------
    tuple
        Number of collisions resolved; whether `room` was too little.
    """
    load_velocities(sim)
    load_paths(sim, t)
    wishes = follow_wishes(sim, t)
    set_limits(sim)
    for k in range(how_many(sim, N_PAIRS)):
        set_int(pair_at(sim, k), HITS, 0)
    done, full = 0, False
    while True:
        chosen = fastest_approach(sim)
        if chosen < 0:
            break
        if done >= room:
            full = True
            break
        p = pair_at(sim, int_at(owner(sim, chosen), ROW_PAIR))
        set_int(p, HITS, int_at(p, HITS) + 1)
        join_collision(sim, chosen)
        collide(sim, entry(sim, AT_VELOCITY), 1.0)
        commit(sim)
        done += 1
        if wishes:
            take_recoil(sim, t)
    stop_slow_approach(sim, t, wishes)
    if wishes:
        take_recoil(sim, t)
        follow_paths(sim)
        stop_slow_approach(sim, t, False)
    for s in range(entry(sim, AT_COUNT)):
        if has_changed(sim, free_body(sim, s)):
            refresh(motion_of(sim, free_body(sim, s)))
    load_velocities(sim)
    return done, full
