"""Plots a result for print: penetration, correction, contacts and frame times by stage over the frames."""

from __future__ import annotations

from collections.abc import Callable, Collection
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.binned_curve import BinnedCurve
from geomphys.errors import ConfigError, LogError
from geomphys.output.output_log import OutputFrame, OutputLog, open_output
from geomphys.results import FLAG_BLOCKED
from geomphys.storage.output_file import OutputFile, check_target, is_standard_output
from geomphys.storage.remote_files import AnyPath, as_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PANELS = ("penetration", "correction", "contacts", "time")
"""Panels of a figure, from top to bottom."""
FORMATS = (".png", ".svg", ".pdf")

LOG_SCALE_RATIO = 30.0
"""Ratio of the 99th percentile to the median of the frame times above which their axis is logarithmic."""
HEADROOM = 1.35
"""Upper end of a linear time axis, times the 99.5th percentile; larger values are marked at the edge."""
MAX_LINE_POINTS = 300
"""Maximum number of points of a stage's line on a logarithmic axis, each a median over bins; keeps dashes legible."""
MIN_STAGE_SHARE = 1e-3
"""Fraction of the total time above which a stage is shown."""

_WIDTH_INCHES = 7.2
_HEIGHTS = {"time": 2.5, "penetration": 1.7, "correction": 1.7, "contacts": 1.3}
_DPI = 200
# Paul Tol's colour-blind safe schemes; dark and light stages alternate, so that neighbours also differ in grey
_STAGES = ("#332288", "#ee8866", "#228833", "#ddcc77", "#aa3377", "#88ccee", "#4477aa", "#cccccc", "#666633")
_BLUE, _RED, _GREEN = "#4477aa", "#cc3311", "#228833"
_PALE = "#a9afb6"
_DASHED = (0, (5.0, 1.5))
_DOTTED = (0, (1.2, 1.2))
_DASHES: tuple[Any, ...] = ("solid", (0, (5.0, 1.2)), (0, (1.2, 1.0)), (0, (5.0, 1.2, 1.2, 1.2)), (0, (2.5, 1.0)))
_INK = "#22262b"
_STYLE: Any = {
    "font.family": "sans-serif",
    "font.size": 8.0,
    "axes.labelsize": 8.0,
    "axes.titlesize": 9.0,
    "axes.edgecolor": "#6b727b",
    "axes.labelcolor": _INK,
    "text.color": _INK,
    "xtick.color": "#4d545c",
    "ytick.color": "#4d545c",
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e1e4e8",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "lines.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "legend.handlelength": 1.9,
    "legend.borderaxespad": 0.2,
    "svg.hashsalt": "geomphys",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
}


