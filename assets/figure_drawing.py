"""Pictures of the figure page: before and after, drawn without a graphics driver, and frame-time curves."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from figure_scenes import Experiment, Shot

from geomphys.analysis.diff.rasterizer import Surface, View, png, render
from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.output import colours, frame_columns
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

SIZE = (480, 360)
SMOOTH = 3
"""Times as many pixels are drawn in each direction, and averaged."""
GAP = 6
"""Pixels between the two halves of a picture."""
INSIDE = (0.86, 0.16, 0.39)
"""Colour of recorded bodies that were moved: they were in something, or hang on what was."""


def before_and_after(world: World, result: FrameResult, later: FrameResult | None, shot: Shot) -> bytes:
    """PNG of a frame as it was recorded, on the left, and corrected, on the right; or of two moments, corrected."""
    target = result.corrected[world.body_names.index(shot.target), :3]
    if later is None:
        halves = [_half(world, result, shot, target, corrected=corrected) for corrected in (False, True)]
    else:
        halves = [_half(world, moment, shot, target, corrected=True) for moment in (result, later)]
    gap = np.full((SIZE[1], GAP, 3), 255, np.uint8)
    return png(np.concatenate([halves[0], gap, halves[1]], axis=1))


def _half(world: World, result: FrameResult, shot: Shot, target: np.ndarray, *, corrected: bool) -> np.ndarray:
    recorded = np.where((world.scene.bodies.role == DRIVEN)[:, None], result.recorded, result.corrected)
    poses = result.corrected if corrected else recorded
    moved = frame_columns.is_corrected(result.recorded[None], result.corrected[None])[0]
    touching = frame_columns.in_contact(ResultColumns.of(result), len(world.body_names))[0]
    palette = colours.colours_of_trees(world.facts)
    solid, glass = [], []
    for body, name in enumerate(world.body_names):
        vertices, faces = world.triangles[body]
        if len(faces) == 0 or name in shot.hidden:
            continue
        corners = vertices @ rotation_from_quaternion(poses[body, 3:]).T + poses[body, :3]
        colour = _unit(palette[world.tree_names[world.scene.bodies.tree[body]]])
        if world.scene.bodies.role[body] == DRIVEN:
            if corrected:
                colour = (
                    _unit(colours.IN_CONTACT) if touching[body] else _unit(colours.CORRECTED) if moved[body] else colour
                )
            elif moved[body]:
                colour = INSIDE
        (glass if name in shot.glass else solid).append(Surface(corners[faces], colour))
    a, e = np.radians([shot.azimuth, shot.elevation])
    direction = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    width, height = (SMOOTH * side for side in SIZE)
    view = View(target, direction, shot.radius, width=width, height=height, near=6 * shot.radius)
    pixels = render(view, solid, glass, opacity=0.5).astype(float)
    return np.rint(pixels.reshape(SIZE[1], SMOOTH, SIZE[0], SMOOTH, 3).mean(axis=(1, 3))).astype(np.uint8)


def _unit(colour: colours.Colour) -> tuple[float, float, float]:
    red, green, blue, _ = colour
    return (red / 255, green / 255, blue / 255)


def draw_times(experiment: Experiment, first: int, times_us: np.ndarray, out: Path) -> None:
    """Curve of the frame times (n,) [µs], with what happens when."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    style = {"font.size": 8.0, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "geomphys"}
    with mpl.rc_context(style):
        figure = Figure(figsize=(9.66, 2.3), dpi=100, layout="constrained")
        axis = figure.subplots()
        frames = first + np.arange(len(times_us))
        top = 1.25 * float(np.percentile(times_us, 99.7))
        for number, (begin, end, what) in enumerate(experiment.marks):
            axis.axvspan(begin, end, color="#dfe7f0" if number % 2 == 0 else "#eef2f7", linewidth=0)
            axis.annotate(
                what,
                ((begin + end) / 2, 1.0),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="bottom",
                fontsize=7.5,
            )
        axis.plot(frames, np.minimum(times_us, top), color="#23527c", linewidth=0.7)
        beyond = times_us > top
        if beyond.any():
            label = f"beyond: up to {times_us.max():,.0f} µs"
            axis.plot(frames[beyond], np.full(int(beyond.sum()), top), "^", color="#b03030", markersize=4, label=label)
            axis.legend(loc="upper left", frameon=False, fontsize=7.5)
        axis.set_xlim(frames[0], frames[-1])
        axis.set_ylim(0.0, 1.04 * top)
        axis.set_xlabel("frame")
        axis.set_ylabel("frame time [µs]")
        axis.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
        figure.savefig(out, format="png", metadata={"Software": None}, facecolor="white")


def draw_curves(curves: Mapping[str, Mapping[str, np.ndarray]], seconds: np.ndarray, out: Path) -> None:
    """Curves over time (n,) [s] beside each other: for each label of a y axis, values (n,) by name; NaN where there are none."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    style = {"font.size": 8.0, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "geomphys"}
    with mpl.rc_context(style):
        figure = Figure(figsize=(9.66, 2.3), dpi=100, layout="constrained")
        for axis, (label, named) in zip(figure.subplots(1, len(curves)), curves.items(), strict=True):
            for (name, values), colour in zip(named.items(), ("#23527c", "#c07020"), strict=True):
                axis.plot(seconds, values, color=colour, linewidth=1.0, label=name)
            axis.set_xlabel("time [s]")
            axis.set_ylabel(label)
            axis.set_xlim(seconds[0], seconds[-1])
            axis.legend(frameon=False, fontsize=7.5)
        figure.savefig(out, format="png", metadata={"Software": None}, facecolor="white")


def wrapped(text: str) -> list[str]:
    """Lines of at most 120 characters."""
    return textwrap.wrap(text, 120, break_long_words=False, break_on_hyphens=False)
