"""Contact points of a pair: found, matched with those of the step before, laid out for the solvers.

A row holds everything an impulse at the point does to both bodies.
"""

from __future__ import annotations

import math

from geomphys.collision.manifold import touching
from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, add, cross, dot, perpendicular, quat_conjugate, quat_rotate, rotate, scale, sub
from geomphys.simulated.cells import add_vec, quat_at, rot_at, set_vec, vec_at
from geomphys.simulated.motion import point_at
from geomphys.simulated.state import (
    ARM_A,
    ARM_B,
    AT_OLD_SLOTS,
    AT_POINTS,
    AT_ROW_ROOM,
    BINORMAL,
    BODY_A,
    BODY_B,
    CLEARANCE,
    DEPTH,
    FORCE,
    FRICTION,
    GOAL,
    GRIP,
    INVERSE,
    INVERSE_T,
    LIGHTNESS,
    LIMIT,
    LOCAL,
    MASS_MOST,
    MASS_N,
    MASS_T,
    N_LOST,
    N_ROWS,
    NORMAL,
    PAIR_FRICTION,
    PAIR_RESTITUTION,
    PIECE_A,
    PIECE_B,
    POINT,
    POINTS,
    PUSH,
    RESTITUTION,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    ROW_SLOT,
    SINCE,
    SLOT_SIZE,
    STAMP,
    SUM_N,
    SUM_T,
    SUM_V,
    TANGENT,
    TOUCHED,
    TURN,
    TURN_A,
    TURN_B,
    entry,
    faces_at,
    has_yielded,
    how_many,
    kept_at,
    kind_of,
    motion_of,
    owner,
    pair_at,
    room_at,
    row,
    set_how_many,
    shapes_at,
    slot_at,
    velocity_of,
)
from geomphys.simulated.time_of_impact import look

NEAR = 4e-4  # m: contact points with no more clearance take part in the solving
SAME = 4e-6  # m²: squared distance within which a point continues one of the step before


@kernel
def fill_masses(a: int, b: int, r: int) -> None:
    """What unit impulses along normal and tangents of row `r` do: turns of both bodies, velocities at the point.

    `a`, `b` are the bodies' rows of `motion`.
    """
    ia, ib = rot_at(a, INVERSE), rot_at(b, INVERSE)
    ra, rb = vec_at(r, ARM_A), vec_at(r, ARM_B)
    light = float_at(a, LIGHTNESS) + float_at(b, LIGHTNESS)
    n, t, u = vec_at(r, NORMAL), vec_at(r, TANGENT), vec_at(r, BINORMAL)
    xa, ya, za = rotate(ia, cross(ra, n)), rotate(ia, cross(ra, t)), rotate(ia, cross(ra, u))
    xb, yb, zb = rotate(ib, cross(rb, n)), rotate(ib, cross(rb, t)), rotate(ib, cross(rb, u))
    set_vec(r, TURN_A, xa)
    set_vec(r, TURN_A + 3, ya)
    set_vec(r, TURN_A + 6, za)
    set_vec(r, TURN_B, xb)
    set_vec(r, TURN_B + 3, yb)
    set_vec(r, TURN_B + 6, zb)
    along_t = add(cross(ya, ra), cross(yb, rb))
    along_u = add(cross(za, ra), cross(zb, rb))
    set_float(r, MASS_N, light + dot(n, add(cross(xa, ra), cross(xb, rb))))
    set_float(r, MASS_T, light + dot(t, along_t))
    set_float(r, MASS_T + 1, dot(t, along_u))
    set_float(r, MASS_T + 2, light + dot(u, along_u))
    invert_mass(r)


@kernel
def invert_mass(r: int) -> None:
    """Note what follows from `MASS_T` of row `r`."""
    k_tt, k_tb, k_bb = vec_at(r, MASS_T)
    inverse, half = 1.0 / (k_tt * k_bb - k_tb * k_tb), 0.5 * (k_tt - k_bb)
    set_vec(r, INVERSE_T, (inverse * k_bb, -inverse * k_tb, inverse * k_tt))
    set_float(r, MASS_MOST, 0.5 * (k_tt + k_bb) + math.sqrt(half * half + k_tb * k_tb))


