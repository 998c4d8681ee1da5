"""The section of the figure page on gripped objects: where they are and how far they slip, here and in MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from figure_drawing import draw_curves, wrapped

from geomphys.bench.experiments import experiment_files, load_experiment
from geomphys.bench.measure import WARM_UP_FRAMES, measure
from geomphys.bench.mujoco_grip import MujocoGripPeer
from geomphys.config import Config
from geomphys.engine.pipeline import Pipeline
from geomphys.numerics.transforms import apply, invert, matrix_from_pose

LIFTED = 0.01  # m above where it lay: the object is held by the hand alone

TEXT = (
    "Driven bodies grip a simulated one, and carry, turn and release it. Beside each stands MuJoCo on the same recording: the "
    "same convex pieces, masses and friction, elliptic cones with the friction impedance that its documentation advises against "
    "slip, steps of 2 ms, and hands that yield by the same springs (K, R and m of the virtual coupling for the position of the "
    "root and for every joint), so that they press as hard. On the left how high the object is; on the right how far it has "
    "moved in the gripping hand since it left the table: slip, and what the fingers yield when the hand turns. The table has the "
    "times of a frame, the same frames in turn, and ours over MuJoCo's."
)


@dataclass(frozen=True)
class GripFigure:
    """A recording of a grip."""

    name: str
    title: str
    thing: str  # the simulated body
    hand: str  # body in whose frame slip is measured


GRIP_FIGURES = (
    GripFigure("hand_lift", "a hand lifts a ball, turns over, sets it down", "ball", "hand/palm"),
    GripFigure("mug_lift", "a hand lifts a mug by its handle", "mug", "hand/palm"),
    GripFigure("two_hands", "two hands carry a box", "box", "near/palm"),
    GripFigure("gripper_cube", "a gripper lifts, turns and carries a cube", "cube", "gripper/palm"),
)


def grip_section(grips: Sequence[GripFigure], pictures: Path, repeats: int) -> str:
    """Replay the recordings in both, draw their curves, and return the part of the page."""
    lines = ["## Gripped objects, beside MuJoCo", "", *wrapped(TEXT), ""]
    rows = [
        "| | frame [µs]: mean | p99 | max | MuJoCo: mean | p99 | max | ratio: mean | p99 | max | most slip [mm] | MuJoCo |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for grip in grips:
        print(f"{grip.name} …", flush=True)
        rows.append(_row(grip, pictures, repeats))
        lines.append(f"![{grip.title}](pictures/{grip.name}_held.png)")
    return "\n".join([*lines, "", *rows, ""])


def _row(grip: GripFigure, pictures: Path, repeats: int) -> str:
    """Draw a recording's curves; returns its row of the table."""
    (files,) = experiment_files(Path(__file__).resolve().parent.parent, [grip.name])
    experiment = load_experiment(files, Config())
    world = experiment.world
    thing, hand = world.body_names.index(grip.thing), world.body_names.index(grip.hand)
    pipeline, peer, ours, theirs, seconds = Pipeline(world, Config()), None, [], [], []
    for chunk in pipeline.chunks(([frame], 0) for frame in experiment.frames):
        result = pipeline.results(chunk).result(0)
        seconds.append((result.frame.time_ns - experiment.frames[0].time_ns) * 1e-9)
        ours.append(result.corrected[[thing, hand]])
        if peer is None:
            peer = MujocoGripPeer(world, result)
            theirs.append(result.corrected[[thing, hand]])
        else:
            peer.frame(result)
            theirs.append(peer.poses(result)[[thing, hand]])
    both = {"geomphys": np.array(ours), "MuJoCo": np.array(theirs)}
    height = {name: 1e3 * (poses[:, 0, 2] - poses[0, 0, 2]) for name, poses in both.items()}
    held = np.logical_and.reduce([h > 1e3 * LIFTED for h in height.values()])
    slip = {name: _slip(poses, held) for name, poses in both.items()}
    curves = {"height [mm]": height, "moved in the hand [mm]": slip}
    draw_curves(curves, np.array(seconds), pictures / f"{grip.name}_held.png")
    figures = measure(experiment, Config(), repeats, (MujocoGripPeer,))
    assert figures.step.count == len(experiment.frames) - WARM_UP_FRAMES
    (other,) = figures.peers
    times = [f"{1e-3 * t:.3g}" for d in (figures.step, other.ns) for t in (d.mean, d.p99, d.max)]
    ratios = [f"{r:.2f}" for r in (other.ratio_mean, other.ratio_p99, other.ratio_max)]
    slips = [f"{np.nanmax(values):.2g}" for values in slip.values()]
    return f"| {grip.title} | {' | '.join([*times, *ratios, *slips])} |"


def _slip(poses: np.ndarray, held: np.ndarray) -> np.ndarray:
    """How far a thing has moved in a hand since it was lifted (n,) [mm], of their poses (n, 2, 7); NaN where it is not `held`."""
    in_hand = np.array([apply(invert(matrix_from_pose(b)), a[None, :3])[0] for a, b in poses])
    moved = 1e3 * np.linalg.norm(in_hand - in_hand[np.argmax(held)], axis=1)
    return np.where(held, moved, np.nan)
