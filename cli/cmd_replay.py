"""``geomphys replay``: replays one log and prints a summary."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import click

from .command import command, current_terminal
from .options import (
    INPUT,
    OUTPUT_FILE,
    check_ending,
    check_outputs,
    config_of,
    config_options,
    force_option,
    json_option,
    note_partial_outputs,
    scene_option,
    written_options,
)
from .progress import ProgressBars, meshes_report
from .signals import StopAtFrame

EXIT_THRESHOLD = 4

MM = 1000.0

COMPILE_SECONDS = 60
"""s; approximate compile time on two cores of 2024."""


@command(
    "replay",
    examples="""
    geomphys replay hand.mcap --scene table.toml
    geomphys replay hand.mcap --scene table.toml -o corrected.mcap --rrd corrected.rrd
    geomphys replay rosbag2_2026_05_04/ -s table.toml -o corrected.mcap --mode chains --force
    geomphys replay hand.mcap -s table.toml --start 10 --end 20 --json
    geomphys replay cut_off.mcap -s table.toml -o corrected.mcap --recover
    geomphys replay hand.mcap -s table.toml -o corrected.mcap --fail-on-penetration 0.01
    """,
)
@click.argument("log", type=INPUT)
@scene_option
@click.option(
    "--output",
    "-o",
    "out",
    type=OUTPUT_FILE,
    metavar="OUT.mcap",
    help="Write the result as MCAP; - is standard output.",
)
@click.option("--rrd", type=OUTPUT_FILE, metavar="OUT.rrd", help="Write a recording for the rerun viewer.")
@config_options
@written_options
@force_option
@json_option
def replay(
    log: Path,
    scene: Path,
    out: Path | None,
    rrd: Path | None,
    no_timing: bool,
    copy_input: bool,
    ros2: bool,
    fail_on_penetration: float | None,
    force: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Replay LOG (an MCAP file or a ROS 2 bag folder) in a scene and print a summary.

    Bodies that were recorded inside something are moved out of it; where nothing touches, the motion stays as it was
    recorded, bit for bit.
    """
    terminal = current_terminal()
    check_outputs(out, force=force, inputs=(log, scene), partial=True)
    check_outputs(rrd, force=force, inputs=(log, scene), partial=True)
    check_outputs(out, rrd, force=True)
    check_ending(out, ".mcap")
    check_ending(rrd, ".rrd")
    config = config_of(options)

    os.environ.setdefault("RUST_LOG", "off")  # the rerun SDK's own messages are raised as errors anyway

    import geomphys
    from geomphys.jit.kernel import are_compiled, cache_folder

    terminal.detail(f"kernels: {cache_folder()}")

    needs_compile, was_reported = not are_compiled(config.method), False

    with StopAtFrame() as stop, ProgressBars(terminal) as bars, note_partial_outputs(out, rrd), _PandasHidden():

        def compiling(done: int, known: int) -> None:
            nonlocal was_reported
            if not was_reported:  # not earlier: errors of the inputs are reported alone
                terminal.note(f"Compiling the kernels, once per machine and version (about {COMPILE_SECONDS} s)…")
                was_reported = True
            bars.show("kernels", done, known, unit="jobs")
            stop.at_frame()

        report_mesh = meshes_report(terminal, bars)

        def loading(what: str, share: float) -> None:
            report_mesh(what, share)
            stop.at_frame()

        def progress(done: int, total: int | None) -> None:
            bars.show(log.name, done, total)
            stop.at_frame()

        summary = geomphys.run(
            log,
            scene,
            out=out,
            rrd=rrd,
            config=config,
            force=force,
            options=geomphys.OutputOptions(timing=not no_timing, copy_input=copy_input, ros2=ros2),
            callbacks=geomphys.Callbacks(
                loading=loading, compiling=compiling if needs_compile else None, progress=progress
            ),
        )
    if as_json:
        terminal.json(summary.as_dict())
    else:
        from .show_summary import show_summary

        show_summary(terminal, summary)
    for message in summary.warnings if as_json or terminal.quiet else ():
        terminal.warning(message.text)
    residual = summary.residual_penetration_max_m * MM
    if fail_on_penetration is not None and residual > fail_on_penetration:
        terminal.error(
            f"{log}: an overlap of {residual:.4g} mm remains in frame {summary.residual_penetration_frame}, "
            f"more than the {fail_on_penetration:g} mm of --fail-on-penetration"
        )
        return EXIT_THRESHOLD
    return 0


class _PandasHidden:
    """Context in which pandas is not found: pyarrow would import it for 0.2 s, to ask whether a list is something of its."""

    def find_spec(self, fullname: str, path: object, target: object = None) -> None:
        """Refuse pandas, and leave all else to the other finders."""
        if fullname == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name=fullname)

    def __enter__(self) -> None:
        """Become the first of the finders."""
        sys.meta_path.insert(0, self)

    def __exit__(self, *_: object) -> None:
        """Be none of them any more."""
        sys.meta_path.remove(self)
