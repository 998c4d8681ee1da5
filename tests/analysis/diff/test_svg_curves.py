"""Curves as SVG: well-formed, within their frame, with round ticks, and each point where its value is."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from geomphys.analysis.diff.svg_curves import BOTTOM, HEIGHT, LEFT, RIGHT, TOP, WIDTH, _frame_ticks, _ticks, curve


def points(svg: str, kind: str = "polyline") -> np.ndarray:
    (text,) = re.findall(rf'<{kind} class="\w+" points="([^"]*)"', svg)
    return np.array([[float(x) for x in pair.split(",")] for pair in text.split()])


@pytest.mark.parametrize(
    ("largest", "steps"),
    [*((x, False) for x in (1e-9, 0.003, 0.7, 1.0, 17.3, 1e6)), *((x, True) for x in (1.0, 7.0, 1e6))],
)
def test_points_are_in_the_frame_at_the_height_of_their_values(largest: float, steps: bool) -> None:
    frames = np.arange(10, 40, 3)
    values = np.random.default_rng(1).uniform(0, largest, len(frames))
    values[4] = largest
    svg = curve("depth", "m", frames, values, steps=steps)
    ElementTree.fromstring(svg)
    top, ticks = _ticks(float(values.max()), integers=steps)
    found = points(svg)
    if steps:
        assert len(found) == 2 * len(frames) - 1
        found = found[::2]
    assert found[:, 0] == pytest.approx(LEFT + (WIDTH - LEFT - RIGHT) * (frames - 10) / 27, abs=0.06)
    assert found[:, 1] == pytest.approx(TOP + (HEIGHT - TOP - BOTTOM) * (1 - values / top), abs=0.06)
    assert found[:, 1].min() >= TOP - 0.06
    assert top == ticks[-1] >= largest * (1 - 1e-9)
    area = points(svg, "polygon")
    assert area[0, 1] == area[-1, 1] == HEIGHT - BOTTOM


@pytest.mark.parametrize("largest", [1e-9, 0.0123, 0.99, 1.0, 3.0, 7.0, 12345.0])
def test_ticks_are_round_few_and_reach_the_top(largest: float) -> None:
    top, ticks = _ticks(largest, integers=False)
    step = ticks[1] - ticks[0]
    mantissa = step / 10.0 ** math.floor(math.log10(step) + 1e-9)
    assert min(abs(mantissa - round_one) for round_one in (1.0, 2.0, 2.5, 5.0, 10.0)) < 1e-6
    assert 2 <= len(ticks) <= 4
    assert top >= largest * (1 - 1e-9)
    assert top - step < largest
    assert all(float(tick).is_integer() for tick in _ticks(max(largest, 1.0), integers=True)[1])


def test_frames_of_ticks_are_round_and_within() -> None:
    for first, last in ((0, 9), (13, 14), (0, 3652), (995, 1043)):
        ticks = _frame_ticks(first, last)
        assert all(first <= tick <= last for tick in ticks)
        assert len(set(np.diff(ticks))) <= 1
        assert 1 <= len(ticks) <= 7


def test_nothing_at_all_and_a_single_frame_are_drawn_too() -> None:
    ElementTree.fromstring(curve("a < b", "&", np.array([3]), np.array([0.0])))
    assert "a &lt; b" in curve("a < b", "&", np.array([3]), np.array([0.0]))
