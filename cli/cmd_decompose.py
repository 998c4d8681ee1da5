"""``geomphys decompose``: meshes cut into convex pieces."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import INPUT_FILE, OUTPUT_FILE, check_output, force_option, json_option


@command(
    "decompose",
    examples="""
    geomphys decompose chair.glb
    geomphys decompose chair.glb --threshold 0.02 -o chair_pieces.glb
    geomphys decompose table.toml --json
    """,
)
@click.argument("mesh", metavar="MESH|SCENE", type=INPUT_FILE)
@click.option("--output", "-o", "out", type=OUTPUT_FILE, metavar="GLB", help="Write the pieces, one colour each.")
@click.option(
    "--threshold",
    type=click.FloatRange(min=0.01, max=1.0),
    default=0.05,
    show_default=True,
    help="Concavity a piece may keep; less: more pieces, closer to the mesh.",
)
@force_option
@json_option
def decompose(mesh: Path, out: Path | None, threshold: float, force: bool, as_json: bool) -> None:
    """Cut a mesh, or all meshes of a scene file, into convex pieces, as a replay does; keep them in the cache."""
    check_output(out, force=force, inputs=(mesh,))
    from geomphys.world.decomposition import decompose_file

    report = decompose_file(mesh, out=out, threshold=threshold, force=force)
    terminal = current_terminal()
    terminal.json(report.as_dict())
