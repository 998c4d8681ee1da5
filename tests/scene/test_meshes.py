"""Mesh files: what is read, what is refused, and what the refusal says."""

from __future__ import annotations

import json
import struct
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geomphys.errors import MeshError
from geomphys.scene import meshes
from geomphys.scene.meshes import Mesh, load_mesh, oriented_outwards, require_closed
from geomphys.scene.tessellation import sphere_triangles
from tests.scene.models import cube, ell, stl


def obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.asarray(vertices, dtype=float).tolist()]
    path.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]))
    return path


def test_an_stl_is_read_with_its_vertices_merged(tmp_path: Path) -> None:
    mesh = load_mesh(stl(tmp_path / "cube.stl", *cube()), scale=0.01)
    assert mesh.vertices.shape == (8, 3)
    assert mesh.faces.shape == (12, 3)
    assert mesh.size == pytest.approx(0.01)
    assert mesh.is_watertight
    assert mesh.is_convex
    assert mesh.signed_volume == pytest.approx(1e-6)


@pytest.mark.parametrize("suffix", ["obj", "ply", "off", "glb", "gltf", "dae"])
def test_other_kinds_hold_the_same_cube(tmp_path: Path, suffix: str) -> None:
    import trimesh

    path = tmp_path / f"cube.{suffix}"
    if suffix == "dae":
        pytest.importorskip("collada")
    data = trimesh.Trimesh(*cube(), process=False).export(file_type=suffix)
    if isinstance(data, dict):
        for name, content in data.items():
            (tmp_path / name).write_bytes(content)
        path = tmp_path / "model.gltf"
    elif isinstance(data, str):
        path.write_text(data)
    else:
        path.write_bytes(data)
    mesh = load_mesh(path)
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert mesh.signed_volume == pytest.approx(1.0)


def test_each_axis_may_have_its_scale(tmp_path: Path) -> None:
    mesh = load_mesh(stl(tmp_path / "cube.stl", *cube()), scale=np.array([1.0, 2.0, -3.0]))
    assert np.ptp(mesh.vertices, axis=0).tolist() == [1.0, 2.0, 3.0]
    assert mesh.signed_volume == pytest.approx(-6.0)
    assert oriented_outwards(mesh).signed_volume == pytest.approx(6.0)


def test_an_l_is_watertight_but_not_convex() -> None:
    mesh = Mesh("ell", *ell())
    assert mesh.is_watertight
    assert mesh.has_consistent_winding
    assert not mesh.is_convex
    assert mesh.signed_volume == pytest.approx(0.003)
    assert len(mesh.hull_vertices) == 10


def test_convexity_forgives_single_precision() -> None:
    corners, faces = cube()
    middle = np.array([[0.5 - 3e-8, 0.0, 0.0]])
    face = [f for f in faces.tolist() if not np.all(corners[f][:, 0] > 0)]
    ring = [4, 6, 7, 5]
    fan = [(8, ring[k], ring[(k + 1) % 4]) for k in range(4)]
    assert Mesh("dent", np.vstack([corners, middle]), np.array(face + fan)).is_convex
    middle[0, 0] = 0.49
    assert not Mesh("dent", np.vstack([corners, middle]), np.array(face + fan)).is_convex


def test_triangles_wound_both_ways_are_set_right() -> None:
    corners, faces = ell()
    mixed = faces.copy()
    mixed[::3] = mixed[::3, ::-1]
    mesh = Mesh("mixed", corners, mixed)
    assert not mesh.has_consistent_winding
    assert oriented_outwards(mesh).signed_volume == pytest.approx(0.003)


def test_an_open_mesh_is_refused_with_the_way_out() -> None:
    corners, faces = ell()
    with pytest.raises(MeshError, match=r'chair: is neither watertight nor convex.*decomposition = "hull"'):
        require_closed(Mesh("chair", corners, faces[1:]))
    require_closed(Mesh("cube", cube()[0], cube()[1][1:]))  # open, but convex


