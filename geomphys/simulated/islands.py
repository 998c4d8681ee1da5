"""Which bodies a meeting concerns: the two that meet, and all that hang together with them through contact points."""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_int
from geomphys.jit.kernel import kernel
from geomphys.simulated.contact_points import NEAR
from geomphys.simulated.state import (
    AT_COUNT,
    AWAKE,
    BODY_A,
    BODY_B,
    CHANGED,
    DISTANCE,
    N_PAIRS,
    POINTS,
    SEEN,
    entry,
    free_body,
    has_changed,
    has_yielded,
    how_many,
    is_simulated,
    kept_at,
    kind_of,
    pair_at,
)
from geomphys.simulated.time_of_impact import look


@kernel
def concerns_changed(sim: int, pair: int) -> bool:
    """Whether one of a pair's bodies has changed course."""
    p = pair_at(sim, pair)
    b = int_at(p, BODY_B)
    return has_changed(sim, int_at(p, BODY_A)) or (is_simulated(sim, b) and has_changed(sim, b))


@kernel
def hang_together(sim: int, pair: int, t: float) -> bool:
    """Whether the bodies of a pair have contact points with each other, or will have when they are looked at at `t`."""
    if has_yielded(sim, pair):
        return False
    if int_at(pair_at(sim, pair), POINTS) > 0:
        return True
    if float_at(kept_at(sim, pair), SEEN) != t:
        look(sim, pair, t)
    return float_at(kept_at(sim, pair), DISTANCE) <= NEAR


@kernel
def mark_meeting(sim: int, pair: int, t: float) -> None:
    """Let the bodies count as changed, and no others, that the meeting of a pair at time `t` of the frame concerns."""
    for s in range(entry(sim, AT_COUNT)):
        set_int(kind_of(sim, free_body(sim, s)), CHANGED, 0)
    for side in range(2):
        body = int_at(pair_at(sim, pair), BODY_A + side)
        if is_simulated(sim, body):
            set_int(kind_of(sim, body), CHANGED, 1)
    grows = True
    while grows:
        grows = False
        for k in range(how_many(sim, N_PAIRS)):
            a, b = int_at(pair_at(sim, k), BODY_A), int_at(pair_at(sim, k), BODY_B)
            if is_simulated(sim, b) and has_changed(sim, a) != has_changed(sim, b) and hang_together(sim, k, t):
                set_int(kind_of(sim, a), CHANGED, int_at(kind_of(sim, a), AWAKE))
                set_int(kind_of(sim, b), CHANGED, int_at(kind_of(sim, b), AWAKE))
                grows = grows or has_changed(sim, a) == has_changed(sim, b)
