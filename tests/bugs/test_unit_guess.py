"""`init` took radians for degrees where limits were 0..0 or signs differed, and `check` then contradicted it both ways."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from geomphys_cli.main import run

import geomphys
from tests.recording.log_files import joints, pose, write_log

HAND = """<robot name="hand">
  <link name="palm"><collision><geometry><box size="0.08 0.08 0.03"/></geometry></collision></link>
  {links}
</robot>
"""
FINGER = """<link name="{name}"><collision><geometry><box size="0.02 0.015 0.015"/></geometry></collision></link>
  <joint name="{name}_flex" type="{kind}"><parent link="palm"/><child link="{name}"/><origin xyz="0.1 {y} 0"/>
    <axis xyz="0 1 0"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/></joint>
"""
NAMES = ("index", "middle", "ring", "little")


def write_case(folder: Path, values: dict[str, float], limits=(-0.2, 1.6), kind: str = "revolute") -> None:
    """A log in which each joint swings from 0 to its value, and a hand with these limits."""
    links = [FINGER.format(name=n, kind=kind, y=0.03 * k, low=limits[0], high=limits[1]) for k, n in enumerate(NAMES)]
    (folder / "hand.urdf").write_text(HAND.format(links="".join(links)))
    items = []
    for k in range(60):
        share = 0.5 - 0.5 * math.cos(k / 8)
        items.append(pose("/tracker/wrist", 1 + k / 50, (0.01 * share, 0.0, 0.9, 0, 0, 0, 1)))
        items.append(joints("/glove", 1 + k / 50, {f"{n}_flex": share * v for n, v in values.items()}))
    write_log(folder / "log.mcap", items)


def drafted(folder: Path, capsys: pytest.CaptureFixture[str], **more: str) -> tuple[str, dict]:
    """The unit that `init` writes, and what `check` finds in that scene (`more`: changed lines)."""
    scene = folder / "scene.toml"
    assert (
        run(["init", str(folder / "log.mcap"), "--urdf", str(folder / "hand.urdf"), "-o", str(scene), "--force"]) == 0
    )
    text = scene.read_text()
    for old, new in more.items():
        text = text.replace(f'unit = "{old}"', f'unit = "{new}"')
    scene.write_text(text)
    capsys.readouterr()
    assert run(["check", str(folder / "log.mcap"), "--scene", str(scene), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["diagnostics"]
    return text, {f["key"]: f["text"] for f in found}


@pytest.mark.parametrize("limits", [(-0.2, 1.6), (0.0, 0.0), (0.0, 0.05), (1.6, 1.6)])
@pytest.mark.parametrize("top", [1.0, 3.0, 6.0, -1.0])
def test_small_values_are_radians_whatever_the_limits(tmp_path, capsys, limits, top) -> None:
    write_case(tmp_path, dict.fromkeys(NAMES, top), limits)
    text, found = drafted(tmp_path, capsys)
    assert 'unit = "rad"' in text
    assert "angle_unit" not in found


@pytest.mark.parametrize("limits", [(-0.2, 1.6), (0.0, 0.0)])
def test_a_glove_in_degrees_is_one_for_both(tmp_path, capsys, limits) -> None:
    write_case(tmp_path, {"index": 90.0, "middle": 80.0, "ring": 3.0, "little": 0.5}, limits)
    text, found = drafted(tmp_path, capsys)
    assert 'unit = "deg"' in text
    assert "angle_unit" not in found
    _, found = drafted(tmp_path, capsys, deg="rad")
    assert 'say unit = "deg"' in found["angle_unit"]
    assert "whole turn" in found["angle_unit"]


def test_radians_read_as_degrees_are_told(tmp_path, capsys) -> None:
    write_case(tmp_path, dict.fromkeys(NAMES, 1.2))
    _, found = drafted(tmp_path, capsys, rad="deg")
    assert 'say unit = "rad"' in found["angle_unit"]


def test_lengths_are_no_angles(tmp_path, capsys) -> None:
    write_case(tmp_path, dict.fromkeys(NAMES, 0.04), (0.0, 0.05), "prismatic")
    text, found = drafted(tmp_path, capsys)
    assert "there is no angle to judge by" in text
    assert not {"angle_unit", "angle_sign", "no_angles"} & found.keys()


def test_opposite_signs_are_told_by_both_and_put_right_by_what_they_say(tmp_path, capsys) -> None:
    write_case(tmp_path, {"index": -1.2, "middle": -1.0, "ring": 1.0, "little": -0.1})
    text, found = drafted(tmp_path, capsys)
    (line,) = [line for line in text.splitlines() if line.startswith("# sign = ")]
    assert line == '# sign = { "index_flex" = -1, "middle_flex" = -1 }'
    assert "sign = { index_flex = -1, middle_flex = -1 }" in found["angle_sign"]
    scene = tmp_path / "scene.toml"
    scene.write_text(text.replace("# sign = ", "sign = "))
    capsys.readouterr()
    assert run(["check", str(tmp_path / "log.mcap"), "--scene", str(scene), "--strict"]) == 0


@pytest.mark.parametrize(("low", "top", "says"), [(0.0, 1023.0, "shares of a range"), (0.0, 1.0, "shares of a range")])
def test_sensor_values_are_told_as_no_angles(tmp_path, capsys, low, top, says) -> None:
    items = [
        joints("/glove", 1 + k / 50, {f"{n}_flex": (low, top, 0.3 * top)[k % 3] for n in NAMES}) for k in range(60)
    ]
    write_case(tmp_path, dict.fromkeys(NAMES, 1.0))
    write_log(tmp_path / "log.mcap", [*items, *(pose("/p", 1 + k / 50, (0, 0, 0.9, 0, 0, 0, 1)) for k in range(60))])
    text, found = drafted(tmp_path, capsys)
    assert says in text
    assert says in found["no_angles"]


def test_the_reported_logs(shared_dir, tmp_path, capsys) -> None:
    case = shared_dir / "cases" / "unit_guess_contradicts"
    for log, urdf in (("ok", "hand"), ("ok", "zero_limits"), ("sign", "hand"), ("sign", "zero_limits")):
        for name, source in (("log.mcap", f"{log}.mcap"), ("hand.urdf", f"{urdf}.urdf")):
            (tmp_path / name).write_bytes((case / source).read_bytes())
        text, found = drafted(tmp_path, capsys)
        assert 'unit = "rad"' in text
        assert "angle_unit" not in found
        assert ("angle_sign" in found) == ((log, urdf) == ("sign", "hand"))


def test_no_real_recording_is_taken_for_another_unit_or_sign(shared_dir, tmp_path) -> None:
    models, recordings = shared_dir / "models", shared_dir / "recordings"
    for log, urdf in (
        ("adroit_door_00_ros2", "adroit/adroit_hand.urdf"),
        ("cmu_02_06_protobuf", "cmu_body/cmu_subject_02.urdf"),
        ("dfki_pillow_a_ros2", "human_hands/dfki_glove_right.urdf"),
        ("leap_grab_protobuf", "human_hands/leap_grab_right.urdf"),
    ):
        (avatar,) = geomphys.draft_scene(recordings / f"{log}.mcap", [models / urdf], folder=tmp_path).avatars
        assert (avatar.unit.unit, avatar.unit.doubt, avatar.mirrored) == ("rad", "", ())
