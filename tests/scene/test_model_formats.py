"""Files that are named as a URDF and are none, and a visual or two that are wrong in one that is."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.errors import ModelError
from geomphys.scene.primitives import PrimitiveShape
from geomphys.scene.skeleton import load_skeleton
from geomphys.scene.urdf_file import read_urdf
from tests.scene.models import ball, joint, link, urdf

XMLNS = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
RADIUS = '<geometry><sphere radius="${r}"/></geometry>'
FOUND = '<geometry><mesh filename="$(find p)/a.stl"/></geometry>'
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"ab" * 32 + b"\nsize 68484\n"


def refusal(path: Path, data: str | bytes) -> str:
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    with pytest.raises(ModelError) as caught:
        load_skeleton(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize(
    "body",
    [
        f'<robot name="r" {XMLNS}><xacro:include filename="a.xacro"/>{ball("a")}</robot>',
        f'<robot name="r" {XMLNS}><xacro:macro name="m">{ball("a")}</xacro:macro>{ball("b")}</robot>',
        f'<robot name="${{name}}" {XMLNS}>{ball("a")}</robot>',
        f'<robot name="r">{ball("${prefix}a")}</robot>',
        f'<robot name="r">{link("a", RADIUS)}</robot>',
        f'<robot name="r">{ball("a")}{ball("b")}{joint("j", "a", "b", xyz="0 0 ${length}")}</robot>',
        f'<robot name="r">{link("a", FOUND)}</robot>',
        f'<robot name="r"><xacro:arg name="x"/>{ball("a")}</robot>',  # its prefix is nowhere declared
    ],
)
@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("hand.urdf.xacro", "xacro hand.urdf.xacro > hand.urdf"),
        ("hand.xacro", "xacro hand.xacro > hand.urdf"),
        ("hand.urdf", "xacro hand.urdf > hand_expanded.urdf"),
    ],
)
def test_a_xacro_file_says_how_to_make_a_urdf_of_it(tmp_path: Path, body: str, name: str, command: str) -> None:
    message = refusal(tmp_path / name, body)
    assert message.startswith("is a xacro file (it has ")
    assert f"run `{command}`" in message


def test_what_xacro_leaves_in_a_finished_urdf_does_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    gazebo = '<gazebo reference="a"><x v="${y}"/></gazebo><transmission name="$(arg t)"/>'
    path.write_text(f'<robot name="r" {XMLNS}>{ball("a")}{gazebo}</robot>')
    assert [entry.name for entry in load_skeleton(path).links] == ["a"]


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "is empty"),
        (b" \n", "is empty"),
        (POINTER, "is a Git LFS pointer, not the file itself: run `git lfs pull`"),
        (b'<sdf version="1.7"><model name="m"/></sdf>', "expected <robot>: it is an SDF model"),
        (b'<mujoco model="m"><worldbody/></mujoco>', "expected <robot>: it is a MuJoCo model (MJCF)"),
        (b"<mujocoinclude/>", "a MuJoCo model (MJCF)"),
        (b"PXR-USDC\0\0", "is a USD file"),
        (b"#usda 1.0\n(\n)", "is a USD file"),
        (b"PK\x03\x04rest", "is a packed file (ZIP or USDZ)"),
        (b'<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"/>', "it is a COLLADA mesh"),
        (b"<!doctype html><html></html>", "is a web page"),
        (b'<robot name="r"><group name="arm"/></robot>', "is an SRDF, which has no links"),
        (b"\x89MCAP0\r\n", "is an MCAP log, expected a URDF"),
    ],
)
def test_other_files_are_named(tmp_path: Path, data: bytes, says: str) -> None:
    assert says in refusal(tmp_path / "a.urdf", data)


def visual(inner: str) -> str:
    return f'<link name="a"><visual>{inner}</visual><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'


@pytest.mark.parametrize(
    ("inner", "says"),
    [
        ('<geometry><box size="0 0 0"/></geometry>', "a box of [0.0, 0.0, 0.0] m"),
        ('<geometry><cylinder radius="-1" length="1"/></geometry>', "a cylinder of [-1.0, 1.0] m"),
        ('<geometry><sphere radius="x"/></geometry>', "<sphere radius='x'>, expected numbers"),
        ("<geometry><sphere/></geometry>", "<sphere> has no radius"),
        ("<geometry><ellipsoid/></geometry>", "a <visual> of 'ellipsoid'"),
        ("<geometry/>", "a <visual> of nothing"),
        ("", "a <visual> of nothing"),
        ('<origin xyz="0 0 ${z}"/><geometry><sphere radius="1"/></geometry>', "<origin xyz='0 0 ${z}'>"),
        ("<geometry><mesh/></geometry>", "a <mesh> without a filename"),
        ('<geometry><mesh filename="a.stl" scale="0 1 1"/></geometry>', "a scale of 0"),
        ('<geometry><mesh filename="package://none/a.dae"/></geometry>', "package 'none' was not found"),
        ('<geometry><mesh filename="a_${side}.dae"/></geometry>', "holds an expression that xacro fills in"),
        ('<geometry><mesh filename="http://a/b.dae"/></geometry>', "only file://"),
    ],
)
def test_a_wrong_visual_is_left_out_and_a_wrong_collision_refused(tmp_path: Path, inner: str, says: str) -> None:
    good = '<visual><geometry><box size="1 2 3"/></geometry></visual>'
    text = visual(inner)
    skeleton = load_skeleton(urdf(tmp_path / "a.urdf", text.replace("<collision>", good + "<collision>", 1)))
    assert [v.shape for v in skeleton.links[0].visuals] == [PrimitiveShape("box", (1.0, 2.0, 3.0))]
    (line,) = skeleton.not_shown
    assert says in line
    assert "link 'a'" in line
    with pytest.raises(Exception, match=r"link 'a'|xacro") as caught:
        load_skeleton(urdf(tmp_path / "b.urdf", link("a", inner)))
    assert "\n" not in str(caught.value)


def test_what_is_not_read_may_be_wrong(tmp_path: Path) -> None:
    wrong = '<inertial><mass value="heavy"/><inertia ixx="a"/></inertial>'
    text = ball("a").replace("<collision>", wrong + "<collision>") + '<material name="m"><color rgba="red"/></material>'
    assert load_skeleton(urdf(tmp_path / "a.urdf", text)).links[0].collisions


def test_a_capsule_is_read_where_it_stands(tmp_path: Path) -> None:
    shapes = [
        '<geometry><sphere radius="0.1"/></geometry>',
        '<origin xyz="1 2 3"/><geometry><capsule radius="0.03" length="0.05"/></geometry>',
        '<geometry><cylinder radius="0.1" length="0.2"/></geometry>',
        '<geometry><capsule radius="0.03" length="0"/></geometry>',
    ]
    collisions = read_urdf(urdf(tmp_path / "a.urdf", link("a", *shapes))).links[0].collisions
    assert [shape.name for shape, _ in collisions] == [
        "sphere",
        "capsule",
        "cylinder",
        "sphere",
    ]
    assert collisions[1][0] == PrimitiveShape("capsule", (0.03, 0.05))
    assert collisions[1][1][:3, 3].tolist() == [1.0, 2.0, 3.0]
    assert collisions[3][0] == PrimitiveShape("sphere", (0.03,))


def test_a_capsule_after_a_wrong_visual_is_still_the_capsule(tmp_path: Path) -> None:
    shapes = ['<box size="0 0 0"/>', '<capsule radius="1" length="2"/>', '<cylinder radius="1" length="2"/>']
    visuals = "".join(f"<visual><geometry>{s}</geometry></visual>" for s in shapes)
    urdf(tmp_path / "a.urdf", f'<link name="a">{visuals}</link>')
    kinds = [shape.name for shape, _ in read_urdf(tmp_path / "a.urdf").links[0].visuals]
    assert kinds == ["capsule", "cylinder"]