@kernel
def keep_old_slots(sim: int, pair: int) -> None:
    """Copy the contact points of a pair aside."""
    first = slot_at(sim, pair, 0)
    for i in range(4 * SLOT_SIZE):
        set_float(entry(sim, AT_OLD_SLOTS), i, float_at(first, i))


@kernel
def continued(sim: int, x: Vec) -> int:
    """Which of the old contact points the point x (relative to a, a's frame) continues; -1: none. It is then taken."""
    best, slot = SAME, -1
    for m in range(4):
        if float_at(entry(sim, AT_OLD_SLOTS), m * SLOT_SIZE + STAMP) == 0.0:
            continue
        e = sub(x, vec_at(entry(sim, AT_OLD_SLOTS), m * SLOT_SIZE + LOCAL))
        if dot(e, e) < best:
            best, slot = dot(e, e), m
    if slot >= 0:
        set_float(entry(sim, AT_OLD_SLOTS), slot * SLOT_SIZE + STAMP, 0.0)
    return slot


@kernel
def open_slot(sim: int, slot: int, old: int, x: Vec, clearance: float) -> None:
    """Begin a slot at the point x (relative to a, a's frame), with what the old point `old`, if any, has gathered."""
    for i in range(SLOT_SIZE):
        set_float(slot, i, float_at(entry(sim, AT_OLD_SLOTS), old * SLOT_SIZE + i) if old >= 0 else 0.0)
    if old >= 0:
        for i in range(7):
            set_float(entry(sim, AT_OLD_SLOTS), old * SLOT_SIZE + SUM_N + i, 0.0)
    set_vec(slot, LOCAL, x)
    set_float(slot, STAMP, 1.0)
    set_float(slot, DEPTH, -clearance)


@kernel
def hand_over_sums(sim: int, pair: int, count: int) -> None:
    """Give the impulses of old points that nothing continues to the first of the pair's `count` slots: none is lost."""
    for m in range(count, 4):
        for i in range(7):
            set_float(slot_at(sim, pair, m), SUM_N + i, 0.0)
    first = slot_at(sim, pair, 0)
    for m in range(4):
        set_float(first, SUM_N, float_at(first, SUM_N) + float_at(entry(sim, AT_OLD_SLOTS), m * SLOT_SIZE + SUM_N))
        add_vec(first, SUM_T, vec_at(entry(sim, AT_OLD_SLOTS), m * SLOT_SIZE + SUM_T), 1.0)
        add_vec(first, SUM_V, vec_at(entry(sim, AT_OLD_SLOTS), m * SLOT_SIZE + SUM_V), 1.0)


@kernel
def close_slots(sim: int, pair: int, count: int) -> None:
    """Mark the slots from `count` on as holding no point; what they gathered stays until it is handed over."""
    for m in range(count, 4):
        slot = slot_at(sim, pair, m)
        set_float(slot, STAMP, 0.0)
        for i in range(4):
            set_float(slot, FORCE + i, 0.0)
    set_int(pair_at(sim, pair), POINTS, count)


@kernel
def add_row(sim: int, pair: int, count: int, t: float, n: Vec, x: Vec, clearance: float) -> None:
    """Append the row of contact point number `count` of a pair: at x, normal n, both world."""
    p, kept = pair_at(sim, pair), kept_at(sim, pair)
    a, b = motion_of(sim, int_at(p, BODY_A)), motion_of(sim, int_at(p, BODY_B))
    k = how_many(sim, N_ROWS)
    set_how_many(sim, N_ROWS, k + 1)
    r, o = row(sim, k), owner(sim, k)
    tangent = perpendicular(n)
    set_vec(r, NORMAL, n)
    set_vec(r, TANGENT, tangent)
    set_vec(r, BINORMAL, cross(n, tangent))
    set_vec(r, ARM_A, sub(x, vec_at(a, POINT)))
    set_vec(r, ARM_B, sub(x, point_at(b, t)))
    set_float(r, CLEARANCE, clearance)
    set_vec(r, PUSH, (0.0, 0.0, 0.0))
    set_float(r, GOAL, 0.0)
    set_float(r, FRICTION, float_at(kept, PAIR_FRICTION))
    set_float(r, RESTITUTION, float_at(kept, PAIR_RESTITUTION))
    set_float(r, SINCE, t)
    set_float(r, LIMIT, math.inf)
    set_float(r, GRIP, 0.0)
    fill_masses(a, b, r)
    set_int(kind_of(sim, int_at(p, BODY_A)), TOUCHED, 1)
    set_int(kind_of(sim, int_at(p, BODY_B)), TOUCHED, 1)
    set_int(o, ROW_PAIR, pair)
    set_int(o, ROW_A, int_at(p, BODY_A))
    set_int(o, ROW_B, int_at(p, BODY_B))
    set_int(o, ROW_SLOT, count)
    set_int(o, ROW_ON, 1)
    local = quat_rotate(quat_conjugate(quat_at(a, TURN)), vec_at(r, ARM_A))
    open_slot(sim, slot_at(sim, pair, count), continued(sim, local), local, clearance)


