"""``geomphys demo``: replays the recording that comes with the package."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import OUTPUT_FOLDER, force_option


@command(
    "demo",
    examples="""
    geomphys demo
    geomphys demo -O somewhere --force
    """,
)
@click.option(
    "--output", "-O", "folder", type=OUTPUT_FOLDER, default=Path("out"), show_default=True, metavar="DIR",
    help="Folder of the results; made if it is not there.",
)  # fmt: skip
@force_option
@click.pass_context
def demo(ctx: click.Context, folder: Path, force: bool) -> int:
    """Replay a recorded hand that goes into a table: the recording and its scene come with the package."""
    from geomphys.authoring.demo_files import demo_files

    from .cmd_replay import replay

    files = demo_files()
    folder.mkdir(parents=True, exist_ok=True)
    out, rrd = (folder / f"{files.log.stem}{suffix}" for suffix in (".mcap", ".rrd"))
    code: int = ctx.invoke(replay, log=files.log, scene=files.scene, out=out, rrd=rrd, force=force)
    current_terminal().note(f"look at it: geomphys view {rrd}, or geomphys video {out} -o hand.gif --worst")
    return code
