"""``geomphys bench``: measures frame times by stage, and those of other engines."""

from __future__ import annotations

from pathlib import Path

import click

from .command import command, current_terminal
from .options import COUNT, json_option
from .progress import progress_bar


@command(
    "bench",
    examples="""
    geomphys bench
    geomphys bench --peers
    geomphys bench --peers --only gallery --only door --no-depths --no-scaling --json
    geomphys bench --peers --markdown > results.md
    geomphys bench --whole --only gallery --no-depths --no-scaling
    """,
)
@click.argument("folder", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--only", multiple=True, metavar="NAME", help="Only this experiment; may be given several times.")
@click.option("--peers", is_flag=True, help="The same input through MuJoCo, coal and FCL, in turn (extra: bench).")
@click.option("--depths/--no-depths", default=True, help="Penetration depths of pairs. Default: with them.")
@click.option("--scaling/--no-scaling", default=True, help="Made-up scenes of growing size. Default: with them.")
@click.option("--compile", "compiling", is_flag=True, help="Also compile from nothing, in a process of its own.")
@click.option("--whole", is_flag=True, help="Whole processes and batches of the gallery, from start to files on disk.")
@click.option(
    "--clips",
    type=COUNT,
    default=100,
    show_default=True,
    metavar="N",
    help="With --whole: clips of 5 s in a batch.",
)
@click.option(
    "--repeats",
    type=COUNT,
    default=3,
    show_default=True,
    metavar="N",
    help="How often each frame is run; its smallest time counts.",
)
@json_option
@click.option("--markdown", is_flag=True, help="Print the tables as Markdown.")
def bench(
    folder: Path | None,
    only: tuple[str, ...],
    peers: bool,
    depths: bool,
    scaling: bool,
    compiling: bool,
    whole: bool,
    clips: int,
    repeats: int,
    as_json: bool,
    markdown: bool,
) -> None:
    """Measure frame times of the recorded experiments in FOLDER, which holds `recordings` and `assets`.

    FOLDER is the checkout if it is left out. Real recordings are measured too where $GEOMPHYS_SHARED, or the folder
    `shared` beside FOLDER, has them. Times are without decoding and without writing, but for --whole; compiling is listed
    separately.
    """
    if as_json and markdown:
        raise click.UsageError("choose one of --json and --markdown")

    from geomphys.bench.run import BenchOptions, run_bench

    options = BenchOptions(
        peers=peers, depths=depths, scaling=scaling, compiling=compiling, whole=whole, clips=clips, repeats=repeats
    )
    terminal = current_terminal()
    with progress_bar(terminal, "bench", unit="parts", redraw_interval=1) as bar:
        report = run_bench(
            folder,
            only=only,
            options=options,
            progress=bar,
        )
    if as_json:
        terminal.json(report.as_dict())
    else:
        from .show_bench import show_bench

        show_bench(terminal, report, markdown=markdown)
    if report.missing:
        terminal.note(f"Not measured, as their files are not there: {', '.join(report.missing)}")
    if report.machine.is_busy:
        terminal.warning(
            f"the machine was busy (load {report.machine.load[0]:.1f} on {report.machine.cores} cores): "
            "times are too long, ratios of one run hold"
        )
