"""Quantiles against sorting all values."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geomphys.numerics.quantiles import BIN_WIDTH, MIN_VALUE, Quantiles

VALUES = st.lists(st.floats(0.0, 1e9), min_size=1, max_size=60)


def filled(values: list[float], exact: int) -> Quantiles:
    """A series of the values, of which the first `exact` are kept as they are."""
    series = Quantiles(exact=exact)
    for value in values:
        series.add(value)
    return series


@given(VALUES, st.floats(0.0, 1.0))
def test_exact_while_few(values: list[float], fraction: float) -> None:
    series = filled(values, exact=60)
    found = series.quantile(fraction)
    assert found in values
    assert sum(value <= found for value in values) >= fraction * len(values)
    assert sum(value < found for value in values) <= fraction * len(values)
    assert series.median() == pytest.approx(float(np.median(values)), rel=1e-15)
    assert series.largest == max(values)
    assert series.count == len(values)


@given(VALUES, st.floats(0.0, 1.0))
def test_binned_within_a_bin_of_exact(values: list[float], fraction: float) -> None:
    exact, binned = filled(values, exact=60), filled(values, exact=3)
    assert binned.quantile(fraction) == pytest.approx(exact.quantile(fraction), rel=1.01 * BIN_WIDTH, abs=MIN_VALUE)
    assert binned.largest == exact.largest
    assert binned.total == exact.total


@given(st.lists(st.integers(0, 300), min_size=1, max_size=60), st.floats(0.0, 1.0))
def test_counts_stay_exact_when_binned(values: list[int], fraction: float) -> None:
    numbers = [float(value) for value in values]
    assert filled(numbers, exact=1).quantile(fraction) == filled(numbers, exact=60).quantile(fraction)


def test_memory_does_not_grow() -> None:
    series = filled([float(k) for k in range(2000)], exact=1000)
    assert len(series._values) == 0
    assert series.median() == pytest.approx(999.5, rel=BIN_WIDTH)


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_what_is_no_magnitude_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        Quantiles().add(value)


def test_nothing_gives_zero() -> None:
    assert Quantiles().quantile(0.5) == Quantiles().median() == 0.0
