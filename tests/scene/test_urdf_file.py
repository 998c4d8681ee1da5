"""The text of a URDF: what is read, what is refused, where its meshes may lie."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geomphys.errors import InputError, MeshError, ModelError
from geomphys.scene import urdf_file
from geomphys.scene.primitives import PrimitiveShape
from geomphys.scene.ros_packages import MeshResolver
from geomphys.scene.skeleton import load_skeleton
from geomphys.scene.urdf_file import MeshShape, read_urdf
from tests.scene.models import ball, joint, link, urdf

MESH = '<geometry><mesh filename="{}"{}/></geometry>'


def test_every_shape_is_read_with_its_place(tmp_path: Path) -> None:
    path = urdf(
        tmp_path / "a.urdf",
        link(
            "a",
            '<origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/><geometry><box size="1 2 3"/></geometry>',
            '<geometry><sphere radius="0.5"/></geometry>',
            '<geometry><cylinder radius="0.5" length="2"/></geometry>',
            MESH.format("meshes/a.stl", ' scale="0.001 0.001 -0.001"'),
            MESH.format("b.obj", ' scale="2"'),
        ),
    )
    shapes = read_urdf(path).links[0].collisions
    assert shapes[0][0] == PrimitiveShape("box", (1.0, 2.0, 3.0))
    assert shapes[0][1][:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert shapes[0][1][1, 0] == pytest.approx(1.0)
    assert shapes[1][0] == PrimitiveShape("sphere", (0.5,))
    assert shapes[1][1].tolist() == [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    assert shapes[2][0] == PrimitiveShape("cylinder", (0.5, 2.0))
    assert shapes[3][0] == MeshShape(tmp_path / "meshes/a.stl", (0.001, 0.001, -0.001))
    assert shapes[4][0] == MeshShape(tmp_path / "b.obj", (2.0, 2.0, 2.0))


def test_meshes_by_every_kind_of_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "robots" / "my_hand" / "urdf"
    folder.mkdir(parents=True)
    mesh = tmp_path / "robots" / "my_hand" / "meshes" / "a.stl"
    mesh.parent.mkdir()
    mesh.touch()
    spaced = tmp_path / "a b.stl"
    assert MeshResolver(folder).find("../meshes/a.stl") == folder / "../meshes/a.stl"
    assert MeshResolver(folder).find(f"file://{mesh}") == mesh
    assert MeshResolver(folder).find(f"file://localhost{mesh}") == mesh
    assert MeshResolver(folder).find(f"file://{tmp_path}/a%20b.stl") == spaced
    assert MeshResolver(folder).find("package://my_hand/meshes/a.stl") == mesh
    elsewhere = tmp_path / "other.urdf"
    with pytest.raises(MeshError, match="package 'my_hand' was not found"):
        MeshResolver(elsewhere.parent).find("package://my_hand/meshes/a.stl")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{tmp_path / 'robots'}")
    assert MeshResolver(elsewhere.parent).find("package://my_hand/meshes/a.stl") == mesh
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(mesh.parent.parent))
    assert MeshResolver(elsewhere.parent).find("package://my_hand/meshes/a.stl") == mesh
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    installed = tmp_path / "install" / "share" / "my_hand" / "b.stl"
    installed.parent.mkdir(parents=True)
    installed.touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    assert MeshResolver(elsewhere.parent).find("package://my_hand/b.stl") == installed


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("http://example.com/a.stl", "only file://, package:// and relative paths"),
        ("https://example.com/a.stl", "only file://"),
        ("ftp://a/b.stl", "only file://"),
        ("file://example.com/a.stl", "lies on another machine"),
        ("package://nowhere/a.stl", "package 'nowhere' was not found"),
    ],
)
def test_nothing_is_fetched(tmp_path: Path, name: str, says: str) -> None:
    path = urdf(tmp_path / "a.urdf", link("a", MESH.format(name, "")))
    with pytest.raises(MeshError, match=says) as caught:
        load_skeleton(path)
    assert name in str(caught.value)


def bad(tmp_path: Path, text: str | bytes) -> str:
    """What is said about a URDF."""
    path = tmp_path / "bad.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ModelError) as caught:
        load_skeleton(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    return message.removeprefix(f"{path}: ")


def test_entities_and_dtds_are_refused_and_never_shown(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("hidden words")
    for declaration in (f'<!ENTITY x SYSTEM "file://{secret}">', '<!ENTITY x "y">'):
        text = f'<!DOCTYPE r [{declaration}]><robot name="&x;"><link name="a"/></robot>'
        message = bad(tmp_path, text)
        assert "declares entities or a DTD" in message
        assert "hidden" not in message
    assert "DTD" in bad(tmp_path, '<!DOCTYPE robot SYSTEM "http://example.com/r.dtd"><robot name="a"/>')


def test_an_include_stays_a_word(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text('<link name="hidden"/>')
    path = tmp_path / "a.urdf"
    path.write_text(
        '<robot name="r" xmlns:xi="http://www.w3.org/2001/XInclude"><link name="a"/>'
        f'<xi:include href="{secret}"/></robot>'
    )
    assert [entry.name for entry in load_skeleton(path).links] == ["a"]


def numbers(element: str) -> str:
    return f'<robot name="r">{link("a", element)}</robot>'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("<robot name='r'>\n<link></robot>", "not well-formed XML at line 2"),
        (b"\xff\xfe\x00", "not well-formed XML"),
        ('<?xml version="1.0" encoding="nonsense"?><robot/>', "not XML text in a known encoding|not well-formed"),
        ("<sdf/>", "the outermost element is <'sdf'>, expected <robot>"),
        ("<robot/>", "<robot> has no name"),
        ('<robot name="r"/>', "has no links"),
        ('<robot name="r"><link/></robot>', "link number 1 has no usable name"),
        ('<robot name="r"><link name="a&#10;b"/></robot>', "link number 1 has no usable name ('a b')"),
        ('<robot name="r"><link name="a&#27;"/></robot>', "not well-formed XML"),
        (f'<robot name="r">{link("a")}{link("a")}</robot>', "two links are named 'a'"),
        (
            f'<robot name="r">{link("a")}{link("b")}{joint("j", "a", "b", "ball")}</robot>',
            "joint 'j' has the type 'ball', only fixed, revolute, continuous, prismatic are supported",
        ),
        (
            '<robot name="r"><link name="a"/><joint name="j" type="fixed"/></robot>',
            "joint 'j' has no <parent link=...>",
        ),
        (numbers("<geometry/>"), "link 'a' has a <collision> of nothing"),
        (numbers(""), "link 'a' has a <collision> of nothing"),
        (numbers("<geometry><ellipsoid/></geometry>"), "of 'ellipsoid', expected one of box, sphere"),
        (numbers('<geometry><capsule radius="1"/></geometry>'), "link 'a': <capsule> has no length"),
        (numbers('<geometry><capsule radius="0" length="1"/></geometry>'), "a capsule of [0.0, 1.0] m"),
        (numbers("<geometry><mesh/></geometry>"), "a <mesh> without a filename"),
        (numbers("<geometry><sphere/></geometry>"), "link 'a': <sphere> has no radius"),
        (numbers('<geometry><sphere radius="big"/></geometry>'), "<sphere radius='big'>, expected numbers"),
        (numbers('<geometry><sphere radius="nan"/></geometry>'), "link 'a': <sphere radius='nan'>, expected finite"),
        (numbers('<geometry><sphere radius="-1"/></geometry>'), "a sphere of [-1.0] m"),
        (numbers('<geometry><box size="1 2"/></geometry>'), "<box size='1 2'>, expected 3 numbers"),
        (
            numbers('<origin xyz="1 2 inf"/><geometry><sphere radius="1"/></geometry>'),
            "<origin xyz='1 2 inf'>, expected finite numbers",
        ),
        (
            numbers('<origin rpy="1 2 1e300"/><geometry><sphere radius="1"/></geometry>'),
            "<origin rpy='1 2 1e300'>, expected finite",
        ),
        (numbers('<geometry><mesh filename="a.stl" scale="0 1 1"/></geometry>'), "a mesh has a scale of 0"),
        (f'<robot name="r">{"<a>" * 100}{"</a>" * 100}</robot>', "nested deeper than 32"),
        (f'<robot name="r">{"<a>" * 100_000}{"</a>" * 100_000}</robot>', "nested deeper than 32|not well-formed"),
    ],
)
def test_faults_are_named_with_their_element(tmp_path: Path, text: str | bytes, says: str) -> None:
    message = bad(tmp_path, text)
    assert any(part in message for part in says.split("|")), message


def test_a_model_of_too_many_links(tmp_path: Path) -> None:
    assert "has 2001 links, expected 1 to 2000" in bad(
        tmp_path, f'<robot name="r">{"".join(link(f"l{k}") for k in range(2001))}</robot>'
    )


def test_missing_and_large_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ModelError, match="no such URDF"):
        read_urdf(tmp_path / "none.urdf")
    with pytest.raises(ModelError, match="is not a file"):
        read_urdf(tmp_path)
    monkeypatch.setattr(urdf_file, "MAX_FILE_BYTES", 10)
    with pytest.raises(ModelError, match="is larger than"):
        read_urdf(urdf(tmp_path / "a.urdf", ball("a")))


GOOD = f'<robot name="r">{ball("a")}{ball("b")}{joint("ab", "a", "b")}</robot>'


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_damaged_urdf_raises_anything_else(tmp_path: Path, data: st.DataObject) -> None:
    text = GOOD
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text) - 1))
        insert = data.draw(
            st.sampled_from(["", "0", "nan", '"', "<", ">", "1e999", "-", "é", "&amp;", "<link/>", "\x00"])
        )
        text = text[:at] + insert + text[at + data.draw(st.integers(0, 12)) :]
    path = tmp_path / "fuzz.urdf"
    path.write_text(text)
    message = ""
    try:
        load_skeleton(path)
    except InputError as error:
        message = str(error)
    assert message == "" or message.isprintable()
