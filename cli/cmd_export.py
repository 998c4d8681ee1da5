"""``geomphys export``: writes a result as tables, Parquet or CSV, as an episode of a LeRobot data set; a Foxglove layout."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE, OUTPUT_FILE, OUTPUT_FOLDER, check_ending, check_outputs, force_option
from .progress import progress_bar
from .terminal import counted


@command(
    "export",
    examples="""
    geomphys export corrected.mcap -o tables
    geomphys export corrected.mcap -o tables --format csv
    geomphys export corrected.mcap --lerobot dataset
    geomphys export corrected.mcap --foxglove layout.json
    """,
)
@click.argument("result", metavar="OUT", type=INPUT_FILE)
@click.option(
    "--output", "-o", "folder", type=OUTPUT_FOLDER, metavar="DIR", help="Folder of the tables; made if it is not there."
)
@click.option(
    "--format",
    "file_format",
    type=click.Choice(["parquet", "csv"]),
    default="parquet",
    show_default=True,
    help="Format of the tables.",
)
@click.option(
    "--lerobot", type=OUTPUT_FOLDER, metavar="DIR", help="Write a LeRobot data set (v3) of one episode: a new folder."
)
@click.option(
    "--foxglove", type=OUTPUT_FILE, metavar="LAYOUT.json", help="Write a layout for Foxglove, made for this output."
)
@force_option
def export(
    result: Path, folder: Path | None, file_format: str, lerobot: Path | None, foxglove: Path | None, force: bool
) -> None:
    """Write OUT as tables: poses, joints, contacts and metrics, a file each.

    Metres, radians, seconds; quaternions x y z w. The state of the LeRobot episode is the corrected joint values and poses of
    the roots; beside it stand those that were recorded.
    """
    if folder is None and lerobot is None and foxglove is None:
        raise click.UsageError(
            "nothing to write: name a folder with -o DIR or --lerobot DIR, or --foxglove LAYOUT.json"
        )
    check_outputs(foxglove, force=force, inputs=(result,))
    check_ending(foxglove, ".json")
    import geomphys

    terminal = current_terminal()
    if folder is not None:
        with progress_bar(terminal, result.name) as bar:
            rows = geomphys.export_tables(result, folder, file_format=file_format, force=force, progress=bar)
        written = ", ".join(f"{table} ({counted(count, 'row')})" for table, count in rows.items())
        terminal.note(f"wrote {folder}: {written}")
    if lerobot is not None:
        with progress_bar(terminal, result.name) as bar:
            frames = geomphys.export_lerobot(result, lerobot, progress=bar)
        terminal.note(f"wrote {lerobot}: an episode of {counted(frames, 'frame')}")
    if foxglove is not None:
        geomphys.write_foxglove_layout(result, foxglove, force=force)
        terminal.note(f"wrote {foxglove}: in Foxglove, Import from file in the menu of layouts")
