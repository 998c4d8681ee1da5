"""``geomphys snapshot``: renders one frame to an image, without a screen."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import check_ending, check_outputs, force_option, picture_options


@command(
    "snapshot",
    examples="""
    geomphys snapshot corrected.mcap -o frame.png --frame 1200
    geomphys snapshot corrected.mcap -o finger.png --frame 1200 --focus hand/index_distal
    geomphys snapshot corrected.mcap -o window.png --frame 1200 --whole --size 1920 1080
    """,
)
@picture_options(
    "PNG",
    "The picture to write.",
    size=(1280, 960),
    size_limit=8192,
    size_text="Width and height of the picture, or of the viewer's window.",
)
@click.option("--frame", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True, help="Which frame, from 0.")
@click.option("--whole", is_flag=True, help="The viewer's whole window, plots and all, not only the scene.")
@force_option
def snapshot(
    result: Path, out: Path, frame: int, focus: str | None, whole: bool, size: tuple[int, int], force: bool
) -> None:
    """Make a picture of one frame of OUT, without a screen.

    Of a .mcap in software: that needs no graphics driver. The recorded pose is a ghost, contacts are red dots. A .rrd, and
    --whole, are drawn by the rerun viewer.
    """
    from geomphys.viewer.snapshot import take_snapshot

    check_outputs(out, force=force, inputs=(result,))
    check_ending(out, ".png")
    take_snapshot(result, out, frame=frame, size=size, focus=focus, whole_window=whole)
    current_terminal().note(f"wrote {out}")
