"""Prints benchmark results as tables, for a terminal or as Markdown."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .terminal import fields, heading, table_in, write_text

if TYPE_CHECKING:
    from geomphys.bench.report import BatchTime, Curve, DepthResult, ExperimentResult, ProcessTime, Report

    from .terminal import Terminal

US = 1e-3
MM = 1e3

FRAME_COLUMNS = (
    *("experiment", "frames", "Hz", "driven / all pieces", "median", "p95", "p99", "max", "call", "take", "contacts"),
    *("recorded mm", "left mm"),
)
PEER_COLUMNS = (
    *("experiment", "engine", "mean", "its mean", "ratio", "median ratio", "p99 ratio", "max", "its max", "ratio"),
    *("tips mm", "its tips mm", "kept", "its kept", "left mm", "its left mm", "its free tips mm", "its warnings"),
)


@dataclass(frozen=True)
class Sheet:
    """A table of text: the first column is names, the others figures."""

    title: str
    note: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def show_bench(terminal: Terminal, report: Report, *, markdown: bool) -> None:
    """Print the machine, then every table."""
    facts = machine_facts(report)
    if markdown:
        lines = [f"- {label}: {text}" for label, (text,) in facts]
        lines += [line for sheet in sheets(report) for line in as_markdown(sheet)]
        write_text("\n".join(lines) + "\n", sys.stdout)
        return
    terminal.result(fields(facts), "")
    for sheet in sheets(report):
        table = table_in(terminal.width, sheet.columns, sheet.rows, droppable=sheet.columns[:3:-1])
        terminal.result(heading(sheet.title), *([sheet.note] if sheet.note else []), table, "")


def as_markdown(sheet: Sheet) -> list[str]:
    """Return the lines of a sheet."""
    rule = ["---", *["---:"] * (len(sheet.columns) - 1)]
    rows = [sheet.columns, rule, *sheet.rows]
    table = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return ["", f"### {sheet.title}", "", *([sheet.note, ""] if sheet.note else []), *table]


def machine_facts(report: Report) -> list[tuple[str, list[str]]]:
    """Return the machine, versions and compile times."""
    machine = report.machine
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    load = f"load {machine.load[0]:.1f}"
    first = "loading the kernels" if report.kernels_were_cached else "compiling the kernels"
    compiling = "" if report.compile_s is None else f"; {report.compile_s:.1f} s in a process with an empty cache"
    return [
        ("Machine", [f"{machine.processor}, {machine.cores} cores, {machine.memory_gib:.1f} GiB, {load}"]),
        ("System", [f"{machine.system}, Python {machine.python}"]),
        ("Packages", [versions]),
        ("First frame", [f"after {report.ready_s:.1f} s, of {first}{compiling}; not in the times below"]),
        ("Times", [f"smallest of {report.repeats} runs of each frame, one thread"]),
    ]


def sheets(report: Report) -> list[Sheet]:
    """Return the tables of a report, those that have rows."""
    peers = any(experiment.peers for experiment in report.experiments)
    found = [_frames(report.experiments), _stages(report.experiments)]
    if peers:
        found.insert(1, _peers(report.experiments))
    if report.depths:
        found.append(_depths(report.depths))
    found += [_curve(curve) for curve in report.curves]
    found += [_processes(report.processes)] if report.processes else []
    found += [_batches(report.batches)] if report.batches else []
    return found


def _frames(experiments: Sequence[ExperimentResult]) -> Sheet:
    """Frame times."""
    rows = [
        (
            e.name,
            f"{e.frames:,}",
            f"{e.hertz:.0f}",
            f"{e.driven_pieces} / {e.pieces}",
            *_times(e.step.median, e.step.p95, e.step.p99, e.step.max, e.call_ns, e.result_ns),
            f"{e.contacts:.2f}",
            f"{e.recorded_m * MM:.2f}",
            f"{e.residual_m.max * MM:.2g}",
        )
        for e in experiments
    ]
    return Sheet(
        "Frames",
        "`step`: everything between a decoded frame and its result, µs. `call`: mean processor time of the compiled calls, "
        "`take`: making a frame's result object.",
        FRAME_COLUMNS,
        tuple(rows),
    )


def _peers(experiments: Sequence[ExperimentResult]) -> Sheet:
    """Frame times beside those of other engines."""
    rows = [
        (
            e.name,
            p.engine,
            *_times(e.step.mean, p.ns.mean),
            *(f"{ratio:.2f}" for ratio in (p.ratio_mean, p.ratio_median, p.ratio_p99)),
            *_times(e.step.max, p.ns.max),
            f"{p.ratio_max:.2f}",
            *(f"{f.touching_m.mean * MM:.2f}" if f.touching_m.count else "" for f in (e.fidelity, p.fidelity)),
            *("" if f.retained is None else f"{f.retained:.2f}" for f in (e.fidelity, p.fidelity)),
            *(f"{left.max * MM:.2g}" for left in (e.residual_m, p.residual_m)),
            f"{p.fidelity.free_m.p95 * MM:.2g}" if p.fidelity.free_m.count else "",
            str(p.warnings),
        )
        for e in experiments
        for p in e.peers
    ]
    return Sheet(
        "Frames beside a physics engine",
        "The same pieces, recording and frame rate, in turn in one process; µs. There the hand is welded to the tracked "
        "pose, in one piece (rigid) or with servos in its joints (jointed), so stiffly that a free hand follows within 2 mm "
        "(free tips: 95th percentile), without gravity on it, with elliptic cones, in steps of 2 ms. Tips: mean distance of "
        "fingertips recorded in contact from where they were recorded; kept: share of these contacts that are still there. "
        "Left: deepest overlap of the hand on the final poses of a frame.",
        PEER_COLUMNS,
        tuple(rows),
    )


def _stages(experiments: Sequence[ExperimentResult]) -> Sheet:
    """Times of the stages."""
    rows = [
        (
            f"{e.name}: {s.name}" if s is e.stages[0] else f"  {s.name}",
            *_times(s.ns.median, s.ns.p95, s.ns.p99, s.ns.mean),
            f"{s.count:.2f}",
        )
        for e in experiments
        for s in e.stages
    ]
    note = "µs a frame; count: moving bodies, overlapping pairs of bodies, iterations, impacts, contacts, a frame."
    return Sheet("Stages", note, ("stage", "median", "p95", "p99", "mean", "count"), tuple(rows))


def _depths(depths: Sequence[DepthResult]) -> Sheet:
    """Penetration depths of pairs."""
    rows = [
        (
            f"{d.name} ({d.pairs})" if engine is d.engines[0] else "",
            engine.engine,
            f"{engine.ns.median * US:.2f}",
            f"{engine.ratio:.2f}",
            f"{engine.deviation.median:.1e}",
            f"{engine.deviation.p95:.1e}",
            f"{engine.deviation.max:.1e}",
            f"{engine.residual_m.p95 * MM:.1e}",
            f"{engine.residual_m.max * MM:.1e}",
            str(engine.missed),
        )
        for d in depths
        for engine in d.engines
    ]
    return Sheet(
        "Penetration depth of a pair",
        "`loop`: compiled, as in a frame; `call`: one call from Python a pair, as the others. µs; the ratio is loop over "
        "engine. Deviation of the depth is relative to ours; left: overlap after moving by depth and normal, ours judged "
        "by coal where it is there.",
        ("pairs", "engine", "µs", "ratio", "deviation median", "p95", "max", "left mm (p95)", "max", "missed"),
        tuple(rows),
    )


def _curve(curve: Curve) -> Sheet:
    """A scaling curve."""
    first = curve.points[0]
    peers = [p.peers[0] for p in curve.points if p.peers]
    rows = []
    for k, (size, point) in enumerate(zip(curve.sizes, curve.points, strict=True)):
        cells = _times(point.step.median, point.step.mean, point.step.p99, point.step.max)
        cells += (f"{point.step.median / first.step.median:.2f}",)
        if peers:
            peer = peers[k]
            cells += (*_times(peer.ns.median), f"{peer.ns.median / peers[0].ns.median:.2f}")
            cells += tuple(f"{ratio:.2f}" for ratio in (peer.ratio_median, peer.ratio_mean, peer.ratio_max))
        rows.append((f"{size:,}", f"{point.pieces:,}", *cells))
    columns: tuple[str, ...] = (curve.variable, "pieces", "median", "mean", "p99", "max", "growth")
    if peers:
        columns += ("its median", "its growth", "median ratio", "mean ratio", "max ratio")
    return Sheet(f"Scaling: {curve.name}", "µs a frame.", columns, tuple(rows))


def _processes(processes: Sequence[ProcessTime]) -> Sheet:
    """Whole processes and what they spend their time on."""
    rows = [
        (
            p.name,
            f"{p.frames:,}",
            f"{p.wall_s:.2f}",
            f"{p.cpu_s:.2f}",
            f"{p.real_time_ratio:.0f}",
            *(f"{100 * share.seconds / p.wall_s:.0f} %" for share in p.shares),
        )
        for p in processes
    ]
    columns = (
        "replay",
        "frames",
        "s",
        "processor s",
        "times real time",
        *(share.name for share in processes[0].shares),
    )
    return Sheet("Whole processes", "From the command line to the files on disk, caches filled.", columns, tuple(rows))


def _batches(batches: Sequence[BatchTime]) -> Sheet:
    """Whole batches."""
    rows = [
        (
            f"{b.clips:,} clips, {b.jobs} jobs",
            f"{b.wall_s:.1f}",
            f"{b.cpu_s:.1f}",
            f"{b.clips / b.wall_s:.2f}",
            f"{b.real_time_ratio:.0f}",
            f"{batches[0].wall_s / b.wall_s:.2f}",
        )
        for b in batches
    ]
    columns = ("batch", "s", "processor s", "clips/s", "times real time a job", "times as fast")
    return Sheet("Batches", "Clips of 5 s, from the command line to the files on disk.", columns, tuple(rows))


def _times(*ns: float) -> tuple[str, ...]:
    """Return times in µs."""
    return tuple(f"{value * US:,.0f}" if value >= 1e5 else f"{value * US:.1f}" for value in ns)
