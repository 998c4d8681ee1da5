"""Whole bodies by a map of point to link: each bone has its own length, and the ends come back."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.load import load_world, scaled_to_log
from geomphys.numerics.transforms import matrix_from_pose
from geomphys.recording.frames import FrameSource
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.scene.skeleton import load_skeleton
from tests.keypoints.hands import motion, write_points

FRAMES = 120
BONES = {
    # link: parent, where on it, axes of its joint
    "spine": ("pelvis", "0 0 0.15", "xyz"),
    "chest": ("spine", "0 0 0.2", "xyz"),
    "head": ("chest", "0 0 0.25", ""),
    **{f"{s}_upper_arm": ("chest", f"0 {y} 0.18", "xyz") for s, y in (("left", 0.2), ("right", -0.2))},
    **{f"{s}_forearm": (f"{s}_upper_arm", "0.3 0 0", "zx") for s in ("left", "right")},
    **{f"{s}_hand": (f"{s}_forearm", "0.26 0 0", "") for s in ("left", "right")},
    **{f"{s}_thigh": ("pelvis", f"0 {y} -0.06", "xyz") for s, y in (("left", 0.1), ("right", -0.1))},
    **{f"{s}_shank": (f"{s}_thigh", "0 0 -0.42", "y") for s in ("left", "right")},
    **{f"{s}_foot": (f"{s}_shank", "0 0 -0.4", "") for s in ("left", "right")},
}
POINTS = ("pelvis", *BONES)
ENDS = [k for k, link in enumerate(POINTS) if link.endswith(("hand", "foot", "head"))]


def body_urdf():
    """A body whose ball joints are chains of hinges at one place."""
    parts = [
        '<robot name="body"><link name="pelvis"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    ]
    for name, (base, at, axes) in BONES.items():
        parent, place = base, at
        for k, axis in enumerate(axes or "f"):
            link = name if k == max(len(axes) - 1, 0) else f"{name}_{axis}"
            limits = "" if axis == "f" else '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
            parts.append(
                f'<link name="{link}"/><joint name="{link}_j" type="{"fixed" if axis == "f" else "revolute"}">'
                f'<origin xyz="{place}"/><parent link="{parent}"/><child link="{link}"/>'
                f'<axis xyz="{" ".join(str(int(axis == a)) for a in "xyz")}"/>{limits}</joint>'
            )
            parent, place = link, "0 0 0"
    return "".join([*parts, "</robot>"])


def positions(urdf, angles, roots):
    skeleton = load_skeleton(urdf)
    poses = skeleton.forward(angles, matrix_from_pose(roots))
    return np.stack([poses[:, skeleton.index(link), :3, 3] for link in POINTS], axis=1)


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """True factors of the links; their points (n, K, 3) m, true, recorded and as they were reached; the factors found."""
    folder = tmp_path_factory.mktemp("body")
    rng, urdf, other = np.random.default_rng(6), folder / "body.urdf", folder / "other.urdf"
    urdf.write_text(body_urdf())
    skeleton = load_skeleton(urdf)
    factors = {link: 1 + rng.uniform(-0.15, 0.15) for link in POINTS}
    other.write_bytes(scaled_urdf(urdf, factors))
    true = positions(other, *motion(skeleton, FRAMES))
    points = true + rng.normal(0, 0.001, true.shape)
    points[rng.random(points.shape[:2]) < 0.1] = np.nan
    log = write_points(folder / "log.mcap", points)
    links = ", ".join(f'"{k}" = "{link}"' for k, link in enumerate(POINTS))
    scene = folder / "scene.toml"
    scene.write_text(
        f'[[avatar]]\nname = "body"\nurdf = "body.urdf"\nkeypoints = {{ topic = "/hand", links = {{ {links} }} }}\n'
    )
    world = scaled_to_log(log, load_world(scene), Config())
    with FrameSource(log, world, Config()) as source:
        frames = list(source)
    angles, roots = np.array([f.angles for f in frames]), np.array([f.roots[0] for f in frames])
    return factors, true, points, positions(world.urdfs["body"], angles, roots), world.keypoint_scale["body"]


def test_every_bone_between_two_points_has_its_own_length(fitted):
    factors, *_, found = fitted
    bones = {base for base, *_ in BONES.values()}
    assert {link: found[link] for link in bones} == pytest.approx({link: factors[link] for link in bones}, abs=0.01)


def test_hands_and_feet_come_back(fitted):
    _, true, _, reached, _ = fitted
    errors = np.linalg.norm(reached - true, axis=2)
    assert np.median(errors[:, ENDS]) < 0.0015
    assert np.percentile(errors[:, ENDS], 95) < 0.003
    assert np.percentile(errors, 95) < 0.003


def test_no_link_jumps_where_its_body_does_not(fitted):
    _, true, _, reached, _ = fitted
    steps, shown = (np.linalg.norm(np.diff(p, axis=0), axis=2) for p in (reached, true))
    assert np.max(steps - shown) < 0.01