def plot_output(
    output: AnyPath | str,
    out: AnyPath | str,
    *,
    panels: Collection[str] = PANELS,
    scale: str = "auto",
    force: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> None:
    """Draw an output's curves over its frames. The same output gives the same bytes.

    Parameters
    ----------
    output : Path or str
        The output log.
    out : Path or str
        The picture; its ending says what it becomes: PNG, SVG or PDF. ``-``: a PNG on standard output.
    panels : collection of str
        Which of `PANELS` to show. ``time`` needs the channel ``/timing`` and is left out of the default without it.
    scale : str
        Of the frame times: ``linear`` (stages stacked), ``log`` (stages as lines, smoothed by a median), or ``auto``,
        which is logarithmic where a few frames would press all others flat.
    force : bool
        Whether a file that is there is replaced.
    progress : callable, optional
        Called with the frames read and their number.

    Raises
    ------
    ConfigError
        An unknown panel, scale or ending, or matplotlib (the extra ``plots``) is not installed.
    LogError
        `output` is none, has no frame, or has no stage times and `panels` asks for nothing else.
    OutputError
        The picture exists without `force`, or cannot be written.
    """
    out, log = as_path(out), open_output(output)
    if unknown := set(panels) - set(PANELS) or not panels:
        raise ConfigError(f"panel = {unknown}: choose among {', '.join(PANELS)}")
    if scale not in ("auto", "linear", "log"):
        raise ConfigError(f"scale = {scale!r}: choose auto, linear or log")
    kind = "png" if is_standard_output(out) else out.suffix.lower()[1:]
    if f".{kind}" not in FORMATS:
        raise ConfigError(f"{out}: ends in {out.suffix!r}; choose {', '.join(FORMATS)}")
    if find_spec("matplotlib") is None:
        raise ConfigError("figures need matplotlib: pip install 'geomphys[plots]'")
    check_target(out, force=force, inputs=(log.path,))
    curves = _read(log, progress)
    shown = [panel for panel in PANELS if panel in panels and (panel != "time" or curves.stages)]
    if not shown:
        raise LogError(f"{log.path}: has no stage times; it was replayed with --no-timing")
    figure = _draw(log, curves, shown, scale)
    with OutputFile(out, force=force, inputs=(log.path,)) as file:
        _save(figure, file.stream, kind)


class _Curves:
    """The curves of a figure; all have the same bins."""

    def __init__(self) -> None:
        self.frames = 0
        self.first = self.first_ns = 0
        self.values: dict[str, BinnedCurve] = {}
        self.stages: dict[str, BinnedCurve] = {}

    def add(self, frame: OutputFrame) -> None:
        if self.frames == 0:
            self.first, self.first_ns = frame.index, frame.time_ns
        deepest = max((float(np.linalg.norm(row.pd)) for row in frame.penetrations), default=0.0)
        metrics = frame.metrics
        values = {
            "recorded": 1e3 * metrics["recorded_penetration_m"],
            "global": 1e3 * deepest,
            "residual": 1e3 * metrics["residual_penetration_m"],
            "translation": 1e3 * metrics["correction_m"],
            "rotation": float(np.degrees(metrics["correction_rad"])),
            "contacts": metrics["contacts"],
            "impacts": metrics["impacts"],
            "seconds": (frame.time_ns - self.first_ns) / 1e9,
            "held": float(bool(metrics["held"])),
            "blocked": float(int(metrics["flags"]) & FLAG_BLOCKED > 0),
        }
        for name, value in values.items():
            self.values.setdefault(name, BinnedCurve()).add(frame.index, value)
        times = {stage.name: stage.ns / 1e3 for stage in frame.timing}
        for name in dict.fromkeys([*self.stages, *times]):
            if name not in self.stages:
                self.stages[name] = BinnedCurve()
                for number in range(self.first, frame.index):
                    self.stages[name].add(number, 0.0)
            self.stages[name].add(frame.index, times.get(name, 0.0))
        self.frames += 1

    def x(self) -> Floats:
        """Frame number at which each bin begins."""
        return self.values["recorded"].frames().astype(np.float64)


def _read(log: OutputLog, progress: Callable[[int, int | None], None] | None) -> _Curves:
    curves = _Curves()
    for frame in log.frames(["/penetration", "/metrics", "/timing"]):
        curves.add(frame)
        if progress is not None:
            progress(curves.frames, log.frame_count)
    if curves.frames == 0:
        raise LogError(f"{log.path}: holds no frame")
    return curves


def _draw(log: OutputLog, curves: _Curves, panels: list[str], scale: str) -> Figure:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    heights = [_HEIGHTS[panel] for panel in panels]
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH_INCHES, sum(heights) + 0.55), dpi=_DPI, layout="constrained")
        rows: Any = figure.subplots(len(panels), 1, sharex=True, squeeze=False, height_ratios=heights)
        axes: list[Axes] = [row[0] for row in rows]
        for panel, axis in zip(panels, axes, strict=True):
            _mark_frames(axis, curves, labelled=axis is axes[0])
            if panel == "time":
                _draw_times(axis, curves, scale)
            else:
                {"penetration": _draw_penetration, "correction": _draw_correction, "contacts": _draw_contacts}[panel](
                    axis, curves
                )
        figure.align_ylabels(axes)
        _add_seconds(axes[-1], curves, heights[-1])
        axes[-1].set_xlabel("frame")
        axes[-1].set_xlim(curves.first, curves.first + max(curves.frames - 1, 1))
        axes[-1].xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
        seconds = (log.end_ns - log.start_ns) / 1e9
        title = f"{log.path.stem}: {curves.frames:,} frames in {seconds:,.1f} s"
        figure.suptitle(title, x=0.012, horizontalalignment="left", fontsize=9.0, fontweight="bold")
        _fix_layout(figure)
    return figure


