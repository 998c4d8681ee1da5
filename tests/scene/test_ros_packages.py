"""Where ``package://`` leads: names of folders, of package.xml, of the environment; what is not there; bounded work."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import MeshError
from geomphys.scene import ros_packages
from geomphys.scene.ros_packages import MeshResolver

NAME = "package://my_hand/meshes/box.stl"


def package(folder: Path, name: str = "my_hand", mesh: bool = True) -> Path:
    """A package whose folder is called otherwise; returns its mesh."""
    (folder / "meshes").mkdir(parents=True)
    (folder / "urdf").mkdir()
    (folder / "package.xml").write_text(f'<?xml version="1.0"?><package format="3"><name> {name} </name></package>')
    if mesh:
        (folder / "meshes" / "box.stl").touch()
    return folder / "meshes" / "box.stl"


def test_by_the_package_xml_above(tmp_path: Path) -> None:
    mesh = package(tmp_path / "checkout-1.2")
    assert MeshResolver(tmp_path / "checkout-1.2" / "urdf").find(NAME) == mesh
    assert MeshResolver(tmp_path / "checkout-1.2" / "urdf" / "deep" / "er").find(NAME) == mesh


def test_by_the_package_xml_of_a_folder_beside_those_above(tmp_path: Path) -> None:
    mesh = package(tmp_path / "src" / "meshes-of-hand")
    package(tmp_path / "src" / "description", "my_description")
    assert MeshResolver(tmp_path / "src" / "description" / "urdf").find(NAME) == mesh


def test_by_the_environment_and_its_package_xml(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = package(tmp_path / "workspace" / "hand-main")
    (tmp_path / "elsewhere").mkdir()
    with pytest.raises(MeshError, match="was not found"):
        MeshResolver(tmp_path / "elsewhere").find(NAME)
    for path in (tmp_path / "workspace", tmp_path / "workspace" / "hand-main"):
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(path))
        assert MeshResolver(tmp_path / "elsewhere").find(NAME) == mesh


def test_from_the_urdfs_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = package(tmp_path / "my_hand")
    monkeypatch.chdir(tmp_path / "my_hand" / "urdf")
    assert MeshResolver(Path()).find(NAME) == mesh
    assert MeshResolver(Path("../urdf")).find(NAME) == mesh
    package(tmp_path / "other", "by_xml")
    monkeypatch.chdir(tmp_path / "other" / "urdf")
    assert (
        MeshResolver(Path()).find("package://by_xml/meshes/box.stl").samefile(tmp_path / "other" / "meshes" / "box.stl")
    )


def test_through_a_link_to_the_urdfs_folder(tmp_path: Path) -> None:
    mesh = package(tmp_path / "src" / "hand-main")
    installed = tmp_path / "install" / "share"
    installed.mkdir(parents=True)
    (installed / "urdf").symlink_to(tmp_path / "src" / "hand-main" / "urdf")
    assert MeshResolver(installed / "urdf").find(NAME).samefile(mesh)


def test_a_missing_file_is_told_apart_from_a_missing_package(tmp_path: Path) -> None:
    package(tmp_path / "hand-main", mesh=False)
    with pytest.raises(MeshError, match=r"no such file in the package 'my_hand', which is .*hand-main"):
        MeshResolver(tmp_path / "hand-main" / "urdf").find(NAME)
    with pytest.raises(MeshError, match="package 'your_hand' was not found in the folders above"):
        MeshResolver(tmp_path / "hand-main" / "urdf").find("package://your_hand/a.stl")


def test_the_package_that_has_the_file_counts(tmp_path: Path) -> None:
    (tmp_path / "a" / "my_hand").mkdir(parents=True)  # so named, and empty
    mesh = package(tmp_path / "a" / "hand-main")
    assert MeshResolver(tmp_path / "a" / "hand-main" / "urdf").find(NAME) == mesh


@pytest.mark.parametrize(
    "manifest",
    [
        '<!DOCTYPE p [<!ENTITY x "my_hand">]><package><name>&x;</name></package>',
        "<package><name>my_hand</name>",
        "<other><name>my_hand</name></other>",
        f"<package><name>my_hand</name><!--{'x' * ros_packages.MAX_MANIFEST_BYTES}--></package>",
        "",
    ],
)
def test_manifests_that_are_none_are_passed_by(tmp_path: Path, manifest: str) -> None:
    package(tmp_path / "hand-main")
    (tmp_path / "hand-main" / "package.xml").write_text(manifest)
    with pytest.raises(MeshError, match="was not found"):
        MeshResolver(tmp_path / "hand-main" / "urdf").find(NAME)


def test_the_search_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ros_packages, "MAX_SIBLINGS", 3)
    for k in range(5):
        package(tmp_path / f"package_{k}", f"name_{k}")
    package(tmp_path / "urdfs", "mine")
    assert MeshResolver(tmp_path / "urdfs" / "urdf").find("package://name_2/meshes/box.stl")
    with pytest.raises(MeshError, match="was not found"):
        MeshResolver(tmp_path / "urdfs" / "urdf").find("package://name_4/meshes/box.stl")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("package://", "expected package://PACKAGE/PATH"),
        ("package://my_hand", "expected package://PACKAGE/PATH"),
        ("package:///etc/passwd.stl", "expected package://PACKAGE/PATH"),
        ("package://../a.stl", "expected package://PACKAGE/PATH"),
        ("model://my_hand/a.stl", "only file://, package:// and relative paths"),
        ("http://host/a.stl", "only file://, package:// and relative paths"),
        ("file://host/a.stl", "lies on another machine"),
        ("meshes/${side}.stl", "holds an expression that xacro fills in"),
        ("file://$(find my_hand)/a.stl", "holds an expression that xacro fills in"),
        ("a\0.stl", "is not a path"),
        (f"package://{'p' * 5000}/a.stl", "was not found"),
        (f"package://my_hand/{'p' * 5000}.stl", "was not found"),
    ],
)
def test_names_that_lead_nowhere(tmp_path: Path, name: str, says: str) -> None:
    with pytest.raises(MeshError, match=says.replace("(", r"\(")):
        MeshResolver(tmp_path).find(name)


def test_a_path_in_a_package_does_not_begin_at_the_root(tmp_path: Path) -> None:
    mesh = package(tmp_path / "hand-main")
    assert MeshResolver(mesh.parent.parent / "urdf").find("package://my_hand//meshes/box.stl") == mesh
