"""How the rerun viewer opens a recording: the scene at a good view, the plots under it."""

from __future__ import annotations

from typing import TYPE_CHECKING

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


def blueprint(eye: Eye, *, timing: bool = True) -> Blueprint:
    """Layout with the scene seen from `eye`; without `timing` the plot of stage times is left out."""
    import rerun.blueprint as rrb

    titles = {
        "penetration_mm": "Penetration depth [mm]",
        "correction": "Correction [mm, degrees]",
        "contacts": "Contacts, impacts",
        "stages_us": "Stage times [µs]",
    }
    if not timing:
        del titles["stages_us"]
    scene = rrb.Spatial3DView(
        origin="/".join(SCENE),
        name="Scene",
        eye_controls=rrb.EyeControls3D(position=eye.position, look_target=eye.target, eye_up=(0.0, 0.0, 1.0)),
        line_grid=False,
        background=rrb.Background(color=(244, 244, 246)),
    )
    plots = [
        rrb.TimeSeriesView(origin="/".join((*PLOTS, name)), name=title, axis_x=rrb.TimeAxis(link="LinkToGlobal"))
        for name, title in titles.items()
    ]
    return rrb.Blueprint(
        rrb.Vertical(
            scene,
            rrb.Horizontal(*plots, rrb.TextLogView(origin="/".join(LOG), name="Log")),
            row_shares=[3.2, 1.0],
        ),
        rrb.TimePanel(state="collapsed", timeline="frame"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
    )
