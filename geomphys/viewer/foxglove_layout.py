"""Makes a layout for Foxglove that shows an output: the scene, plots of penetration, correction and joints, flags, log.

The file is what Foxglove and Lichtblick import and export as a layout: settings of panels by id (``configById``), and a binary
tree of splits (``layout``). What the panels are set to is named by topics and fields of the output, so that a layout made for
one output shows any other of the same avatars.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from geomphys.output.camera import Viewpoint
from geomphys.output.output_log import open_output
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.output.urdf_description import WORLD
from geomphys.storage.output_file import write_file
from geomphys.storage.remote_files import AnyPath, as_path
from geomphys.viewer.frame_picture import sample_of, viewpoint_of

SHOWN = ("/meshes", "/recorded/meshes", "/contacts/points", "/contacts/scene")
"""Topics of the scene that are drawn, the ghost too; robot descriptions are not, as their surfaces are in ``/meshes``."""

PLOTS = {
    "penetration": (
        "Penetration [m]",
        {"recorded_penetration_m": ("recorded", "#d8629a"), "residual_penetration_m": ("left", "#46c878")},
    ),
    "correction": (
        "Correction [m, rad]",
        {"correction_m": ("moved", "#4a87c7"), "correction_rad": ("turned", "#e2be78")},
    ),
    "contacts": (
        "Contacts",
        {
            "contacts": ("points", "#ed8229"),
            "contacts_recorded": ("of fingertips, recorded", "#d8629a"),
            "contacts_kept": ("of these, kept", "#46c878"),
        },
    ),
}
"""Plot -> its title, and field of ``/metrics`` -> label and colour."""

_ROOT_STAGES = ("decode", "step", "encode")
_FIELD_OF_VIEW = 45.0  # degrees, vertical


def write_foxglove_layout(output: AnyPath | str, out: AnyPath | str, *, force: bool = False) -> None:
    """Write a layout in which Foxglove shows an output.

    Parameters
    ----------
    output : Path or str
        The output log.
    out : Path or str
        The layout, JSON; ``-`` is standard output.
    force : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    LogError, SceneError
        The file is no output, is a ROS 2 bag, or its scene cannot be rebuilt.
    OutputError
        The layout cannot be written.
    """
    log = open_output(output)
    world = world_of_output(log)
    eye = viewpoint_of(world, sample_of(results_of_output(log, world)))
    first = next(iter(log.frames(("joint_states",))))
    joints = {topic: values.names for topic, values in first.joints.items()}
    layout = foxglove_layout(log.topics, joints, eye)
    write_file(as_path(out), layout_text(layout).encode(), force=force, inputs=(log.path,))


def layout_text(layout: dict[str, Any]) -> str:
    """The layout as the text of a file."""
    return json.dumps(layout, indent=2) + "\n"


def foxglove_layout(topics: Collection[str], joints: Mapping[str, Sequence[str]], eye: Viewpoint) -> dict[str, Any]:
    """The layout for a file with these topics; panels that would have none of them are left out.

    Parameters
    ----------
    topics : collection of str
    joints : mapping
        Topic of joint values -> names, in the order of its messages.
    eye : Viewpoint
        Position of the camera, world frame, m.
    """
    panels: dict[str, dict[str, Any]] = {"3D!scene": _scene(topics, eye)}
    tabs: list[dict[str, Any]] = []
    if "/metrics" in topics:
        for name, (title, fields) in PLOTS.items():
            lines = [_line(f"/metrics.{field}", label, colour) for field, (label, colour) in fields.items()]
            panels[f"Plot!{name}"] = _plot(title, lines)
        states = [
            {"value": f"/metrics.{field}", "label": field, "enabled": True, "timestampMethod": "receiveTime"}
            for field in ("held", "flags")
        ]
        panels["StateTransitions!flags"] = {
            "foxglovePanelTitle": "Held frames, flags",
            "paths": states,
            "isSynced": True,
        }
        main = ["Plot!penetration", "Plot!correction", "Plot!contacts", "StateTransitions!flags"]
        tabs.append({"title": "Motion", "layout": _split("row", main)})
    if joints:
        for number, (topic, names) in enumerate(joints.items()):
            lines = [_line(f"{topic}.position[{k}]", name) for k, name in enumerate(names)]
            panels[f"Plot!joints{number}"] = _plot(f"{topic} [rad, m]", lines)
        tabs.append({"title": "Joints", "layout": _split("row", [f"Plot!joints{k}" for k in range(len(joints))])})
    if "/timing" in topics:
        lines = [_line(f'/timing.stages[:]{{name=="{stage}"}}.ns', stage) for stage in _ROOT_STAGES]
        panels["Plot!times"] = _plot("Stage times [ns]", lines)
        tabs.append({"title": "Times", "layout": "Plot!times"})
    above: Any = "3D!scene"
    if "/log" in topics:
        panels["RosOut!log"] = {"topicToRender": "/log", "minLogLevel": 2, "searchTerms": []}
        above = {"first": above, "second": "RosOut!log", "direction": "row", "splitPercentage": 72}
    if tabs:
        panels["Tab!below"] = {"activeTabIdx": 0, "tabs": tabs}
        above = {"first": above, "second": "Tab!below", "direction": "column", "splitPercentage": 66}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": above,
    }


def _scene(topics: Collection[str], eye: Viewpoint) -> dict[str, Any]:
    """Settings of the 3D panel: what is drawn, and the camera."""
    offset = eye.position - eye.target
    distance = float(np.linalg.norm(offset))
    shown: dict[str, dict[str, Any]] = {topic: {"visible": True} for topic in SHOWN if topic in topics}
    if "/contacts/points" in shown:
        shown["/contacts/points"] |= {"pointSize": 8, "colorMode": "flat", "flatColor": "#dc2828ff"}
    shown |= {topic: {"visible": False} for topic in topics if topic.endswith("/robot_description")}
    return {
        "foxglovePanelTitle": "Scene",
        "followTf": WORLD,
        "followMode": "follow-none",
        "cameraState": {
            "perspective": True,
            "distance": round(distance, 4),
            "phi": round(float(np.degrees(np.arccos(offset[2] / distance))), 2),
            "thetaOffset": round(float(np.degrees(np.arctan2(-offset[0], -offset[1]))), 2),
            "targetOffset": [round(x, 4) for x in eye.target.tolist()],
            "target": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": _FIELD_OF_VIEW,
            "near": round(distance / 100, 4),
            "far": 1000,
        },
        "scene": {"backgroundColor": "#f4f4f6", "transforms": {"visible": False, "showLabel": False}},
        "topics": shown,
        "layers": {},
    }


def _plot(title: str, lines: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "foxglovePanelTitle": title,
        "paths": lines,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _line(path: str, label: str, colour: str | None = None) -> dict[str, Any]:
    line = {"value": path, "enabled": True, "timestampMethod": "receiveTime", "label": label}
    return line if colour is None else line | {"color": colour}


def _split(direction: str, panels: Sequence[str]) -> Any:
    """Panels beside one another, of one width."""
    if len(panels) == 1:
        return panels[0]
    return {
        "first": panels[0],
        "second": _split(direction, panels[1:]),
        "direction": direction,
        "splitPercentage": round(100 / len(panels), 2),
    }
