"""Finds the pairs of pieces that may come into contact in a frame."""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_of
from geomphys.numerics.vec3 import (
    norm,
    sub,
)
from geomphys.simulated.contact_points import clear_slot
from geomphys.simulated.motion import point_at
from geomphys.simulated.state import Simulation, has_changed, is_simulated
from geomphys.simulated.swept_boxes import apart, box_all, reach_ahead


@kernel
def any_beyond_range(sim: Simulation, t: float) -> bool:
    """Whether a changed body may leave the range in which its pairs were searched before their time span ends."""
    for s in range(len(sim.free)):
        body = sim.free[s]
        if has_changed(sim, body):
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
    p.distance = p.measured_at = p.due = 0.0
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
    sim.pairs[k] = sim.old_pairs[old]
    for m in range(4):
        sim.slots[k, m] = sim.old_pair_slots[old, m]


@kernel
def skip_old(sim: Simulation, old: int) -> int:
    """Skip a pair of the old list that is no longer near; one with an impulse in this frame stays. Returns the next one."""
    loaded = False
    for m in range(4):
        loaded = loaded or sim.old_pair_slots[old, m].normal_impulse > 0.0
    if loaded and sim.counts.pairs < len(sim.pairs):
        append_old(sim, old)
        sim.pairs[sim.counts.pairs - 1].measured_at = -1.0
        sim.pairs[sim.counts.pairs - 1].queue_index = -1
    return old + 1


@kernel
def add_pair(sim: Simulation, i: int, j: int, a: int, b: int, old: int) -> int:
    """Append a pair of pieces with its cached data; `old` is the position in the old list.

    Returns the position after it.
    """
    count = sim.counts.old_pairs
    while old < count:
        p = sim.old_pairs[old]
        if p.piece[0] > i or (p.piece[0] == i and p.piece[1] >= j):
            break
        old = skip_old(sim, old)
    k = sim.counts.pairs
    if k == len(sim.pairs):
        sim.counts.lost += 1
        return old
    p = sim.old_pairs[old]
    if old < count and p.piece[0] == i and p.piece[1] == j:
        append_old(sim, old)
        old += 1
    else:
        sim.counts.pairs = k + 1
        new_pair(sim, k, i, j, a, b)
    sim.pairs[k].measured_at = -1.0
    sim.pairs[k].queue_index = -1
    return old


@kernel
def save_pairs(sim: Simulation) -> None:
    """Copy the pairs to the old list."""
    count = sim.counts.pairs
    for k in range(count):
        sim.old_pairs[k] = sim.pairs[k]
        for m in range(4):
            sim.old_pair_slots[k, m] = sim.slots[k, m]
    sim.counts.old_pairs = count
    sim.counts.pairs = 0


@noinline
def find_pairs(sim: Simulation, t: float, until: float) -> None:
    """List the pairs of pieces, one of a simulated body, that may come into contact between times `t` and `until` of the frame.

    Pairs are sorted by (piece a, piece b). One with an impulse in this frame stays on the list.
    """
    sim.frame.span_start = t
    sim.frame.span_end = until
    save_pairs(sim)
    box_all(sim)
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
    label_islands(sim)


@kernel
def label_islands(sim: Simulation) -> None:
    """Give bodies that may touch, directly or through others, the same label, and sum the mass of each island."""
    for s in range(len(sim.free)):
        sim.bodies[sim.free[s]].island = sim.free[s]
        sim.island_mass[sim.free[s]] = 0.0
    changed = True
    while changed:
        changed = False
        for k in range(sim.counts.pairs):
            b = sim.pairs[k].body[1]
            if is_simulated(sim, b):
                x, y = sim.bodies[sim.pairs[k].body[0]], sim.bodies[b]
                if x.island != y.island:
                    least = min(x.island, y.island)
                    x.island = least
                    y.island = least
                    changed = True
    for s in range(len(sim.free)):
        body = sim.free[s]
        label = sim.bodies[body].island
        sim.island_mass[label] = sim.island_mass[label] + sim.motion[body].mass
