"""The layout for Foxglove: its paths lead to values of the output, its settings are those that Foxglove's own package knows."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import foxglove.layouts as fl
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoders
from mcap_ros2.decoder import DecoderFactory as Ros2Decoders

import geomphys
from geomphys.errors import OutputError
from geomphys.output.camera import Viewpoint
from geomphys.viewer.foxglove_layout import foxglove_layout
from tests.house.output_reference import LAYOUT, channels, foxglove
from tests.made import Results

TITLE = "foxglovePanelTitle"


@pytest.fixture(scope="module")
def layout(landed: Results, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("layout") / "layout.json"
    geomphys.write_foxglove_layout(landed.out, out)
    with pytest.raises(OutputError, match="exists"):
        geomphys.write_foxglove_layout(landed.out, out)
    found: dict[str, Any] = json.loads(out.read_text())
    return found


def paths(layout: dict[str, Any]) -> list[dict[str, Any]]:
    """Every line of every plot."""
    return [line for panel in layout["configById"].values() for line in panel.get("paths", [])]


def value_at(message: Any, path: str) -> Any:
    """What a path of Foxglove's syntax leads to: ``.field``, ``[k]``, ``[:]``, ``{field=="text"}``."""
    for step in re.findall(r"\.\w+|\[[^]]*\]|\{[^}]*\}", path):
        if step[0] == ".":
            message = getattr(message, step[1:])
        elif step == "[:]":
            message = list(message)
        elif step[0] == "[":
            message = message[int(step[1:-1])]
        else:
            name, text = step[1:-1].split("==")
            (message,) = [m for m in message if getattr(m, name) == json.loads(text)]
    return message


def leaves(tree: Any) -> list[str]:
    """Panels of a tree of splits."""
    return [tree] if isinstance(tree, str) else [*leaves(tree["first"]), *leaves(tree["second"])]


def test_every_path_leads_to_numbers_of_the_output(landed: Results, layout: dict[str, Any]) -> None:
    messages: dict[str, Any] = {}
    with landed.out.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[ProtobufDecoders(), Ros2Decoders()])
        for _, channel, _, message in reader.iter_decoded_messages():
            messages[channel.topic] = message
    lines = paths(layout)
    for line in lines:
        topic, path = re.fullmatch(r"(/[\w/]+)(.*)", line["value"]).groups()
        assert isinstance(value_at(messages[topic], path), int | float), line
    joints = [line for line in lines if line["value"].startswith("/joint_states")]
    assert [line["label"] for line in joints] == list(messages["/joint_states"].name)
    scene = layout["configById"]["3D!scene"]
    assert set(scene["topics"]) <= set(messages)
    assert scene["followTf"] in {t.parent_frame_id for t in messages["/tf"].transforms}
    assert layout["configById"]["RosOut!log"]["topicToRender"] == "/log"


def test_settings_of_panels_are_known_to_foxglove(layout: dict[str, Any]) -> None:
    configs = {
        "3D": fl.ThreeDeeConfig, "Plot": fl.PlotConfig, "StateTransitions": fl.StateTransitionsConfig, "RosOut": fl.LogConfig,
    }  # fmt: skip
    lines = {"Plot": fl.PlotSeries, "StateTransitions": fl.StateTransitionsSeries}
    for name, panel in layout["configById"].items():
        kind = name.split("!")[0]
        if kind == "Tab":
            continue
        assert set(panel) - {TITLE} <= set(configs[kind]()._to_dict()), name
        for line in panel.get("paths", []):
            assert set(line) <= set(lines[kind]()._to_dict())
    scene = layout["configById"]["3D!scene"]
    assert set(scene["cameraState"]) <= set(fl.ThreeDeeCameraState()._to_dict())
    assert set(scene["topics"]["/contacts/points"]) <= set(fl.BaseRendererPointCloudTopicSettings()._to_dict())


def test_every_panel_is_in_the_window_once(layout: dict[str, Any]) -> None:
    placed = leaves(layout["layout"])
    placed += [panel for tab in layout["configById"]["Tab!below"]["tabs"] for panel in leaves(tab["layout"])]
    assert sorted(placed) == sorted(layout["configById"])


def test_the_camera_is_where_the_viewpoint_is() -> None:
    """Foxglove turns three.js's spherical coordinates, whose pole is y, about x by a right angle."""
    eye = Viewpoint(np.array([1.0, -2.0, 0.7]), np.array([0.2, 0.1, 0.3]))
    camera = foxglove_layout(["/meshes"], {}, eye)["configById"]["3D!scene"]["cameraState"]
    phi, theta, radius = np.radians(camera["phi"]), -np.radians(camera["thetaOffset"]), camera["distance"]
    x, y, z = radius * np.array([np.sin(phi) * np.sin(theta), np.cos(phi), np.sin(phi) * np.cos(theta)])
    assert np.allclose(np.array([x, -z, y]) + camera["targetOffset"], eye.position, atol=1e-3)


def test_what_a_file_lacks_has_no_panel() -> None:
    layout = foxglove_layout(["/meshes", "/tf"], {}, Viewpoint(np.ones(3), np.zeros(3)))
    assert list(layout["configById"]) == ["3D!scene"] == [layout["layout"]]


def test_the_shipped_layout_is_fresh_and_fits_every_output_of_one_avatar() -> None:
    text = foxglove()
    assert LAYOUT.read_text() == text, "run: python tests/house/output_reference.py"
    topics = {topic for topic, _, _ in channels()}
    assert {re.match(r"/[\w/]+", line["value"])[0] for line in paths(json.loads(text))} <= topics


def test_the_command_writes_it_and_prints_it(landed: Results, tmp_path: Path, capsysbinary: Any) -> None:
    from geomphys_cli.main import run

    out = tmp_path / "layout.json"
    assert run(["export", str(landed.out), "--foxglove", str(out)]) == 0
    assert run(["export", str(landed.out), "--foxglove", str(tmp_path / "layout.txt")]) == 2
    capsysbinary.readouterr()
    assert run(["export", str(landed.out), "--foxglove", "-"]) == 0
    assert capsysbinary.readouterr().out == out.read_bytes()
