"""Distributions of the measures of frames, against numpy's quantiles."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.analysis.metric_values import FINGERTIPS, METRICS, MetricValues, distribution
from geomphys.numerics.quantiles import Quantiles


def frames(count: int) -> list[dict[str, float]]:
    rng = np.random.default_rng(2)
    out = []
    for k in range(count):
        row = {name: float(rng.exponential()) * (rng.random() < 0.5) for name in METRICS}
        out.append(row | {"fingertip_error_m": float(rng.exponential()), "contacts_recorded": float(k % 3 == 0)})
    return out


def test_quantiles_are_those_of_the_values() -> None:
    values, series = np.random.default_rng(1).exponential(size=2000), Quantiles()
    for value in values:
        series.add(float(value))
    found = distribution(series)
    assert (found.count, found.max) == (2000, values.max())
    assert found.mean == pytest.approx(values.mean(), rel=1e-12)
    for share in (50, 90, 95, 99):
        expected = np.quantile(values, share / 100)
        assert getattr(found, f"p{share}") == pytest.approx(expected, rel=0.02)


def test_an_empty_series_has_no_values() -> None:
    found = distribution(Quantiles())
    assert (found.count, found.mean, found.max) == (0, 0.0, 0.0)


def test_frames_without_a_value_do_not_count_but_where_zero_is_one() -> None:
    """Of overlap that is left and of passes zero is the good value."""
    rows, series = frames(300), MetricValues()
    for row in rows:
        series.add(row)
    found = series.distributions()
    assert set(found) == {*METRICS, *FINGERTIPS}
    for name in METRICS:
        values = np.array([row[name] for row in rows])
        counted = values if name in ("residual_penetration_m", "iterations") else values[values > 0.0]
        assert (found[name].count, found[name].max) == (len(counted), counted.max())
        assert found[name].mean == pytest.approx(counted.mean(), rel=1e-12)
    errors = np.array([row["fingertip_error_m"] for row in rows])
    assert found["fingertip_error_m"].count == 300
    in_contact = errors[::3]
    assert found["fingertip_error_in_contact_m"].count == len(in_contact)
    assert found["fingertip_error_in_contact_m"].mean == pytest.approx(in_contact.mean(), rel=1e-12)
