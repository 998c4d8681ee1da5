"""Replays every recording by the published method and by ours and writes the page that compares them.

``python assets/compare_methods.py`` (or ``make methods``) writes ``assets/docs/methods.md``. Real recordings are taken
from the folder `$GEOMPHYS_SHARED`, or `shared` beside the checkout, and left out, saying so, where it is not there.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from between_frames import Passage
from make_figures import wrapped
from numpy.typing import NDArray

import geomphys
from geomphys.analysis.motion_quality import MotionQuality
from geomphys.bench.machine import describe_machine
from geomphys.bench.measure import TimedPipeline
from geomphys.engine.frame_buffer import FRAMES
from geomphys.engine.pipeline import Pipeline
from geomphys.recording.frames import FrameSource
from geomphys.results import FLAG_NOT_CONVERGED, FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

HERE = Path(__file__).resolve().parent
FREE_M = 1e-5
"""m; an overlap of no more than this is none."""

METHODS = ("paper", "exact")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Recordings:
    """A row of the table: logs in one scene."""

    title: str
    logs: tuple[Path, ...]
    scene: Path


@dataclass
class Figures:
    """What a method made of the recordings of a row."""

    frames: int = 0
    missed: int = 0
    left_frames: int = 0
    left_m: float = 0.0
    unflagged: int = 0
    spikes: int = 0
    contacts_recorded: int = 0
    contacts_retained: int = 0
    moved_m: float = 0.0
    busy_ns: int = 0

    def kept(self) -> float:
        """Share of contacts kept; NaN without a contact."""
        return self.contacts_retained / self.contacts_recorded if self.contacts_recorded else math.nan


def rows(root: Path, shared: Path) -> Iterator[Recordings]:
    """The rows of the table."""
    for name, log, title in (
        ("gallery", "gallery_hand", "a hand in an art gallery, rigid"),
        ("wall_slide", "wall_slide", "a hand along walls, rigid"),
        ("finger_snip", "finger_snip", "a finger snips a ball"),
        ("two_arms", "two_arms", "two arms"),
        ("avatar_box", "avatar_box", "a body and a box"),
        ("hand_mug", "hand_mug", "a hand on a mug"),
        ("hand_ball", "hand_ball", "a hand on a ball"),
    ):
        yield Recordings(title, (root / f"recordings/{log}.mcap",), root / f"assets/scenes/{name}.toml")
    if not shared.is_dir():
        return
    doors = tuple(sorted((shared / "recordings").glob("adroit_door_*.mcap")))
    for title, names, scene in (
        (f"{len(doors)} doors, rigid", doors, "door_rigid"),
        (f"{len(doors)} doors, chains", doors, "door_chains"),
        ("claps, rigid", ("leap_three_claps_ros2.mcap",), "claps_rigid"),
        ("claps, chains", ("leap_three_claps_ros2.mcap",), "claps_chains"),
        ("a grab", ("leap_grab_protobuf.mcap",), "table_grab"),
        ("a pinch", ("leap_pinch_57fps_json.mcap",), "table_pinch"),
    ):
        logs = tuple(shared / "recordings" / name for name in names)
        yield Recordings(title, logs, shared / f"checks/scenes/{scene}.toml")


def results(log: Path, world: World, method: str, figures: Figures) -> Iterator[FrameResult]:
    """Replay a log by a method; adds the processor time of the step to the figures."""
    config = geomphys.Config(method=method)
    with FrameSource(log, world, config) as source:
        frames = list(source)
    for _ in Pipeline(world, config).chunks(iter([(frames[:1], 0)])):  # loads the kernels
        pass
    pipeline = TimedPipeline(world, config)
    for chunk in pipeline.chunks((frames[k : k + FRAMES], 0) for k in range(0, len(frames), FRAMES)):
        columns = pipeline.results(chunk)
        for row in range(len(columns)):
            yield columns.result(row)
    figures.busy_ns += pipeline.busy_ns


def measure(log: Path, world: World, method: str, figures: Figures) -> None:
    """Replay a log by a method and add what came of it."""
    driven = np.flatnonzero(world.scene.bodies.role == DRIVEN)
    quality, passage = MotionQuality(world.scene.bodies.tree[driven]), Passage(world)
    for result in results(log, world, method, figures):
        metrics = result.metrics
        figures.frames += 1
        figures.missed += passage.add(result.frame.time_ns, result.corrected)
        if metrics.residual_penetration_m > FREE_M:
            figures.left_frames += 1
            figures.unflagged += not metrics.flags & FLAG_NOT_CONVERGED
        figures.left_m = max(figures.left_m, metrics.residual_penetration_m)
        figures.contacts_recorded += metrics.contacts_recorded
        figures.contacts_retained += metrics.contacts_kept
        figures.moved_m = max(figures.moved_m, metrics.correction_m)
        quality.add(
            np.array([result.frame.time_ns]), result.recorded[None, driven], result.corrected[None, driven],
            depths=np.array([metrics.recorded_penetration_m]),
        )  # fmt: skip
    figures.spikes += quality.figures().spikes


def compared(recordings: Recordings) -> tuple[Figures, Figures]:
    """The figures of both methods."""
    world = geomphys.load_world(recordings.scene)
    found = Figures(), Figures()
    for figures, method in zip(found, METHODS, strict=True):
        for log in recordings.logs:
            measure(log, world, method, figures)
        assert figures.unflagged == 0, f"{recordings.title}: overlap is left by {method} in frames without a flag"
    return found


def line(title: str, paper: Figures, ours: Figures) -> str:
    """A line of the table: in each cell the published method, then ours."""

    def pair(name: str) -> str:
        return f"{getattr(paper, name):,} / {getattr(ours, name):,}"

    def depth(figures: Figures) -> str:
        return f"{1e3 * figures.left_m:.3g} mm" if figures.left_m > FREE_M else "0"

    def kept(figures: Figures) -> str:
        return "–" if math.isnan(figures.kept()) else f"{figures.kept():.2f}"

    def moved(figures: Figures) -> str:
        return f"{1e3 * figures.moved_m:.3g}"

    def time(figures: Figures) -> str:
        us = float(f"{figures.busy_ns / 1e3 / figures.frames:.3g}")
        return f"{us:,.0f}" if us >= 100 else f"{us:.3g}"

    cells = [
        title, f"{paper.frames:,}", pair("missed"), pair("left_frames"), f"{depth(paper)} / {depth(ours)}", pair("spikes"),
        f"{moved(paper)} / {moved(ours)}", f"{kept(paper)} / {kept(ours)}", f"{time(paper)} / {time(ours)}",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


TEXT = (
    "The method of the paper, as it was published, runs with `--method paper`: checks of single frames, translation by the "
    "global penetration depth (1), chains by cyclic coordinate descent (2) to (5), interpolation back to the last free state "
    "where normals cancel. It is here to be compared with. Every number on this page is made by `make methods`; in each cell "
    "the published method stands first and the default one, `--method exact`, second."
)

COLUMNS = (
    "*Missed*: frames before which, on the straight way from the frame before, a pair is deeper in each other than a fifth of "
    "its mean thickness, although in both frames it is not: sampled at 1 kHz. A straight line may also cut an edge that a "
    "body went round, so a few need not be a fault. *Overlap left*: frames with more than 0.01 mm, and the deepest; each "
    "carries the flag `not_converged`. *Jumps*: frames in which the offset of a link from its recording steps by more than "
    "3 mm and three times the recorded motion. *Contacts kept*: of fingertips recorded within 2 mm of something or inside, the "
    "share that is still within 1 mm, or no farther than recorded. *Moved*: how far a link is off its recording at most. "
    "*Frame*: processor time of the step in the mean, on one core of {processor}."
)

WEAKNESS = (
    "What lies between two frames is not seen by the published method. A ball that moves 10 cm a frame goes through a panel of "
    "5 mm, and as no frame overlaps there is nothing to correct: `tests/driven/paper/test_paper_replays.py` holds that it does, "
    "and that the default method stops it. The way back to the last free state is long where that was stored long ago: a rigid "
    "hand that stays hooked on the handle of a door that opens is put to where it was before, up to 390 mm away, and jumps forth "
    "again. And a first frame that starts inside has no free state to go back to: overlap is left, and said."
)

HEAD = (
    "| paper / ours | frames | missed | overlap left in | deepest | jumps | moved [mm] | contacts kept | frame [µs] |\n"
    "|---|---|---|---|---|---|---|---|---|"
)


def page(lines: Sequence[str]) -> str:
    """The whole page."""
    columns = COLUMNS.format(processor=describe_machine().processor)
    parts = ["# The published method beside ours", *("\n".join(wrapped(t)) for t in (TEXT, columns))]
    return "\n\n".join([*parts, "\n".join([HEAD, *lines]), "\n".join(wrapped(WEAKNESS))]) + "\n"


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "docs" / "methods.md")
    parser.add_argument("--only", action="append", default=[], help="part of a title; prints lines, writes no page")
    given = parser.parse_args()
    shared = Path(os.environ.get("GEOMPHYS_SHARED", HERE.parent.parent / "shared"))
    if not shared.is_dir():
        print("no folder of real recordings: $GEOMPHYS_SHARED, or `shared` beside the checkout; they are left out")
    lines = []
    for recordings in rows(HERE.parent, shared):
        if not given.only or any(part in recordings.title for part in given.only):
            lines.append(line(recordings.title, *compared(recordings)))
            print(lines[-1], flush=True)
    if not given.only:
        given.out.write_text(page(lines))


if __name__ == "__main__":
    main()
