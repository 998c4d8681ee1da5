"""A number that is not finite ends the writing ahead of it, with its frame, body and field."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import geomphys
from geomphys.errors import OutputError
from geomphys.output.finite_check import first_non_finite
from geomphys.results import ResultColumns
from tests.made import Results


@pytest.fixture(scope="module")
def columns(pressed: Results) -> tuple[ResultColumns, tuple[str, ...]]:
    """Twenty frames, most with contacts and overlaps, and the names of the bodies."""
    world = geomphys.load_world(pressed.scene)
    results = list(geomphys.replay(pressed.log, world))[20:40]
    made = ResultColumns.joined([ResultColumns.of(result) for result in results])
    assert made.contacts.depth.size > 5
    assert made.penetrations.largest.size > 5
    return made, world.body_names


def test_good_frames_are_good(columns: tuple[ResultColumns, tuple[str, ...]]) -> None:
    assert first_non_finite(*columns) is None


def spoilt(values: np.ndarray, at: tuple[int, ...], value: float) -> np.ndarray:
    out = values.copy()
    out[at] = value
    return out


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["corrected", "recorded", "contact point", "penetration pd", "metric"])
def test_the_first_bad_number_is_found(
    columns: tuple[ResultColumns, tuple[str, ...]], field: str, value: float
) -> None:
    made, names = columns
    row = 7
    if field in ("corrected", "recorded"):
        made = replace(made, **{field: spoilt(spoilt(getattr(made, field), (row, -1, 2), value), (12, 0, 0), value)})
    elif field == "contact point":
        at = int(made.contact_end[row])
        made = replace(made, contacts=made.contacts._replace(point=spoilt(made.contacts.point, (at, 1), value)))
    elif field == "penetration pd":
        at = int(made.penetration_end[row])
        made = replace(made, penetrations=made.penetrations._replace(pd=spoilt(made.penetrations.pd, (at, 1), value)))
    else:
        metrics = made.metrics | {"correction_m": spoilt(made.metrics["correction_m"], (row,), value)}
        made = replace(made, metrics=metrics)
    found = first_non_finite(made, names)
    assert found is not None
    assert found[0] == row
    assert isinstance(found[1], OutputError)
    text = str(found[1])
    assert f"frame {made.frames[row].index}" in text
    assert ("metric" if field == "metric" else field) in text
    if field in ("corrected", "recorded"):
        assert f"of {names[-1]} " in text
