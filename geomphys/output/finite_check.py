"""Checks that every number of a frame is finite before it is written."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geomphys.errors import OutputError
from geomphys.results import FrameResult


def check_finite(result: FrameResult, body_names: Sequence[str]) -> None:
    """Raise OutputError that names frame and body or field if a number of the result is NaN or infinite."""
    metrics, contacts, pairs = result.metrics, result.contacts, result.penetrations
    total = float(
        metrics.recorded_penetration_m
        + metrics.residual_penetration_m
        + metrics.correction_m
        + metrics.correction_rad
        + sum(metrics[-5:])
        + np.vdot(result.corrected, result.corrected)
        + np.vdot(result.recorded, result.recorded)
        + np.vdot(result.angles, result.angles)
    )
    if len(contacts.depth):
        total += sum(float(np.vdot(column, column)) for column in contacts[2:])
    if len(pairs.largest):
        total += float(np.vdot(pairs.pd, pairs.pd) + np.vdot(pairs.largest, pairs.largest))
    if not math.isfinite(total):
        raise OutputError(
            f"frame {result.frame.index}: {_first_non_finite(result, body_names)}; nothing after the frame before is written"
        )


def _first_non_finite(result: FrameResult, body_names: Sequence[str]) -> str:
    for name, poses in (("corrected", result.corrected), ("recorded", result.recorded)):
        bad = np.flatnonzero(~np.isfinite(poses).all(axis=1))
        if len(bad):
            return f"the {name} pose of {body_names[bad[0]]} is not finite: {poses[bad[0]].tolist()}"
    columns = {
        "angle": result.angles,
        **_columns("contact", result.contacts),
        **_columns("penetration", result.penetrations),
    }
    for name, values in columns.items():
        if not np.isfinite(values).all():
            return f"{name} is not finite: {values[~np.isfinite(values)][0]}"
    return f"a metric is not finite: {result.metrics}"


def _columns(kind: str, columns: tuple[np.ndarray, ...]) -> dict[str, np.ndarray]:
    names: tuple[str, ...] = columns._fields  # type: ignore[attr-defined]
    return {f"{kind} {name}": column for name, column in zip(names, columns, strict=True)}
