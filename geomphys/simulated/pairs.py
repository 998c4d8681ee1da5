"""Finds the pairs of pieces that may come into contact in a step."""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.record_copy import copy_record
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import (
    norm,
    sub,
)
from geomphys.simulated.contact_points import clear_slot
from geomphys.simulated.impact_queue import put
from geomphys.simulated.islands import label_islands
from geomphys.simulated.motion import point_at
from geomphys.simulated.state import Simulation, concerns_changed, is_simulated
from geomphys.simulated.swept_boxes import apart, box_all, box_changed, reach_ahead


@kernel
def any_beyond_range(sim: Simulation, t: float) -> bool:
    """Whether a changed body may leave the range in which its pairs were searched before their time span ends."""
    for s in range(sim.counts.changed):
        body = sim.changed[s]
        m = sim.motion[body]
        gone = norm(sub(point_at(m, t), vec_of(m.listed_position))) + min(2.0, m.listed_rotation) * m.reach
        if gone + reach_ahead(sim, body, sim.frame.span_end - t) > m.listed_range:
            return True
    return False


@kernel
def insert(sim: Simulation, count: int, body: int) -> int:
    """Put a body into the sorted list of found ones; returns the list's new length."""
    k = count
    while k > 0 and sim.found[k - 1] > body:
        sim.found[k] = sim.found[k - 1]
        k -= 1
    sim.found[k] = body
    return count + 1


@kernel
def near_bodies(sim: Simulation, a: int) -> int:
    """Bodies whose boxes overlap that of simulated body a, simulated ones below it left out; sorted, in `found`."""
    box = sim.body_boxes[a]
    low, high = box.low[0], box.high[0]
    count = 0
    first, last = 0, len(sim.still)
    while first < last:  # the first whose low x is not below
        middle = (first + last) // 2
        if sim.still_low[middle] < low - sim.widest:
            first = middle + 1
        else:
            last = middle
    for k in range(first, len(sim.still)):
        if sim.still_low[k] > high:
            break
        if not apart(box, sim.body_boxes[sim.still[k]]):
            count = insert(sim, count, sim.still[k])
    for k in range(len(sim.others)):
        b = sim.others[k]
        if not (is_simulated(sim, b) and b <= a) and not apart(box, sim.body_boxes[b]):
            count = insert(sim, count, b)
    return count


@kernel
def new_pair(sim: Simulation, k: int, i: int, j: int, a: int, b: int) -> None:
    """Record k of `pairs`, and its slots, for a new pair."""
    p = sim.pairs[k]
    p.piece[0], p.piece[1], p.body[0], p.body[1] = i, j, a, b
    p.point_count = p.encounters = p.resting = p.disabled = p.touching = 0
    set_vec(p.axis, (0.0, 0.0, 0.0))
    p.simplex.count = 0
    p.distance = p.known_distance = p.travelled = p.due = 0.0
    p.measured_at, p.queue_index = -1.0, -1
    material_a, material_b = sim.bodies[a].material, sim.bodies[b].material
    p.restitution = sim.materials.restitution[material_a, material_b]
    p.friction = sim.materials.friction[material_a, material_b]
    for m in range(4):
        clear_slot(sim.slots[k, m])


@kernel
def append_old(sim: Simulation, old: int) -> None:
    """Append a pair of the old list with its cached data."""
    k = sim.counts.pairs
    sim.counts.pairs = k + 1
    if old >= sim.counts.saved_from:
        copy_record(sim.pairs[k], sim.old_pairs[old])
        for m in range(4):
            copy_record(sim.slots[k, m], sim.old_pair_slots[old, m])
    elif old > k:
        copy_record(sim.pairs[k], sim.pairs[old])
        for m in range(4):
            copy_record(sim.slots[k, m], sim.slots[old, m])


@kernel
def old_pieces(sim: Simulation, old: int) -> tuple[int, int]:
    """Pieces of a pair of the old list."""
    p = sim.old_pairs[old] if old >= sim.counts.saved_from else sim.pairs[old]
    return p.piece[0], p.piece[1]


