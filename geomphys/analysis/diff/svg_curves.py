"""Draws curves over frames as inline SVG in the colours of the surrounding page, wide enough for a telephone."""

from __future__ import annotations

import math
from html import escape

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WIDTH, HEIGHT = 460, 170
LEFT, RIGHT, TOP, BOTTOM = 52, 12, 28, 26


def curve(title: str, unit: str, frames: Ints, values: Floats, *, steps: bool = False) -> str:
    """An SVG of values >= 0 over frames; `steps` for counts. The axis begins at 0 and ends at a round number."""
    top, ticks = _ticks(float(values.max(initial=0.0)), integers=steps)
    first, last = int(frames[0]), max(int(frames[-1]), int(frames[0]) + 1)
    plot_width, plot_height = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM

    def x(frame: float) -> float:
        return LEFT + plot_width * (frame - first) / (last - first)

    def y(value: float) -> float:
        return TOP + plot_height * (1.0 - value / top)

    parts = [
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title, quote=True)}">',
        f'<text class="title" x="{LEFT}" y="15">{escape(title)} <tspan class="unit">{escape(unit)}</tspan></text>',
    ]
    for tick in ticks:
        parts.append(f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y(tick):.1f}" y2="{y(tick):.1f}"/>')
        parts.append(f'<text class="tick" x="{LEFT - 6}" y="{y(tick) + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for frame in _frame_ticks(first, last):
        anchor = "end" if x(frame) > WIDTH - RIGHT - 20 else "middle"
        parts.append(f'<text class="tick" x="{x(frame):.1f}" y="{HEIGHT - 6}" text-anchor="{anchor}">{frame:,}</text>')
    points = _stairs(frames, values) if steps else list(zip(frames.tolist(), values.tolist(), strict=True))
    line = " ".join(f"{x(frame):.1f},{y(value):.1f}" for frame, value in points)
    area = f"{x(points[0][0]):.1f},{y(0):.1f} {line} {x(points[-1][0]):.1f},{y(0):.1f}"
    parts += [f'<polygon class="area" points="{area}"/>', f'<polyline class="line" points="{line}"/>', "</svg>"]
    return "".join(parts)


def _stairs(frames: Ints, values: Floats) -> list[tuple[float, float]]:
    """Points of a step curve that holds each value until the next frame."""
    points: list[tuple[float, float]] = []
    for k, (frame, value) in enumerate(zip(frames.tolist(), values.tolist(), strict=True)):
        points.append((frame, value))
        if k + 1 < len(frames):
            points.append((int(frames[k + 1]), value))
    return points


def _ticks(maximum: float, *, integers: bool) -> tuple[float, list[float]]:
    """The top of an axis and its three or four ticks at round numbers."""
    if maximum <= 0.0:
        return 1.0, [0.0]
    step = _round_step(maximum / 3.0)
    if integers:
        step = max(1.0, math.ceil(step))
    count = math.ceil(maximum / step - 1e-9)
    return count * step, [k * step for k in range(count + 1)]


def _frame_ticks(first: int, last: int) -> list[int]:
    """About five round frame numbers."""
    step = max(1, round(_round_step((last - first) / 5.0)))
    return list(range(-(-first // step) * step, last + 1, step))


def _round_step(raw_step: float) -> float:
    """The smallest of 1, 2, 2.5, 5 times a power of ten that is not below."""
    power = 10.0 ** math.floor(math.log10(raw_step))
    return next(factor * power for factor in (1.0, 2.0, 2.5, 5.0, 10.0) if factor * power >= raw_step * (1.0 - 1e-9))
