"""Distributions of the measures in ``/metrics`` over the frames of an output."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from geomphys.numerics.quantiles import Quantiles

METRICS = (
    "recorded_penetration_m",
    "residual_penetration_m",
    "correction_m",
    "correction_rad",
    "contacts",
    "iterations",
    "amplification",
    "shape_change_rad",
    "contact_precision_m",
    "contact_alignment_rad",
)
FINGERTIPS = ("fingertip_error_m", "fingertip_error_in_contact_m")
_OF_ALL_FRAMES = ("residual_penetration_m", "iterations")


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """Distribution of a series of values >= 0, in the unit of its name."""

    count: int
    mean: float
    p50: float
    p90: float
    p95: float
    p99: float
    max: float


def distribution(values: Quantiles) -> Distribution:
    """The distribution of a series."""
    return Distribution(
        count=values.count,
        mean=values.total / values.count if values.count else 0.0,
        p50=values.median(),
        p90=values.quantile(0.90),
        p95=values.quantile(0.95),
        p99=values.quantile(0.99),
        max=values.largest,
    )


class MetricValues:
    """Accumulates the measures of frames; memory does not grow with their number."""

    def __init__(self) -> None:
        self._series = {name: Quantiles() for name in (*METRICS, *FINGERTIPS)}

    def add(self, metrics: Mapping[str, float]) -> None:
        """Take the metrics of a frame: those above 0, of residual penetration and iterations all; see `OutputStatistics`."""
        for name in METRICS:
            value = float(metrics[name])
            if value > 0.0 or name in _OF_ALL_FRAMES:
                self._series[name].add(value)
        for name in FINGERTIPS[: 2 if metrics["contacts_recorded"] else 1]:
            self._series[name].add(metrics["fingertip_error_m"])

    def distributions(self) -> dict[str, Distribution]:
        """Name -> distribution, of `METRICS` and `FINGERTIPS`."""
        return {name: distribution(values) for name, values in self._series.items()}
