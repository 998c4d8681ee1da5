"""``geomphys info``: shows the topics of a log."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT, json_option


@command(
    "info",
    examples="""
    geomphys info hand.mcap
    geomphys info rosbag2_2026_05_04/ --json
    geomphys info cut_off.mcap --recover
    """,
)
@click.argument("log", type=INPUT)
@click.option("--recover", is_flag=True, help="Of a damaged log, show what is intact.")
@json_option
def info(log: Path, recover: bool, as_json: bool) -> None:
    """Show the topics of LOG (an MCAP file or a ROS 2 bag folder): types, rates, gaps, joints, frames."""
    from geomphys.recording.inspect import inspect_log

    terminal = current_terminal()
    content = inspect_log(log, recover=recover)
    if as_json:
        terminal.json(content.as_dict())
    else:
        from .show_log import show_log

        show_log(terminal, content)
