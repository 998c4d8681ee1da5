"""A good model was refused for a visual of no size, without its file, or that cannot be read."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import InputError
from geomphys.load import load_world
from tests.cli.press import command_line
from tests.scene.models import ball, cube, joint, stl, urdf
from tests.zoo import through_all

LINK = (
    '<link name="palm"><{0}><geometry>{1}</geometry></{0}>'
    '<collision><geometry><sphere radius="0.05"/></geometry></collision></link>'
)
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"ab" * 32 + b"\nsize 68484\n"
MESH = '<mesh filename="{}"/>'
WRONG = {
    "no size": '<box size="0 0 0"/>',
    "a shape that is none": "<ellipsoid/>",
    "no file": MESH.format("m/not_here.dae"),
    "no package": MESH.format("package://nowhere/a.stl"),
    "xacro remnant": MESH.format("cable_${hand_version}.dae"),
    "cut off": MESH.format("cut.stl"),
    "LFS pointer": MESH.format("pointer.stl"),
    "no mesh": MESH.format("a.txt"),
    "no points": MESH.format("empty.obj"),
}


def model(folder: Path, kind: str, shape: str) -> Path:
    data = stl(folder / "cut.stl", *cube()).read_bytes()
    (folder / "cut.stl").write_bytes(data[:300])
    (folder / "pointer.stl").write_bytes(POINTER)
    (folder / "empty.obj").write_bytes(b"")
    return urdf(folder / "hand.urdf", LINK.format(kind, shape), ball("tip"), joint("j", "palm", "tip"))


@pytest.mark.parametrize("shape", WRONG.values(), ids=WRONG.keys())
def test_a_wrong_visual_is_a_warning(tmp_path: Path, shape: str) -> None:
    outcome = through_all(model(tmp_path, "visual", shape), tmp_path)
    (line,) = outcome.check["warnings"]
    assert "hand.urdf: a visual is not shown: link 'palm'" in line
    assert [m["text"] for m in outcome.replay["messages"] if "not shown" in m["text"]] == [line]
    assert outcome.audit["same_world"]


@pytest.mark.parametrize("shape", WRONG.values(), ids=WRONG.keys())
def test_a_wrong_collision_shape_is_an_error(tmp_path: Path, shape: str) -> None:
    model(tmp_path, "collision", shape)
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    with pytest.raises(InputError) as caught:
        load_world(tmp_path / "scene.toml")
    assert str(tmp_path / "hand.urdf") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_visual_that_comes_back_is_shown(tmp_path: Path) -> None:
    model(tmp_path, "visual", MESH.format("later.stl"))
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    first = load_world(tmp_path / "scene.toml")
    stl(tmp_path / "later.stl", *cube(0.1))
    second = load_world(tmp_path / "scene.toml")
    assert first.findings.warnings
    assert not second.findings.warnings
    assert len(second.triangles[0][1]) == 12


def test_many_are_told_in_one_line(tmp_path: Path) -> None:
    links = [LINK.replace("palm", f"l{k}").format("visual", MESH.format(f"{k}.dae")) for k in range(9)]
    urdf(tmp_path / "hand.urdf", *links, *(joint(f"j{k}", "l0", f"l{k}") for k in range(1, 9)))
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    world = load_world(tmp_path / "scene.toml")
    (line,) = world.findings.warnings
    assert "9 visuals are not shown" in line
    assert line.endswith("and 6 more")
    assert len(world.findings.not_shown) == 9


def test_the_shared_case(shared_dir: Path) -> None:
    case = shared_dir / "cases" / "visuals_that_do_not_matter"
    for scene in ("zero_box.toml", "missing_visual.toml"):
        for command in ("check", "replay"):
            done = command_line(command, case / "ok.mcap", "-s", case / scene)
            assert done.returncode == 0, done.stderr
            assert "not shown" in done.stdout


def test_the_log_has_the_warning_at_its_first_frame(tmp_path: Path) -> None:
    from geomphys.output.output_log import open_output

    outcome = through_all(model(tmp_path, "visual", WRONG["no size"]), tmp_path)
    rows = [(frame.index, row.text) for frame in open_output(outcome.out).frames(["/log"]) for row in frame.log]
    assert [index for index, text in rows if "not shown" in text] == [0]


def test_a_package_that_comes_to_be_beside_the_model_is_found(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    model(tmp_path / "models", "visual", MESH.format("package://parts/later.stl"))
    (tmp_path / "models" / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    assert load_world(tmp_path / "models" / "scene.toml").findings.warnings
    (tmp_path / "checkout").mkdir()
    (tmp_path / "checkout" / "package.xml").write_text("<package><name>parts</name></package>")
    stl(tmp_path / "checkout" / "later.stl", *cube(0.1))
    assert not load_world(tmp_path / "models" / "scene.toml").findings.warnings
