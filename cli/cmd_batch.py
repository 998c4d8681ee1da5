"""``geomphys batch``: replays many logs with several processes or a Dask cluster, with a manifest and resume."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .command import command, current_terminal
from .options import (
    COUNT,
    INPUTS,
    OUTPUT_FOLDER,
    config_of,
    config_options,
    force_option,
    json_option,
    scene_option,
    written_options,
)
from .progress import ProgressBars, meshes_report
from .signals import StopAtFrame
from .terminal import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from geomphys.batch.manifest import Entry
    from geomphys.batch.run import BatchReport

    from .terminal import Terminal

EXIT_SOME_FAILED = 3
EXIT_THRESHOLD = 4

LISTED = 100
"""Most logs that are listed at the end; of more, those that matter."""

MM = 1000.0


@command(
    "batch",
    examples="""
    geomphys batch monday/*.mcap --scene table.toml -O corrected
    geomphys batch recordings/ --scene table.toml -O corrected --jobs 8 --rrd
    geomphys batch recordings/ --scene table.toml -O corrected --resume
    geomphys batch recordings/ -s table.toml -O corrected --fail-on-penetration 0.01 --json > report.json
    geomphys batch /data/recordings -s /data/table.toml -O /data/corrected --scheduler tcp://10.0.0.5:8786
    """,
)
@click.argument("logs", type=INPUTS, nargs=-1, required=True, metavar="LOG|DIR...")
@scene_option
@click.option(
    "--output-folder",
    "-O",
    "folder",
    type=OUTPUT_FOLDER,
    required=True,
    metavar="DIR",
    help="Folder of the results: NAME.mcap for each log, and manifest.json.",
)
@click.option("--rrd", is_flag=True, help="Write NAME.rrd for the rerun viewer too.")
@click.option("--jobs", "-j", type=COUNT, metavar="N", help="Processes at once. Default: one a processor.")
@click.option("--scheduler", metavar="ADDRESS", help="Run on the workers of a Dask scheduler, tcp://HOST:PORT.")
@click.option("--resume", is_flag=True, help="Replay only what an earlier batch in DIR left undone, or what changed.")
@click.option(
    "--keep-going/--stop-at-failure",
    default=True,
    show_default=True,
    help="Whether the other logs are replayed after one failed.",
)
@config_options
@written_options
@force_option
@json_option
def batch(
    logs: tuple[Path, ...],
    scene: Path,
    folder: Path,
    rrd: bool,
    jobs: int | None,
    scheduler: str | None,
    resume: bool,
    keep_going: bool,
    no_timing: bool,
    copy_input: bool,
    ros2: bool,
    fail_on_penetration: float | None,
    force: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Replay many LOGs in a scene: MCAP files, ROS 2 bag folders, and all of them in and below other folders.

    DIR/NAME.mcap holds the bytes that replay gives. A log in a subfolder of a folder that was named keeps its place
    below it. DIR/manifest.json tells what became of each log, with figures and hashes; --resume goes on from it, also
    after a crash.

    The exit code is 3 if some logs failed, else 4 if --fail-on-penetration was broken.
    """
    terminal, config = current_terminal(), config_of(options)
    if scheduler is not None and jobs is not None:
        raise click.UsageError("--jobs is for this machine alone; with --scheduler the number of its workers counts")

    os.environ.setdefault("RUST_LOG", "off")  # as in replay

    import geomphys

    outputs = geomphys.OutputOptions(timing=not no_timing, copy_input=copy_input, ros2=ros2)
    how = geomphys.BatchOptions(
        rrd=rrd, jobs=jobs, scheduler=scheduler, resume=resume, keep_going=keep_going, force=force
    )

    def report_failure(entry: Entry) -> None:
        if entry.status == "failed":
            error = entry.error or ""
            terminal.warning(error if entry.log in error else f"{entry.log}: {error}")

    start = time.monotonic()
    with StopAtFrame(), ProgressBars(terminal) as bars:

        def progress(done: int, total: int | None) -> None:
            bars.show(folder.name, done, total, unit="logs", redraw_interval=1)

        report = geomphys.run_batch(
            logs,
            scene,
            folder,
            config=config,
            options=how,
            outputs=outputs,
            callbacks=geomphys.BatchCallbacks(
                loading=meshes_report(terminal, bars), progress=progress, ended=report_failure
            ),
        )
    if as_json:
        terminal.json(report.as_dict())
    else:
        _show(terminal, report, time.monotonic() - start)
    return _exit_code(terminal, report, fail_on_penetration)


def _exit_code(terminal: Terminal, report: BatchReport, limit_mm: float | None) -> int:
    """Return the exit code; reports the reason on stderr if it is not 0."""
    not_done = len(report.entries) - report.count("done")
    if not_done:
        terminal.error(f"{not_done} of {counted(len(report.entries), 'log')} not done; {report.manifest} tells why")
        return EXIT_SOME_FAILED
    if limit_mm is not None:
        worst = max(report.entries, key=_residual_mm)
        if _residual_mm(worst) > limit_mm:
            terminal.error(
                f"{worst.log}: an overlap of {_residual_mm(worst):.4g} mm remains, more than the {limit_mm:g} mm of "
                "--fail-on-penetration"
            )
            return EXIT_THRESHOLD
    return 0


def _residual_mm(entry: Entry) -> float:
    """Return the largest residual overlap of a log, mm."""
    return MM * float((entry.metrics or {}).get("residual_penetration_max_m", 0.0))


def _correction_mm(entry: Entry) -> float:
    """Return the largest correction of a log, mm."""
    return MM * float((entry.metrics or {}).get("correction_max_m", 0.0))


def _show(terminal: Terminal, report: BatchReport, elapsed_s: float) -> None:
    """Print one line per log, or of many for those that matter, the totals, and the speed."""
    from rich.text import Text

    from .terminal import printable, table_in

    rows: list[list[str | Text]] = []
    for entry in _listed(report.entries):
        status = "as it was" if entry.out in report.up_to_date else entry.status
        style = {"done": "green", "failed": "bold red"}.get(entry.status, "yellow")
        rows.append([printable(entry.out), Text(status, style=style), *_figures(entry)])
    columns = ["output", "status", "frames", "recorded", "left", "moved by"]
    table = table_in(terminal.width, columns, rows, droppable=("frames", "moved by"), left_aligned="status")
    left_out = len(report.entries) - len(rows)
    remarks = [Text(f"and {counted(left_out, 'log')} more, all in {printable(report.manifest)}")] if left_out else []
    terminal.result(table, *remarks, "", Text("; ".join([*_sums(report), *_speed(report, elapsed_s)])))


def _listed(entries: Sequence[Entry]) -> list[Entry]:
    """Return the logs to be listed: of more than `LISTED` those not done, then by residual overlap and correction."""
    ranked = sorted(entries, key=lambda entry: (entry.status == "done", -_residual_mm(entry), -_correction_mm(entry)))
    chosen = {entry.out for entry in ranked[:LISTED]}
    return [entry for entry in entries if entry.out in chosen]


def _figures(entry: Entry) -> list[str]:
    """Return frames, deepest recorded and residual overlap, and largest correction."""
    if entry.metrics is None:
        return []
    names = ("recorded_penetration_max_m", "residual_penetration_max_m", "correction_max_m")
    return [f"{entry.metrics['frames']:,}", *(f"{MM * entry.metrics[name]:.3g} mm" for name in names)]


def _speed(report: BatchReport, elapsed_s: float) -> Iterator[str]:
    """Yield how fast the logs were replayed that are done since."""
    played = [
        e.metrics["duration_s"] for e in report.entries if e.metrics is not None and e.out not in report.up_to_date
    ]
    if played and elapsed_s > 0.0:
        yield f"{len(played) / elapsed_s:.3g} logs/s, {sum(played) / elapsed_s:.3g} times real time"


def _sums(report: BatchReport) -> Iterator[str]:
    """Yield the number of logs of each status."""
    yield f"{counted(len(report.entries), 'log')}: {report.count('done'):,} done"
    if report.up_to_date:
        yield f"{len(report.up_to_date):,} of them before"
    for status in ("failed", "interrupted", "pending"):
        if report.count(status):
            yield f"{report.count(status):,} {status}"
