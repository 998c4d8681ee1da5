"""The contacts of a frame: where simulated bodies touched, with what impulse, and what overlap is left."""

from __future__ import annotations

import math

from geomphys.collision.penetration import Scratch, separation
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add, norm, quat_rotate, rotate, sub, unit
from geomphys.scene.arrays import DRIVEN, SIMULATED, Floats, Ints, Pieces
from geomphys.simulated.state import (
    AWAKE,
    AXIS,
    BODY_A,
    BODY_B,
    DEPTH,
    DISTANCE,
    LOCAL,
    N_PAIRS,
    OFFSET,
    PIECE_A,
    PIECE_B,
    ROLE,
    SLOT_SIZE,
    SLOTS,
    STAMP,
    SUM_N,
    SUM_T,
    SUM_V,
    SimulatedState,
)


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
            n = (kept[AXIS], kept[AXIS + 1], kept[AXIS + 2])
            if kept[c + SUM_N] > 0.0:
                # that of the impulses: a body that bounced is elsewhere by now
                n = unit((kept[c + SUM_V], kept[c + SUM_V + 1], kept[c + SUM_V + 2]))
            for i in range(3):
                values[first, i] = poses[a, i] + x[i]
                values[first, 3 + i] = n[i]
                square += kept[c + SUM_T + i] ** 2
            values[first, 6] = max(0.0, kept[c + DEPTH])
            values[first, 7], values[first, 8] = kept[c + SUM_N], math.sqrt(square)
            first += 1
    return first


@outlined
def deepest_overlap(pieces: Pieces, state: SimulatedState, frames: Floats, scratch: Scratch) -> float:
    """Deepest overlap of simulated bodies with what is not driven, at the end of the frame last simulated.

    Parameters
    ----------
    pieces, state
        `Scene.pieces`, and the state as `simulate` left it.
    frames
        (P, 12) world_from_piece at the frame's end.
    scratch
        Work space of the narrow phase.

    Returns
    -------
    float
        m; 0 if there is none.
    """
    deepest = 0.0
    for k in range(state.counts[N_PAIRS]):
        a, b, kept = state.pairs[k, BODY_A], state.pairs[k, BODY_B], state.kept[k]
        if state.kinds[b, ROLE] == DRIVEN:
            continue
        if state.kinds[a, AWAKE] == 1:
            axis = (kept[AXIS], kept[AXIS + 1], kept[AXIS + 2])
            i, j = state.pairs[k, PIECE_A], state.pairs[k, PIECE_B]
            kept[DISTANCE] = separation(pieces, frames, i, j, 0.0, axis, scratch)[0]
        deepest = max(deepest, -kept[DISTANCE])
    return deepest


@kernel
def centre_of(pieces: Pieces, frames: Floats, i: int) -> Vec:
    """World position of the middle of the ball about a piece."""
    f, c = frames[i], pieces.centre[i]
    turn = (f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8])
    return add((f[9], f[10], f[11]), rotate(turn, (c[0], c[1], c[2])))


@outlined
def deepest_overlap_at_start(pieces: Pieces, state: SimulatedState, frames: Floats, scratch: Scratch) -> float:
    """`deepest_overlap` before anything was simulated, and so without a list of pairs."""
    deepest = 0.0
    for i in range(len(pieces.body)):
        a = pieces.body[i]
        if state.kinds[a, ROLE] != SIMULATED:
            continue
        for j in range(len(pieces.body)):
            b = pieces.body[j]
            role = state.kinds[b, ROLE]
            if role == DRIVEN or (role == SIMULATED and b <= a):
                continue
            between = norm(sub(centre_of(pieces, frames, i), centre_of(pieces, frames, j)))
            if between < pieces.reach[i] + pieces.reach[j]:
                deepest = max(deepest, -separation(pieces, frames, i, j, 0.0, (0.0, 0.0, 0.0), scratch)[0])
    return deepest
