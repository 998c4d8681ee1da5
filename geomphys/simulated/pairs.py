"""Which pairs of pieces may meet in a frame."""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import (
    norm,
    sub,
)
from geomphys.simulated.cells import vec_at
from geomphys.simulated.motion import point_at
from geomphys.simulated.state import (
    ARM,
    AT_COUNT,
    AT_FOUND,
    AT_FROM,
    AT_HEFT,
    AT_KEPT,
    AT_MATERIAL_COUNT,
    AT_MATERIALS,
    AT_OLD_KEPT,
    AT_OLD_PAIRS,
    AT_OTHER_COUNT,
    AT_OTHERS,
    AT_PAIR_ROOM,
    AT_PAIRS,
    AT_STILL,
    AT_STILL_COUNT,
    AT_STILL_LOW,
    AT_UNTIL,
    AT_WIDEST,
    BODY_A,
    BODY_B,
    EVENTS,
    FIRST,
    HELD,
    HOME,
    ISLAND,
    KEPT_COLUMNS,
    LAST,
    MASS,
    MATERIAL,
    N_LOST,
    N_OLD,
    N_PAIRS,
    PAIR_COLUMNS,
    PAIR_FRICTION,
    PAIR_RESTITUTION,
    PIECE_A,
    PIECE_B,
    PLACE,
    POINTS,
    RANGE,
    SEEN,
    SLOT_SIZE,
    SLOTS,
    SUM_N,
    TURNED,
    YIELDED,
    entry,
    free_body,
    has_changed,
    how_many,
    is_simulated,
    kept_at,
    kind_of,
    knob,
    motion_of,
    pair_at,
    set_how_many,
)
from geomphys.simulated.swept_boxes import apart, body_box, box_all, piece_box, reach_ahead


@kernel
def any_beyond_range(sim: int, t: float) -> bool:
    """Whether a changed body may leave the range its pairs were looked for in before the time they are for ends."""
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        if has_changed(sim, body):
            m = motion_of(sim, body)
            gone = norm(sub(point_at(m, t), vec_at(m, HOME))) + min(2.0, float_at(m, TURNED)) * float_at(m, ARM)
            if gone + reach_ahead(sim, body, knob(sim, AT_UNTIL) - t) > float_at(m, RANGE):
                return True
    return False


@kernel
def insert(sim: int, count: int, body: int) -> int:
    """Put a body into the sorted list of found ones; returns the list's new length."""
    k = count
    while k > 0 and int_at(entry(sim, AT_FOUND), k - 1) > body:
        set_int(entry(sim, AT_FOUND), k, int_at(entry(sim, AT_FOUND), k - 1))
        k -= 1
    set_int(entry(sim, AT_FOUND), k, body)
    return count + 1


@kernel
def near_bodies(sim: int, a: int) -> int:
    """Bodies whose boxes meet that of simulated body a, simulated ones below it left out; sorted, in `found`."""
    box = body_box(sim, a)
    low, high = float_at(box, 0), float_at(box, 3)
    count = 0
    first, last = 0, entry(sim, AT_STILL_COUNT)
    while first < last:  # the first whose low x is not below
        middle = (first + last) // 2
        if float_at(entry(sim, AT_STILL_LOW), middle) < low - knob(sim, AT_WIDEST):
            first = middle + 1
        else:
            last = middle
    for k in range(first, entry(sim, AT_STILL_COUNT)):
        if float_at(entry(sim, AT_STILL_LOW), k) > high:
            break
        if not apart(box, body_box(sim, int_at(entry(sim, AT_STILL), k))):
            count = insert(sim, count, int_at(entry(sim, AT_STILL), k))
    for k in range(entry(sim, AT_OTHER_COUNT)):
        b = int_at(entry(sim, AT_OTHERS), k)
        if not (is_simulated(sim, b) and b <= a) and not apart(box, body_box(sim, b)):
            count = insert(sim, count, b)
    return count


@kernel
def new_pair(sim: int, k: int, i: int, j: int, a: int, b: int) -> None:
    """Row k of `pairs` and `kept` for a pair of which nothing is known yet."""
    p, kept = pair_at(sim, k), kept_at(sim, k)
    for c in range(KEPT_COLUMNS):
        set_float(kept, c, 0.0)
    set_int(p, PIECE_A, i)
    set_int(p, PIECE_B, j)
    set_int(p, BODY_A, a)
    set_int(p, BODY_B, b)
    set_int(p, POINTS, 0)
    set_int(p, EVENTS, 0)
    set_int(p, HELD, 0)
    set_int(p, YIELDED, 0)
    table, count = entry(sim, AT_MATERIALS), entry(sim, AT_MATERIAL_COUNT)
    cell = count * int_at(kind_of(sim, a), MATERIAL) + int_at(kind_of(sim, b), MATERIAL)
    set_float(kept, PAIR_RESTITUTION, float_at(table, cell))
    set_float(kept, PAIR_FRICTION, float_at(table, count * count + cell))


@kernel
def old_pair(sim: int, old: int) -> int:
    """Row of `old_pairs`."""
    return entry(sim, AT_OLD_PAIRS) + 8 * PAIR_COLUMNS * old


