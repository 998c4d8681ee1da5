"""Blueprints (layouts) of the rerun viewer: the scene above, plots and log below."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from geomphys.output import colours
from geomphys.output.camera import Viewpoint

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

SCENE = ("world",)
CORRECTED_BODIES = ("world", "bodies")
RECORDED_BODIES = ("world", "recorded")
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
    "penetration_mm/recorded": (*colours.GHOST[:3], 255),
    "penetration_mm/global": colours.DEPTH,
    "penetration_mm/remaining": (70, 200, 120, 255),
    "correction/mm": colours.CORRECTED,
    "correction/degrees": (226, 190, 120, 255),
    "contacts/contacts": colours.IN_CONTACT,
    "contacts/impacts": (150, 160, 174, 255),
}
"""Colours of plotted lines; others have the viewer's."""


def blueprint(
    eye: Viewpoint, *, rate: float, frames: tuple[int, int], stages_us: float = 0.0, log: bool = True
) -> Blueprint:
    """Layout of a rerun recording.

    Parameters
    ----------
    eye : Viewpoint
        Camera of the scene view.
    rate : float
        Hz; frames a second when played.
    frames : (int, int)
        First and last frame: the range of the plots.
    stages_us : float
        Upper end of the axis of the stage times, µs; 0 for no such plot.
    log : bool
        Whether the log has lines.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    begin, end = (rr.TimeRangeBoundary.absolute(seq=frame) for frame in frames)
    span = rr.TimeRange(start=begin, end=end)
    plots = [
        _plot(rrb, span, origin="/".join((*PLOTS, name)), name=title, **_range(rrb, name, stages_us))
        for name, title in _PLOTS.items()
        if stages_us > 0.0 or name != "stages_us"
    ]
    time = rrb.TimePanel(state="collapsed", timeline="frame", fps=rate, loop_mode="all")
    below = [*plots, _log(rrb, "/".join(LOG))] if log else plots
    return _layout(rrb, _scene(rrb, "/".join(SCENE), eye), below, time)


def _scene(rrb: Any, origin: str, eye: Viewpoint) -> Any:
    return rrb.Spatial3DView(
        origin=origin,
        name="Scene",
        eye_controls=rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=False,
        background=rrb.Background(color=(244, 244, 246)),
    )


def _plot(rrb: Any, span: Any, **options: Any) -> Any:
    """A time series view; the legend is at the top left, where recordings mostly have no contact yet."""
    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop)
    return rrb.TimeSeriesView(axis_x=rrb.TimeAxis(view_range=span), plot_legend=legend, **options)


def _range(rrb: Any, name: str, stages_us: float) -> dict[str, Any]:
    """Fixed range of the time axis, so that a few slow frames do not compress the other curves."""
    return {"axis_y": rrb.ScalarAxis(range=(0.0, stages_us))} if name == "stages_us" else {}


def _log(rrb: Any, origin: str) -> Any:
    columns = [rrb.encodings.TextLogColumn("LogLevel"), rrb.encodings.TextLogColumn("Body")]
    return rrb.TextLogView(origin=origin, name="Log", columns=rrb.TextLogColumns(text_log_columns=columns))


def _layout(rrb: Any, scene: Any, below: Sequence[Any], time: Any) -> Blueprint:
    layout: Blueprint = rrb.Blueprint(
        rrb.Vertical(scene, rrb.Horizontal(*below), row_shares=[2.6, 1.0]),
        time,
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
    return layout
