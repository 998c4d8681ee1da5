"""``geomphys stats``: percentiles of one or more outputs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .command import command, current_terminal
from .options import INPUT_FILE, json_option
from .progress import progress_bar
from .show_motion import moment_lines, motion_rows
from .terminal import counted, fields, heading, table_in

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from geomphys.analysis.metric_values import Distribution
    from geomphys.analysis.stats import OutputStatistics, Statistics

    from .terminal import Terminal

DEGREES = 57.29577951308232

ROWS = {
    "recorded_penetration_m": ("recorded penetration", "mm", 1e3),
    "residual_penetration_m": ("residual penetration", "mm", 1e3),
    "correction_m": ("correction, translation", "mm", 1e3),
    "correction_rad": ("correction, rotation", "°", DEGREES),
    "amplification": ("amplification", "times", 1.0),
    "shape_change_rad": ("change of shape (rigid)", "°", DEGREES),
    "fingertip_error_in_contact_m": ("fingertip error in contact", "mm", 1e3),
    "fingertip_error_m": ("fingertip error", "mm", 1e3),
    "contact_precision_m": ("contact precision", "mm", 1e3),
    "contact_alignment_rad": ("contact alignment", "°", DEGREES),
    "contacts": ("contacts", "", 1.0),
    "iterations": ("iterations", "", 1.0),
    "recorded_speed_m_s": ("speed, recorded", "m/s", 1.0),
    "corrected_speed_m_s": ("speed, corrected", "m/s", 1.0),
    "correction_speed_m_s": ("speed, correction", "m/s", 1.0),
    "recorded_jerk_m_s3": ("jerk, recorded", "m/s³", 1.0),
    "corrected_jerk_m_s3": ("jerk, corrected", "m/s³", 1.0),
    "correction_jerk_m_s3": ("jerk, correction", "m/s³", 1.0),
}
"""Series -> label, display unit, factor from the SI unit."""


@command(
    "stats",
    examples="""
    geomphys stats corrected.mcap
    geomphys stats corrected/*.mcap
    geomphys stats corrected/*.mcap --json > figures.json
    """,
)
@click.argument("outputs", type=INPUT_FILE, nargs=-1, required=True, metavar="OUT...")
@json_option
def stats(outputs: tuple[Path, ...], as_json: bool) -> None:
    """Show percentiles of each OUT, and of all together.

    Penetration, correction, contacts and times of the stages are over the frames; speeds and jerks are those of the
    fastest driven body in each frame, as recorded, as corrected, and of the correction between them.

    Amplification is the correction over the recorded penetration. Fingertip error is how far fingertips are from where
    they were recorded, contact precision and alignment how far contact points lie from the recorded ones and by how
    much their normals differ. Iterations are those of the solver that removes overlaps.
    """
    import geomphys

    terminal = current_terminal()
    with progress_bar(terminal, counted(len(outputs), "result")) as bar:
        statistics = geomphys.statistics_of(outputs, progress=bar)
    if as_json:
        terminal.json(statistics.as_dict())
    else:
        _show(terminal, statistics)
    for output in statistics.outputs:
        if not output.complete:
            terminal.warning(f"{output.name}: is the finished part of a replay that ended early")


def _show(terminal: Terminal, statistics: Statistics) -> None:
    """Print each output, and the total of several."""
    several = len(statistics.outputs) > 1
    for output in (*statistics.outputs, *([statistics.all] if several else [])):
        name = f"all {len(statistics.outputs)}" if output is statistics.all else Path(output.name).name
        terminal.result(heading(name), fields(_facts(output)), _table(output, terminal.width))
        if output.worst:
            terminal.result(fields([("Look at", moment_lines(output.worst, output.name))]))
        terminal.result("")


def _facts(output: OutputStatistics) -> list[tuple[str, list[str | Text]]]:
    """Return the counts."""
    share = f"{output.frames_penetrating:,} inside something as recorded, {output.frames_in_contact:,} in contact"
    rows: list[tuple[str, list[str | Text]]] = [("Frames", [f"{output.frames:,} in {output.duration_s:,.2f} s", share])]
    notes: list[str | Text] = [
        counted(count, "frame") + f" {flag.replace('_', ' ')}" for flag, count in output.flags.items() if flag != "held"
    ]
    if output.held_frames:
        notes.insert(0, counted(output.held_frames, "frame") + " held")
    if output.frames_with_residual:
        notes.insert(0, counted(output.frames_with_residual, "frame") + " not free")
    if output.impacts:
        notes.append(counted(output.impacts, "impact"))
    if output.fallbacks:
        notes.append(counted(output.fallbacks, "fallback"))
    if output.motion is not None:
        rows += [(label, [text]) for label, text in motion_rows(output.motion)]
    return [*rows, ("Notes", notes)] if notes else rows


def _table(output: OutputStatistics, width: int) -> Table:
    """Return one row per series with values."""
    rows = [
        [label, *_cells(output.values[key], factor), unit]
        for key, (label, unit, factor) in ROWS.items()
        if output.values[key].max > 0
    ]
    rows += [[name, *_cells(times, 1e-3), "µs"] for name, times in output.stages.items()]
    columns = ["", "frames", "mean", "median", "p90", "p95", "p99", "largest", "unit"]
    return table_in(width, columns, rows, droppable=("frames", "p90", "p95", "mean"), left_aligned="unit")


def _cells(values: Distribution, factor: float) -> list[str]:
    """Return count and percentiles."""
    figures = (values.mean, values.p50, values.p90, values.p95, values.p99, values.max)
    return [f"{values.count:,}", *(_short(factor * figure) for figure in figures)]


def _short(value: float) -> str:
    """Return a number in three digits or, above a thousand, without decimals."""
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"
