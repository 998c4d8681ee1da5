"""How the rerun viewer opens a result: the scene at a good view, the plots under it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from geomphys.sinks import colours
from geomphys.sinks.camera import Eye

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

SCENE = ("world",)
SHOWN = ("world", "bodies")
RECORDED = ("world", "recorded")
CONTACTS = ("world", "contacts")
DEPTHS = ("world", "penetration_depths")
PLOTS = ("plots",)
LOG = ("log",)

_PLOTS = {
    "penetration_mm": "Penetration [mm]",
    "correction": "Correction [mm, °]",
    "contacts": "Contacts",
    "stages_us": "Stages [µs]",
}
LINES = {
    "penetration_mm/recorded": colours.GHOST,
    "penetration_mm/global": colours.DEPTH,
    "penetration_mm/residual": (70, 200, 120, 255),
    "correction/largest_mm": colours.CORRECTED,
    "correction/largest_degrees": (226, 190, 120, 255),
    "contacts/contacts": colours.TOUCHING,
    "contacts/impacts": (150, 160, 174, 255),
}
"""Colours of plotted lines; others have the viewer's."""

_METRICS = {
    "Penetration [m]": ("recorded_penetration_m", "residual_penetration_m"),
    "Correction [m]": ("correction_m",),
    "Contacts": ("contacts",),
}


def blueprint(eye: Eye, *, rate: float, timing: bool = True) -> Blueprint:
    """Layout of a rerun recording.

    Parameters
    ----------
    eye : Eye
        Where the scene is seen from.
    rate : float
        Hz; frames a second when played.
    timing : bool
        Whether there are stage times to plot.
    """
    import rerun.blueprint as rrb

    plots = [
        _plot(rrb, origin="/".join((*PLOTS, name)), name=title)
        for name, title in _PLOTS.items()
        if timing or name != "stages_us"
    ]
    time = rrb.TimePanel(state="collapsed", timeline="frame", fps=rate, loop_mode="all")
    log = rrb.TextLogView(origin="/".join(LOG), name="Log")
    return _layout(rrb, _scene(rrb, "/".join(SCENE), eye), [*plots, log], time)


def mcap_blueprint(eye: Eye, joint_topics: Sequence[str]) -> Blueprint:
    """Layout of an output log as the viewer's own importer reads it."""
    import rerun as rr
    import rerun.blueprint as rrb
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    def line(name: str) -> Any:
        mapping = VisualizerComponentMapping(
            target="Scalars:scalars",
            source_kind=ComponentSourceKind.SourceComponent,
            source_component="geomphys.FrameMetrics:message",
            selector=f".{name}",
        )
        return rr.SeriesLines(names=name).visualizer(mappings=[mapping])

    plots = [
        _plot(rrb, origin="/metrics", name=title, overrides={"/metrics": [line(name) for name in names]})
        for title, names in _METRICS.items()
    ]
    plots += [_plot(rrb, origin=f"{topic}/position", name=topic) for topic in joint_topics]
    log = rrb.TextLogView(origin="/log", name="Log")
    time = rrb.TimePanel(state="collapsed", timeline="message_log_time", loop_mode="all")
    return _layout(rrb, _scene(rrb, "/", eye, background=(38, 40, 44)), [*plots, log], time)


def _scene(rrb: Any, origin: str, eye: Eye, background: tuple[int, int, int] = (244, 244, 246)) -> Any:
    return rrb.Spatial3DView(
        origin=origin,
        name="Scene",
        eye_controls=rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=False,
        background=rrb.Background(color=background),
    )


def _plot(rrb: Any, **options: Any) -> Any:
    legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
    return rrb.TimeSeriesView(axis_x=rrb.TimeAxis(link="LinkToGlobal"), plot_legend=legend, **options)


def _layout(rrb: Any, scene: Any, below: Sequence[Any], time: Any) -> Blueprint:
    layout: Blueprint = rrb.Blueprint(
        rrb.Vertical(scene, rrb.Horizontal(*below), row_shares=[3.2, 1.0]),
        time,
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
    return layout
