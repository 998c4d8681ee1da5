"""``geomphys diff``: compares two outputs."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE, OUTPUT_FILE, THRESHOLD, check_ending, check_outputs, force_option, json_option
from .progress import progress_bar

EXIT_SAME = 0
EXIT_DIFFERENT = 1
EXIT_ERROR = 2

CHANNELS = ["/tf", "/recorded/tf", "joint_states", "/contacts", "/penetration", "/metrics", "/log"]


@command(
    "diff",
    examples="""
    geomphys diff old.mcap new.mcap
    geomphys diff old.mcap new.mcap --tolerance-m 1e-4 --tolerance-rad 1e-3
    geomphys diff old.mcap new.mcap --channel /tf --channel joint_states --json
    geomphys diff old.mcap new.mcap --html report.html --rrd overlay.rrd
    """,
)
@click.argument("a", type=INPUT_FILE)
@click.argument("b", type=INPUT_FILE)
@click.option(
    "--tolerance-m",
    type=THRESHOLD,
    default=0.0,
    metavar="M",
    help="Lengths (m) that differ by no more count as equal. Default: 0, every bit counts.",
)
@click.option(
    "--tolerance-rad",
    type=THRESHOLD,
    default=0.0,
    metavar="RAD",
    help="Angles (rad) that differ by no more count as equal. Default: 0.",
)
@click.option(
    "--channel",
    "channels",
    type=click.Choice(CHANNELS),
    multiple=True,
    help="Compare only this channel; may be given several times.",
)
@click.option("--html", type=OUTPUT_FILE, metavar="REPORT.html", help="Write a page with curves and pictures.")
@click.option("--rrd", type=OUTPUT_FILE, metavar="OVERLAY.rrd", help="Write both motions over each other, for rerun.")
@click.option(
    "--scene",
    "-s",
    type=INPUT_FILE,
    metavar="SCENE",
    help="The scene file, for pictures and overlay. Default: the one attached to A.",
)
@force_option
@json_option
def diff(
    a: Path,
    b: Path,
    tolerance_m: float,
    tolerance_rad: float,
    channels: tuple[str, ...],
    html: Path | None,
    rrd: Path | None,
    scene: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Compare the outputs A and B, channel by channel and body by body; frames are matched by their times.

    Parameters, scenes and versions that differ are listed; they do not make the outputs different. With a tolerance,
    pairs in contact gained and lost, counts, flags, impulses and messages are listed and do not count either. /timing is
    never compared.

    The exit code is 0 if they are the same, 1 if they differ, 2 if they cannot be compared.
    """
    terminal = current_terminal()
    check_outputs(html, rrd, force=force, inputs=(a, b, scene))
    check_ending(html, ".html", ".htm")
    check_ending(rrd, ".rrd")

    import geomphys

    try:
        with progress_bar(terminal, f"{a.name} {b.name}") as bar:
            difference = geomphys.compare_outputs(
                a,
                b,
                tolerance_m=tolerance_m,
                tolerance_rad=tolerance_rad,
                channels=channels or CHANNELS,
                progress=bar,
            )
        if html is not None:
            from geomphys.analysis.diff.html_report import write_page

            write_page(difference, html, scene=scene)
        if rrd is not None:
            from geomphys.analysis.diff.rerun_overlay import write_overlay

            write_overlay(difference, rrd, scene=scene)
    except geomphys.GeomphysError as error:
        terminal.error("; ".join([str(error), *getattr(error, "__notes__", ())]))
        return EXIT_ERROR
    if as_json:
        terminal.json(difference.as_dict())
    else:
        from .show_difference import show_difference

        show_difference(terminal, difference)
    return EXIT_SAME if difference.equal else EXIT_DIFFERENT
