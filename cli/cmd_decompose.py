"""``geomphys decompose``: decomposes meshes into convex pieces."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .command import command, current_terminal
from .options import INPUT_FILE, SEED, Number, check_ending, check_outputs, force_option, json_option
from .progress import ProgressBars, meshes_report
from .terminal import printable

if TYPE_CHECKING:
    from geomphys.authoring.convex_pieces import DecomposedMesh

    from .terminal import Terminal


@command(
    "decompose",
    examples="""
    geomphys decompose chair.glb
    geomphys decompose chair.glb --threshold 0.05 -o chair_pieces.glb
    geomphys decompose scene.toml -o pieces/ --json
    """,
)
@click.argument("path", metavar="MESH|SCENE", type=INPUT_FILE)
@click.option(
    "--output",
    "-o",
    "out",
    type=click.Path(path_type=Path),
    metavar="FILE|DIR",
    help="Write the pieces, one colour each: a mesh file (.glb, .obj, .ply, .stl; - prints a .glb); for a scene a folder.",
)
@click.option(
    "--threshold",
    type=Number(min=0.01, max=1.0),
    default=None,
    show_default="0.02, but 1 to 5 mm",
    help="Concavity a piece may keep, of half the longest side; a replay takes the default.",
)
@click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of the search.")
@force_option
@json_option
def decompose(path: Path, out: Path | None, threshold: float | None, seed: int, force: bool, as_json: bool) -> None:
    """Cut a mesh, or the meshes a scene file or a URDF collides with, into convex pieces, as a replay does.

    What is cut is kept in the cache, so that a replay need not cut it again.
    """
    has_many_meshes = path.suffix.lower() in {".toml", ".urdf"}
    if has_many_meshes and out is not None and (str(out) == "-" or (out.exists() and not out.is_dir())):
        raise click.UsageError(f"{out}: is a file; the pieces of {path} need a folder")
    from geomphys.authoring.convex_pieces import FORMATS, decompose_file, write_pieces

    if not has_many_meshes:
        check_outputs(out, force=force, inputs=(path,))
        check_ending(out, *FORMATS)

    terminal = current_terminal()
    with ProgressBars(terminal) as bars:
        meshes = decompose_file(path, threshold=threshold, seed=seed, progress=meshes_report(terminal, bars))
    written: list[Path] = []
    if out is not None and has_many_meshes:
        out.mkdir(exist_ok=True)
        written = [out / f"{number:02d}_{mesh.path.stem}.glb" for number, mesh in enumerate(meshes)]
    elif out is not None:
        written = [out]
    check_outputs(*written, force=force, inputs=meshes[0].source_files)
    for mesh, target in zip(meshes, written, strict=False):
        write_pieces(mesh.pieces, target, force=force, inputs=mesh.source_files)
    if as_json:
        terminal.json([mesh.as_dict() for mesh in meshes])
    else:
        _show(terminal, meshes)
    for target in written:
        terminal.note(f"wrote {target}")


def _show(terminal: Terminal, meshes: tuple[DecomposedMesh, ...]) -> None:
    """Print one line per mesh."""
    from rich.table import Table

    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for heading, justify in (("mesh", "left"), ("triangles", "right"), ("pieces", "right"), ("how", "left")):
        table.add_column(heading, justify="right" if justify == "right" else "left", overflow="fold")
    for mesh in meshes:
        description = {"hull": "convex", "parts": "convex parts", "coacd": "cut"}[mesh.pieces.method]
        duration = "from the cache" if mesh.pieces.cached else f"{mesh.pieces.seconds:.1f} s"
        note = f"{description}, {duration}" if mesh.pieces.method == "coacd" else description
        table.add_row(printable(mesh.path.name), f"{mesh.triangles:,}", str(len(mesh.pieces.hulls)), note)
    terminal.result(table)
