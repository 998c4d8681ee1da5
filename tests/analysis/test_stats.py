"""Figures of outputs, against numpy on the whole columns, and against motions whose derivatives are known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import geomphys
from geomphys.analysis.stats import _MotionRates
from geomphys.output.decoders import Poses
from geomphys.output.output_log import OutputFrame, open_output
from tests.made import Results


def test_percentiles_are_those_of_the_columns(landed: Results) -> None:
    statistics = geomphys.statistics_of([landed.out]).outputs[0]
    columns = open_output(landed.out).metrics()
    assert statistics.frames == len(columns["frame"])
    assert statistics.frames_in_contact == np.count_nonzero(columns["contacts"])
    for name in ("recorded_penetration_m", "correction_m"):
        values, found = columns[name][columns[name] > 0], statistics.values[name]
        assert found.count == len(values) > 10
        assert found.max == values.max()
        assert found.p50 == np.median(values)
        assert found.mean == pytest.approx(values.mean())
        for share, figure in ((0.9, found.p90), (0.95, found.p95), (0.99, found.p99)):
            assert figure == np.quantile(values, share, method="inverted_cdf")
    assert statistics.values["residual_penetration_m"].count == statistics.frames
    timing = open_output(landed.out).timing()
    assert set(statistics.stages) == set(timing)
    assert statistics.stages["step"].max == timing["step"].ns.max()


def test_several_outputs_add_up(pressed: Results, landed: Results) -> None:
    both = geomphys.statistics_of([pressed.out, landed.out])
    assert both.all.frames == sum(output.frames for output in both.outputs)
    for name in both.all.values:
        parts = [output.values[name] for output in both.outputs]
        assert both.all.values[name].count == sum(part.count for part in parts)
        assert both.all.values[name].max == max(part.max for part in parts)
    assert json.loads(json.dumps(both.as_dict()))["all"]["frames"] == both.all.frames


def motion(times: np.ndarray, recorded: np.ndarray, corrected: np.ndarray) -> list[dict[str, float]]:
    """What is found frame by frame in the motion of one body along x; one that stands still beside it."""
    gathered, derive = [], _MotionRates()
    for time, r, c in zip(times, recorded, corrected, strict=True):
        poses = [np.array([[x, 0, 0, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 1]], float) for x in (r, c)]
        tf = Poses(("body", "other"), poses[1])
        before = Poses(("recorded/body", "recorded/other"), poses[0])
        gathered.append(derive.add(OutputFrame(0, round(1e9 * time), tf, before)))
    return gathered


def test_speed_and_jerk_of_a_cubic_are_exact_at_uneven_times() -> None:
    times = 5.0 + np.cumsum(np.random.default_rng(2).uniform(0.005, 0.02, 40))
    t = times - times[0]
    found = motion(times, 2.0 * t, 2.0 * t + 7.0 * t**3)
    assert found[0] == {}
    assert [frame["recorded_speed_m_s"] for frame in found[1:]] == pytest.approx([2.0] * 39)
    for frame in found[3:]:
        assert frame["correction_jerk_m_s3"] == pytest.approx(42.0, rel=1e-3)
        assert frame["corrected_jerk_m_s3"] == pytest.approx(42.0, rel=1e-3)
        assert frame["recorded_jerk_m_s3"] == pytest.approx(0.0, abs=0.05)


def test_nothing_is_derived_across_a_gap() -> None:
    times = np.array([0.0, 0.01, 0.02, 0.03, 2.0, 2.01])
    found = motion(times, 3.0 * times, 3.0 * times)
    assert [len(frame) for frame in found] == [0, 3, 3, 6, 0, 3]


def test_what_is_no_output(pressed: Results, tmp_path: Path) -> None:
    with pytest.raises(geomphys.LogError, match="no output"):
        geomphys.statistics_of([pressed.out, pressed.log])
    with pytest.raises(ValueError, match="no output at all"):
        geomphys.statistics_of([])