@kernel
def is_loaded(sim: Simulation, old: int) -> bool:
    """Whether a pair of the old list has had an impulse in this frame."""
    for m in range(4):
        slot = sim.old_pair_slots[old, m] if old >= sim.counts.saved_from else sim.slots[old, m]
        if slot.normal_impulse > 0.0:
            return True
    return False


@kernel
def skip_old(sim: Simulation, old: int) -> int:
    """Skip a pair of the old list that is no longer near; one with an impulse in this frame stays. Returns the next one."""
    if is_loaded(sim, old) and sim.counts.pairs < len(sim.pairs):
        append_old(sim, old)
    return old + 1


@kernel
def save_pairs(sim: Simulation, first: int) -> None:
    """Copy the pairs of the old list from number `first` on elsewhere, as a new one takes the place of that."""
    for k in range(first, sim.counts.old_pairs):
        copy_record(sim.old_pairs[k], sim.pairs[k])
        for m in range(4):
            copy_record(sim.old_pair_slots[k, m], sim.slots[k, m])
    sim.counts.saved_from = first


@kernel
def add_pair(sim: Simulation, i: int, j: int, a: int, b: int, old: int) -> int:
    """Append a pair of pieces with its cached data; `old` is the position in the old list.

    Returns the position after it.
    """
    count = sim.counts.old_pairs
    while old < count:
        x, y = old_pieces(sim, old)
        if x > i or (x == i and y >= j):
            break
        old = skip_old(sim, old)
    k = sim.counts.pairs
    if k == len(sim.pairs):
        sim.counts.lost += 1
        return old
    if old < count and old_pieces(sim, old) == (i, j):
        append_old(sim, old)
        old += 1
    else:
        if k == old and old < sim.counts.saved_from:
            save_pairs(sim, old)
        sim.counts.pairs = k + 1
        new_pair(sim, k, i, j, a, b)
    return old


@kernel
def list_pairs(sim: Simulation) -> None:
    """List the pairs of pieces, one of a simulated body, whose boxes overlap, with the cached data that they had.

    Pairs are sorted by (piece a, piece b). One with an impulse in this frame stays on the list.
    """
    sim.counts.old_pairs = sim.counts.saved_from = sim.counts.pairs
    sim.counts.pairs = 0
    old = 0
    for s in range(len(sim.free)):
        a = sim.free[s]
        count = near_bodies(sim, a)
        for i in range(sim.bodies[a].first_piece, sim.bodies[a].end_piece):
            box = sim.boxes[i]
            for f in range(count):
                b = sim.found[f]
                if apart(box, sim.body_boxes[b]):
                    continue
                for j in range(sim.bodies[b].first_piece, sim.bodies[b].end_piece):
                    if not apart(box, sim.boxes[j]):
                        old = add_pair(sim, i, j, a, b, old)
    while old < sim.counts.old_pairs:
        old = skip_old(sim, old)


@noinline
def find_pairs(sim: Simulation, until: float) -> None:
    """List the pairs that may come into contact from the step's start to time `until`, and label islands."""
    sim.frame.span_start, sim.frame.span_end = 0.0, until
    box_all(sim)
    list_pairs(sim)
    for k in range(sim.counts.pairs):
        sim.pairs[k].measured_at = -1.0
        sim.pairs[k].queue_index = -1
    sim.counts.queued = 0
    label_islands(sim)


@noinline
def find_pairs_again(sim: Simulation, t: float) -> None:
    """Search again for pairs of the changed bodies from time `t` to the end of the span, and label islands.

    Pairs of other bodies, their order and their places in the queue stay.
    """
    sim.frame.span_start = t
    box_changed(sim)
    list_pairs(sim)
    sim.counts.queued = 0
    for k in range(sim.counts.pairs):
        p = sim.pairs[k]
        queued = p.queue_index >= 0 and not concerns_changed(sim, k)
        p.queue_index = -1
        if concerns_changed(sim, k):
            p.measured_at = -1.0
        elif queued:
            put(sim, k, p.due)
    label_islands(sim)
