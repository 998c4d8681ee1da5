"""``geomphys check``: checks whether a log can be replayed in a scene."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from .command import command, current_terminal
from .options import INPUT, config_of, config_options, json_option, scene_option
from .progress import ProgressBars, meshes_report
from .terminal import counted

EXIT_FAILED = 1


@command(
    "check",
    examples="""
    geomphys check hand.mcap --scene table.toml
    geomphys check hand.mcap --scene table.toml --strict
    geomphys check hand.mcap -s table.toml --json
    """,
)
@click.argument("log", type=INPUT)
@scene_option
@config_options
@click.option("--strict", is_flag=True, help="Warnings count as errors.")
@json_option
def check(log: Path, scene: Path, strict: bool, as_json: bool, **options: Any) -> int:
    """Tell whether LOG can be replayed in a scene: what feeds what, units, gaps, limits, names without a match.

    The exit code is 0 if it can, 1 if it cannot.
    """
    from geomphys.errors import LogError
    from geomphys.load import load_world, scaled_to_log
    from geomphys.recording.check import check_log

    terminal, config = current_terminal(), config_of(options)
    with ProgressBars(terminal) as bars:
        loading = meshes_report(terminal, bars)
        world = load_world(scene, mode=config.mode, seed=config.seed, progress=loading)
        with suppress(LogError):  # which the check reports
            world = scaled_to_log(log, world, config, progress=loading)
    report = check_log(log, world, config)
    if as_json:
        terminal.json(report.as_dict())
    else:
        from .show_log import show_check

        show_check(terminal, report)
    if report.errors:
        more = f" (and {counted(len(report.errors) - 1, 'error')} more)" if len(report.errors) > 1 else ""
        terminal.error(report.errors[0] + more)
    elif strict and report.warnings:
        terminal.error(f"{log}: {counted(len(report.warnings), 'warning')}, taken for errors with --strict")
    else:
        return 0
    return EXIT_FAILED
