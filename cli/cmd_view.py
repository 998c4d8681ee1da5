"""``geomphys view``: opens an output in the rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE


@command(
    "view",
    examples="""
    geomphys view corrected.rrd
    geomphys view corrected.mcap
    geomphys view corrected.rrd --web
    """,
)
@click.argument("out", type=INPUT_FILE)
@click.option("--web", is_flag=True, help="In the browser, served on 127.0.0.1 only.")
def view(out: Path, web: bool) -> None:
    """Open OUT (.rrd or .mcap) in the rerun viewer."""
    from geomphys.viewer.view import view_result

    terminal = current_terminal()
    terminal.detail(f"viewer: {out}")
    view_result(out, web=web, serving=lambda address: terminal.note(f"shown at {address}; Ctrl-C ends it"))
