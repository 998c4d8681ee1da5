"""What mesh files say of themselves: cut off, empty, another kind, another unit."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import MeshError
from geomphys.scene.collada_file import check_collada
from geomphys.scene.mesh_header import is_ascii_stl, mesh_problem
from geomphys.scene.meshes import load_mesh
from tests.scene.models import cube, ell, stl

POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:" + b"ab" * 32 + b"\nsize 68484\n"


def ascii_stl(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = ["solid thing"]
    for face in faces:
        corners = "\n".join(f"vertex {x!r} {y!r} {z!r}" for x, y, z in vertices[face].tolist())
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}\nendloop\nendfacet")
    return "\n".join([*lines, "endsolid thing\n"]).encode()


@pytest.mark.parametrize("there", [0, 1, 4, 11])
def test_a_binary_stl_that_is_cut_off_tells_how_far(tmp_path: Path, there: int) -> None:
    data = stl(tmp_path / "a.stl", *cube()).read_bytes()
    for extra in (0, 17):
        fault = mesh_problem(data[: 84 + 50 * there + extra], "stl")
        assert fault.startswith(f"is cut off: 12 triangles announced, {there} there"), fault
    assert "its head alone has 84" in mesh_problem(data[:50], "stl")
    assert mesh_problem(data, "stl") == ""


def test_a_binary_stl_may_begin_as_a_text_and_have_a_trailer(tmp_path: Path) -> None:
    data = stl(tmp_path / "a.stl", *cube()).read_bytes()
    named = b"solid made by a program".ljust(80) + data[80:]
    path = tmp_path / "b.stl"
    for written in (named, named + b"written behind"):
        path.write_bytes(written)
        assert load_mesh(path).signed_volume == pytest.approx(1.0)
    assert "12 triangles announced, 5 there" in mesh_problem(named[: 84 + 50 * 5], "stl")


def test_an_ascii_stl_that_is_cut_off() -> None:
    data = ascii_stl(*cube())
    assert is_ascii_stl(data)
    assert mesh_problem(data, "stl") == ""
    assert mesh_problem(data.upper(), "stl") == ""
    assert "is cut off" in mesh_problem(data[: len(data) // 2], "stl")
    between = data[: data.rindex(b"endsolid")]
    assert "is cut off: no `endsolid` after its 12 triangles" in mesh_problem(between, "stl")


def test_no_cut_of_an_ascii_stl_passes() -> None:
    data = ascii_stl(*cube())
    end = data.index(b"endsolid") + len(b"endsolid")
    for length in range(1, end, 7):
        assert mesh_problem(data[:length], "stl"), length


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "glb", "gltf", "ply", "off"])
@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", r"is empty \(0 bytes\)"),
        (POINTER, "is a Git LFS pointer.*git lfs pull"),
        (b"<!DOCTYPE html><html><body>404", "is a web page, not a mesh"),
    ],
)
def test_files_that_are_none_of_the_mesh(tmp_path: Path, suffix: str, data: bytes, says: str) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(data)
    with pytest.raises(MeshError, match=says):
        load_mesh(path)


def test_points_without_faces_are_told_as_such(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    with pytest.raises(MeshError, match="holds no triangles"):
        load_mesh(path)


def test_a_glb_that_is_cut_off() -> None:
    data = b"glTF" + struct.pack("<II", 2, 4000) + b"\0" * 88
    assert mesh_problem(data, "glb").startswith("is cut off: 4000 bytes announced, 100 there")


COLLADA = '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">{}</COLLADA>'


@pytest.mark.parametrize(
    ("asset", "metres"),
    [
        ("", 1.0),
        ("<asset/>", 1.0),
        ('<asset><unit name="meter"/></asset>', 1.0),
        ('<asset><unit name="millimeter" meter="0.001"/><up_axis>Y_UP</up_axis></asset>', 0.001),
        ('<asset><unit meter=" 0.0254 " name="inch"/></asset>', 0.0254),
    ],
)
def test_the_unit_of_a_collada_file(asset: str, metres: float) -> None:
    assert check_collada(COLLADA.format(asset).encode(), 1) == (metres, "")


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf", "millimetre"])
def test_a_unit_that_is_none(unit: str) -> None:
    with pytest.raises(ValueError, match=r"unit|float"):
        check_collada(COLLADA.format(f'<asset><unit meter="{unit}"/></asset>').encode(), 1)


def test_an_l_in_millimetres_is_an_l_in_metres(tmp_path: Path) -> None:
    pytest.importorskip("collada")
    import trimesh

    corners, faces = ell()
    text = trimesh.Trimesh(corners * 1000, faces, process=False).export(file_type="dae").decode()
    assert 'meter="1' in text or "<unit" not in text
    path = tmp_path / "a.dae"
    for name, up in (("mm", "Z_UP"), ("mm", "Y_UP")):
        asset = f'<asset><unit name="{name}" meter="0.001"/><up_axis>{up}</up_axis></asset>'
        start, end = text.index("<asset"), text.index("</asset>") + len("</asset>")
        path.write_text(text[:start] + asset + text[end:])
        mesh = load_mesh(path)
        assert mesh.signed_volume == pytest.approx(0.003)
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx(np.ptp(corners, axis=0))  # as it stands
        assert load_mesh(path, scale=2.0).size == pytest.approx(2 * 0.2)


@pytest.mark.parametrize("suffix", ["ply", "off"])
def test_a_text_that_lacks_faces_it_announces(tmp_path: Path, suffix: str) -> None:
    import trimesh

    solid = trimesh.Trimesh(*cube(), process=False)
    data = solid.export(file_type="ply", encoding="ascii") if suffix == "ply" else solid.export(file_type="off")
    text = data.decode() if isinstance(data, bytes) else data
    path = tmp_path / f"a.{suffix}"
    path.write_text(text)
    assert len(load_mesh(path).faces) == 12
    path.write_text("\n".join(text.rstrip().splitlines()[:-3]) + "\n")
    with pytest.raises(MeshError, match="is cut off: 12 faces announced, 9 there"):
        load_mesh(path)
