"""A package was looked for by the name of its folder alone, and above a relative path not at all."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from geomphys.errors import MeshError
from geomphys.load import load_world
from tests.cli.press import command_line
from tests.scene.models import ball, cube, joint, stl, urdf
from tests.zoo import through_all

MESH = '<link name="palm"><collision><geometry><mesh filename="package://my_hand/meshes/{}.stl"/></geometry></collision></link>'


def checkout(folder: Path, mesh: str = "box") -> Path:
    """A checkout whose folder is called otherwise than its package; returns its URDF."""
    for name in ("urdf", "meshes"):
        (folder / name).mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>my_hand</name></package>")
    stl(folder / "meshes" / "box.stl", *cube(0.04))
    return urdf(folder / "urdf" / "hand.urdf", MESH.format(mesh), ball("tip"), joint("j", "palm", "tip"))


def test_a_checkout_of_another_name_goes_all_the_way(tmp_path: Path) -> None:
    outcome = through_all(checkout(tmp_path / "hand-description-main"), tmp_path)
    assert not outcome.check["findings"]["not_shown"]
    assert outcome.audit["same_world"]


def test_from_its_own_folder_by_a_relative_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = checkout(tmp_path / "my_hand").parent
    (folder.parent / "package.xml").unlink()  # by the folder's name
    (folder / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    monkeypatch.chdir(folder)
    assert len(load_world(Path("scene.toml")).scene.pieces.kind) == 2


def test_a_missing_file_is_no_missing_package(tmp_path: Path) -> None:
    model = checkout(tmp_path / "hand-main", mesh="L-Carpals")
    (model.parent / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    with pytest.raises(MeshError, match=r"link 'palm': .*no such file in the package 'my_hand', which is .*hand-main"):
        load_world(model.parent / "scene.toml")


def test_a_world_is_read_anew_when_its_package_moves(tmp_path: Path) -> None:
    model = checkout(tmp_path / "hand-main")
    (tmp_path / "scene.toml").write_text('[[avatar]]\nname = "hand"\nurdf = "hand-main/urdf/hand.urdf"\n')
    load_world(tmp_path / "scene.toml")
    (model.parent.parent / "package.xml").write_text("<package><name>renamed</name></package>")
    with pytest.raises(MeshError, match="package 'my_hand' was not found"):
        load_world(tmp_path / "scene.toml")


def test_the_shared_case(shared_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = shared_dir / "cases" / "package_by_its_xml"
    done = command_line("check", case / "ok.mcap", "-s", case / "hand-description" / "urdf" / "scene.toml")
    assert done.returncode == 0, done.stderr
    monkeypatch.chdir(case / "run_from_its_folder" / "my_hand_description" / "urdf")
    done = command_line("check", "../../../ok.mcap", "-s", "scene.toml")
    assert done.returncode == 0, done.stderr
    copy = tmp_path / "copy"
    shutil.copytree(case / "hand-description", copy)
    (copy / "meshes" / "box.stl").unlink()
    done = command_line("check", case / "ok.mcap", "-s", copy / "urdf" / "scene.toml")
    assert done.returncode == 1
    assert "no such file in the package 'my_hand_description'" in done.stderr
