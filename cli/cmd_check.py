"""``geomphys check``: whether a log can be replayed in a scene, and what to expect of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from .command import command, current_terminal
from .options import INPUT, config_of, config_options, json_option, scene_option

EXIT_THRESHOLD = 4


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
@click.option("--strict", is_flag=True, help="End with exit code 4 if there is anything to warn of.")
@json_option
def check(log: Path, scene: Path, strict: bool, as_json: bool, **options: Any) -> int:
    """Tell whether LOG can be replayed in a scene: what feeds what, units, gaps, limits, names without a match."""
    from geomphys.recording.inspect import check_log

    from geomphys.load import load_world

    terminal = current_terminal()
    report = check_log(log, load_world(scene), config_of(options))
    if as_json:
        terminal.json(report.as_dict())
    else:
        from .show_log import show_check

        show_check(terminal, report)
    return EXIT_THRESHOLD if strict and report.warnings else 0
