"""``geomphys snapshot``: a picture of one frame, without a screen."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE, OUTPUT_FILE, check_output, force_option


@command(
    "snapshot",
    examples="""
    geomphys snapshot corrected.rrd -o frame.png --frame 1200
    """,
)
@click.argument("result", metavar="OUT", type=INPUT_FILE)
@click.option("--output", "-o", "out", type=OUTPUT_FILE, required=True, metavar="PNG", help="The picture to write.")
@click.option("--frame", type=click.IntRange(min=0), default=0, show_default=True, help="Which frame, from 0.")
@force_option
def snapshot(result: Path, out: Path, frame: int, force: bool) -> None:
    """Make a picture of one frame of OUT (.rrd or .mcap), as the rerun viewer shows it."""
    from geomphys.snapshot import take_snapshot

    check_output(out, force=force, inputs=(result,))
    take_snapshot(result, out, frame=frame)
    current_terminal().note(f"wrote {out}")