def _mark_frames(axis: Axes, curves: _Curves, *, labelled: bool) -> None:
    """Shade the frames that were held or blocked; `labelled` for the legend."""
    x = curves.x()
    for name, colour in (("held", _PALE), ("blocked", "#ee8866")):
        marked = curves.values[name].maximum() > 0.0
        if marked.any():
            edges = np.append(x, x[-1] + curves.values[name].stride)
            where = np.append(marked, marked[-1])
            axis.fill_between(
                edges, 0.0, 1.0, where=where, step="post", transform=axis.get_xaxis_transform(), color=colour,
                alpha=0.35, linewidth=0.0, zorder=0.5, label=f"{name} frames" if labelled else None,
            )  # fmt: skip


def _add_seconds(axis: Axes, curves: _Curves, height: float) -> None:
    """A second axis below the frames: seconds since the first one."""
    x, seconds = curves.x(), curves.values["seconds"].mean()
    x, seconds = np.append(x, curves.first + curves.frames), np.append(seconds, 2.0 * seconds[-1] - seconds[-2:][0])
    if len(x) < 3 or (np.diff(seconds) <= 0.0).any():
        return
    to_seconds = (lambda frame: np.interp(frame, x, seconds), lambda time: np.interp(time, seconds, x))
    below = axis.secondary_xaxis(-0.52 / height, functions=to_seconds)
    below.set_xlabel("time [s]")


def _fix_layout(figure: Figure) -> None:
    """Run the layout once and round the axes' positions, so that equal inputs give equal bytes.

    The layout solver varies in the last bits from run to run, and ids in an SVG are hashes of such numbers.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axis in figure.axes:
        x, y, width, height = axis.get_position().bounds
        axis.set_position((round(x, 6), round(y, 6), round(width, 6), round(height, 6)))


def _draw_times(axis: Axes, curves: _Curves, scale: str) -> None:
    """Times of the step's stages, stacked, or on a logarithmic axis as lines."""
    x, overall = curves.x(), curves.stages.get("step")
    stages = {
        name: series for name, series in curves.stages.items() if name.startswith("step.") and series.maximum().any()
    }
    stages = {name: series for name, series in stages.items() if name.count(".") == 1} or stages
    parts = {name.removeprefix("step."): series.mean() for name, series in stages.items()}
    total = overall.mean() if overall is not None else np.sum(list(parts.values()), axis=0)
    parts = {name: values for name, values in parts.items() if values.sum() > MIN_STAGE_SHARE * total.sum()}
    remainder = np.maximum(total - np.sum(list(parts.values()), axis=0), 0.0) if parts else total
    if remainder.sum() > 0.02 * total.sum():
        parts["other"] = remainder
    if scale == "auto":
        typical = max(float(np.median(total)), 1e-3)
        scale = "log" if float(np.percentile(total, 99)) / typical > LOG_SCALE_RATIO else "linear"
    axis.set_ylabel("frame time [µs]")
    if scale == "log":
        axis.plot(x, total, color=_PALE, label="whole", linewidth=0.6)
        for k, (name, values) in enumerate(parts.items()):
            positions, middle = _medians(x, values)
            colour, dashes = _STAGES[k % len(_STAGES)], _DASHES[k % len(_DASHES)]
            axis.plot(
                positions,
                np.where(middle > 0, middle, np.nan),
                color=colour,
                linestyle=dashes,
                label=name,
                linewidth=1.1,
            )
        axis.set_yscale("log")
        axis.set_ylim(bottom=max(0.1, float(np.percentile(total[total > 0], 1)) / 10) if total.any() else 0.1)
    else:
        axis.stackplot(x, *parts.values(), labels=list(parts), colors=_STAGES, linewidth=0.0)
        maximum = HEADROOM * float(np.percentile(total, 99.5))
        beyond = total > maximum
        if maximum > 0:
            axis.set_ylim(0.0, maximum)
        if beyond.any():
            label = f"beyond: up to {total.max():,.0f} µs"
            axis.plot(
                x[beyond],
                np.full(int(beyond.sum()), maximum),
                "v",
                color=_INK,
                markersize=3,
                clip_on=False,
                label=label,
            )
    axis.yaxis.set_major_formatter(lambda value, _: f"{value:,g}")
    _legend(axis, reverse=scale == "linear")


