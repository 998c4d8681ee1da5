"""The queue of impacts: a binary heap of pairs by time of impact, of equal times the first in the list.

It holds a pair at most once; when the motion of one of its bodies changes it is put in again with its new time, or
removed. Its index in the heap (`queue_index`) and its time (`due`) are fields of the pair.
"""

from __future__ import annotations

from geomphys.jit.kernel import kernel
from geomphys.simulated.state import Simulation


@kernel
def comes_before(sim: Simulation, a: int, b: int) -> bool:
    """Whether pair a is due before pair b."""
    x, y = sim.pairs[a].due, sim.pairs[b].due
    return x < y or (x == y and a < b)


@kernel
def set_entry(sim: Simulation, k: int, pair: int) -> None:
    """Write `pair` to index k."""
    sim.queue[k] = pair
    sim.pairs[pair].queue_index = k


@kernel
def sift_up(sim: Simulation, k: int) -> None:
    """Move the pair at index k towards the front until its parent comes before it."""
    pair = sim.queue[k]
    while k > 0:
        parent = (k - 1) // 2
        if not comes_before(sim, pair, sim.queue[parent]):
            break
        set_entry(sim, k, sim.queue[parent])
        k = parent
    set_entry(sim, k, pair)


@kernel
def sift_down(sim: Simulation, k: int) -> None:
    """Move the pair at index k towards the back until it comes before its children."""
    pair, count = sim.queue[k], sim.counts.queued
    while True:
        child = 2 * k + 1
        if child >= count:
            break
        if child + 1 < count and comes_before(sim, sim.queue[child + 1], sim.queue[child]):
            child += 1
        if not comes_before(sim, sim.queue[child], pair):
            break
        set_entry(sim, k, sim.queue[child])
        k = child
    set_entry(sim, k, pair)


@kernel
def put(sim: Simulation, pair: int, time: float) -> None:
    """Put `pair` in at `time` [s of the frame], or move it there."""
    sim.pairs[pair].due = time
    if sim.pairs[pair].queue_index < 0:
        k = sim.counts.queued
        sim.counts.queued = k + 1
        set_entry(sim, k, pair)
    sift_up(sim, sim.pairs[pair].queue_index)
    sift_down(sim, sim.pairs[pair].queue_index)


@kernel
def take_out(sim: Simulation, pair: int) -> None:
    """Remove `pair` if it is in the queue."""
    k = sim.pairs[pair].queue_index
    if k < 0:
        return
    count = sim.counts.queued - 1
    sim.counts.queued = count
    sim.pairs[pair].queue_index = -1
    if k < count:
        last = sim.queue[count]
        set_entry(sim, k, last)
        sift_up(sim, k)
        sift_down(sim, sim.pairs[last].queue_index)


@kernel
def empty_queue(sim: Simulation) -> None:
    """Remove all pairs."""
    for pair in range(sim.counts.pairs):
        sim.pairs[pair].queue_index = -1
    sim.counts.queued = 0
