"""An output is enough by itself: it is looked at where no other file of it exists, and looks the same."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from mcap.reader import make_reader
from PIL import Image

import geomphys
from geomphys.errors import MeshError, SceneError
from geomphys.output.attached_files import INDEX, write_attachments
from geomphys.output.output_log import open_output
from geomphys.output.output_results import results_of_output
from geomphys.output.output_world import world_of_output
from geomphys.scene.arrays import DRIVEN
from geomphys.viewer.snapshot import take_snapshot
from geomphys.viewer.view import as_recording
from tests.cli.press import SCENE, write_log

WEDGE = trimesh.creation.cone(0.05, 0.1, sections=8)
URDF = """<robot name="rack">
  <link name="base">
    <visual><geometry><mesh filename="package://racks/shown.gltf"/></geometry></visual>
    <visual><geometry><mesh filename="nowhere.stl"/></geometry></visual>
    <collision><geometry><mesh filename="meshes/hard.stl" scale="1 1 0.5"/></geometry></collision>
  </link>
</robot>
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A replay among a mesh object and a URDF with STL, glTF and its buffer, and a visual that is missing."""
    folder = tmp_path_factory.mktemp("made")
    racks = folder / "racks"
    (racks / "meshes").mkdir(parents=True)
    WEDGE.export(folder / "wedge.obj")
    WEDGE.export(racks / "meshes" / "hard.stl")
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene(trimesh.creation.icosphere(2, 0.06)))
    for name, data in files.items():
        (racks / name.replace("model.gltf", "shown.gltf")).write_bytes(data)
    (racks / "rack.urdf").write_text(URDF)
    scene = SCENE + (
        '\n[[object]]\nname = "wedge"\nclass = "fixed"\nmesh = "wedge.obj"\nposition = [0.3, 0.0, 0.0]\n'
        '\n[[object]]\nname = "rack"\nclass = "fixed"\nurdf = "racks/rack.urdf"\nposition = [-0.3, 0.0, 0.1]\n'
    )
    (folder / "scene.toml").write_text(scene)
    write_log(folder / "press.mcap")
    geomphys.run(folder / "press.mcap", folder / "scene.toml", out=folder / "out.mcap")
    take_snapshot(folder / "out.mcap", folder / "before.png", frame=30, size=(320, 240))
    return folder


@pytest.fixture
def alone(folder: Path, tmp_path: Path) -> Iterator[Path]:
    """The output elsewhere, while everything it was made from is gone; beside it the picture from before."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.copy(folder / "before.png", elsewhere)
    moved = elsewhere / "mailed.mcap"
    shutil.copy(folder / "out.mcap", moved)
    kept = folder.with_name("kept")
    folder.rename(kept)
    yield moved
    kept.rename(folder)


def test_it_looks_the_same(alone: Path) -> None:
    take_snapshot(alone, alone.with_name("after.png"), frame=30, size=(320, 240))
    before, after = (np.asarray(Image.open(alone.with_name(f"{n}.png")), int) for n in ("before", "after"))
    assert np.abs(before - after).max() <= 2
    assert len(np.unique(before.reshape(-1, 3), axis=0)) > 100


def test_all_that_reads_an_output_reads_it(alone: Path) -> None:
    assert geomphys.audit_output(alone).same_world
    assert geomphys.statistics_of([alone])
    assert geomphys.compare_outputs(alone, alone).equal
    with as_recording(alone) as recording:
        assert recording.stat().st_size > 10_000


def test_its_surfaces_are_those_of_the_replay(folder: Path) -> None:
    made, read = geomphys.load_world(folder / "scene.toml"), world_of_output(open_output(folder / "out.mcap"))
    assert made.body_names == read.body_names
    for kind in ("triangles", "collision_triangles"):
        for (points, faces), (read_points, read_faces) in zip(getattr(made, kind), getattr(read, kind), strict=True):
            assert np.array_equal(points, read_points)
            assert np.array_equal(faces, read_faces)
    rack = made.body_names.index("rack/base")
    assert len(made.triangles[rack][1]) == 320, "the visual is shown, not the collision mesh"


def test_frames_are_read_back_as_they_were(folder: Path) -> None:
    output = open_output(folder / "out.mcap")
    read = list(results_of_output(output, world_of_output(output)))
    for result, again in zip(geomphys.replay(folder / "press.mcap", folder / "scene.toml"), read, strict=True):
        assert np.array_equal(result.corrected, again.corrected)
        assert np.array_equal(result.recorded, again.recorded)
        assert result.metrics == again.metrics
        for column, read_column in zip(
            result.contacts + result.penetrations, again.contacts + again.penetrations, strict=True
        ):
            assert np.array_equal(column, read_column)


