"""``geomphys audit``: checks an output with python-fcl on the original triangles, or measures the motion of a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from .command import command, current_terminal
from .options import INPUT, INPUT_FILE, OUTPUT_FILE, THRESHOLD, check_ending, check_outputs, force_option, json_option
from .progress import progress_bar
from .terminal import counted, fields, heading, printable

if TYPE_CHECKING:
    from rich.text import Text

    from geomphys.analysis.audit import AuditReport
    from geomphys.analysis.motion_audit import MotionAudit

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
    geomphys audit hand.mcap --scene table.toml --max-penetration 2 --junit report.xml
    """,
)
@click.argument("motion", metavar="OUT|LOG", type=INPUT)
@click.option(
    "--scene", "-s", type=INPUT_FILE, metavar="SCENE", help="The scene file. Default: the one attached to OUT."
)
@click.option("--recorded", is_flag=True, help="Of OUT: test the motion as it was recorded, not the corrected one.")
@click.option(
    "--max-penetration",
    type=THRESHOLD,
    metavar="MM",
    help="End with exit code 4 if bodies overlap by more than this (mm) in any frame.",
)
@click.option("--junit", type=OUTPUT_FILE, metavar="FILE.xml", help="Write what was claimed and found as JUnit XML.")
@force_option
@json_option
def audit(
    motion: Path,
    scene: Path | None,
    recorded: bool,
    max_penetration: float | None,
    junit: Path | None,
    force: bool,
    as_json: bool,
) -> int:
    """Check OUT with python-fcl on the original triangles: in which frames do which bodies overlap? Or measure LOG.

    Of an output nothing of the pipeline's collision detection is used; a depth is an upper bound, found by moving one body
    out. The exit code is 4 if bodies overlap by more than --max-penetration; without it by more than 0.01 mm, simulated
    ones by more than 0.1 mm.

    Of any other log, with --scene, the motion is measured as it was recorded: penetration, self-overlap, speed, jerk. The
    exit code is 4 if it goes deeper than --max-penetration.
    """
    check_outputs(junit, force=force, inputs=(motion, scene))
    check_ending(junit, ".xml")
    from geomphys.output.output_log import is_output
    from geomphys.output.provenance import files_of_log
    from geomphys.scene.source_files import tracked_sources

    terminal = current_terminal()
    with tracked_sources() as sources:
        if scene is None or is_output(motion):
            claim, found = _audit_output(terminal, motion, scene, recorded, max_penetration, as_json)
        else:
            if recorded:
                raise click.UsageError(f"{motion}: is no output of geomphys; --recorded is for outputs")
            if junit is not None and max_penetration is None:
                raise click.UsageError("--junit has nothing to claim: add --max-penetration MM")
            claim, found = _audit_log(terminal, motion, scene, max_penetration, as_json)
    if junit is not None:
        from geomphys.analysis.junit import Claim, write_junit

        read = (*files_of_log(motion), *sources.contents)
        write_junit(junit, [Claim(motion.name, claim, found)], force=force, inputs=read)
    if found:
        terminal.error(f"{motion}: {found}")
        return EXIT_OVERLAPS
    return 0


def _audit_output(
    terminal: Terminal, output: Path, scene: Path | None, recorded: bool, limit_mm: float | None, as_json: bool
) -> tuple[str, str]:
    """Audit an output; return the claim, and what breaks it or ""."""
    import geomphys

    with progress_bar(terminal, output.name) as bar:
        report = geomphys.audit_output(output, scene=scene, recorded=recorded, progress=bar)
    if as_json:
        terminal.json(report.as_dict())
    else:
        _show(terminal, report)
    if not report.same_world:
        terminal.warning(f"{scene}: is not the scene, with its meshes, that {output} was made in")
    claim = "free of overlaps" if limit_mm is None else f"penetration at most {limit_mm:g} mm"
    deepest = report.deepest
    broken = report.frames_broken > 0
    if limit_mm is not None:
        broken = deepest is not None and MM * deepest.depth_at_most_m > limit_mm
    if not broken or deepest is None:
        return claim, ""
    frames = counted(report.frames_broken, "frame")
    return claim, (
        f"{frames} with an overlap, the deepest in frame {deepest.frame}: "
        f"{deepest.body_a} in {deepest.body_b}, up to {MM * deepest.depth_at_most_m:.3g} mm"
    )


def _audit_log(terminal: Terminal, log: Path, scene: Path, limit_mm: float | None, as_json: bool) -> tuple[str, str]:
    """Measure the motion of a log; return the claim, and what breaks it or ""."""
    import geomphys

    with progress_bar(terminal, log.name) as bar:
        report = geomphys.audit_motion(log, scene, progress=bar)
    if as_json:
        terminal.json(report.as_dict())
    else:
        _show_motion(terminal, report)
    claim = "" if limit_mm is None else f"penetration at most {limit_mm:g} mm"
    if limit_mm is None or MM * report.max_penetration_m <= limit_mm:
        return claim, ""
    return (
        claim,
        f"goes {MM * report.max_penetration_m:.3g} mm deep in frame {report.deepest_frame}, allowed are {limit_mm:g} mm",
    )


def _show_motion(terminal: Terminal, report: MotionAudit) -> None:
    """Print the measures of a motion."""
    volume = report.intersection_volume_m3
    depth = [
        f"up to {MM * report.max_penetration_m:.3g} mm, inside something in {counted(report.frames_penetrating, 'frame')}, "
        f"over 2 mm in {report.share_deep:.1%}"
    ]
    if report.deepest_frame is not None and volume is not None:
        depth.append(f"in frame {report.deepest_frame:,} {1e6 * volume:.3g} cm³ in common")
    rows: list[tuple[str, list[str | Text]]] = [
        ("Frames", [f"{report.frames:,} in {report.duration_s:.2f} s, {report.held_frames:,} held"]),
        ("Penetration", list(depth)),
        ("Self-overlap", [f"up to {MM * report.max_self_overlap_m:.3g} mm"]),
        ("Speed", [f"up to {report.max_speed_m_s:.3g} m/s"]),
        ("Jerk", [f"median {report.jerk_p50_m_s3:.3g} m/s³, 99 % below {report.jerk_p99_m_s3:.3g} m/s³"]),
    ]
    if report.pairs:
        texts: list[str | Text] = [
            f"frame {p.frame:,}: {printable(p.body_a)} in {printable(p.body_b)}, {MM * p.largest_m:.3g} mm, "
            f"{counted(p.frames, 'frame')}"
            for p in report.pairs[:OVERLAPS_SHOWN]
        ]
        rows.append(("Deepest", texts))
    terminal.result(heading(Path(report.log).name, " as it was recorded"), fields(rows))


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
