"""``geomphys plot``: plots an output over its frames."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE, OUTPUT_FILE, check_ending, check_outputs, force_option
from .progress import progress_bar

PANELS = ["penetration", "correction", "contacts", "time"]
FORMATS = (".png", ".svg", ".pdf")


@command(
    "plot",
    examples="""
    geomphys plot corrected.mcap -o corrected.png
    geomphys plot corrected.mcap -o times.svg --panel time --scale log
    """,
)
@click.argument("result", metavar="OUT", type=INPUT_FILE)
@click.option(
    "--output",
    "-o",
    "out",
    type=OUTPUT_FILE,
    required=True,
    metavar="PICTURE",
    help="A .png, .svg or .pdf to write; -: a PNG, printed.",
)
@click.option(
    "--panel",
    "panels",
    type=click.Choice(PANELS),
    multiple=True,
    help="Show only this panel; may be given several times.",
)
@click.option(
    "--scale",
    type=click.Choice(["auto", "linear", "log"]),
    default="auto",
    show_default=True,
    help="Axis of the frame times: linear stacks the stages, log draws lines.",
)
@force_option
def plot(result: Path, out: Path, panels: tuple[str, ...], scale: str, force: bool) -> None:
    """Draw OUT over its frames: penetration, correction, contacts, frame time by stage (extra: plots).

    Frames that were held or blocked are shaded.
    """
    check_outputs(out, force=force, inputs=(result,))
    check_ending(out, *FORMATS)

    import geomphys

    terminal = current_terminal()
    with progress_bar(terminal, result.name) as bar:
        geomphys.plot_output(result, out, panels=panels or PANELS, scale=scale, force=force, progress=bar)
    terminal.note(f"wrote {out}")
