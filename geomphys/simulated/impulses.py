"""Collisions: equations (7)–(10).

With n out of b into a and v_AB the velocity of a's contact point relative to b's, a collision is a contact with
v_n = n·v_AB < 0  (7). It leaves  v_n⁺ = -ε v_n⁻  (8), through the impulse

    j = -(1 + ε) v_n⁻ / (m_a⁻¹ + m_b⁻¹ + n·(I_a⁻¹(r_a × n) × r_a) + n·(I_b⁻¹(r_b × n) × r_b))      (9)

+j n on a and -j n on b, and then Coulomb's friction  j_t = -μ j v_t/|v_t|  (10), never more than stops the sliding.
Where two faces meet, the points of the collision get their normal impulses together, so that (8) holds at each, and
then their friction, by sweeps over the points. Each impulse acts on both bodies with opposite signs: momentum is kept
to rounding; each takes energy, as (1 - ε²) and friction do.

The points are the rows whose `ROW_ON` says so; their impulses so far stand in `PUSH` and `RUB`. `velocity` is the
address of six floats a body: velocity of the reference point and angular velocity.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import dot
from geomphys.simulated.cells import vec_at
from geomphys.simulated.contact_points import normal_speed, push, speed_at
from geomphys.simulated.state import (
    BINORMAL,
    DISTURBED,
    FRICTION,
    GOAL,
    GRIP,
    INVERSE_T,
    LIGHTNESS,
    LIMIT,
    MASS_MOST,
    MASS_N,
    MASS_T,
    N_ROWS,
    N_SWEEPS,
    PUSH,
    RESTITUTION,
    ROW_A,
    ROW_B,
    ROW_ON,
    ROW_PAIR,
    ROW_VISIT,
    RUB,
    TANGENT,
    count_one,
    has_yielded,
    how_many,
    kind_of,
    motion_of,
    owner,
    row,
)

SWEEPS = 300
UNFELT = 0.1  # of the precision asked for: smaller changes of velocity do not call for another visit to a row
PRECISION = 1e-13  # of the fastest approach: sweeps over the points of a collision end when none changes by more


@kernel
def let_go(sim: int) -> None:
    """No impulses are sought any more for the rows of pairs that have yielded."""
    for k in range(how_many(sim, N_ROWS)):
        if has_yielded(sim, int_at(owner(sim, k), ROW_PAIR)):
            set_int(owner(sim, k), ROW_ON, 0)


@kernel
def rub(sim: int, velocity: int, k: int, x: float, y: float) -> None:
    """Add the friction impulse (x, y) [N s] along tangent and binormal of row k."""
    r, a, b = row(sim, k), int_at(owner(sim, k), ROW_A), int_at(owner(sim, k), ROW_B)
    set_float(r, RUB, float_at(r, RUB) + x)
    set_float(r, RUB + 1, float_at(r, RUB + 1) + y)
    push(sim, velocity, r, a, b, 1, x)
    push(sim, velocity, r, a, b, 2, y)


@kernel
def rub_once(sim: int, velocity: int, k: int, cap: float) -> None:
    """Friction (10) at a single point: along -v_t, at most `cap` [N s], at most what stops the sliding."""
    r, o = row(sim, k), owner(sim, k)
    v = speed_at(velocity, r, int_at(o, ROW_A), int_at(o, ROW_B))
    x, y = dot(vec_at(r, TANGENT), v), dot(vec_at(r, BINORMAL), v)
    speed = math.sqrt(x * x + y * y)
    if speed == 0.0:
        return
    x, y = x / speed, y / speed
    k_tt, k_tb, k_bb = vec_at(r, MASS_T)
    j = min(cap, speed / (x * x * k_tt + 2.0 * x * y * k_tb + y * y * k_bb))
    rub(sim, velocity, k, -j * x, -j * y)


@kernel
def rub_more(sim: int, velocity: int, k: int, cap: float) -> float:
    """One sweep's change of the friction impulse at row k within the disc of radius `cap` [N s].

    Returns how much it changed the sliding velocity [m/s].
    """
    r, o = row(sim, k), owner(sim, k)
    v = speed_at(velocity, r, int_at(o, ROW_A), int_at(o, ROW_B))
    vx, vy = dot(vec_at(r, TANGENT), v), dot(vec_at(r, BINORMAL), v)
    i_tt, i_tb, i_bb = vec_at(r, INVERSE_T)
    x0, y0, mass = float_at(r, RUB), float_at(r, RUB + 1), float_at(r, MASS_MOST)
    # what stops the sliding, if the cone allows it
    x, y = x0 - i_tt * vx - i_tb * vy, y0 - i_tb * vx - i_bb * vy
    if x * x + y * y > cap * cap:
        # else against the sliding, on the cone
        x, y = x0 - vx / mass, y0 - vy / mass
        size = math.sqrt(x * x + y * y)
        if size > cap:
            x, y = x * cap / size, y * cap / size
    if x != x0 or y != y0:
        rub(sim, velocity, k, x - x0, y - y0)
    return (abs(x - x0) + abs(y - y0)) * mass


@kernel
def push_more(sim: int, velocity: int, k: int) -> float:
    """One sweep's change of the normal impulse at row k, which may only push, towards v_n >= `GOAL`.

    Returns how much it changed the normal velocity [m/s].
    """
    r, a, b = row(sim, k), int_at(owner(sim, k), ROW_A), int_at(owner(sim, k), ROW_B)
    mass, before = float_at(r, MASS_N), float_at(r, PUSH)
    change = (float_at(r, GOAL) - normal_speed(velocity, r, a, b)) / mass
    total = min(float_at(r, LIMIT), max(0.0, before + change))
    change = total - before
    if change != 0.0:
        set_float(r, PUSH, total)
        push(sim, velocity, r, a, b, 0, change)
    return abs(change) * mass


@kernel
def collide(sim: int, velocity: int, elastic: float) -> None:
    """Resolve one collision: the rows whose `ROW_ON` is 2, by (8)–(10).

    `elastic` is 1 for restitution as the materials say, 0 for none. The rows' impulses must be zero before.
    """
    count = how_many(sim, N_ROWS)
    members, only, fastest = 0, -1, 0.0
    for k in range(count):
        o, r = owner(sim, k), row(sim, k)
        if int_at(o, ROW_ON) == 2:
            members += 1
            only = k
            v = normal_speed(velocity, r, int_at(o, ROW_A), int_at(o, ROW_B))
            set_float(r, GOAL, max(0.0, -elastic * float_at(r, RESTITUTION) * v))
            fastest = max(fastest, -v)
    if members == 1:
        push_more(sim, velocity, only)
        rub_once(sim, velocity, only, float_at(row(sim, only), FRICTION) * float_at(row(sim, only), PUSH))
        return
    for _ in range(SWEEPS):
        most = 0.0
        for k in range(count):
            if int_at(owner(sim, k), ROW_ON) == 2:
                most = max(most, push_more(sim, velocity, k))
        if most <= PRECISION * fastest:
            break
    for _ in range(SWEEPS):
        most = 0.0
        for k in range(count):
            if int_at(owner(sim, k), ROW_ON) == 2:
                r = row(sim, k)
                most = max(most, rub_more(sim, velocity, k, float_at(r, FRICTION) * float_at(r, PUSH)))
        if most <= PRECISION * fastest:
            break


@kernel
def disturb(sim: int, body: int, visit: int) -> None:
    """Note that visit number `visit` to a row has changed a body's velocity, if anything can."""
    if float_at(motion_of(sim, body), LIGHTNESS) > 0.0:
        set_int(kind_of(sim, body), DISTURBED, visit)


