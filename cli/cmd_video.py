"""``geomphys video``: recorded and corrected motion side by side, as MP4 or GIF, without a screen."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import COUNT, SECONDS, Number, check_ending, check_outputs, force_option, picture_options
from .progress import progress_bar
from .signals import StopAtFrame

FORMATS = (".mp4", ".gif")


@command(
    "video",
    examples="""
    geomphys video corrected.mcap -o corrected.mp4
    geomphys video corrected.mcap -o worst.gif --worst
    geomphys video corrected.mcap -o grasp.mp4 --from 3.5 --to 8 --focus hand/index_distal
    """,
)
@picture_options(
    "VIDEO",
    "The .mp4 or .gif to write; - is standard output, a GIF.",
    size=(640, 480),
    size_limit=4096,
    size_text="Width and height of each half, even numbers.",
)
@click.option("--from", "start", type=SECONDS, metavar="S", help="Begin S seconds after the first frame.")
@click.option("--to", "end", type=SECONDS, metavar="S", help="End S seconds after the first frame.")
@click.option("--worst", is_flag=True, help="Only the seconds about the largest correction.")
@click.option("--fps", type=Number(0.1, 240.0), help="Pictures a second. Default: 30, of a GIF 15.")
@click.option("--jobs", "-j", type=COUNT, help="Processes that draw. Default: one for each core.")
@force_option
def video(
    result: Path,
    out: Path,
    start: float | None,
    end: float | None,
    focus: str | None,
    worst: bool,
    fps: float | None,
    size: tuple[int, int],
    jobs: int | None,
    force: bool,
) -> None:
    """Make a video of OUT (.mcap): as recorded left, corrected right. Needs neither a screen nor a graphics driver."""
    check_outputs(out, force=force, inputs=(result,))
    check_ending(out, *FORMATS)
    from geomphys.errors import ConfigError
    from geomphys.storage.child_process import available_cores
    from geomphys.viewer.video import VideoConfig, make_video

    try:
        config = VideoConfig(
            start=start, end=end, focus=focus, worst=worst, rate=fps, size=size,
            processes=jobs or available_cores(),
        )  # fmt: skip
    except ConfigError as problem:
        raise click.UsageError(str(problem)) from problem
    terminal = current_terminal()
    with StopAtFrame() as stop, progress_bar(terminal, out.name, redraw_interval=1) as bar:

        def done(pictures: int, total: int | None) -> None:
            stop.at_frame()
            bar(pictures, total)

        made = make_video(result, out, config, force=force, progress=done)
    terminal.note(
        f"wrote {out}: {made.pictures} pictures, {made.rate:.4g} a second, frames {made.first_frame} to {made.last_frame}"
    )
