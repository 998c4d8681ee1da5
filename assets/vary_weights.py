"""Varies each weight of the objective over recordings and writes the page of what comes of it.

``python assets/vary_weights.py`` (or ``make weights``) writes ``assets/docs/weights.md``. Real recordings are taken from the
folder `$GEOMPHYS_SHARED`, or `shared` beside the checkout, and left out, saying so, where it is not there.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from make_figures import wrapped

import geomphys
from geomphys.analysis.motion_quality import MotionQuality
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.engine.frame_buffer import FRAMES
from geomphys.engine.pipeline import Pipeline
from geomphys.recording.frames import FrameSource
from geomphys.results import Frame
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

HERE = Path(__file__).resolve().parent
FACTORS = (0.3, 3.0)
WEIGHTS_OF = {
    "chains": (
        "base",
        "supported",
        "amplification",
        "excess",
        "smooth",
        "posture",
        "grip_posture",
        "inertia",
        "grip_inertia",
        "tremor",
        "offset_rate",
        "growth_rate",
        "contact",
        "closing_speed",
        "closing_share",
        "unusual",
        "stretch",
    ),
    "rigid": (
        "shape",
        "rigid_smooth",
        "rigid_posture",
        "grip_posture",
        "rigid_inertia",
        "grip_inertia",
        "tremor",
        "offset_rate",
        "unusual",
        "stretch",
        "rigid_contact",
        "closing_speed",
        "closing_share",
        "translation_of_depth",
        "least_translation",
        "most_translation",
        "translation_speed",
        "grip_depth",
    ),
}
"""The weights that have a say in a mode."""


@dataclass(frozen=True)
class Recorded:
    """A log in its scene, read."""

    world: World
    frames: list[Frame]


@dataclass
class Figures:
    """What weights made of the recordings."""

    residual: float = 0.0  # m
    spikes: int = 0
    jerks: list[float] = field(default_factory=list)
    joint_jerks: list[float] = field(default_factory=list)
    amplifications: list[float] = field(default_factory=list)
    recorded: int = 0
    kept: int = 0
    fingertips: list[float] = field(default_factory=list)  # m
    passes: list[float] = field(default_factory=list)

    def cells(self) -> list[str]:
        """Cells of the table."""
        return [
            f"{1e3 * self.residual:.3f}", f"{self.spikes}", f"{np.median(self.amplifications):.2f}",
            f"{np.percentile(self.amplifications, 95):.2f}", f"{np.mean(self.jerks):.3f}", f"{np.mean(self.joint_jerks):.2f}",
            f"{self.kept / self.recorded:.3f}", f"{1e3 * np.mean(self.fingertips):.2f}", f"{np.mean(self.passes):.2f}",
        ]  # fmt: skip


HEAD = (
    "| weight | left [mm] | spikes | amplification | its p95 | jerk | joint jerk | contacts kept | fingertips [mm] | passes |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)

TEXT = (
    "What a correction costs is a matter of a few weights (`geomphys/driven/weights.py`). Here each is 0.3 and 3 times what it "
    "is, the others as they are, over recordings of contact: a hand on a mug and on a ball{shared}. Every number on "
    "this page is made by `make weights`."
)

COLUMNS = (
    "*Left*: deepest overlap. *Spikes*: frames in which the offset of a link steps by more than 3 mm and three times the "
    "recorded motion. *Amplification*: largest offset of a link over the recorded depth; median and 95th percentile. *Jerk*, "
    "*joint jerk*: over the recorded one, root mean square, mean over the recordings. *Contacts kept*: of fingertips recorded "
    "within 2 mm of something or inside. *Fingertips*: how far those are off in the mean. *Passes*: of the search, a frame. "
    "Where a row is missing nothing changed. [What the measures are](comparing.md)."
)

REASONS = {
    "base": "of a palm, times its area: lighter, jerk is less, but what meets nothing moves with it by over 1.4 mm",
    "supported": "of the palm's rotation, times the second moments of what it carries: less, and it turns with a finger",
    "amplification": "times the depth; farther off, links weigh more, others share: less, and a palm moves with a finger",
    "excess": "times it; so far beyond, twice as much: without it fingers that meet near their knuckles go 8 times their overlap",
    "shape": "in one piece: high enough that a hand keeps its shape where a short way aside frees it",
    "smooth": "joints that tremble against palms that move with a finger: more is calmer; at 0 a pinch jerks 1.2 times",
    "rigid_smooth": "the same in one piece: half of it, and joints of clapping hands jerk over twice",
    "posture": "one lever for all joints of a tree: at 0.06 joints at a mug jerk 2.5 times; more: a palm moves with a finger",
    "rigid_posture": "the same in one piece: more, and contacts at doors are lost",
    "inertia": "what presses goes on as in the last frame: without it a slap of a door jerks 1.2 times; more: it overshoots",
    "rigid_inertia": "the same in one piece: more, and contacts at doors are lost; without it they jerk 1.05 times in the mean",
    "grip_inertia": "the same in a grip: fingers stop over some frames, not in one",
    "offset_rate": "of the rate of an offset in contact, what goes on after it: without it doors jerk up to 1.22 times",
    "growth_rate": "the same in chains of one that grew: more, and it overshoots; at 0 a slap of a door jerks 1.2 times",
    "contact": "recorded contacts of fingertips that stay contacts; without it one in ten more is lost at doors",
    "rigid_contact": "the same in one piece: more, and joints jerk in more passes; less, and a thumb stays 1.3 mm off a mug",
    "grip_posture": "in addition, in a grip: fingers stop together; in one piece joints at a ball jerk 3.7 times without it",
    "tremor": "m; of noise filtered out of a hand in a grip: without it joints at a mug jerk 5 times as recorded; more: it lags",
    "closing_speed": "m/s; how fast fingers close: without a bound one recorded near a mug snaps to it by half a millimetre",
    "closing_share": "of the recorded motion, added to it: at 1 joints at a mug jerk more, at 0.3 contacts at a door are lost",
    "unusual": "fingers are not extended beyond what the recording has shown",
    "stretch": "rad; how far beyond it they may be all the same",
    "translation_of_depth": "in one piece: times the recorded depth, how far a translation may go before the shape changes;",
    "least_translation": "m; so far it always may,",
    "most_translation": "m; farther never,",
    "translation_speed": "m/s; nor faster: a whole hand thrown aside by a fingertip was most of the jerk at doors,",
    "grip_depth": "m; nor where fingers close on something by more: half of it, and a hand laid on a table grips it",
}

TITLES = {"chains": "Limb by limb", "rigid": "In one piece"}


def logs(root: Path, shared: Path, mode: str) -> Iterator[tuple[Path, Path]]:
    """Logs and scenes."""
    for name in ("hand_mug", "hand_ball"):
        yield root / f"recordings/{name}.mcap", root / f"assets/scenes/{name}.toml"
    if shared.is_dir():
        doors = sorted((shared / "recordings").glob("adroit_door_*.mcap"))[1::8]
        for log in doors:
            yield log, shared / f"checks/scenes/door_{mode}.toml"


def read(root: Path, shared: Path, mode: str) -> list[Recorded]:
    """All recordings."""
    found, config = [], geomphys.Config(mode=mode)
    for log, scene in logs(root, shared, mode):
        world = geomphys.load_world(scene, mode=mode)
        with FrameSource(log, world, config) as source:
            found.append(Recorded(world, list(source)))
    return found


def add(recorded: Recorded, mode: str, weights: Weights, figures: Figures) -> None:
    """Replay a recording with weights and add what came of it."""
    scene = recorded.world.scene
    driven = np.flatnonzero(scene.bodies.role == DRIVEN)
    joints = np.flatnonzero(scene.trees.role[scene.dofs.tree] == DRIVEN)
    quality = MotionQuality(scene.bodies.tree[driven])
    pipeline = Pipeline(recorded.world, geomphys.Config(mode=mode), weights)
    batches = ((recorded.frames[k : k + FRAMES], 0) for k in range(0, len(recorded.frames), FRAMES))
    blocks = [pipeline.results(chunk) for chunk in pipeline.chunks(batches)]
    results = [block.result(row) for block in blocks for row in range(len(block))]
    for metrics in (result.metrics for result in results):
        figures.residual = max(figures.residual, metrics.residual_penetration_m)
        figures.passes.append(metrics.iterations)
        figures.recorded += metrics.contacts_recorded
        figures.kept += metrics.contacts_kept
        if metrics.contacts_recorded:
            figures.fingertips.append(metrics.fingertip_error_m)
        if metrics.amplification > 0.0:
            figures.amplifications.append(metrics.amplification)
    quality.add(
        np.array([result.frame.time_ns for result in results]),
        np.stack([result.recorded[driven] for result in results]),
        np.stack([result.corrected[driven] for result in results]),
        recorded_angles=np.stack([result.frame.angles[joints] for result in results]),
        corrected_angles=np.stack([result.angles[joints] for result in results]),
    )
    found = quality.figures()
    figures.spikes += found.spikes
    figures.jerks.append(found.jerk_rms_ratio or 0.0)
    figures.joint_jerks.append(found.joint_jerk_rms_ratio or 0.0)


def variants(mode: str) -> Iterator[tuple[str, Weights]]:
    """The weights as they are, then each of a mode times the factors."""
    yield "as they are", WEIGHTS
    for name in WEIGHTS_OF[mode]:
        for factor in FACTORS:
            yield f"`{name}` × {factor:g}", WEIGHTS._replace(**{name: factor * getattr(WEIGHTS, name)})


def table(recordings: Sequence[Recorded], mode: str) -> list[str]:
    """Lines of the table of a mode."""
    lines: list[str] = []
    usual: list[str] = []
    for title, weights in variants(mode):
        figures = Figures()
        for recorded in recordings:
            add(recorded, mode, weights, figures)
        cells = figures.cells()
        if cells != usual:
            lines.append(f"| {title} | {' | '.join(cells)} |")
            print(lines[-1], flush=True)
        usual = usual or cells
    return lines


def meanings() -> str:
    """The weights and what each is chosen for."""
    lines = [f"| `{name}` | {getattr(WEIGHTS, name):.3g} | {REASONS[name]} |" for name in Weights._fields]
    return "\n".join(["| weight | is | chosen so because |", "|---|---|---|", *lines])


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "docs" / "weights.md")
    given = parser.parse_args()
    shared = Path(os.environ.get("GEOMPHYS_SHARED", HERE.parent.parent / "shared"))
    if not shared.is_dir():
        print("no folder of real recordings: $GEOMPHYS_SHARED, or `shared` beside the checkout; they are left out")
    text = TEXT.format(shared=", and two doors" if shared.is_dir() else "")
    parts = ["# The weights of the objective", "\n".join(wrapped(text)), meanings(), "\n".join(wrapped(COLUMNS))]
    for mode in WEIGHTS_OF:
        lines = table(read(HERE.parent, shared, mode), mode)
        parts += [f"## {TITLES[mode]} (mode `{mode}`)", "\n".join([HEAD, *lines])]
    given.out.write_text("\n\n".join(parts) + "\n")


if __name__ == "__main__":
    main()
