"""Checks that every number of a frame is finite before it is written."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from geomphys.errors import OutputError
from geomphys.results import FrameResult, ResultColumns


def first_non_finite(columns: ResultColumns, body_names: Sequence[str]) -> tuple[int, OutputError] | None:
    """The first row with a number that is NaN or infinite, and the error that names frame and body or field; None without."""
    numbers = [columns.corrected, columns.recorded, columns.angles, *columns.contacts[2:]]
    numbers += [columns.penetrations.pd, columns.penetrations.largest]
    numbers += [column for column in columns.metrics.values() if column.dtype.kind == "f"]
    if all(np.isfinite(values).all() for values in numbers):
        return None
    for row in range(len(columns)):
        if (text := _first_of_frame(columns.result(row), body_names)) is not None:
            frame = columns.frames[row].index
            return row, OutputError(f"frame {frame}: {text}; nothing after the frame before is written")
    return None


def _first_of_frame(result: FrameResult, body_names: Sequence[str]) -> str | None:
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
    return None if all(map(math.isfinite, result.metrics)) else f"a metric is not finite: {result.metrics}"


def _columns(kind: str, columns: tuple[np.ndarray, ...]) -> dict[str, np.ndarray]:
    names: tuple[str, ...] = columns._fields  # type: ignore[attr-defined]
    return {f"{kind} {name}": column for name, column in zip(names, columns, strict=True)}