@kernel
def add_rows(sim: int, pair: int, t: float) -> None:
    """Look at a pair at time `t` of the frame and, if it is within `NEAR`, append a row for each contact point.

    The bases of simulated bodies must stand at `t`.
    """
    p = pair_at(sim, pair)
    if has_yielded(sim, pair):
        return
    s, n, pa, pb = look(sim, pair, t)
    if s > NEAR:
        if int_at(p, POINTS) > 0:
            close_slots(sim, pair, 0)
        return
    i, j = int_at(p, PIECE_A), int_at(p, PIECE_B)
    on_a = entry(sim, AT_POINTS)
    found = touching(
        shapes_at(sim),
        faces_at(sim),
        i,
        j,
        s,
        n,
        pa,
        pb,
        entry(sim, AT_POINTS),
        entry(sim, AT_POINTS) + 96,
        room_at(sim),
    )
    if how_many(sim, N_ROWS) + found > entry(sim, AT_ROW_ROOM):
        set_how_many(sim, N_LOST, how_many(sim, N_LOST) + 1)
        return
    keep_old_slots(sim, pair)
    count = 0
    for m in range(found):
        xa, xb = vec_at(on_a, 3 * m), vec_at(on_a, 12 + 3 * m)
        clearance = dot(n, sub(xa, xb))
        if clearance <= NEAR:
            add_row(sim, pair, count, t, n, scale(add(xa, xb), 0.5), clearance)
            count += 1
    close_slots(sim, pair, count)
    if count > 0:
        hand_over_sums(sim, pair, count)


@kernel
def speed_at(velocity: int, r: int, a: int, b: int) -> Vec:
    """v_AB of row `r`: velocity of body a's contact point relative to b's [m/s]; `velocity` holds rows of six."""
    va, vb = velocity_of(velocity, a), velocity_of(velocity, b)
    at_a = add(vec_at(va, 0), cross(vec_at(va, 3), vec_at(r, ARM_A)))
    at_b = add(vec_at(vb, 0), cross(vec_at(vb, 3), vec_at(r, ARM_B)))
    return sub(at_a, at_b)


@kernel
def normal_speed(velocity: int, r: int, a: int, b: int) -> float:
    """v_n of (7) at row `r` [m/s]; negative: approaching."""
    return dot(vec_at(r, NORMAL), speed_at(velocity, r, a, b))


@kernel
def push(sim: int, velocity: int, r: int, a: int, b: int, axis: int, j: float) -> None:
    """Apply the impulse +j to a and -j to b [N s] along axis 0 (normal), 1 (tangent) or 2 (binormal) of row `r`."""
    va, vb = velocity_of(velocity, a), velocity_of(velocity, b)
    d = vec_at(r, NORMAL + 3 * axis)
    add_vec(va, 0, d, j * float_at(motion_of(sim, a), LIGHTNESS))
    add_vec(vb, 0, d, -j * float_at(motion_of(sim, b), LIGHTNESS))
    add_vec(va, 3, vec_at(r, TURN_A + 3 * axis), j)
    add_vec(vb, 3, vec_at(r, TURN_B + 3 * axis), -j)
