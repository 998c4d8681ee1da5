"""``geomphys audit``: checks an output for overlaps with python-fcl on the original triangles."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .command import command, current_terminal
from .options import INPUT_FILE, json_option
from .progress import progress_bar
from .terminal import counted, fields, heading, printable

if TYPE_CHECKING:
    from rich.text import Text

    from geomphys.analysis.audit import AuditReport

    from .terminal import Terminal

EXIT_OVERLAPS = 4

MM = 1000.0
OVERLAPS_SHOWN = 10


@command(
    "audit",
    examples="""
    geomphys audit corrected.mcap
    geomphys audit corrected.mcap --scene table.toml --json
    geomphys audit corrected.mcap --recorded
    """,
)
@click.argument("output", metavar="OUT", type=INPUT_FILE)
@click.option(
    "--scene", "-s", type=INPUT_FILE, metavar="SCENE", help="The scene file. Default: the one attached to OUT."
)
@click.option("--recorded", is_flag=True, help="Test the motion as it was recorded instead of the corrected one.")
@json_option
def audit(output: Path, scene: Path | None, recorded: bool, as_json: bool) -> int:
    """Check OUT with python-fcl on the original triangles: in which frames do which bodies overlap?

    Nothing of the pipeline's collision detection is used. A depth is an upper bound, found by moving one body out.

    The exit code is 4 if bodies overlap by more than 0.01 mm, simulated ones by more than 0.1 mm.
    """
    import geomphys

    terminal = current_terminal()
    with progress_bar(terminal, output.name) as bar:
        report = geomphys.audit_output(output, scene=scene, recorded=recorded, progress=bar)
    if as_json:
        terminal.json(report.as_dict())
    else:
        _show(terminal, report)
    if not report.same_world:
        terminal.warning(f"{scene}: is not the scene, with its meshes, that {output} was made in")
    if report.frames_broken and report.deepest is not None:
        deepest = report.deepest
        terminal.error(
            f"{output}: {counted(report.frames_broken, 'frame')} with an overlap, the deepest in frame {deepest.frame}: "
            f"{deepest.body_a} in {deepest.body_b}, up to {MM * deepest.depth_at_most_m:.3g} mm"
        )
        return EXIT_OVERLAPS
    return 0


def _show(terminal: Terminal, report: AuditReport) -> None:
    """Print the verdict and the deepest overlaps."""
    from rich.text import Text

    tested = f"{report.frames:,}, {report.motion} motion"
    pairs = f"{report.pairs:,} of bodies, {report.triangles:,} triangles; {report.tests:,} box overlaps"
    if report.frames_broken:
        verdict = Text(f"{counted(report.frames_broken, 'frame')} with an overlap", style="bold red")
    else:
        verdict = Text("free in every frame", style="green")
    lines: list[str | Text] = [verdict]
    slight = report.frames_overlapping - report.frames_broken
    if slight:
        lines.append(f"{counted(slight, 'frame')} with one within the allowance")
    rows: list[tuple[str, list[str | Text]]] = [("Frames", [tested]), ("Pairs", [pairs]), ("Result", lines)]
    deepest = sorted(report.overlaps, key=lambda o: -o.depth_at_most_m)[:OVERLAPS_SHOWN]
    if deepest:
        texts: list[str | Text] = [
            f"frame {o.frame:,}: {printable(o.body_a)} in {printable(o.body_b)}, up to {MM * o.depth_at_most_m:.3g} mm"
            for o in deepest
        ]
        rows.append(("Deepest", texts))
    terminal.result(heading(Path(report.output).name, " against python-fcl on the triangles"), fields(rows))
