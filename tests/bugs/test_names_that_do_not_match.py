"""Where no recorded joint had a name of the URDF, `init` left nothing to go on with, nor did `check` say what stands still."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path

import pytest
from geomphys_cli.main import run

import geomphys
from tests.recording.log_files import joints, pose, write_log

LINK = """<link name="{link}"><collision><geometry><box size="0.02 0.01 0.01"/></geometry></collision></link>
  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{link}"/><origin xyz="{at}"/>
    <axis xyz="{axis}"/><limit lower="-0.4" upper="1.6" effort="1" velocity="1"/></joint>
"""


def write_hand(folder: Path, names: dict[str, list[str]], stem: str = "right_hand") -> Path:
    """A hand of boxes: finger -> names of its joints from the palm on, of which the first of four spreads."""
    parts = ['<link name="palm"><collision><geometry><box size="0.08 0.08 0.02"/></geometry></collision></link>']
    for k, (finger, own) in enumerate(names.items()):
        parent = "palm"
        for i, name in enumerate(own):
            at = f"0.0{2 if finger == 'thumb' else 6} {0.05 - 0.025 * k} 0" if i == 0 else "0.03 0 0"
            axis = "0 0 1" if i == 0 and len(own) == 4 else "0 1 0"
            link = f"link_{k}_{i}"
            parts.append(LINK.format(link=link, name=name, parent=parent, at=at, axis=axis))
            parent = link
    path = folder / f"{stem}.urdf"
    path.write_text(f'<robot name="{stem}">{"".join(parts)}</robot>')
    return path


def write_glove(folder: Path, names: list[str]) -> Path:
    items = []
    for k in range(40):
        items.append(pose("/wrist", 1 + k / 50, (0.1, 0.02 * math.sin(k / 5), 0.9, 0, 0, 0, 1)))
        items.append(joints("/glove", 1 + k / 50, {n: 0.4 + 0.3 * math.sin(k / 6 + i) for i, n in enumerate(names)}))
    return write_log(folder / "log.mcap", items)


FINGERS = ("thumb", "index", "middle", "ring", "little")
SHADOW = {f: [f"{p}J{k}" for k in (4, 3, 2, 1)] for f, p in zip(FINGERS, ("TH", "FF", "MF", "RF", "LF"), strict=True)}
PLAIN = {f: [f"right_{f}_{k}_joint" for k in (1, 2, 3, 4)] for f in FINGERS}
GLOVE = {
    f: [f"{f.title()}{s}" for s in ("MCPSpread", "MCPStretch", "PIPStretch", "DIPStretch")] for f in FINGERS
}  # of a thumb: what Manus calls its joints
SENSE = {f: [f"{f}_{s}" for s in (("cmc_aa", "cmc_fle", "mcp_fle", "ip_fle") if f == "thumb" else
                                  ("mcp_aa", "mcp_fle", "pip_fle", "dip_fle"))] for f in FINGERS}  # fmt: skip


@pytest.mark.parametrize("glove", [GLOVE, SENSE], ids=["manus", "senseglove"])
@pytest.mark.parametrize("robot", [SHADOW, PLAIN], ids=["shadow", "numbers"])
def test_a_glove_is_renamed_to_a_robot_hand(tmp_path, glove, robot) -> None:
    urdf = write_hand(tmp_path, robot)
    log = write_glove(tmp_path, [n for own in glove.values() for n in own])
    draft = geomphys.draft_scene(log, [urdf], folder=tmp_path)
    rename = tomllib.loads(draft.text)["avatar"][0]["joints"]["rename"]
    assert rename == {g: r for f in FINGERS for g, r in zip(glove[f], robot[f], strict=True)}
    scene = tmp_path / "scene.toml"
    draft.write(scene)
    assert run(["check", str(log), "--scene", str(scene), "--strict"]) == 0


def test_no_name_alike_leaves_lines_to_fill_in_and_check_says_what_stands_still(tmp_path, capsys) -> None:
    urdf = write_hand(tmp_path, {"thumb": ["alpha", "beta"], "index": ["gamma", "delta"]}, "hand")
    log, scene = write_glove(tmp_path, ["p", "q", "r"]), tmp_path / "scene.toml"
    assert run(["init", str(log), "--urdf", str(urdf), "-o", str(scene)]) == 0
    assert "so all stand still; names to fill in are in comments" in " ".join(capsys.readouterr().out.split())
    text = scene.read_text()
    assert [line for line in text.splitlines() if line.endswith('= ""')] == ['# "p" = ""', '# "q" = ""', '# "r" = ""']
    assert "alpha, gamma, beta, delta" in text
    assert run(["check", str(log), "--scene", str(scene), "--json"]) == 0
    (diagnostic,) = json.loads(capsys.readouterr().out)["diagnostics"]
    assert diagnostic["key"] == "joints_without_topic"
    assert "the 4 joints of hand stand still" in diagnostic["text"]
    filled = text.replace('# "p" = ""', '"p" = "alpha"')
    for line in ("[avatar.joints]", 'topic = "/glove"', 'unit = "rad"', "[avatar.joints.rename]"):
        filled = filled.replace(f"# {line}", line)
    scene.write_text(filled)
    assert run(["check", str(log), "--scene", str(scene), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [j["joint"] for j in report["joints"]] == ["alpha"]
    found = {f["key"]: f["text"] for f in report["diagnostics"]}
    assert all(n in found["unmatched_joints"] for n in ("beta", "gamma", "delta"))


def test_what_is_meant_so_is_silenced_by_ignore_also_under_strict(tmp_path, capsys) -> None:
    urdf = write_hand(tmp_path, {f: SENSE[f] for f in FINGERS if f != "little"})
    log, scene = write_glove(tmp_path, [n for f in FINGERS if f != "thumb" for n in SENSE[f]]), tmp_path / "scene.toml"
    assert run(["init", str(log), "--urdf", str(urdf), "-o", str(scene)]) == 0
    assert run(["check", str(log), "--scene", str(scene), "--strict"]) == 1
    text = scene.read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("# ignore = ")]
    assert "little_mcp_aa" in line
    scene.write_text(text.replace(line, 'ignore = ["little_*", "thumb_*"]'))
    capsys.readouterr()
    assert run(["check", str(log), "--scene", str(scene), "--strict"]) == 0


def test_public_hands(shared_dir, tmp_path) -> None:
    models = shared_dir / "models"
    log = write_glove(tmp_path, [n for own in GLOVE.values() for n in own])
    for urdf, expected in (
        ("adroit/adroit_hand.urdf", {"IndexMCPSpread": "FFJ3", "RingPIPStretch": "RFJ1", "ThumbDIPStretch": "THJ0"}),
        ("allegro_right/allegro_hand_right.urdf", {"IndexMCPSpread": "joint_0.0", "ThumbPIPStretch": "joint_14.0"}),
        ("human_hands/leap_grab_right.urdf", {"LittleDIPStretch": "right_little_dip_flex"}),
    ):
        draft = geomphys.draft_scene(log, [models / urdf], folder=tmp_path)
        rename = tomllib.loads(draft.text)["avatar"][0]["joints"]["rename"]
        assert expected.items() <= rename.items()