@kernel
def is_disturbed(sim: int, o: int) -> bool:
    """Whether the velocities of the bodies of row `o` of `row_of` have changed since it was visited."""
    last = int_at(o, ROW_VISIT)
    a, b = int_at(kind_of(sim, int_at(o, ROW_A)), DISTURBED), int_at(kind_of(sim, int_at(o, ROW_B)), DISTURBED)
    return a >= last or b >= last


@kernel
def settle(sim: int, velocity: int, sweeps: int, precision: float) -> int:
    """Solve all rows whose `ROW_ON` is 1 together: v_n >= `GOAL`, impulses only push, friction within its cone.

    What a driven body grips with (`GRIP`) counts for the cone.

    Projected sweeps over the rows (Gauss-Seidel), to and fro so that forces travel up and down a stack, from the
    impulses they hold, which must be in the velocities already.
    Done when no sweep changes a velocity by more than `precision` [m/s]; returns the number of sweeps made. A row whose
    bodies nothing has changed since is passed over.
    """
    count, visit = how_many(sim, N_ROWS), 0
    for k in range(count):
        set_int(owner(sim, k), ROW_VISIT, 0)
        set_int(kind_of(sim, int_at(owner(sim, k), ROW_A)), DISTURBED, 0)
        set_int(kind_of(sim, int_at(owner(sim, k), ROW_B)), DISTURBED, 0)
    for sweep in range(sweeps):
        count_one(sim, N_SWEEPS)
        most = 0.0
        for i in range(count):
            k = i if sweep & 1 == 0 else count - 1 - i
            o = owner(sim, k)
            if int_at(o, ROW_ON) == 1 and is_disturbed(sim, o):
                r = row(sim, k)
                visit += 1
                set_int(o, ROW_VISIT, visit)
                change = push_more(sim, velocity, k)
                cap = float_at(r, FRICTION) * (float_at(r, PUSH) + float_at(r, GRIP))
                if cap > 0.0 or float_at(r, RUB) != 0.0 or float_at(r, RUB + 1) != 0.0:
                    change = max(change, rub_more(sim, velocity, k, cap))
                if change > UNFELT * precision:
                    disturb(sim, int_at(o, ROW_A), visit)
                    disturb(sim, int_at(o, ROW_B), visit)
                most = max(most, change)
        if most <= precision:
            return sweep + 1
    return sweeps


@kernel
def settle_normals(sim: int, velocity: int, sweeps: int, precision: float) -> None:
    """`settle` for the normal impulses alone: a fair start where nothing is known of the friction yet."""
    for _ in range(sweeps):
        most = 0.0
        for k in range(how_many(sim, N_ROWS)):
            if int_at(owner(sim, k), ROW_ON) == 1:
                most = max(most, push_more(sim, velocity, k))
        if most <= precision:
            return