def _medians(x: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Centres and medians of at most `MAX_LINE_POINTS` equal intervals of a curve."""
    length = -(-len(values) // MAX_LINE_POINTS)
    starts = range(0, len(values), length)
    middles: Floats = np.array([np.median(values[k : k + length]) for k in starts])
    return np.array([x[k : k + length].mean() for k in starts]), middles


def _draw_penetration(axis: Axes, curves: _Curves) -> None:
    x = curves.x()
    axis.set_ylabel("penetration [mm]")
    recorded, depth, left = (curves.values[name].maximum() for name in ("recorded", "global", "residual"))
    axis.fill_between(x, recorded, color=_BLUE, alpha=0.25, linewidth=0.0)
    axis.plot(x, recorded, color=_BLUE, label="as recorded, deepest piece")
    axis.plot(x, depth, color=_RED, linestyle=_DASHED, label="global depth PD", linewidth=1.0)
    axis.plot(x, left, color=_INK, linestyle=_DOTTED, label=f"left (largest {left.max():.2g} mm)", linewidth=1.4)
    axis.set_ylim(bottom=0.0)
    _legend(axis)


def _draw_correction(axis: Axes, curves: _Curves) -> None:
    x = curves.x()
    axis.set_ylabel("correction [mm]")
    translations, rotations = curves.values["translation"].maximum(), curves.values["rotation"].maximum()
    axis.plot(x, translations, color=_BLUE, label="moved")
    axis.set_ylim(bottom=0.0)
    if rotations.max() > 1e-3:
        axis.plot([], [], color=_RED, linestyle=_DASHED, label="turned")  # for the legend
        angles = axis.twinx()
        angles.plot(x, rotations, color=_RED, linestyle=_DASHED)
        angles.set_ylabel("turned [°]", color=_RED)
        angles.set_ylim(bottom=0.0)
        angles.grid(False)
        angles.spines["right"].set_visible(True)
        _legend(axis)


def _draw_contacts(axis: Axes, curves: _Curves) -> None:
    from matplotlib.ticker import MaxNLocator

    x = curves.x()
    axis.set_ylabel("contacts")
    contacts, impacts = curves.values["contacts"].maximum(), curves.values["impacts"].maximum()
    axis.fill_between(x, contacts, step="post", color=_BLUE, alpha=0.55, linewidth=0.0, label="contact points")
    if impacts.any():
        hit = impacts > 0
        axis.plot(
            x[hit],
            impacts[hit],
            "o",
            color=_INK,
            markersize=2.6,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label="impacts",
        )
        _legend(axis)
    axis.set_ylim(bottom=0.0)
    axis.yaxis.set_major_locator(MaxNLocator(integer=True, nbins=4))


def _legend(axis: Axes, *, reverse: bool = False) -> None:
    """A legend above the panel, outside of the axes."""
    handles, labels = axis.get_legend_handles_labels()
    if reverse:
        handles, labels = handles[::-1], labels[::-1]
    axis.legend(handles, labels, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(labels))


def _save(figure: Figure, stream: Any, kind: str) -> None:
    """Write a figure without the date, which would differ from run to run."""
    import matplotlib as mpl

    metadata: dict[str, dict[str, Any]] = {
        "png": {"Software": None},
        "svg": {"Date": None, "Creator": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    }
    with mpl.rc_context(_STYLE):
        figure.savefig(stream, format=kind, metadata=metadata[kind], facecolor="white")
