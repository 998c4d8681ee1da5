"""Blueprints (layouts) of the rerun viewer: scene, legend and worst moments above, plots below; details and log in a tab."""

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
LEGEND = ("legend",)
MOMENTS = ("worst_moments",)
JOINTS = ("joint_states",)
RECORDED_JOINTS = ("recorded", "joint_states")
METRICS = ("metrics",)
FLAGS = ("metrics", "flags")

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

_COLOUR_NAMES = {
    colours.CORRECTED: "blue",
    colours.IN_CONTACT: "orange",
    colours.GHOST: "pink, translucent",
    colours.CONTACT: "red",
    colours.DEPTH: "violet",
}


def blueprint(
    eye: Viewpoint,
    *,
    rate: float,
    frames: tuple[int, int],
    stages_us: float = 0.0,
    log: bool = True,
    joints: bool = False,
    moments: bool = False,
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
    joints : bool
        Whether there are joints.
    moments : bool
        Whether there are moments to look at first.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    begin, end = (rr.TimeRangeBoundary.absolute(seq=frame) for frame in frames)
    span = rr.TimeRange(start=begin, end=end)
    plots = [
        _plot(rrb, span, origin="/".join((*PLOTS, name)), name=title)
        for name, title in _PLOTS.items()
        if name != "stages_us"
    ]
    details = []
    if joints:
        details.append(_plot(rrb, span, origin="/".join(JOINTS), name="Joints [rad, m]"))
    if stages_us > 0.0:
        axis = rrb.ScalarAxis(range=(0.0, stages_us))  # a few slow frames would press the curves flat
        origin = "/".join((*PLOTS, "stages_us"))
        details.append(_plot(rrb, span, origin=origin, name=_PLOTS["stages_us"], axis_y=axis))
    if log:
        details.append(_log(rrb, "/".join(LOG)))  # at full width: its lines are long
    words = [rrb.TextDocumentView(origin="/".join(LEGEND), name="Legend")]
    if moments:
        words.append(rrb.TextDocumentView(origin="/".join(MOMENTS), name="Where to look"))
    time = rrb.TimePanel(state="collapsed", timeline="frame", fps=rate, loop_mode="all")
    above = rrb.Horizontal(
        _scene(rrb, "/".join(SCENE), eye),
        rrb.Vertical(*words, row_shares=[1.0, 2.2][: len(words)]),
        column_shares=[3.2, 1.0],
    )
    return _layout(rrb, above, plots, time, details)


def legend() -> str:
    """The legend of a rerun recording's colours, in Markdown."""
    rows = (
        ("the colour of its material", "at its recorded pose"),
        (_COLOUR_NAMES[colours.CORRECTED], "corrected: moved from where it was recorded"),
        (_COLOUR_NAMES[colours.IN_CONTACT], "in contact"),
        (_COLOUR_NAMES[colours.GHOST], "where it was recorded, while it is corrected"),
        (
            _COLOUR_NAMES[colours.CONTACT],
            "points of contact, and normals: 1 cm longer for each newton, else by the depth",
        ),
        (_COLOUR_NAMES[colours.DEPTH], "global penetration depth of a recorded overlap"),
    )
    return "".join(f"- **{colour}**: {meaning}\n" for colour, meaning in rows)


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


def _log(rrb: Any, origin: str) -> Any:
    columns = [rrb.encodings.TextLogColumn("LogLevel"), rrb.encodings.TextLogColumn("Body")]
    return rrb.TextLogView(origin=origin, name="Log", columns=rrb.TextLogColumns(text_log_columns=columns))


def _layout(rrb: Any, above: Any, below: Sequence[Any], time: Any, details: Sequence[Any] = ()) -> Blueprint:
    """Scene (and the views beside it) above the plots; details in a second tab."""
    main = rrb.Vertical(above, rrb.Horizontal(*below), row_shares=[2.6, 1.0], name="Motion")
    layout: Blueprint = rrb.Blueprint(
        rrb.Tabs(main, rrb.Vertical(*details, name="Details and log")) if details else main,
        time,
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
    return layout
