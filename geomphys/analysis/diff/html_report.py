"""Writes a comparison as a self-contained HTML page, without scripts or network access."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path

import numpy as np

from geomphys.analysis.diff.channels import ChannelDifference
from geomphys.analysis.diff.difference import OutputDifference
from geomphys.analysis.diff.measures import Measure
from geomphys.analysis.diff.peak_pictures import Picture, first_poses, pictures_of
from geomphys.analysis.diff.quantities import angle_text, length_text, measure_table
from geomphys.analysis.diff.svg_curves import curve
from geomphys.errors import InputError
from geomphys.output.output_log import open_output
from geomphys.output.output_world import world_of_output
from geomphys.output.worst_moments import command_text, figure_text
from geomphys.scene.source_files import tracked_sources
from geomphys.storage.output_file import check_target, write_file
from geomphys.storage.remote_files import AnyPath, as_path
from geomphys.version import __version__

_STYLE = """
:root { color-scheme: light dark; --ink: #1d2126; --soft: #5d6570; --line: #d9dce0; --paper: #ffffff; --panel: #f6f7f8;
  --a: #2f6db0; --b: #d9761b; --same: #1d7a46; --other: #b3261e; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e8eb; --soft: #a0a8b2; --line: #3a4048; --paper: #16191d;
  --panel: #1f2328; --a: #7fb2e8; --b: #f2a45c; --same: #6cc894; --other: #f28b82; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 1000px; padding: 28px 24px 60px; color: var(--ink); background: var(--paper);
  font: 15px/1.5 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 22px; margin: 0 0 4px; } h2 { font-size: 17px; margin: 36px 0 8px; }
.verdict { font-weight: 600; } .same { color: var(--same); } .other { color: var(--other); } .soft { color: var(--soft); }
.curves { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(420px, 100%), 1fr)); gap: 0 20px; }
h1, h2, p, li, figcaption, code { overflow-wrap: anywhere; } ul { padding-left: 20px; margin: 6px 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 14px; }
th { text-align: left; font-weight: 600; color: var(--soft); border-bottom: 1px solid var(--line); }
th, td { padding: 4px 14px 4px 0; vertical-align: top; } td { border-bottom: 1px solid var(--line); }
th:last-child, td:last-child { padding-right: 0; }
td.n, th.n { text-align: right; white-space: nowrap; } td.long { overflow-wrap: anywhere; }
svg { width: 100%; height: auto; display: block; margin: 6px 0 14px; }
svg .title { font-size: 13px; font-weight: 600; fill: var(--ink); } svg .unit { font-weight: 400; fill: var(--soft); }
svg .tick { font-size: 11px; fill: var(--soft); } svg .grid { stroke: var(--line); }
svg .line { fill: none; stroke: var(--a); stroke-width: 1.4; } svg .area { fill: var(--a); opacity: 0.16; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(380px, 100%), 1fr)); gap: 16px; }
figure { margin: 0; background: var(--panel); border-radius: 8px; overflow: hidden; }
figure img { width: 100%; display: block; } figcaption { padding: 8px 12px 10px; font-size: 13px; }
.key { display: inline-block; width: 11px; height: 11px; border-radius: 2px; margin: 0 5px 0 14px; }
details > summary { cursor: pointer; color: var(--soft); margin: 6px 0; }
@media (max-width: 760px) { body { padding: 16px 14px 40px; } svg .tick { font-size: 14px; } svg .title { font-size: 16px; }
  thead { display: none; } table, tbody, tr, td { display: block; } tr { padding: 8px 0; border-bottom: 1px solid var(--line); }
  td, td.n { border: 0; padding: 1px 0; display: flex; justify-content: space-between; gap: 16px; white-space: normal; }
  td:empty { display: none; } td > * { text-align: right; } td::before { content: attr(data-title); color: var(--soft);
  flex: none; max-width: 60%; } td:first-child { font-weight: 600; } td:first-child::before { content: none; } }
