"""What is gathered of a difference, against the same on whole arrays."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.analysis.diff.measures import DifferenceTable, Peak, Peaks


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("tolerance", [0.0, 0.5])
def test_spread_is_largest_rms_and_first(seed: int, tolerance: float) -> None:
    random = np.random.default_rng(seed)
    table = random.choice([0.0, 0.0, 1e-3, 0.5, 2.0], size=random.integers(1, (40, 5)))
    names = [f"body {k}" for k in range(table.shape[1])]
    differences = DifferenceTable(tolerance)
    rows = differences.rows(names)
    for frame, row in enumerate(table):
        assert differences.add(rows, row, 10 + frame) == bool((row > tolerance).any())
    for name, column in zip(names, table.T, strict=True):
        measure, over = differences.each()[name], np.flatnonzero(column > tolerance)
        assert measure.max == column.max()
        assert measure.rms == pytest.approx(np.sqrt(np.mean(column**2)))
        assert measure.frames == len(over)
        assert measure.first_frame == (10 + over[0] if len(over) else None)
        assert measure.worst_frame == (10 + int(column.argmax()) if column.any() else None)
    assert differences.overall().max == table.max()
    assert differences.overall().rms == pytest.approx(np.sqrt(np.mean(table**2)))


def test_things_may_come_late_and_go() -> None:
    differences = DifferenceTable(0.0)
    differences.add(differences.rows(["a"]), np.array([1.0]), 0)
    differences.add(differences.rows(["b", "a"]), np.array([3.0, 0.0]), 1)
    assert list(differences.each()) == ["a", "b"]
    assert differences.each()["a"].rms == pytest.approx(np.sqrt(0.5))
    assert differences.each()["b"].rms == 3.0
    assert differences.has("b")
    assert not differences.has("c")


def test_peaks_lie_apart() -> None:
    peaks = Peaks(2, min_distance_ns=100)
    for frame, value in enumerate([1.0, 3.0, 2.0, 0.0, 0.5, 4.0, 0.7, 2.5]):
        time = 60 * frame
        if peaks.would_keep(value, time):
            peaks.add(Peak(value, frame, time, None))
    assert [(peak.value, peak.frame) for peak in peaks.sorted_peaks()] == [(4.0, 5), (3.0, 1)]
    assert not peaks.would_keep(0.0, 10_000)
