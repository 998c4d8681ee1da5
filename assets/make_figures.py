"""Replays the recorded experiments and writes the figure page: ``python assets/make_figures.py`` (or ``make figures``).

The pictures of the scenes come out the same on every run; times are those of the machine.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from figure_drawing import before_and_after, draw_times, wrapped  # noqa: E402
from figure_scenes import EXPERIMENTS, PAPER, Experiment  # noqa: E402
from grip_figures import GRIP_FIGURES, grip_section  # noqa: E402

from geomphys.bench.experiments import experiment_files, load_experiment  # noqa: E402
from geomphys.bench.machine import describe_machine  # noqa: E402
from geomphys.config import Config  # noqa: E402
from geomphys.engine.frame_buffer import FRAMES  # noqa: E402
from geomphys.engine.pipeline import Pipeline  # noqa: E402
from geomphys.replays import run  # noqa: E402
from geomphys.results import Metrics  # noqa: E402
from geomphys.viewer.video import VideoConfig, make_video  # noqa: E402

REPEATS = 5
"""Passes over a recording; of a frame's times the smallest counts, the one that was disturbed least."""


def main() -> None:
    """Write page and pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=HERE / "docs", help="folder of the page")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        help="name of an experiment; prints its section, leaves the page as it is",
    )
    parser.add_argument("--repeats", type=int, default=REPEATS)
    given = parser.parse_args()
    (given.out / "pictures").mkdir(parents=True, exist_ok=True)
    chosen = [e for e in EXPERIMENTS if not given.only or e.name in given.only]
    sections = [section(experiment, given.out / "pictures", given.repeats) for experiment in chosen]
    grips = [g for g in GRIP_FIGURES if not given.only or g.name in given.only]
    if grips:
        sections.append(grip_section(grips, given.out / "pictures", given.repeats))
    if not given.only:
        draw_video(given.out / "pictures" / "hand_mug.gif")
        (given.out / "figures.md").write_text(page([*sections, comparison()]))
    else:
        print("\n".join(sections))


def section(experiment: Experiment, pictures: Path, repeats: int) -> str:
    """Replay an experiment, draw its pictures, and return its part of the page."""
    print(f"{experiment.name} …", flush=True)
    (files,) = experiment_files(HERE.parent, [experiment.name])
    loaded = load_experiment(files, Config())
    wanted = {n for shot in experiment.shots for n in (shot.frame, shot.later)}
    times: list[list[int]] = []
    metrics, kept = [], {}
    for k in range(repeats):
        ns = []
        pipeline = Pipeline(loaded.world, Config())
        batches = ((loaded.frames[i : i + FRAMES], 0) for i in range(0, len(loaded.frames), FRAMES))
        for chunk in pipeline.chunks(batches):
            columns = pipeline.results(chunk)
            for row in range(len(columns)):
                result = columns.result(row)
                ns.append({name: t for name, t, _ in result.timing}["step"])
                if k == 0:
                    metrics.append(result.metrics)
                    if result.frame.index in wanted:
                        kept[result.frame.index] = result
        times.append(ns)
    us = np.min(times, axis=0) / 1e3
    us[0] = us[1]  # the first frame sets up what the others keep
    draw_times(experiment, loaded.frames[0].index, us, pictures / f"{experiment.name}_times.png")
    drawn = {}
    for shot in experiment.shots:
        name = f"{experiment.name}_{shot.frame}.png"
        later = None if shot.later is None else kept[shot.later]
        (pictures / name).write_bytes(before_and_after(loaded.world, kept[shot.frame], later, shot))
        drawn[name] = f"frame {shot.frame:,}: recorded and corrected"
        if shot.later is not None:
            drawn[name] = f"frames {shot.frame:,} and {shot.later:,}: corrected"
    return text_of(experiment, metrics, us, drawn)


def draw_video(out: Path) -> None:
    """The video that opens the README: a hand closes on a mug."""
    from tempfile import TemporaryDirectory

    print(f"{out.name} …", flush=True)
    with TemporaryDirectory() as folder:
        result = Path(folder) / "hand_mug.mcap"
        run(HERE.parent / "recordings" / "hand_mug.mcap", HERE / "scenes" / "hand_mug.toml", out=result)
        make_video(result, out, VideoConfig(start=3.0, end=6.4, rate=10.0, size=(360, 270)), force=True)


def text_of(experiment: Experiment, metrics: Sequence[Metrics], us: np.ndarray, drawn: Mapping[str, str]) -> str:
    """The section of the page."""
    told = experiment.text.format(
        frames=f"{len(metrics):,}",
        median=f"{np.median(us):.3g} µs",
        p95=f"{np.percentile(us, 95):.3g} µs",
        deepest=f"{1e3 * max(m.recorded_penetration_m for m in metrics):.3g} mm",
        moved=f"{1e3 * max(m.correction_m for m in metrics):.3g} mm",
        contacts=max(m.contacts for m in metrics),
        impacts=sum(m.impacts for m in metrics),
    )
    lines = [f"## {experiment.title}", "", *wrapped(told), ""]
    lines += [f"![{experiment.title}, {caption}](pictures/{name})" for name, caption in drawn.items()]
    lines += ["", f"![Frame times of {experiment.name}](pictures/{experiment.name}_times.png)", ""]
    return "\n".join(lines)


def page(sections: Sequence[str]) -> str:
    """The whole page."""
    machine = describe_machine()
    head = (
        "Every picture and every number here is made by `make figures`. On the left a frame as it was recorded, on the right "
        "as it was corrected; or two moments of what was corrected. Left: red is what had to be moved. Right: blue is moved, "
        "orange touches. The things that were entered are drawn like glass. Below stand the times of the whole step frame by "
        "frame, without reading and writing, "
        f"the smallest of {REPEATS} passes, on one core of {machine.processor}."
    )
    return "\n".join(["# The experiments", "", *wrapped(head), "", *wrapped(PAPER), "", *sections]).rstrip() + "\n"


def comparison() -> str:
    """The section on the published method: the table of ``assets/docs/methods.md``, which `compare_methods` makes."""
    table = [line for line in (HERE / "docs" / "methods.md").read_text().splitlines() if line.startswith("|")]
    head = (
        "The method as it was published runs with `--method paper`. In each cell it stands first and the default one second: "
        "what each of them misses between two frames, what overlap it leaves, how often it jumps, which of the recorded contacts "
        "of fingertips it keeps, and the time of a frame. [What the columns mean](methods.md); `make methods` measures them."
    )
    return "\n".join(["## The published method beside ours", "", *wrapped(head), "", *table, ""])


if __name__ == "__main__":
    main()
