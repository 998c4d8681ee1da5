"""Prints a comparison of two outputs: verdict, and the largest differences of each channel."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from geomphys.analysis.diff.quantities import angle_text, length_text, measure_table

from .show_motion import moment_lines
from .terminal import counted, fields, heading, printable, table_in

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from geomphys.analysis.diff.channels import ChannelDifference
    from geomphys.analysis.diff.difference import OutputDifference
    from geomphys.analysis.diff.measures import Measure

    from .terminal import Terminal

PARTS_SHOWN = 8
"""Parts of a channel that are shown, the most different ones first; all of them with ``-v``."""


def show_difference(terminal: Terminal, difference: OutputDifference) -> None:
    """Print the verdict, the parameters that differ, and a table per channel with differences."""
    from rich.text import Text

    frames = difference.frames
    verdict = Text("the same", style="green") if difference.equal else Text("different", style="bold red")
    match_frames = f"{counted(frames.compared, 'frame')} compared"
    if frames.only_a or frames.only_b:
        match_frames += f", {frames.only_a:,} only in a, {frames.only_b:,} only in b"
    rows: list[tuple[str, list[str | Text]]] = [("Result", [verdict]), ("Frames", [match_frames])]
    if frames.offset_s:
        first = ("b", "a") if frames.offset_s > 0 else ("a", "b")
        rows.append(
            ("Times", [f"{first[0]} begins {abs(frames.offset_s):,.9g} s after {first[1]}; frames are matched by time"])
        )
    tolerance = difference.tolerance
    if not tolerance.exact:
        rows.append(("Tolerance", [f"{length_text(tolerance.m)}, {angle_text(tolerance.rad)}"]))
    same = [name for name, channel in difference.channels.items() if channel.equal and _has_no_differences(channel)]
    if same:
        rows.append(("Equal", ["  ".join(same)]))
    rows += [
        (printable(name), [f"{a if a is not None else 'none'}  ->  {b if b is not None else 'none'}"])
        for name, (a, b) in difference.parameters.items()
    ]
    if difference.scene:
        rows.append(("Scenes", list(difference.scene)))
    terminal.result(heading(Path(difference.a).name, f" against {Path(difference.b).name}"), fields(rows))
    measures = [] if difference.equal else [list(row) for row in measure_table(difference)]
    if measures:
        terminal.result("", heading("motion", "  of each"), table_in(terminal.width, ["", "a", "b"], measures))
    limit = None if terminal.verbose else PARTS_SHOWN
    for name, channel in difference.channels.items():
        if frames.compared and not (channel.equal and _has_no_differences(channel)):
            terminal.result("", heading(name, _first_difference(channel)), _table(channel, limit, terminal.width))
    if not difference.equal:
        for path, moments in zip((difference.a, difference.b), difference.worst, strict=True):
            if moments:
                terminal.result("", fields([(f"Look at {Path(path).name}", moment_lines(moments, path))]))


def _has_no_differences(channel: ChannelDifference) -> bool:
    """Return whether an equal channel has no difference within the tolerance either."""
    measures = [channel.overall_m, channel.overall_rad, *channel.others.values()]
    return not channel.sets and not any(m is not None and m.max for m in measures)


def _first_difference(channel: ChannelDifference) -> str:
    """Return the text after a channel's name."""
    if channel.equal:
        return "  within the tolerance"
    return "" if channel.first_frame is None else f"  from frame {channel.first_frame:,} on"


def _table(channel: ChannelDifference, limit: int | None, width: int) -> Table:
    """Return one row per part that differs."""
    headers = _headers(channel)
    lines: dict[tuple[str, ...], list[str]] = {}
    for part in channel.largest_differences():
        cells = dict(_cells(channel, part))
        lines.setdefault(tuple(cells.get(header, "") for header in headers), []).append(part)
    rows = [[_part_names(names, show_all=limit is None), *texts] for texts, names in list(lines.items())[:limit]]
    for side, parts in (("a", channel.only_a), ("b", channel.only_b)):
        if parts:
            rows.append([f"only in {side}: {printable(', '.join(parts))}"])
    if limit is not None and len(lines) > limit:
        hidden = sum(len(names) for names in list(lines.values())[limit:])
        rows.append([f"and {hidden} more, with -v"])
    return table_in(width, [channel.kind, *headers], rows, droppable=("frames", "worst frame", "RMS turn", "RMS"))


def _part_names(names: list[str], *, show_all: bool) -> str:
    """Return the names of parts that share a line."""
    if show_all or len(names) <= 2:
        return printable(", ".join(names))
    return printable(f"{names[0]} and {len(names) - 1} that move with it")


def _headers(channel: ChannelDifference) -> list[str]:
    """Return the columns that are not empty."""
    found = dict.fromkeys(header for part in channel.largest_differences() for header, _ in _cells(channel, part))
    order = ["largest", "RMS", "turned", "RMS turn", "gained", "lost", "first frame", "worst frame", "frames"]
    return [header for header in order if header in found]


def _cells(channel: ChannelDifference, part: str) -> Iterator[tuple[str, str]]:
    """Yield the columns of a part."""
    metres, radians, others = (group.get(part) for group in (channel.metres, channel.radians, channel.others))
    if metres is not None and metres.max:
        yield from _pair("largest", "RMS", length_text(metres.max), length_text(metres.rms))
    if radians is not None and radians.max:
        yield from _pair("turned", "RMS turn", angle_text(radians.max), angle_text(radians.rms))
    if others is not None and others.max and channel.kind == "fields":
        yield from _pair("largest", "RMS", f"{others.max:.4g}", f"{others.rms:.3g}")
    sets = channel.sets.get(part)
    if sets is not None:
        yield from _pair("gained", "lost", f"{sets.gained:,}", f"{sets.lost:,}")
    measures: list[Measure] = [m for m in (metres, radians, others) if m is not None and m.max]
    first_frames = [m.first_frame for m in measures if m.first_frame is not None]
    if sets is not None and sets.first_frame is not None:
        first_frames.append(sets.first_frame)
    if first_frames:
        yield "first frame", f"{min(first_frames):,}"
    if measures and measures[0].worst_frame is not None:
        yield "worst frame", f"{measures[0].worst_frame:,}"
    if measures:
        yield "frames", f"{max(m.frames for m in measures):,}"


def _pair(one: str, other: str, first: str, second: str) -> Iterator[tuple[str, str]]:
    """Yield two columns."""
    yield one, first
    yield other, second
