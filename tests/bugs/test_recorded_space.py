"""Logs with y up or in millimetres were replayed lying on their side, a thousand times too large, without a word."""

from __future__ import annotations

import json
import math
import tomllib

import pytest
from geomphys_cli.main import run

from geomphys.recording.channels import JointSample, kind_of, make_message_reader
from geomphys.recording.reader import open_log
from tests.authoring.test_scene_draft import twin
from tests.recording.log_files import joints, pose, write_log


def write_twin(source, path, up, unit):
    """The same log, recorded with another axis up and in another unit."""
    items = []
    with open_log(source) as reader:
        for raw in reader.read(set(reader.channels)):
            channel = reader.channels[raw.key]
            kind = kind_of(channel)
            if kind is None:
                continue
            content, time = make_message_reader(channel, kind)(raw.data), raw.log_time / 1e9
            if isinstance(content, JointSample):
                items.append(joints(channel.topic, time, dict(zip(content.names, content.values, strict=True))))
            else:
                items.append(pose(channel.topic, time, twin(content[0].value, up, unit)))
    return write_log(path, items)


def lowest_table(text):
    return tomllib.loads(text)["object"][0]["position"][2]


@pytest.mark.parametrize(("up", "unit"), [("y", "m"), ("z", "mm"), ("y", "mm")])
def test_init_writes_the_space_and_check_agrees(root, tmp_path, capsys, up, unit):
    log = write_twin(root / "recordings" / "wall_slide.mcap", tmp_path / "log.mcap", up, unit)
    urdf, scene = str(root / "assets" / "hand" / "hand.urdf"), tmp_path / "scene.toml"
    assert (
        run(["init", str(root / "recordings" / "wall_slide.mcap"), "--urdf", urdf, "-o", str(tmp_path / "a.toml")]) == 0
    )
    assert run(["init", str(log), "--urdf", urdf, "-o", str(scene)]) == 0
    text = scene.read_text()
    told = capsys.readouterr().out
    assert ("y is up" in told) == (up == "y")
    assert ("lengths are in mm" in told) == (unit == "mm")
    if up == "y" and "# [recording]" in text:
        pytest.fail("y up is only suggested")
    assert tomllib.loads(text)["recording"].get("unit", "m") == unit
    assert lowest_table(text) == pytest.approx(lowest_table((tmp_path / "a.toml").read_text()), abs=2e-3)
    assert run(["check", str(log), "--scene", str(scene), "--json"]) == 0
    assert not {"up_axis", "position_unit"} & {f["key"] for f in json.loads(capsys.readouterr().out)["diagnostics"]}


def test_check_suggests_what_the_scene_does_not_say_and_a_stated_space_silences_it(tmp_path, capsys):
    items = []
    for k in range(120):
        place = (800 * math.sin(k / 20), 1100 + 200 * math.sin(k / 9), 700 * math.cos(k / 15), 0, 0, 0, 1)
        items.append(pose("/hand", 1 + k / 60, place))
    log = write_log(tmp_path / "log.mcap", items)
    (tmp_path / "hand.urdf").write_text(
        '<robot name="h"><link name="palm"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link></robot>'
    )
    base = '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\nmode = "rigid"\nmaterial = "human"\nroot = { topic = "/hand" }\n'
    keys = {}
    for name, table in {
        "nothing": "",
        "unit": '[recording]\nunit = "mm"\n',
        "stated": '[recording]\nunit = "mm"\nup = "z"\n',
        "metres": '[recording]\nunit = "m"\nup = "z"\n',
        "right": '[recording]\nunit = "mm"\nup = "y"\n',
    }.items():
        (tmp_path / "scene.toml").write_text(table + base)
        assert run(["check", str(log), "--scene", str(tmp_path / "scene.toml"), "--json"]) == 0
        keys[name] = {f["key"] for f in json.loads(capsys.readouterr().out)["diagnostics"]}
    assert keys == {
        "nothing": {"position_unit", "up_axis"}, "unit": {"up_axis"}, "stated": set(), "metres": set(), "right": set(),
    }  # fmt: skip


def test_metres_read_as_millimetres_are_told(root, tmp_path, capsys):
    log, scene = root / "recordings" / "wall_slide.mcap", tmp_path / "scene.toml"
    text = (root / "assets" / "scenes" / "wall_slide.toml").read_text().replace('"../', f'"{root}/assets/')
    scene.write_text('[recording]\nunit = "mm"\n' + text)
    assert run(["check", str(log), "--scene", str(scene), "--json"]) == 0
    found = {f["key"]: f["text"] for f in json.loads(capsys.readouterr().out)["diagnostics"]}
    assert 'say unit = "m"' in found["position_unit"]