def test_foxglove_gets_the_surfaces_in_their_frames(folder: Path) -> None:
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    world = geomphys.load_world(folder / "scene.toml")
    with (folder / "out.mcap").open("rb") as stream:
        (message,) = [m for _, _, m in make_reader(stream).iter_messages(topics=["/meshes"])]
    entities = {entity.id: entity for entity in SceneUpdate.FromString(message.data).entities}
    assert set(entities) == set(world.body_names)
    for name, frame, (points, faces) in zip(world.body_names, world.frame_names, world.triangles, strict=True):
        (mesh,) = entities[name].triangles
        assert entities[name].frame_id == frame
        assert np.array_equal(
            np.array([(p.x, p.y, p.z) for p in mesh.points])[np.array(mesh.indices)], points[faces].reshape(-1, 3)
        )


def test_foxglove_gets_a_ghost_that_a_body_at_its_recorded_pose_hides(folder: Path) -> None:
    from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    world = geomphys.load_world(folder / "scene.toml")
    with (folder / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        (message,) = [m for _, _, m in reader.iter_messages(topics=["/recorded/meshes"])]
        _, _, transforms = next(iter(reader.iter_messages(topics=["/recorded/tf"])))
    entities = {entity.id: entity for entity in SceneUpdate.FromString(message.data).entities}
    driven = [b for b in np.flatnonzero(world.scene.bodies.role == DRIVEN) if len(world.triangles[b][1])]
    assert set(entities) == {f"recorded/{world.body_names[b]}" for b in driven}
    frames = {t.child_frame_id for t in FrameTransforms.FromString(transforms.data).transforms}
    for body in driven:
        entity = entities[f"recorded/{world.body_names[body]}"]
        assert entity.frame_id in frames
        (mesh,) = entity.triangles
        assert 0 < mesh.color.a < 1
        ghost = np.array([(p.x, p.y, p.z) for p in mesh.points])[np.array(mesh.indices)]
        points, faces = world.triangles[body]
        moved = points[faces].reshape(-1, 3) - ghost
        assert np.allclose(np.linalg.norm(moved, axis=1), 3e-4, atol=1e-6)
        a, b, c = points[faces].swapaxes(0, 1)
        outward = np.cross(b - a, c - a).repeat(3, axis=0)
        assert (moved * outward).sum(axis=1).min() > -1e-12


def test_no_path_of_this_machine_names_an_attachment(folder: Path) -> None:
    output = open_output(folder / "out.mcap")
    attached = output.attachments()
    assert sorted(name.split("/")[-1] for name in attached if name.startswith("meshes/"))[-3:] == [
        "hard.stl", "shown.gltf", "wedge.obj",
    ]  # fmt: skip
    assert str(folder).encode() not in attached[INDEX]


def test_an_attachment_is_written_nowhere_else(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    names = ["meshes/../../out.obj", "/etc/out.obj", "meshes/a/../../../out.obj", "meshes/x", "scene.toml"]
    write_attachments({**dict.fromkeys(names, b""), "meshes/ab/good.obj": b"v"}, inside)
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()] == [
        "inside/meshes/ab/good.obj"
    ]


@pytest.mark.parametrize("entry", ["wedge", "rack"])
@pytest.mark.parametrize("how", ["absolute", "above", "attached above"])
def test_an_output_from_somebody_else_reads_no_file_of_this_machine(
    entry: str, how: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its list of attachments may name any file; only what is attached stands for a mesh."""
    secret = tmp_path / "secret.stl"
    WEDGE.export(secret)
    output = open_output(folder / "out.mcap")
    files, opened = output.attachments(), []
    name = str(secret) if how == "absolute" else f"meshes/../../../..{secret}"
    if how == "attached above":
        files[name] = b""
    index = json.loads(files[INDEX])
    index["meshes"][entry] = name if entry == "wedge" else dict.fromkeys(index["meshes"][entry], name)
    files[INDEX] = json.dumps(index).encode()
    monkeypatch.setattr(output, "attachments", lambda: files)
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: (opened.append(path.resolve()), read(path))[1])
    with pytest.raises((SceneError, MeshError)):
        world_of_output(output)
    assert secret.resolve() not in opened


def test_an_output_without_meshes_says_what_to_do(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output = open_output(folder / "out.mcap")
    kept = {name: data for name, data in output.attachments().items() if name != INDEX}
    monkeypatch.setattr(output, "attachments", lambda: kept)
    with pytest.raises(SceneError, match="replay the log again, or name the scene with --scene"):
        world_of_output(output)
