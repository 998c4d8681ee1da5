"""Real recordings as points: by forward kinematics, with noise, dropouts, bones of other lengths; the fingertips come back."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.load import load_world, scaled_to_log
from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.check import check_log
from geomphys.recording.frames import FrameSource
from geomphys.recording.message_kinds import HAND_JOINTS
from geomphys.recording.point_labels import label_names, links_of_labels
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.scene.skeleton import load_skeleton
from tests.keypoints.hands import write_points

NOISE_M, DROPOUTS, LENGTHS = 0.001, 0.1, 0.15


def frames_of(log, scene):
    world = scaled_to_log(log, load_world(scene), Config())
    with FrameSource(log, world, Config()) as source:
        return world, list(source)


def link_positions(urdf, frames, links):
    skeleton = load_skeleton(urdf)
    roots = matrix_from_pose(np.array([f.roots[0] for f in frames]))
    poses = skeleton.forward(np.array([f.angles[: len(skeleton.dof_names)] for f in frames]), roots)
    return {label: poses[:, skeleton.index(link), :3, 3] for label, link in links.items()}


def errors(
    folder: Path, log: Path, urdf: Path, root: str, joints: str, seed: int, layout: str = "openxr"
) -> tuple[np.ndarray, np.ndarray]:
    """Errors of the fingertips (frames · tips,) m, and how much farther links move in a frame than any point does."""
    recorded = folder / "recorded.toml"
    tables = f'root = {{ topic = "{root}" }}\njoints = {{ topic = "{joints}" }}'
    recorded.write_text(f'[[avatar]]\nname = "hand"\nurdf = "{urdf}"\n{tables}\n')
    _, frames = frames_of(log, recorded)
    rng, skeleton = np.random.default_rng(seed), load_skeleton(urdf)
    links = links_of_labels([link.name for link in skeleton.links], "")
    other = folder / "other.urdf"
    other.write_bytes(scaled_urdf(urdf, {link.name: 1 + rng.uniform(-LENGTHS, LENGTHS) for link in skeleton.links}))
    true = link_positions(other, frames, links)
    labels = [label.point for label in label_names(HAND_JOINTS).values()]
    points = np.full((len(frames), len(labels), 3), np.nan)
    for k, label in enumerate(labels):
        if label in true:
            points[:, k] = true[label] + rng.normal(0, NOISE_M, (len(frames), 3))
    lost = rng.random(points.shape[:2]) < DROPOUTS
    rate = (len(frames) - 1) / (frames[-1].time_ns - frames[0].time_ns) * 1e9
    of_21 = [k for k, n in enumerate(HAND_JOINTS) if n == "thumb_metacarpal" or not n.endswith(("palm", "metacarpal"))]
    used = of_21 if layout == "mediapipe" else slice(None)
    made = write_points(folder / "points.mcap", np.where(lost[..., None], np.nan, points)[:, used], rate=rate)
    fitted = folder / "fitted.toml"
    fitted.write_text(
        f'[[avatar]]\nname = "hand"\nurdf = "{urdf}"\nkeypoints = {{ topic = "/hand", layout = "{layout}" }}\n'
    )
    world, found = frames_of(made, fitted)
    assert len(found) == len(frames)
    reached = link_positions(Path(world.urdfs["hand"]), found, links)
    ends = [n for n in links if n.endswith("_tip")] or [n for n in links if n.endswith(("_dip", "_ip"))]
    tips = np.concatenate([np.linalg.norm(reached[n] - true[n], axis=1) for n in ends])
    steps = [np.linalg.norm(np.diff(positions, axis=0), axis=1) for positions in reached.values()]
    shown = np.max([np.linalg.norm(np.diff(positions, axis=0), axis=1) for positions in true.values()], axis=0)
    return tips, np.max(steps, axis=0) - shown


CASES = [
    ("leap_grab_protobuf.mcap", "human_hands/leap_grab_right.urdf", "/tracker/right_hand", "/glove/right/joint_states"),
    ("adroit_door_00_ros2.mcap", "adroit/adroit_hand.urdf", "/tracker/wrist", "/glove/joint_states"),
    ("leap_pinch_57fps_json.mcap", "human_hands/leap_pinch_57fps_right.urdf", "/tracker/right_hand", "/glove/right/joint_states"),
]  # fmt: skip


@pytest.mark.parametrize(("log", "urdf", "root", "joints"), CASES, ids=[case[0] for case in CASES])
def test_fingertips_of_real_recordings(shared_dir, tmp_path, log, urdf, root, joints):
    tips, jumps = errors(tmp_path, shared_dir / "recordings" / log, shared_dir / "models" / urdf, root, joints, 1)
    assert np.median(tips) < 0.002
    assert np.percentile(tips, 95) < 0.005
    assert np.percentile(jumps, 99) < 0.008


def test_fingertips_of_a_layout_without_metacarpals(shared_dir, tmp_path):
    """Adroit's little finger has a joint in its metacarpal, whose length no two points of MediaPipe's measure."""
    log, urdf = shared_dir / "recordings" / CASES[1][0], shared_dir / "models" / CASES[1][1]
    tips, _ = errors(tmp_path, log, urdf, *CASES[1][2:], 1, "mediapipe")
    assert np.median(tips) < 0.002
    assert np.percentile(tips, 95) < 0.004


def body_errors(folder: Path, log: Path, urdf: Path, seed: int, *, clamped: bool) -> tuple[np.ndarray, Path, Path]:
    """Errors (frames, points) m of all joints of a body by a map of point to link, the log of its points, and its scene.

    Recorded angles beyond the limits are taken to them if `clamped`.
    """
    scene, other, rng = folder / "scene.toml", folder / "other.urdf", np.random.default_rng(seed)
    topics = 'root = { topic = "/tracker/root" }\njoints = { topic = "/body/joint_states" }'
    scene.write_text(f'[[avatar]]\nname = "body"\nurdf = "{urdf}"\n{topics}\n')
    _, frames = frames_of(log, scene)
    skeleton, frames = load_skeleton(urdf), frames[:600]
    if clamped:
        frames = [replace(f, angles=np.clip(f.angles, skeleton.lower, skeleton.upper)) for f in frames]
    other.write_bytes(scaled_urdf(urdf, {link.name: 1 + rng.uniform(-LENGTHS, LENGTHS) for link in skeleton.links}))
    links = {link.name: link.name for link in skeleton.links if not link.name.endswith("_link") and link.name != "root"}
    true = link_positions(other, frames, {n: n for n in links if not n.endswith("hipjoint")})
    points = np.stack(list(true.values()), axis=1)
    shown = points + rng.normal(0, NOISE_M, points.shape)
    shown[rng.random(points.shape[:2]) < DROPOUTS] = np.nan
    made = write_points(folder / "points.mcap", shown, rate=120.0)
    table = ", ".join(f'"{k}" = "{link}"' for k, link in enumerate(true))
    scene.write_text(
        f'[[avatar]]\nname = "body"\nurdf = "{urdf}"\nkeypoints = {{ topic = "/hand", links = {{ {table} }} }}\n'
    )
    world, found = frames_of(made, scene)
    reached = np.stack(list(link_positions(Path(world.urdfs["body"]), found, {n: n for n in true}).values()), axis=1)
    return np.linalg.norm(reached - points, axis=2), made, scene


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("log", ["cmu_02_01_json.mcap", "cmu_02_05_ros2.mcap", "cmu_02_06_protobuf.mcap"])
def test_bodies_of_real_recordings(shared_dir, tmp_path, log, seed):
    urdf = shared_dir / "models" / "cmu_body" / "cmu_subject_02.urdf"
    error, _, _ = body_errors(tmp_path, shared_dir / "recordings" / log, urdf, seed, clamped=True)
    assert np.median(error) < 0.002
    assert np.percentile(error, 95) < 0.003


@pytest.mark.slow
def test_points_of_a_body_beyond_its_limits_are_off_by_the_limits_alone(shared_dir, tmp_path):
    """Arms that are recorded up to 35 degrees beyond their limits: off and said; without limits as exact as all others."""
    log, urdf = (
        shared_dir / "recordings" / "cmu_02_05_ros2.mcap",
        shared_dir / "models" / "cmu_body" / "cmu_subject_02.urdf",
    )
    error, points, scene = body_errors(tmp_path, log, urdf, 1, clamped=False)
    assert np.median(error) < 0.002
    assert np.percentile(error, 95) < 0.010
    world = scaled_to_log(points, load_world(scene), Config())
    (told,) = [warning for warning in check_log(points, world).warnings if "beyond the limits" in warning]
    assert "lhumerus_rz (" in told
    unlimited = tmp_path / "unlimited.urdf"
    unlimited.write_text(
        re.sub(r'(lower|upper)="(-?)[^"]*"', lambda m: f'{m[1]}="{"-" * (m[1] == "lower")}6"', urdf.read_text())
    )
    error, _, _ = body_errors(tmp_path, log, unlimited, 1, clamped=False)
    assert np.percentile(error, 95) < 0.003


def test_fingertips_of_a_recording_of_the_project(root, tmp_path):
    hand = root / "assets" / "hand" / "hand.urdf"
    tips, jumps = errors(
        tmp_path, root / "recordings" / "hand_ball.mcap", hand, "/tracker/wrist", "/glove/joint_states", 2
    )
    assert np.median(tips) < 0.002
    assert np.percentile(tips, 95) < 0.005
    assert np.percentile(jumps, 99) < 0.008