@kernel
def append_old(sim: int, old: int) -> None:
    """Append a pair of the old list, with what is remembered of it."""
    k = how_many(sim, N_PAIRS)
    set_how_many(sim, N_PAIRS, k + 1)
    for c in range(PAIR_COLUMNS):
        set_int(pair_at(sim, k), c, int_at(old_pair(sim, old), c))
    for c in range(KEPT_COLUMNS):
        set_float(kept_at(sim, k), c, float_at(entry(sim, AT_OLD_KEPT) + 8 * KEPT_COLUMNS * old, c))


@kernel
def skip_old(sim: int, old: int) -> int:
    """Go past a pair of the old list that is no longer near; what pushed in this frame stays. Returns the next one."""
    kept = entry(sim, AT_OLD_KEPT) + 8 * KEPT_COLUMNS * old
    pushed = False
    for m in range(4):
        pushed = pushed or float_at(kept, SLOTS + m * SLOT_SIZE + SUM_N) > 0.0
    if pushed and how_many(sim, N_PAIRS) < entry(sim, AT_PAIR_ROOM):
        append_old(sim, old)
        set_float(kept_at(sim, how_many(sim, N_PAIRS) - 1), SEEN, -1.0)
        set_int(pair_at(sim, how_many(sim, N_PAIRS) - 1), PLACE, -1)
    return old + 1


@kernel
def add_pair(sim: int, i: int, j: int, a: int, b: int, old: int) -> int:
    """Append a pair of pieces, with what is remembered of it; `old` is how far the old list is through.

    Returns how far it is after.
    """
    count = how_many(sim, N_OLD)
    while old < count:
        p = old_pair(sim, old)
        if int_at(p, PIECE_A) > i or (int_at(p, PIECE_A) == i and int_at(p, PIECE_B) >= j):
            break
        old = skip_old(sim, old)
    k = how_many(sim, N_PAIRS)
    if k == entry(sim, AT_PAIR_ROOM):
        set_how_many(sim, N_LOST, how_many(sim, N_LOST) + 1)
        return old
    p = old_pair(sim, old)
    if old < count and int_at(p, PIECE_A) == i and int_at(p, PIECE_B) == j:
        append_old(sim, old)
        old += 1
    else:
        set_how_many(sim, N_PAIRS, k + 1)
        new_pair(sim, k, i, j, a, b)
    set_float(kept_at(sim, k), SEEN, -1.0)
    set_int(pair_at(sim, k), PLACE, -1)
    return old


@kernel
def set_pairs_aside(sim: int) -> None:
    """Make the present pairs the old ones."""
    count = how_many(sim, N_PAIRS)
    for i in range(count * PAIR_COLUMNS):
        set_int(entry(sim, AT_OLD_PAIRS), i, int_at(entry(sim, AT_PAIRS), i))
    for i in range(count * KEPT_COLUMNS):
        set_float(entry(sim, AT_OLD_KEPT), i, float_at(entry(sim, AT_KEPT), i))
    set_how_many(sim, N_OLD, count)
    set_how_many(sim, N_PAIRS, 0)


@kernel
def find_pairs(sim: int, t: float, until: float) -> None:
    """List the pairs of pieces, one of a simulated body, that may meet between times `t` and `until` of the frame.

    Pairs come sorted by (piece a, piece b). One that has pushed in this frame stays on the list.
    """
    set_float(sim, AT_FROM, t)
    set_float(sim, AT_UNTIL, until)
    set_pairs_aside(sim)
    box_all(sim)
    old = 0
    for s in range(entry(sim, AT_COUNT)):
        a = free_body(sim, s)
        count = near_bodies(sim, a)
        for i in range(int_at(kind_of(sim, a), FIRST), int_at(kind_of(sim, a), LAST)):
            box = piece_box(sim, i)
            for f in range(count):
                b = int_at(entry(sim, AT_FOUND), f)
                if apart(box, body_box(sim, b)):
                    continue
                for j in range(int_at(kind_of(sim, b), FIRST), int_at(kind_of(sim, b), LAST)):
                    if not apart(box, piece_box(sim, j)):
                        old = add_pair(sim, i, j, a, b, old)
    while old < how_many(sim, N_OLD):
        old = skip_old(sim, old)
    label_islands(sim)


@kernel
def label_islands(sim: int) -> None:
    """Give bodies that may meet, directly or through others, the same label, and add up the mass of each island."""
    for s in range(entry(sim, AT_COUNT)):
        set_int(kind_of(sim, free_body(sim, s)), ISLAND, free_body(sim, s))
        set_float(entry(sim, AT_HEFT), free_body(sim, s), 0.0)
    changed = True
    while changed:
        changed = False
        for k in range(how_many(sim, N_PAIRS)):
            b = int_at(pair_at(sim, k), BODY_B)
            if is_simulated(sim, b):
                x, y = kind_of(sim, int_at(pair_at(sim, k), BODY_A)), kind_of(sim, b)
                if int_at(x, ISLAND) != int_at(y, ISLAND):
                    least = min(int_at(x, ISLAND), int_at(y, ISLAND))
                    set_int(x, ISLAND, least)
                    set_int(y, ISLAND, least)
                    changed = True
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        label = int_at(kind_of(sim, body), ISLAND)
        set_float(
            entry(sim, AT_HEFT), label, float_at(entry(sim, AT_HEFT), label) + float_at(motion_of(sim, body), MASS)
        )
