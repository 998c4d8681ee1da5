"""Orientations of the wrist and palm: they count where they agree with the points, whatever the axes of the source."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.load import load_world, scaled_to_log
from geomphys.numerics.transforms import angle_between, quaternion_from_rpy, quaternion_product, rotation_about
from geomphys.numerics.transforms import quaternion_from_rotation as from_rotation
from geomphys.recording.frames import FrameSource
from tests.keypoints.hands import motion, openxr_points, write_hand, write_points, write_scene

FRAMES = 100
PALM, WRIST = 0, 1
"""Of OpenXR's joints; `hand_urdf` has a link for the wrist only."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder, poses of the root (n, 7), and points (n, 26, 3) with 2 mm of noise of which a quarter is lost."""
    folder = tmp_path_factory.mktemp("oriented")
    skeleton, rng = write_hand(folder), np.random.default_rng(3)
    angles, roots = motion(skeleton, FRAMES)
    points = openxr_points(skeleton, angles, roots)
    points += rng.normal(0, 0.002, points.shape)
    lost = rng.random(points.shape[:2]) < 0.25
    lost[:, WRIST] = False
    points[lost] = np.nan
    return folder, roots, points


def fitted(recorded, orientations, more=""):
    """World, and poses of the root (n, 7), where the wrist has orientations (n, 4) or (4,)."""
    folder, _, points = recorded
    poses = np.zeros((FRAMES, 26, 7))
    poses[..., 6] = 1.0
    poses[..., :3] = points
    poses[:, WRIST, 3:] = orientations
    log = write_points(folder / "log.mcap", poses)
    scene = write_scene(folder, f'topic = "/hand", layout = "openxr"{more}')
    world = scaled_to_log(log, load_world(scene), Config())
    with FrameSource(log, world, Config()) as source:
        return world, np.array([frame.roots[0] for frame in source])


def noisy(orientations, degrees):
    rng = np.random.default_rng(4)
    turns = [
        from_rotation(rotation_about(rng.normal(size=3), np.radians(degrees) * rng.normal())) for _ in orientations
    ]
    return quaternion_product(orientations, np.array(turns))


def errors(recorded, roots):
    return np.degrees(angle_between(roots[:, 3:], recorded[1][:, 3:]))


NOT_FILLED_IN = np.array([0.0, 0.0, 0.0, 1.0])


def test_an_orientation_that_agrees_makes_the_wrist_more_exact_whatever_its_axes(recorded):
    world, plain = fitted(recorded, NOT_FILLED_IN)
    assert not world.palm_orientations
    found = []
    for axes in ((0, 0, 0), (-30, 170, 45)):
        given = quaternion_product(noisy(recorded[1][:, 3:], 0.2), quaternion_from_rpy(axes))
        world, roots = fitted(recorded, given)
        assert set(world.palm_orientations) == {"hand"}
        found.append(roots)
        assert np.median(errors(recorded, roots)) < 0.6 * np.median(errors(recorded, plain))
        assert np.percentile(errors(recorded, roots), 95) < 0.7 * np.percentile(errors(recorded, plain), 95)
    np.testing.assert_allclose(angle_between(found[0][:, 3:], found[1][:, 3:]), 0, atol=1e-3)


def test_it_counts_where_bone_lengths_are_not_scaled_too(recorded):
    world, _ = fitted(recorded, recorded[1][:, 3:], ', scale = "none"')
    assert set(world.palm_orientations) == {"hand"}
    assert not world.keypoint_scale


@pytest.mark.parametrize(
    "kind", ["of another motion", "turning about its own axis", "in the frame of a camera that turns"]
)
def test_an_orientation_that_does_not_agree_changes_nothing(recorded, kind):
    _, plain = fitted(recorded, NOT_FILLED_IN)
    true = recorded[1][:, 3:]
    spin = np.array([from_rotation(rotation_about([1, 0, 0], 0.05 * k)) for k in range(FRAMES)])
    given = {
        "of another motion": true[::-1],
        "turning about its own axis": quaternion_product(true, spin),
        "in the frame of a camera that turns": quaternion_product(spin, true),
    }[kind]
    world, roots = fitted(recorded, given)
    assert not world.palm_orientations
    np.testing.assert_array_equal(roots, plain)