"""

_SHOWN = 12
"""Parts of a channel shown at once; the others are in a collapsed table."""


def write_page(difference: OutputDifference, out: AnyPath, *, scene: AnyPath | None = None) -> None:
    """Write a comparison as an HTML page with curves, pictures of the worst frames and all figures.

    Parameters
    ----------
    difference : OutputDifference
        From `compare_outputs`.
    out : Path
        The page; replaced if it is there.
    scene : Path, optional
        The scene file for the pictures; None: what is attached to a. Where its meshes are gone the page says so.

    Raises
    ------
    InputError
        `scene` was given and is wrong, or an output has gone.
    OutputError
        The page cannot be written.
    """
    outputs = (as_path(difference.a), as_path(difference.b))
    check_target(out, force=True, inputs=outputs)
    with tracked_sources() as sources:
        text = "".join(_page(difference, scene))
    write_file(out, text.encode(), force=True, inputs=(*outputs, *sources.contents))


def _page(difference: OutputDifference, scene: AnyPath | None) -> Iterator[str]:
    a, b = Path(difference.a).name, Path(difference.b).name
    yield '<!doctype html><html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
    yield f"<title>{escape(a)} against {escape(b)}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{escape(a)} <span class=soft>against</span> {escape(b)}</h1>"
    yield from _verdict(difference)
    yield from _only_in_one(difference)
    yield from _scenes(difference)
    if not difference.equal and difference.frames.compared:
        yield from _curves(difference)
        yield from _pictures(difference, scene)
    yield from _inputs(difference)
    if rows := [[escape(text) for text in row] for row in measure_table(difference)]:
        yield "<h2>The motions</h2>" + _table(["", "a", "b"], rows, 1)
    for channel in difference.channels.values():
        yield from _channel(channel)
    yield from _worst(difference)
    yield f'<p class="soft">geomphys {escape(__version__)}. Frames are counted as in {escape(a)}.</p>'
    yield "</body></html>\n"


def _verdict(difference: OutputDifference) -> Iterator[str]:
    frames = difference.frames
    word = (
        '<span class="verdict same">The same</span>'
        if difference.equal
        else '<span class="verdict other">Different</span>'
    )
    yield f"<p>{word} <span class=soft>in {frames.compared:,} frames compared"
    if frames.offset_s:
        yield f"; b begins {frames.offset_s:+,.9g} s after a"
    if not difference.tolerance.exact:
        yield f"; tolerance {length_text(difference.tolerance.m)}, {angle_text(difference.tolerance.rad)}"
    yield "</span></p>"
    rows = []
    for channel in difference.channels.values():
        sets = channel.sets.values()
        changed = f"+{sum(s.gained for s in sets):,} / &minus;{sum(s.lost for s in sets):,}" if sets else ""
        verdict = '<span class="same">equal</span>' if channel.equal else '<span class="other">differs</span>'
        verdict = verdict if frames.compared else '<span class="soft">not compared</span>'
        first = "" if channel.equal or channel.first_frame is None else f"{channel.first_frame:,}"
        texts = [_formatted(channel.overall_m, "max", length_text), _formatted(channel.overall_m, "rms", length_text)]
        texts += [
            _formatted(channel.overall_rad, "max", angle_text),
            _formatted(channel.overall_rad, "rms", angle_text),
            changed,
            first,
        ]
        rows.append([escape(channel.channel), verdict, *texts])
    yield _table(["channel", "", "largest", "RMS", "rotation", "RMS rotation", "gained / lost", "first frame"], rows, 2)


def _only_in_one(difference: OutputDifference) -> Iterator[str]:
    """What only one of the two has: frames, bodies, joints."""
    frames, channels = difference.frames, difference.channels.values()
    for side, count, first_frame in (
        ("a", frames.only_a, frames.first_only_a),
        ("b", frames.only_b, frames.first_only_b),
    ):
        lines = [f"{count:,} frames, from its frame {first_frame:,} on"] if count else []
        for channel in channels:
            names = channel.only_a if side == "a" else channel.only_b
            if names and channel.channel != "/recorded/tf":  # their bodies are in /tf too
                label = channel.kind if channel.kind == "bodies" else f"{channel.kind} of {channel.channel}"
                lines.append(f"{label}: {', '.join(names)}")
        if lines:
            yield f"<h2>Only in {side}</h2>" + _list(lines)


def _scenes(difference: OutputDifference) -> Iterator[str]:
    """What the scenes differ in, in words."""
    if difference.scene:
        yield "<h2>What the scenes differ in</h2>" + _list(difference.scene)


def _list(lines: Iterable[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def _curves(difference: OutputDifference) -> Iterator[str]:
    curves = difference.curves
    drawn = [
        ("Largest difference of a position", "mm", curves.position_m, 1e3, False),
        ("Largest difference of an orientation", "°", curves.angle_rad, np.degrees(1.0), False),
        ("Largest difference of a joint", "°", curves.joints_rad, np.degrees(1.0), False),
        ("Largest difference of a penetration depth", "mm", curves.penetration_m, 1e3, False),
        ("Pairs in contact gained and lost", "", curves.contacts, 1.0, True),
    ]
    plotted = [(t, u, frames, scale * values, steps) for t, u, (frames, values), scale, steps in drawn if values.any()]
    if plotted:
        yield '<h2>Over the frames</h2><div class="curves">'
        for title, unit, frames, values, steps in plotted:
            yield curve(title, unit, frames, values, steps=steps)
        yield "</div>"


def _pictures(difference: OutputDifference, scene: AnyPath | None) -> Iterator[str]:
    if not difference.peaks:
        return
    yield "<h2>Where they differ most</h2>"
    log = open_output(difference.a)
    try:
        world = world_of_output(log, scene)
    except InputError as problem:
        if scene is not None:
            raise
        yield f'<p class="soft">No pictures: {escape(str(problem))}</p>'
        return
    static_poses = (first_poses(log), first_poses(open_output(difference.b)))
    yield '<p class="soft"><span class="key" style="background:#4a87c7;margin-left:0"></span>a'
    yield '<span class="key" style="background:#ed8229"></span>b, where it differs</p><div class="pictures">'
    for picture in pictures_of(world, difference.peaks, *static_poses):
        yield _figure(picture, log.start_ns)
    yield "</div>"


def _figure(picture: Picture, start_ns: int) -> str:
    data = base64.b64encode(picture.png).decode()
    seconds = (picture.time_ns - start_ns) / 1e9
    text = (
        f"Frame {picture.frame:,} ({seconds:.2f} s): {escape(picture.body)}, {length_text(picture.difference_m)} apart"
    )
    return (
        f'<figure><img alt="{escape(text, quote=True)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{text} <span class=soft>&middot; {length_text(2 * picture.radius_m)} high</span></figcaption></figure>"
    )


def _inputs(difference: OutputDifference) -> Iterator[str]:
    rows = [
        [escape(name), escape(str(a if a is not None else "none")), escape(str(b if b is not None else "none"))]
        for name, (a, b) in difference.parameters.items()
    ]
    if rows:
        yield "<h2>What they were made from</h2>" + _table(["parameter", "a", "b"], rows, 3)


def _worst(difference: OutputDifference) -> Iterator[str]:
    """Where to look first in each of the two, with the command that shows it."""
    for side, path, moments in zip("ab", (difference.a, difference.b), difference.worst, strict=True):
        if not moments:
            continue
        rows = [
            [
                escape(figure_text(moment)),
                f"<code>{escape(command_text(moment, Path(path).name))}</code>",
                f"{moment.frame:,}",
                f"{moment.time_s:.2f} s",
            ]
            for moment in moments
        ]
        yield f"<h2>Where to look in {side}</h2>" + _table(["", "shown by", "frame", "time"], rows, 2)


def _channel(channel: ChannelDifference) -> Iterator[str]:
    parts = channel.largest_differences()
    if not parts:
        return
    yield f"<h2>{escape(channel.channel)}</h2>"
    titles = [
        channel.kind,
        "largest",
        "RMS",
        "rotation",
        "RMS rotation",
        "gained",
        "lost",
        "first frame",
        "worst frame",
    ]
    rows = [_row(channel, part) for part in parts]
    yield _table(titles, rows[:_SHOWN], 1)
    if len(rows) > _SHOWN:
        yield f"<details><summary>{len(rows) - _SHOWN} more</summary>{_table(titles, rows[_SHOWN:], 1)}</details>"


def _row(channel: ChannelDifference, part: str) -> list[str]:
    metres, radians, others = (group.get(part) for group in (channel.metres, channel.radians, channel.others))
    plain = others if channel.kind == "fields" else None
    largest = f"{plain.max:.4g}" if plain is not None else _formatted(metres, "max", length_text)
    rms = f"{plain.rms:.3g}" if plain is not None else _formatted(metres, "rms", length_text)
    sets = channel.sets.get(part)
    measures = [m for m in (metres, radians, others) if m is not None and m.max]
    first_frames = [m.first_frame for m in measures if m.first_frame is not None]
    first_frames += [sets.first_frame] if sets is not None and sets.first_frame is not None else []
    worst = next((m.worst_frame for m in measures if m.worst_frame is not None), None)
    return [
        escape(part),
        largest,
        rms,
        _formatted(radians, "max", angle_text),
        _formatted(radians, "rms", angle_text),
        f"{sets.gained:,}" if sets else "",
        f"{sets.lost:,}" if sets else "",
        f"{min(first_frames):,}" if first_frames else "",
        f"{worst:,}" if worst is not None else "",
    ]


def _table(titles: list[str], rows: Iterable[list[str]], texts: int) -> str:
    """A table whose first `texts` columns are text and the others numbers; columns without anything are left out.

    On a narrow page each row is a list of its cells, with the titles beside them.
    """
    rows = list(rows)
    columns = [k for k in range(len(titles)) if any(row[k] for row in rows)]
    kinds = ["long" if k < texts else "n" for k in range(len(titles))]
    head = "".join(f'<th class="{kinds[k]}">{escape(titles[k])}</th>' for k in columns)
    titled = [f'<td class={kinds[k]} data-title="{escape(titles[k], quote=True)}">' for k in range(len(titles))]
    body = "".join(f"<tr>{''.join(f'{titled[k]}{_in_cell(row[k])}</td>' for k in columns)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _in_cell(text: str) -> str:
    """The content of a cell as one element, so that a narrow page can put the column's title beside it."""
    return f"<span>{text}</span>" if text else ""


def _formatted(measure: Measure | None, name: str, unit: object) -> str:
    if measure is None or measure.max == 0.0:
        return ""
    assert callable(unit)
    return str(unit(getattr(measure, name)))
