"""The queue of impacts against a sorted list."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.simulated.impact_queue import empty_queue, put, take_out
from geomphys.simulated.state import (
    AT_COUNTS,
    AT_HEAP,
    AT_KEPT,
    AT_PAIRS,
    DUE,
    HEADER,
    KEPT_COLUMNS,
    N_HEAP,
    N_PAIRS,
    PAIR_COLUMNS,
    PLACE,
)


@pytest.mark.parametrize("seed", range(3))
def test_the_front_is_always_the_earliest(seed: int) -> None:
    count = 40
    pairs, kept = np.zeros((count, PAIR_COLUMNS), np.int64), np.zeros((count, KEPT_COLUMNS))
    counts, heap, header = np.zeros(8, np.int64), np.zeros(count, np.int64), np.zeros(HEADER, np.int64)
    for entry, array in ((AT_PAIRS, pairs), (AT_KEPT, kept), (AT_COUNTS, counts), (AT_HEAP, heap)):
        header[entry] = array.ctypes.data
    counts[N_PAIRS] = count
    queue = header.ctypes.data
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
        assert counts[N_HEAP] == len(twin)
        assert sorted(heap[: len(twin)]) == sorted(twin)
        assert all(heap[pairs[p, PLACE]] == p for p in twin)
        if twin:
            assert heap[0] == min(twin, key=lambda p: (twin[p], p))
            assert kept[heap[0], DUE] == min(twin.values())
    empty_queue(queue)
    assert counts[N_HEAP] == 0
    assert (pairs[:, PLACE] == -1).all()