NAN = struct.pack("<f", float("nan"))


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("a.stl", b"", r"is empty \(0 bytes\)"),
        ("a.stl", b"\0" * 84, "no triangles"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 1) + b"\0" * 50, "zero area"),
        (
            "a.stl",
            b"\0" * 80 + struct.pack("<I", 1) + b"\0" * 12 + NAN * 9 + b"\0\0",
            "NaN or infinite|names a vertex that is not there",
        ),  # the latter with the oldest trimesh
        (
            "a.stl",
            b"\0" * 80 + struct.pack("<I", 4_000_000_000) + b"\0" * 50,
            "cut off: 4000000000 triangles announced, 1 there",
        ),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "not a readable .obj mesh|not there"),
        ("a.obj", b"v 1e300 0 0\nv -1e300 1 0\nv 0 1 1e300\nf 1 2 3\n", "1000 km|NaN"),
        ("a.obj", b"hello", "no triangles|not a readable"),
        ("a.ply", b"ply\nformat ascii 1.0\nend_header\n", "no triangles|not a readable"),
        ("a.ply", b"\xff\xfe\0", "not a readable .ply mesh"),
        ("a.glb", b"glTF\x02\0\0\0\xff\xff\xff\x7f", "cut off: 2147483647 bytes announced, 12 there"),
        ("a.gltf", b"{}", "no triangles|not a readable"),
        ("a.gltf", b"[" * 100_000, "not a readable .gltf mesh"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n", "not a readable .off mesh"),
        ("a.dae", b"<COLLADA>", "not a readable .dae mesh"),
        ("a.txt", b"root:x:0:0", "expected a name that ends in one of stl"),
        ("passwd", b"root:x:0:0", "expected a name that ends in one of stl"),
    ],
)
def test_broken_files_are_told_on_one_line(tmp_path: Path, name: str, data: bytes, says: str) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(MeshError, match=says) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "root:x" not in str(caught.value)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="no such file"):
        load_mesh(tmp_path / "none.stl")
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(MeshError, match="is not a file"):
        load_mesh(tmp_path / "folder.stl")


def test_too_many_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MAX_TRIANGLES", 10)
    with pytest.raises(MeshError, match="has 12 triangles, at most 10"):
        load_mesh(stl(tmp_path / "cube.stl", *cube()))
    with pytest.raises(MeshError, match="has 12 triangles, at most 10"):
        load_mesh(obj(tmp_path / "cube.obj", *cube()))


def test_large_files_are_not_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MAX_FILE_BYTES", 100)
    with pytest.raises(MeshError, match="is larger than"):
        load_mesh(stl(tmp_path / "cube.stl", *cube()))


def test_an_entity_in_a_dae_is_refused(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("hidden words")
    path = tmp_path / "a.dae"
    path.write_text(f'<!DOCTYPE c [<!ENTITY x SYSTEM "file://{secret}">]><COLLADA>&x;</COLLADA>')
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    assert "hidden" not in str(caught.value)


def test_a_gltf_reads_buffers_beside_it_only(tmp_path: Path) -> None:
    import trimesh

    inside = tmp_path / "model"
    inside.mkdir()
    for name, content in trimesh.Trimesh(*cube(), process=False).export(file_type="gltf").items():
        (inside / name).write_bytes(content)
    tree = json.loads((inside / "model.gltf").read_text())
    buffers = sorted(inside.glob("*.bin"))
    for buffer in buffers:
        buffer.rename(tmp_path / buffer.name)
    for entry in tree["buffers"]:
        entry["uri"] = "../" + entry["uri"]
    (inside / "model.gltf").write_text(json.dumps(tree))
    with pytest.raises(MeshError, match=r"no \.bin file beside it"):
        load_mesh(inside / "model.gltf")


def test_flat_meshes_have_no_hull() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1e-12]], dtype=float)
    with pytest.raises(MeshError, match="flat"):
        _ = Mesh("sheet", square, np.array([[0, 1, 2], [0, 2, 3]])).hull_vertices


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(meshes.SUFFIXES), st.binary(max_size=400))
def test_no_bytes_raise_anything_else(tmp_path: Path, suffix: str, data: bytes) -> None:
    path = tmp_path / f"fuzz.{suffix}"
    path.write_bytes(data)
    with suppress(MeshError):
        load_mesh(path)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_no_damaged_stl_raises_anything_else(tmp_path: Path, data: st.DataObject) -> None:
    good = bytearray(stl(tmp_path / "good.stl", *cube()).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "bad.stl"
    path.write_bytes(bytes(good[: data.draw(st.integers(0, len(good)))]))
    try:
        mesh = load_mesh(path)
    except MeshError:
        return
    assert np.isfinite(mesh.vertices).all()


def test_a_large_ball_is_checked_fast_and_one_too_large_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = Mesh("ball", *sphere_triangles(1.0, 128))
    start = time.process_time()
    assert mesh.is_convex
    assert time.process_time() - start < 2.0
    monkeypatch.setattr(meshes, "MAX_HULL_VERTICES", 1000)
    with pytest.raises(MeshError, match="ball: its convex hull has 8066 corners, at most 1000"):
        _ = Mesh("ball", *sphere_triangles(1.0, 128)).hull_vertices
