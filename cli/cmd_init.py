"""``geomphys init``: drafts a scene file for a log."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT, check_ending, check_outputs, force_option, json_option, urdf_option


@command(
    "init",
    examples="""
    geomphys init hand.mcap --urdf hand.urdf
    geomphys init hands.mcap --urdf left.urdf --urdf right.urdf -o desk.toml
    geomphys init hand.mcap --urdf hand.urdf -o - | less
    """,
)
@click.argument("log", type=INPUT)
@urdf_option
@click.option(
    "--output",
    "-o",
    "out",
    type=click.Path(dir_okay=False, allow_dash=True, path_type=Path),
    default=Path("scene.toml"),
    show_default=True,
    metavar="SCENE",
    help="The scene file to write; - prints it.",
)
@click.option("--recover", is_flag=True, help="Go by what is readable of a damaged log.")
@json_option
@force_option
def init(log: Path, urdfs: tuple[Path, ...], out: Path, recover: bool, as_json: bool, force: bool) -> None:
    """Write a first scene file for LOG: its topics, joints matched by name, units, recorded space, what is left to fill in.

    If something of the log fits the URDF, it can be replayed as it is; comments marked CHECK say what was guessed and
    what only you can know, such as where the tracker sits on the hand.
    """
    from geomphys.authoring.scene_draft import draft_scene

    terminal, printed = current_terminal(), str(out) == "-"
    check_outputs(out, force=force, inputs=(log, *urdfs))
    check_ending(out, ".toml")
    draft = draft_scene(log, urdfs, folder=Path() if printed else out.parent, recover=recover)
    draft.write(out, force=force)
    if printed:
        return
    if as_json:
        terminal.json(draft.as_dict())
        return
    from .show_draft import show_draft

    show_draft(terminal, draft, log, out)
