"""The queue of impacts: a binary heap of pairs, the one due first in front, of equal ones the first on the list.

A pair stands in it at most once; when one of its bodies changes course it is put in again with its new time, or taken
out. Where it stands is kept with the pair (`PLACE`), as is when it is due (`DUE`).
"""

from __future__ import annotations

from geomphys.jit.addresses import float_at, int_at, set_float, set_int
from geomphys.jit.kernel import kernel
from geomphys.simulated.state import (
    AT_HEAP,
    DUE,
    N_HEAP,
    N_PAIRS,
    PLACE,
    entry,
    how_many,
    kept_at,
    pair_at,
    set_how_many,
)


@kernel
def heap(sim: int) -> int:
    """Address of the pairs in the queue."""
    return entry(sim, AT_HEAP)


@kernel
def comes_before(sim: int, a: int, b: int) -> bool:
    """Whether pair a is due before pair b."""
    x, y = float_at(kept_at(sim, a), DUE), float_at(kept_at(sim, b), DUE)
    return x < y or (x == y and a < b)


@kernel
def stand(sim: int, k: int, pair: int) -> None:
    """Let `pair` stand at place k."""
    set_int(heap(sim), k, pair)
    set_int(pair_at(sim, pair), PLACE, k)


@kernel
def rise(sim: int, k: int) -> None:
    """Move the pair at place k towards the front until its parent comes before it."""
    pair = int_at(heap(sim), k)
    while k > 0:
        parent = (k - 1) // 2
        if not comes_before(sim, pair, int_at(heap(sim), parent)):
            break
        stand(sim, k, int_at(heap(sim), parent))
        k = parent
    stand(sim, k, pair)


@kernel
def sink(sim: int, k: int) -> None:
    """Move the pair at place k towards the back until it comes before its children."""
    pair, count = int_at(heap(sim), k), how_many(sim, N_HEAP)
    while True:
        child = 2 * k + 1
        if child >= count:
            break
        if child + 1 < count and comes_before(sim, int_at(heap(sim), child + 1), int_at(heap(sim), child)):
            child += 1
        if not comes_before(sim, int_at(heap(sim), child), pair):
            break
        stand(sim, k, int_at(heap(sim), child))
        k = child
    stand(sim, k, pair)


@kernel
def put(sim: int, pair: int, time: float) -> None:
    """Put `pair` in at `time` [s of the frame], or move it there."""
    set_float(kept_at(sim, pair), DUE, time)
    if int_at(pair_at(sim, pair), PLACE) < 0:
        k = how_many(sim, N_HEAP)
        set_how_many(sim, N_HEAP, k + 1)
        stand(sim, k, pair)
    rise(sim, int_at(pair_at(sim, pair), PLACE))
    sink(sim, int_at(pair_at(sim, pair), PLACE))


@kernel
def take_out(sim: int, pair: int) -> None:
    """Take `pair` out if it is in."""
    k = int_at(pair_at(sim, pair), PLACE)
    if k < 0:
        return
    count = how_many(sim, N_HEAP) - 1
    set_how_many(sim, N_HEAP, count)
    set_int(pair_at(sim, pair), PLACE, -1)
    if k < count:
        last = int_at(heap(sim), count)
        stand(sim, k, last)
        rise(sim, k)
        sink(sim, int_at(pair_at(sim, last), PLACE))


@kernel
def empty_queue(sim: int) -> None:
    """Take all pairs out."""
    for pair in range(how_many(sim, N_PAIRS)):
        set_int(pair_at(sim, pair), PLACE, -1)
    set_how_many(sim, N_HEAP, 0)
