"""Prints the summary of a replay: recorded overlap, corrected motion, contacts, times, warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .show_log import finding_rows
from .show_motion import moment_lines
from .terminal import counted, fields, heading, printable, size_text

if TYPE_CHECKING:
    from rich.text import Text

    from geomphys.output.summary import MotionSummary, Summary
    from geomphys.results import Grasp

    from .terminal import Terminal

FREE_MM = 0.01
"""An overlap up to this counts as none."""

WARNINGS_SHOWN = 10

DEGREES = 57.29577951308232

FLAG_TEXTS = {
    "before_first": "before the first sample of some stream",
    "clamped": "with an angle clamped to its limit",
    "outside_limits": "with a recorded angle outside its limits, kept",
    "not_converged": "where no free pose was found within the bounds",
    "impact_bound": "where the simulated loop ended at its bound",
    "quarantined": "where a body was put back to its last good state",
    "blocked": "held back by something in between",
    "started_inside": "began inside something",
    "catching_up": "caught up with what was missed in a gap or a jump",
    "sweep_bound": "where contact forces ended at their bound of sweeps",
    "table_full": "where contacts found their table full and were left out",
}


def show_summary(terminal: Terminal, summary: Summary) -> None:
    """Print the summary as a table without lines: what it is about on the left, the figures on the right."""
    title = heading(Path(summary.log).name, f" in {Path(summary.scene).name}")
    terminal.result(title, fields(_rows(summary)))


def _rows(summary: Summary) -> Iterator[tuple[str, Sequence[str | Text]]]:
    """Yield label and lines of each row."""
    yield "Frames", [_frames(summary)]
    if summary.method == "paper":
        yield "Method", ["as published: overlap may be left, and what happens between two frames is not seen"]
    yield "Recorded", _recorded(summary)
    yield "Corrected", _corrected(summary)
    contacts = f"{summary.contacts:,} in {counted(summary.frames_in_contact, 'frame')}"
    if summary.impacts:
        contacts += f", {counted(summary.impacts, 'impact')}"
    yield "Contacts", [contacts, *_quality(summary.quality)]
    if summary.grasps:
        yield "Grasped", [_grasp(grasp) for grasp in summary.grasps]
    notes = [
        f"{counted(count, 'frame')} {FLAG_TEXTS[flag]}" for flag, count in summary.flags.items() if flag in FLAG_TEXTS
    ]
    if summary.held_frames:
        notes.insert(0, f"{counted(summary.held_frames, 'frame')} held: a good sample was missing")
    if summary.quality.shape_change_frames:
        yielded = counted(summary.quality.shape_change_frames, "frame")
        degrees = DEGREES * summary.quality.shape_change_max_rad
        notes.append(
            f"{yielded} in which a body in rigid mode yielded in shape or orientation too, by up to {degrees:.3g}°"
        )
    if summary.fallbacks:
        notes.append(f"{counted(summary.fallbacks, 'time')} the last free state was the way out")
    if notes:
        yield "Notes", notes
    yield from finding_rows(summary.findings, False)
    if summary.worst:
        named = (path for path in (summary.out, summary.rrd) if path and path != "-")
        yield "Look at", moment_lines(summary.worst, next(named, None))
    if "step" in summary.timing:
        yield "Time", list(_times(summary))
    if summary.out or summary.rrd:
        yield "Written", [_written(path) for path in (summary.out, summary.rrd) if path]
    frames = [printable(m.text) for m in summary.information if m.text not in summary.findings.notes]
    if frames:
        yield "Space", frames
    if summary.warnings:
        yield "Warnings", _warnings(summary)


def _grasp(grasp: Grasp) -> str:
    """Return what became of a simulated object, and how firmly it was gripped."""
    if grasp.outcome == "touched":
        return f"{grasp.body}: touched for {grasp.touched_s:.2f} s, not held"
    text = f"{grasp.body}: held for {grasp.held_s:.2f} s with {grasp.grip_force_n:.3g} N"
    if grasp.lifted_m > 0.01:
        text += f", lifted by {grasp.lifted_m * 1e3:.0f} mm"
    if grasp.margin < float("inf"):
        text += f", friction {grasp.margin:.3g} times what was needed at least"
    return text + (f", dropped {counted(grasp.dropped, 'time')}" if grasp.dropped else "")


def _frames(summary: Summary) -> str:
    """Return the frames, how long they last, and their rate."""
    text = f"{summary.frames:,} in {summary.duration_s:.2f} s"
    if summary.duration_s > 0 and summary.frames > 1:
        text += f" ({(summary.frames - 1) / summary.duration_s:.1f} Hz)"
    return text


def _recorded(summary: Summary) -> list[str]:
    """Describe the recorded overlaps."""
    if not summary.frames_penetrating:
        return ["never inside anything"]
    share = 100.0 * summary.frames_penetrating / summary.frames
    deepest = f"deepest {_mm(summary.recorded_penetration_max_m)}"
    if summary.deepest is not None:
        where = summary.deepest
        deepest += f": {where.body_a} in {where.body_b}, frame {where.frame:,}"
    return [
        f"inside something in {counted(summary.frames_penetrating, 'frame')} ({share:.0f} %), "
        f"median {_mm(summary.recorded_penetration_median_m)}",
        deepest,
    ]


def _corrected(summary: Summary) -> list[str | Text]:
    """Describe the residual overlap and the corrections."""
    from rich.text import Text

    if 1000.0 * summary.residual_penetration_max_m <= FREE_MM:
        verdict = Text("free in every frame", style="green")
    else:
        verdict = Text(f"{_mm(summary.residual_penetration_max_m)} left", style="bold red")
        verdict.append(f" at worst, frame {summary.residual_penetration_frame:,}", style="not bold default")
        verdict.append(f"; {counted(summary.frames_with_residual, 'frame')} not free", style="not bold default")
    if summary.correction_max_m == 0.0 and summary.correction_max_rad == 0.0:
        return [verdict, "nothing was moved"]
    degrees = DEGREES * summary.correction_max_rad
    rotation = f", turned by up to {degrees:.3g}°" if degrees >= 0.001 else ""
    return [verdict, f"moved by up to {_mm(summary.correction_max_m)}{rotation}"]


def _quality(quality: MotionSummary) -> Iterator[str]:
    """Describe what became of recorded contacts of fingertips, and how corrections compare to depths."""
    if quality.contacts_recorded:
        share = 100.0 * quality.contacts_kept / quality.contacts_recorded
        text = f"{share:.0f} % of {quality.contacts_recorded:,} recorded contacts of fingertips kept"
        if quality.grasps_recorded:
            text += f", {quality.grasps_kept:,} of {counted(quality.grasps_recorded, 'grasp')}"
        yield f"{text}; fingertips {_mm(quality.fingertip_error_mean_m)} off on average"
    if quality.amplification_median > 0.0:
        yield (
            f"links moved {quality.amplification_median:.3g} times the recorded depth in the median, "
            f"{quality.amplification_p95:.3g} times at the 95th percentile"
        )


def _times(summary: Summary) -> Iterator[str]:
    """Describe frame times and the speed relative to real time."""
    step = summary.timing["step"]
    yield (
        f"{_duration(step.median_ns)} a frame, {_duration(step.mean_ns)} on average, "
        f"{_duration(step.p99_ns)} at the 99th percentile, at most {_duration(step.max_ns)}"
    )
    if summary.elapsed_s > 0:
        speed = f"{summary.frames / summary.elapsed_s:,.0f} frames/s with reading and writing"
        if summary.duration_s > 0:
            speed += f", {summary.duration_s / summary.elapsed_s:,.1f} times real time"
        yield speed


def _written(path: str) -> str:
    """Return a file and its size."""
    if path == "-":
        return "to standard output"
    from geomphys.storage.remote_files import as_path

    return f"{path} ({size_text(as_path(path).stat().st_size)})"


def _warnings(summary: Summary) -> list[str | Text]:
    """Return the warnings, the first of them in full."""
    from rich.text import Text

    lines: list[str | Text] = []
    for message in summary.warnings[:WARNINGS_SHOWN]:
        line = Text(printable(message.text), style="yellow")
        if message.count > 1:
            line.append(f" ({message.count:,} times, first in frame {message.first_frame:,})", style="default")
        lines.append(line)
    hidden = len(summary.warnings) - WARNINGS_SHOWN + summary.messages_dropped
    if hidden > 0:
        lines.append(f"and {hidden:,} more, in the channel /log and with --json")
    return lines


def _mm(metres: float) -> str:
    """Return a length in millimetres, to three digits."""
    return f"{1000.0 * metres:.3g} mm" if metres < 1.0 else f"{metres:.3g} m"


def _duration(nanoseconds: float) -> str:
    """Return a time in the unit that fits it."""
    for limit, unit in ((1e3, "ns"), (1e6, "µs"), (1e9, "ms")):
        if nanoseconds < limit:
            return f"{nanoseconds / limit * 1e3:.3g} {unit}"
    return f"{nanoseconds / 1e9:.3g} s"
