"""Where impulses go: to the bodies' motions, and to the sums of the frame."""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, add_scaled, cross, scale
from geomphys.scene.arrays import DRIVEN
from geomphys.simulated.cells import add_vec, set_vec, vec_at
from geomphys.simulated.state import (
    ARM_A,
    ARM_B,
    AT_DRIVEN_IMPULSE,
    BINORMAL,
    FORCE,
    GRASP,
    LIGHTNESS,
    MOMENTUM,
    N_ROWS,
    NORMAL,
    PUSH,
    ROLE,
    ROW_A,
    ROW_B,
    ROW_COLUMNS,
    ROW_INTS,
    ROW_PAIR,
    ROW_SLOT,
    RUB,
    SINCE,
    SPEED,
    SUM_N,
    SUM_T,
    SUM_V,
    TANGENT,
    TREE,
    entry,
    has_changed,
    how_many,
    is_simulated,
    kind_of,
    motion_of,
    owner,
    row,
    set_how_many,
    slot_at,
)


@kernel
def impulse_of(r: int) -> Vec:
    """World impulse on body a that row `r` holds [N s]."""
    j = scale(vec_at(r, NORMAL), float_at(r, PUSH))
    j = add_scaled(j, vec_at(r, TANGENT), float_at(r, RUB))
    return add_scaled(j, vec_at(r, BINORMAL), float_at(r, RUB + 1))


@kernel
def give(sim: int, k: int, j: Vec, s: float, speed: int, turn: int) -> None:
    """Add s j / m and s r × j of row k to columns `speed` and `turn` of the motions of both bodies, b's reversed."""
    r, a, b = row(sim, k), int_at(owner(sim, k), ROW_A), int_at(owner(sim, k), ROW_B)
    m = motion_of(sim, a)
    add_vec(m, speed, j, s * float_at(m, LIGHTNESS))
    add_vec(m, turn, cross(vec_at(r, ARM_A), j), s)
    if is_simulated(sim, b):
        m = motion_of(sim, b)
        add_vec(m, speed, j, -s * float_at(m, LIGHTNESS))
        add_vec(m, turn, cross(vec_at(r, ARM_B), j), -s)


@kernel
def note(sim: int, k: int, normal: float, friction: Vec) -> None:
    """Add an impulse [N s] of row k to its point's sums of the frame, and to those of a driven tree it pushed back."""
    o, r = owner(sim, k), row(sim, k)
    slot = slot_at(sim, int_at(o, ROW_PAIR), int_at(o, ROW_SLOT))
    set_float(slot, SUM_N, float_at(slot, SUM_N) + normal)
    add_vec(slot, SUM_T, friction, 1.0)
    add_vec(slot, SUM_V, vec_at(r, NORMAL), normal)
    kind = kind_of(sim, int_at(o, ROW_B))
    if int_at(kind, ROLE) == DRIVEN:
        j = add_scaled(friction, vec_at(r, NORMAL), normal)
        add_vec(entry(sim, AT_DRIVEN_IMPULSE), 3 * int_at(kind, TREE), j, -1.0)


@kernel
def commit(sim: int) -> None:
    """Give the impulses the rows hold to the bodies' motions and the frame's sums, and clear them."""
    for k in range(how_many(sim, N_ROWS)):
        r = row(sim, k)
        normal = float_at(r, PUSH)
        if normal == 0.0 and float_at(r, RUB) == 0.0 and float_at(r, RUB + 1) == 0.0:
            continue
        j = impulse_of(r)
        give(sim, k, j, 1.0, SPEED, MOMENTUM)
        note(sim, k, normal, add_scaled(j, vec_at(r, NORMAL), -normal))
        if int_at(kind_of(sim, int_at(owner(sim, k), ROW_B)), ROLE) == DRIVEN:
            slot = slot_at(sim, int_at(owner(sim, k), ROW_PAIR), int_at(owner(sim, k), ROW_SLOT))
            set_float(slot, GRASP, float_at(slot, GRASP) + normal)
        set_vec(r, PUSH, (0.0, 0.0, 0.0))


@kernel
def drop_rows(sim: int, t: float) -> None:
    """Add what the contact forces on changed bodies did until time `t` to the frame's sums, and drop their rows."""
    kept = 0
    for k in range(how_many(sim, N_ROWS)):
        o, r = owner(sim, k), row(sim, k)
        if has_changed(sim, int_at(o, ROW_A)):
            slot = slot_at(sim, int_at(o, ROW_PAIR), int_at(o, ROW_SLOT))
            elapsed = t - float_at(r, SINCE)
            rub = vec_at(slot, FORCE + 1)
            if elapsed > 0.0 and (float_at(slot, FORCE) > 0.0 or rub != (0.0, 0.0, 0.0)):
                note(sim, k, elapsed * float_at(slot, FORCE), scale(rub, elapsed))
            continue
        if kept < k:
            for i in range(ROW_COLUMNS):
                set_float(row(sim, kept), i, float_at(r, i))
            for i in range(ROW_INTS):
                set_int(owner(sim, kept), i, int_at(o, i))
        kept += 1
    set_how_many(sim, N_ROWS, kept)
