"""What stats and plot tell, against the numbers in the file as anyone reads them: plain mcap, protobuf and numpy."""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import geomphys

SVG = "{http://www.w3.org/2000/svg}"


def messages(path: Path, topic: str) -> list[Any]:
    """The decoded messages of a topic."""
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=[topic])]


def column(path: Path, name: str) -> np.ndarray:
    """A figure of each frame."""
    return np.array([getattr(message, name) for message in messages(path, "/metrics")], dtype=float)


def agrees(found: Any, values: np.ndarray) -> None:
    """Compare a distribution with numpy's on the whole column."""
    assert found.count == len(values)
    assert found.mean == pytest.approx(values.mean(), rel=1e-12)
    assert (found.p50, found.max) == (np.median(values), values.max())
    shares = [0.9, 0.95, 0.99]
    assert [found.p90, found.p95, found.p99] == np.percentile(
        values, [100 * share for share in shares], method="inverted_cdf"
    ).tolist()


@pytest.mark.parametrize("which", ["pressed", "landed"])
def test_statistics_are_those_of_the_file(which: str, request: pytest.FixtureRequest) -> None:
    out = request.getfixturevalue(which).out
    found = geomphys.statistics_of([out]).outputs[0]
    for name in ("recorded_penetration_m", "correction_m", "correction_rad", "contacts"):
        values = column(out, name)
        if values.any():
            agrees(found.values[name], values[values > 0])
        else:
            assert found.values[name].count == 0
    for name in ("residual_penetration_m", "iterations"):
        agrees(found.values[name], column(out, name))
    assert found.frames_in_contact == np.count_nonzero(column(out, "contacts"))
    assert found.impacts == column(out, "impacts").sum()
    assert found.fallbacks == column(out, "fallbacks").sum()
    stages = defaultdict(list)
    for message in messages(out, "/timing"):
        for stage in message.stages:
            stages[stage.name].append(stage.ns)
    assert set(found.stages) == set(stages)
    assert len(stages) > 5
    for name, times in stages.items():
        agrees(found.stages[name], np.array(times, dtype=float))


def polylines(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    """The open lines of an SVG: their style, and their corners (n, 2)."""
    for element in ElementTree.parse(path).iter(f"{SVG}path"):
        style, drawn = element.get("style", ""), element.get("d", "")
        if "fill: none" in style and "Q" not in drawn:
            yield style, np.array(re.findall(r"[ML] (\S+) (\S+)", drawn), dtype=float)


def same_shape(drawn: np.ndarray, x: np.ndarray, y: np.ndarray) -> bool:
    """Whether a line is the curve, but for place and size: each coordinate is that of the curve times a number."""
    if len(drawn) < 3 or np.ptp(drawn[:, 1]) == 0.0:
        return False
    for part, values, sign in ((drawn[:, 0], x, 1.0), (drawn[:, 1], y, -1.0)):
        placed = np.interp(drawn[:, 0], (drawn[0, 0], drawn[-1, 0]), (x[0], x[-1]))
        expected = np.interp(placed, x, values)
        slope, offset = np.polyfit(expected, part, 1)
        if slope * sign <= 0.0 or not np.allclose(slope * expected + offset, part, atol=0.02):
            return False
    return True


@pytest.mark.parametrize("which", ["pressed", "landed"])
def test_a_picture_draws_the_curves_of_the_file(which: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    out = request.getfixturevalue(which).out
    frames = column(out, "frame")
    depth = [
        max((math.dist((0, 0, 0), (pair.pd.x, pair.pd.y, pair.pd.z)) for pair in message.pairs), default=0.0)
        for message in messages(out, "/penetration")
    ]
    curves = {
        "penetration": [column(out, "recorded_penetration_m"), np.array(depth)],
        "correction": [column(out, "correction_m")],
    }
    for panel, expected in curves.items():
        picture = tmp_path / f"{panel}.svg"
        geomphys.plot_output(out, picture, panels=[panel])
        lines = [line for _, line in polylines(picture)]
        for values in expected:
            assert values.max() > 0.0
            assert not any(same_shape(line, frames, np.roll(values, 5)) for line in lines)
            found = [k for k, line in enumerate(lines) if same_shape(line, frames, values)]
            assert found, panel
            lines.pop(found[0])  # a curve like another is drawn too
