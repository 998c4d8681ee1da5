"""Bone lengths from recorded points: a factor for each finger, one for all, and what is not measured."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh
from mcap.reader import make_reader

import geomphys
from geomphys.config import Config
from geomphys.load import load_world, scaled_to_log
from geomphys.output.output_log import open_output
from geomphys.output.output_world import world_of_output
from geomphys.recording.point_measures import measure_points
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.scene.skeleton import load_skeleton
from tests.keypoints.hands import FINGERS, motion, openxr_points, write_hand, write_points, write_scene

FACTORS = {"thumb": 0.9, "index": 1.1, "middle": 1.0, "ring": 0.85, "little": 1.15}


def recorded(folder, factor_of, frames=80, **options):
    """A scene with the plain hand, and a log of one whose links are larger by `factor_of` their names."""
    skeleton = write_hand(folder, **options)
    other = folder / "other.urdf"
    other.write_bytes(scaled_urdf(folder / "hand.urdf", {link.name: factor_of(link.name) for link in skeleton.links}))
    large = load_skeleton(other)
    angles, roots = motion(large, frames)
    points = openxr_points(large, angles, roots)
    return write_points(folder / "log.mcap", points), points


def by_finger(link):
    return FACTORS.get(link.split("_")[0], 1.05)


def test_a_factor_for_each_finger(tmp_path):
    log, _ = recorded(tmp_path, by_finger)
    world = load_world(write_scene(tmp_path))
    found = measure_points(log, world, Config())["hand"].branches
    assert found == pytest.approx({**FACTORS, "palm": 1.05}, abs=1e-3)


def test_one_factor_for_the_hand(tmp_path):
    log, _ = recorded(tmp_path, lambda _: 1.12)
    world = load_world(write_scene(tmp_path, 'topic = "/hand", layout = "openxr", scale = "hand"'))
    found = measure_points(log, world, Config())["hand"].branches
    assert set(found.values()) == {1.12}


def test_a_finger_that_shows_one_segment_takes_the_factor_of_all(tmp_path):
    log, points = recorded(tmp_path, lambda link: 1.1 if link.startswith("index") else 1.0)
    points[:, 9:11] = np.nan  # distal and tip of the index finger
    write_points(log, points)
    found = measure_points(log, load_world(write_scene(tmp_path)), Config())["hand"].branches
    assert found["index"] not in (1.0, 1.1)
    assert 1.0 < found["index"] < 1.1
    assert found["middle"] == 1.0


def test_none_leaves_the_lengths(tmp_path):
    log, _ = recorded(tmp_path, by_finger)
    world = load_world(write_scene(tmp_path, 'topic = "/hand", layout = "openxr", scale = "none"'))
    assert scaled_to_log(log, world, Config()) is world


def test_points_in_another_unit_are_an_error_that_says_so(tmp_path):
    log, points = recorded(tmp_path, by_finger)
    write_points(log, 1000 * points)
    with pytest.raises(geomphys.LogError, match=r"times as far apart as the links of 'hand': check `unit`"):
        measure_points(log, load_world(write_scene(tmp_path)), Config())


def test_an_output_has_the_scaled_urdf_and_the_factors(tmp_path):
    log, _points = recorded(tmp_path, by_finger)
    out = tmp_path / "out.mcap"
    geomphys.run(log, write_scene(tmp_path), out=out)
    with out.open("rb") as stream:
        reader = make_reader(stream)
        (metadata,) = [m.metadata for m in reader.iter_metadata() if m.name == "geomphys"]
        (urdf,) = [a.data for a in reader.iter_attachments() if a.name == "hand.urdf"]
    assert json.loads(metadata["keypoint_scale"])["hand"] == pytest.approx({**FACTORS, "palm": 1.05}, abs=1e-3)
    (tmp_path / "attached.urdf").write_bytes(urdf)
    attached = load_skeleton(tmp_path / "attached.urdf")
    plain = load_skeleton(tmp_path / "hand.urdf")
    for finger in FINGERS:
        link = attached.index(f"{finger}_tip")
        lengths = [s.joints[link].parent_from_joint[0, 3] for s in (attached, plain)]
        assert lengths[0] / lengths[1] == pytest.approx(FACTORS[finger], abs=1e-3)
    world_of_output(open_output(out))  # raises where the attached model is not that of the replay


def everything_in(path):
    """Messages, metadata and attachments of an output."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        messages = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        metadata = [(m.name, m.metadata) for m in reader.iter_metadata()]
        attachments = [(a.name, a.data) for a in reader.iter_attachments()]
    return messages, metadata, attachments


def test_the_same_log_and_scene_give_the_same_output_in_any_folder(tmp_path):
    log, _ = recorded(tmp_path, by_finger, frames=20)
    found = []
    for name in ("here", "there"):
        folder = tmp_path / name
        folder.mkdir()
        write_hand(folder)
        trimesh.creation.box((0.05, 0.06, 0.014)).export(folder / "palm.stl")
        text = (
            (folder / "hand.urdf").read_text().replace('<box size="0.05 0.06 0.014"/>', '<mesh filename="palm.stl"/>')
        )
        (folder / "hand.urdf").write_text(text)
        out = folder / "out.mcap"
        geomphys.run(log, write_scene(folder), out=out, options=geomphys.OutputOptions(timing=False))
        found.append(everything_in(out))
        assert str(tmp_path).encode() not in b"".join(data for _, data in found[-1][2])
        world = world_of_output(open_output(out))
        assert len(world.triangles[0][1]) == 12, "the palm is read from the attachments"
    assert found[0] == found[1]


def test_a_visual_without_a_file_does_not_matter_and_is_told_of_the_users_urdf(tmp_path):
    log, _ = recorded(tmp_path, by_finger, frames=20)
    missing = '<visual><geometry><mesh filename="package://nowhere/skin.stl"/></geometry></visual>'
    urdf = tmp_path / "hand.urdf"
    urdf.write_text(urdf.read_text().replace('<link name="wrist">', f'<link name="wrist">{missing}'))
    world = scaled_to_log(log, load_world(write_scene(tmp_path)), Config())
    assert world.keypoint_scale
    assert [w for w in world.findings.warnings if str(urdf) in w and "skin.stl" in w]
    assert len([w for w in world.findings.warnings if "skin.stl" in w]) == 1
