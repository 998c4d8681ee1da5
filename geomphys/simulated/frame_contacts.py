"""Contacts of a frame: points where simulated bodies touched, their impulses, and the remaining overlap."""

from __future__ import annotations

from geomphys.collision.penetration import separation
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import quat_from, set_vec, vec_at, vec_from, vec_of
from geomphys.numerics.vec3 import Vec, add, norm, quat_rotate, rotate, sub, unit
from geomphys.scene.arrays import DRIVEN, SIMULATED, Floats, Pieces
from geomphys.scene.kinematics import frame_position, frame_rotation
from geomphys.simulated.state import ASLEEP, Records, Simulation
from geomphys.simulated.time_of_impact import LOOK_FAR, is_apart, note_distance


@kernel
def write_touches(sim: Simulation, poses: Floats, contacts: Records, first: int) -> int:
    """List the contact points of the frame last simulated.

    Parameters
    ----------
    sim
        As `simulate` left it.
    poses
        (B, 7) world poses at the frame's end.
    contacts
        (n,) `geomphys.engine.frame_buffer.CONTACT`, written from row `first` on: bodies a (simulated) and b, point [m],
        unit normal out of b into a, overlap [m], normal and tangential impulse of the frame [N s].
    first
        The first row to write. Points beyond the capacity are left out.

    Returns
    -------
    int
        One past the last row written.
    """
    for k in range(sim.counts.pairs):
        pair = sim.pairs[k]
        a = pair.body[0]
        for m in range(4):
            slot = sim.slots[k, m]
            if slot.used == 0 and slot.normal_impulse == 0.0:
                continue
            if first == len(contacts):
                return first
            c = contacts[first]
            c.body_a, c.body_b = a, pair.body[1]
            x = quat_rotate(quat_from(poses[a], 3), add(vec_of(slot.local), vec_of(sim.motion[a].centre)))
            set_vec(c.point, add(vec_from(poses[a], 0), x))
            n = vec_of(pair.axis)
            if slot.normal_impulse > 0.0:
                # the normal of the impulses: a body that bounced has moved on
                n = unit(vec_of(slot.normal_impulses))
            set_vec(c.normal, n)
            c.depth, c.normal_impulse = max(0.0, slot.depth), slot.normal_impulse
            c.tangential_impulse = norm(vec_of(slot.friction_impulse))
            first += 1
    return first


@noinline
def deepest_overlap(sim: Simulation, frames: Floats) -> float:
    """Deepest overlap of simulated bodies with what is not driven, at the end of the frame last simulated.

    Parameters
    ----------
    sim
        As `simulate` left it.
    frames
        (P, 12) world_from_piece at the frame's end.

    Returns
    -------
    float
        m; 0 if there is none.
    """
    deepest = 0.0
    for k in range(sim.counts.pairs):
        pair = sim.pairs[k]
        if sim.bodies[pair.body[1]].role == DRIVEN:
            continue
        if is_apart(sim, k, sim.frame.step, 0.0):
            continue
        if sim.bodies[pair.body[0]].activation != ASLEEP:
            i, j = pair.piece[0], pair.piece[1]
            pair.distance = separation(sim.pieces, frames, i, j, LOOK_FAR, vec_of(pair.axis), sim.scratch)[0]
            note_distance(sim, k, sim.frame.step, pair.distance)
        deepest = max(deepest, -pair.distance)
    return deepest


@kernel
def centre_of(pieces: Pieces, frames: Floats, i: int) -> Vec:
    """World position of the middle of the ball about a piece."""
    return add(frame_position(frames, i), rotate(frame_rotation(frames, i), vec_at(pieces.centre, i)))


@noinline
def deepest_overlap_at_start(sim: Simulation, frames: Floats) -> float:
    """`deepest_overlap` before anything was simulated, and so without a list of pairs."""
    pieces, deepest = sim.pieces, 0.0
    for i in range(len(pieces.body)):
        a = pieces.body[i]
        if sim.bodies[a].role != SIMULATED:
            continue
        for j in range(len(pieces.body)):
            b = pieces.body[j]
            role = sim.bodies[b].role
            if role == DRIVEN or (role == SIMULATED and b <= a):
                continue
            between = norm(sub(centre_of(pieces, frames, i), centre_of(pieces, frames, j)))
            if between < pieces.reach[i] + pieces.reach[j]:
                deepest = max(deepest, -separation(pieces, frames, i, j, 0.0, (0.0, 0.0, 0.0), sim.scratch)[0])
    return deepest
