"""The contacts of a frame: where simulated bodies touched, and with what impulse."""

from __future__ import annotations

import math

from geomphys.kernel import kernel
from geomphys.simulated.state import (
    AXIS,
    BODY_A,
    BODY_B,
    DEPTH,
    LOCAL,
    N_PAIRS,
    OFFSET,
    SLOT_SIZE,
    SLOTS,
    STAMP,
    SUM_N,
    SUM_T,
    SimulatedState,
)
from geomphys.vec3 import quat_rotate
from geomphys.world.scene import Floats, Ints


@kernel
def write_touches(state: SimulatedState, poses: Floats, bodies: Ints, values: Floats, first: int) -> int:
    """List the contact points of the frame last simulated.

    Parameters
    ----------
    state
        The state, as `simulate` left it.
    poses
        (B, 7) world poses at the frame's end.
    bodies
        (n, 2), written from row `first` on: a (simulated) and b.
    values
        (n, 9), written: point [m], unit normal out of b into a, overlap [m], normal and tangential impulse of the
        frame [N s].
    first
        The first row to write. What finds no room is left out.

    Returns
    -------
    int
        One past the last row written.
    """
    for k in range(state.counts[N_PAIRS]):
        a, kept = state.pairs[k, BODY_A], state.kept[k]
        for m in range(4):
            c = SLOTS + m * SLOT_SIZE
            if kept[c + STAMP] == 0.0 and kept[c + SUM_N] == 0.0:
                continue
            if first == len(bodies):
                return first
            local = (
                kept[c + LOCAL] + state.motion[a, OFFSET],
                kept[c + LOCAL + 1] + state.motion[a, OFFSET + 1],
                kept[c + LOCAL + 2] + state.motion[a, OFFSET + 2],
            )
            x = quat_rotate((poses[a, 3], poses[a, 4], poses[a, 5], poses[a, 6]), local)
            bodies[first, 0], bodies[first, 1] = a, state.pairs[k, BODY_B]
            square = 0.0
            for i in range(3):
                values[first, i] = poses[a, i] + x[i]
                values[first, 3 + i] = kept[AXIS + i]
                square += kept[c + SUM_T + i] ** 2
            values[first, 6] = max(0.0, kept[c + DEPTH])
            values[first, 7], values[first, 8] = kept[c + SUM_N], math.sqrt(square)
            first += 1
    return first
