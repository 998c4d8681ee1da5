"""The audit finds what overlaps: closed forms, a free result, a recording that was inside, and a lie."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from mcap.reader import make_reader
from mcap.writer import Writer

import geomphys
from geomphys.analysis import audit
from geomphys.analysis.audit import _PosedPair, _Shape, _shape, pairs_to_test
from geomphys.output.output_log import open_output
from geomphys.scene.world import World
from tests.cli.press import DEEPEST_M, SCENE
from tests.made import Results


def shape(mesh: trimesh.Trimesh) -> _Shape:
    """A mesh as the audit takes it."""
    return _shape(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))


def pair(position: tuple[float, float, float], rotation: np.ndarray | None = None) -> _PosedPair:
    """A ball of 0.1 m at a place, and a cube of 1 m about the origin, both turned and moved together."""
    rotation, shift = np.eye(3) if rotation is None else rotation, np.array([3.0, -2.0, 1.0])
    ball, cube = shape(trimesh.creation.icosphere(2, 0.1)), shape(trimesh.creation.box((1, 1, 1)))
    return _PosedPair(ball, cube, rotation, rotation, rotation @ np.array(position) + shift, shift)


@pytest.mark.parametrize("seed", [None, 1, 2])
@pytest.mark.parametrize(
    ("position", "depth"),
    [((0, 0, 0.61), 0.0), ((0, 0, 0.59), 0.01), ((0.45, 0, 0), 0.15), ((0, 0, 0), 0.6), ((0.1, 0.2, -0.3), 0.3)],
)
def test_a_ball_in_a_cube(position: tuple[float, float, float], depth: float, seed: int | None) -> None:
    rotation = (
        None
        if seed is None
        else trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))[:3, :3]
    )
    found = pair(position, rotation)
    assert found.overlaps(np.zeros(3)) == (depth > 0)
    if depth:
        bound = found.depth()
        assert bound >= depth - 2e-3  # the ball is a polyhedron inside the sphere
        assert bound <= 1.25 * depth + 1e-3


def test_a_part_inside_is_found_beside_one_outside() -> None:
    two = trimesh.util.concatenate(
        [trimesh.creation.icosphere(1, 0.1).apply_translation([5, 0, 0]), trimesh.creation.icosphere(1, 0.1)]
    )
    cube, position = shape(trimesh.creation.box((1, 1, 1))), np.zeros(3)
    assert _PosedPair(shape(two), cube, np.eye(3), np.eye(3), position, position).overlaps(np.zeros(3))
    assert not _PosedPair(shape(two), cube, np.eye(3), np.eye(3), position, np.array([0, 3.0, 0])).overlaps(np.zeros(3))


@pytest.mark.parametrize("made", ["pressed", "landed"])
def test_a_result_is_free(made: str, request: pytest.FixtureRequest) -> None:
    results: Results = request.getfixturevalue(made)
    report = geomphys.audit_output(results.out)
    assert report.frames_broken == 0
    assert report.same_world
    assert report.frames > 50


def test_the_recording_was_not(pressed: Results) -> None:
    report = geomphys.audit_output(pressed.out, recorded=True)
    assert report.frames_broken > 20
    assert report.deepest is not None
    assert {report.deepest.body_a, report.deepest.body_b} == {"finger", "table"}
    assert report.deepest.depth_at_most_m == pytest.approx(DEEPEST_M, rel=0.05)


def test_a_planted_overlap_is_found_and_nothing_else(pressed: Results, tmp_path: Path) -> None:
    """One pose of one frame in contact is put a millimetre deeper, by the library of the format."""
    (frame, *_) = (f.index for f in open_output(pressed.out).frames(["/contacts"]) if f.contacts)
    lie, frame, known = tmp_path / "lie.mcap", frame + 5, dict[int, int]()
    with pressed.out.open("rb") as stream, lie.open("wb") as made:
        reader, writer = make_reader(stream), Writer(made)
        writer.start()
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in known:
                assert schema is not None
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            data, time = message.data, message.log_time
            if channel.topic == "/tf" and message.sequence == frame:
                poses = FrameTransforms.FromString(data)
                (finger,) = (t for t in poses.transforms if t.child_frame_id == "finger")
                finger.translation.z -= 0.001
                data = poses.SerializeToString()
            writer.add_message(known[channel.id], time, data, time, message.sequence)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        for file in reader.iter_attachments():
            writer.add_attachment(file.create_time, file.log_time, file.name, file.media_type, file.data)
        writer.finish()
    report = geomphys.audit_output(lie)
    assert [(o.frame, {o.body_a, o.body_b}) for o in report.overlaps if o.broken] == [(frame, {"finger", "table"})]
    assert report.deepest is not None
    assert report.deepest.depth_at_most_m == pytest.approx(0.001, rel=0.1)


def test_nothing_of_the_engine_is_used_once_the_scene_is_read(
    pressed: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    imported = {
        node.module
        for node in ast.walk(ast.parse(Path(audit.__file__).read_text()))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("geomphys")
    }
    assert imported <= {
        f"geomphys.{name}"
        for name in (
            "errors",
            "numerics.transforms",
            "output.output_log",
            "output.output_world",
            "output.provenance",
            "scene.arrays",
            "scene.world",
            "storage.remote_files",
        )
    }
    begun: list[str] = []
    read = audit.world_of_output

    def read_and_shut(*args: object) -> World:
        world = read(*args)  # type: ignore[arg-type]
        for name, module in list(sys.modules.items()):
            if name.startswith(("geomphys.collision", "geomphys.driven", "geomphys.simulated", "geomphys.engine.step")):
                for key, value in vars(module).items():
                    if callable(value) and not isinstance(value, type):
                        monkeypatch.setattr(module, key, lambda *_, **__: begun.append("called"))
        return world

    monkeypatch.setattr(audit, "world_of_output", read_and_shut)
    assert audit.audit_output(pressed.out).frames_broken == 0
    assert not begun


def test_a_result_in_the_wrong_scene_is_found_out(pressed: Results, tmp_path: Path) -> None:
    """The shapes are those of the scene: with a larger finger the result overlaps by what was added."""
    scene = tmp_path / "larger.toml"
    scene.write_text(SCENE.replace("sphere = 0.05", "sphere = 0.052"))
    report = geomphys.audit_output(pressed.out, scene=scene)
    assert not report.same_world
    assert report.frames_broken > 20
    assert report.deepest is not None
    assert report.deepest.depth_at_most_m == pytest.approx(0.002, rel=0.2)


def test_a_body_without_a_pose_is_said(pressed: Results, tmp_path: Path) -> None:
    scene = tmp_path / "more.toml"
    scene.write_text(
        SCENE + '\n[[object]]\nname = "far"\nclass = "fixed"\nsphere = 0.1\nposition = [9, 9, 9]\nmaterial = "wood"\n'
    )
    with pytest.raises(geomphys.LogError, match="'far'"):
        geomphys.audit_output(pressed.out, scene=scene)


def test_pairs_are_those_that_must_not_overlap(root: Path) -> None:
    world = geomphys.load_world(root / "assets" / "scenes" / "gallery.toml")
    pairs = {(world.body_names[a], world.body_names[b]) for a, b in pairs_to_test(world)}
    assert ("hand/palm", "table") in pairs
    assert ("hand/palm", "ball") in pairs
    assert ("ball", "table") in pairs
    assert not any(a in {"table", "vase"} and b in {"table", "vase", "floor"} for a, b in pairs)
    assert not any(a.startswith("hand/") and b.startswith("hand/") for a, b in pairs)


def test_links_in_chains_mode_are_tested_but_for_those_let(root: Path) -> None:
    world = geomphys.load_world(root / "assets" / "scenes" / "two_arms.toml")
    pairs = pairs_to_test(world)
    links = [(a, b) for a, b in pairs if world.scene.bodies.tree[a] == world.scene.bodies.tree[b]]
    assert links
    assert not any(world.scene.excluded[a, b] for a, b in links)
