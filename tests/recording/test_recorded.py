"""The frames of real recordings against an independent reading of the same logs."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.load import load_world
from geomphys.recording.frames import FrameSource

PAIRS = [
    ("adroit_door_00_ros2", "door_rigid"),
    ("adroit_door_01_protobuf", "door_rigid"),
    ("adroit_door_02_json", "door_rigid"),
    ("adroit_door_14_json-ros", "door_rigid"),
    ("leap_three_claps_ros2", "claps_rigid"),
    ("leap_pinch_57fps_json", "table_pinch"),
    ("cmu_02_05_ros2", "body_02_shared"),
    ("dfki_pillow_a_ros2", "pillow_a"),
]


@pytest.fixture(scope="module")
def judge(shared_dir):
    """The independent reading."""
    folder = shared_dir / "checks"
    if not (folder / "recorded.py").is_file():
        pytest.skip("the independent checks are not there")
    pytest.importorskip("coal")
    sys.path.insert(0, str(folder))
    try:
        import recorded
        import world
    finally:
        sys.path.remove(str(folder))
    return recorded, world


@pytest.fixture(scope="module")
def worlds(shared_dir, judge):
    """Each scene loaded once, by both."""
    loaded = {}

    def get(scene):
        if scene not in loaded:
            path = shared_dir / "checks" / "scenes" / f"{scene}.toml"
            loaded[scene] = (load_world(path), judge[1].World(path))
        return loaded[scene]

    return get


@pytest.mark.parametrize(("log", "scene"), PAIRS)
def test_frames_are_what_the_recording_says(shared_dir, judge, worlds, log, scene):
    path = shared_dir / "recordings" / f"{log}.mcap"
    ours, theirs = worlds(scene)
    recorded = judge[0].Recorded(theirs, judge[0].Log(path))
    with FrameSource(path, ours, Config()) as source:
        frames = list(source)
    assert [f.time_ns for f in frames] == recorded.t.tolist()
    assert [f.held for f in frames] == recorded.held.tolist()
    angles = np.array([f.angles for f in frames])
    compared = 0
    for avatar in theirs.avatars:
        tree = ours.tree_names.index(avatar.name)
        roots = judge[0].matrices(np.array([f.roots[tree] for f in frames]))
        np.testing.assert_allclose(roots, recorded.roots[avatar.name], atol=1e-12)
        for dof, name in enumerate(ours.dof_names):
            if ours.scene.dofs.tree[dof] == tree and name in recorded.angles[avatar.name]:
                expected = np.broadcast_to(recorded.angles[avatar.name][name], len(frames))
                np.testing.assert_allclose(angles[:, dof], expected, atol=1e-12)
                compared += int(np.ptp(expected) > 0)
    assert compared > 10
    for thing in theirs.articulated:
        tree = ours.tree_names.index(thing.name)
        roots = judge[0].matrices(np.array([f.roots[tree] for f in frames]))
        np.testing.assert_allclose(roots, recorded.bodies[f"{thing.name}/{thing.tree.root}"], atol=1e-12)
    assert source.expected_frames == len(frames)
    assert source.report.unmatched_recorded == ()
    assert source.report.unmatched_joints == ()


@pytest.mark.parametrize("max_gap", [0.0, 0.02, 0.5])
def test_gaps_are_bridged_as_far_as_asked(shared_dir, judge, worlds, max_gap):
    path = shared_dir / "recordings" / "dfki_pillow_a_ros2.mcap"
    ours, theirs = worlds("pillow_a")
    recorded = judge[0].Recorded(theirs, judge[0].Log(path), max_gap=max_gap)
    with FrameSource(path, ours, Config(max_gap=max_gap)) as source:
        frames = list(source)
    sure = ~recorded.held  # a gap of just `max_gap` may be either
    assert not any(f.held for f, s in zip(frames, sure, strict=True) if s)
    assert (source.report.held_frames > 100) == (max_gap < 0.1)
    tree = ours.tree_names.index("hand")
    angles = np.array([f.angles for f in frames])
    for dof, name in enumerate(ours.dof_names):
        if ours.scene.dofs.tree[dof] == tree and name in recorded.angles["hand"]:
            expected = np.broadcast_to(recorded.angles["hand"][name], len(frames))
            np.testing.assert_allclose(angles[sure, dof], expected[sure], atol=1e-12)
