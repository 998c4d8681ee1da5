"""The queue of impacts against a sorted list."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

from geomphys.jit.packed_records import pack
from geomphys.simulated.impact_queue import empty_queue, put, take_out
from geomphys.simulated.state import COUNTS, PAIR


class Tables(NamedTuple):
    """What the queue needs of a `Simulation`."""

    pairs: np.ndarray
    counts: np.ndarray
    queue: np.ndarray


@pytest.mark.parametrize("seed", range(3))
def test_the_front_is_always_the_earliest(seed: int) -> None:
    count = 40
    tables = Tables(np.zeros(count, PAIR), np.zeros((), COUNTS), np.zeros(count, np.int64))
    pairs, counts, heap = tables
    counts["pairs"] = count
    queue = pack(tables)
    empty_queue(queue)
    rng, twin = np.random.default_rng(seed), {}
    for _ in range(2000):
        pair = int(rng.integers(count))
        if rng.random() < 0.6:
            # few different times, so that some are equal
            twin[pair] = float(rng.integers(12))
            put(queue, pair, twin[pair])
        else:
            twin.pop(pair, None)
            take_out(queue, pair)
        assert counts["queued"] == len(twin)
        assert sorted(heap[: len(twin)]) == sorted(twin)
        assert all(heap[pairs[p]["queue_index"]] == p for p in twin)
        if twin:
            assert heap[0] == min(twin, key=lambda p: (twin[p], p))
            assert pairs[heap[0]]["due"] == min(twin.values())
    empty_queue(queue)
    assert counts["queued"] == 0
    assert (pairs["queue_index"] == -1).all()
