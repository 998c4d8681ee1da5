"""A moving metacarpal that no point is on has the length with which the fit comes nearest to the points."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.keypoints.bone_scale import branch_names
from geomphys.keypoints.hidden_lengths import hidden_links
from geomphys.keypoints.setup import make_model
from geomphys.load import load_world
from geomphys.recording.point_measures import measure_points
from geomphys.scene.scaled_urdf import scaled_urdf
from geomphys.scene.skeleton import load_skeleton
from tests.keypoints.hands import hand_urdf, motion, openxr_points, write_hand, write_points, write_scene

CARPAL = (
    '<link name="little_carpal"/><joint name="little_carpal_j" type="revolute"><origin xyz="0.03 -0.02 0"/>'
    '<parent link="wrist"/><child link="little_carpal"/><axis xyz="0 1 0"/>'
    '<limit lower="-0.1" upper="0.4" effort="1" velocity="1"/></joint>'
)


def with_carpal(folder):
    """The hand with a joint at the root of the little finger's metacarpal."""
    text = hand_urdf()
    parent = '<parent link="wrist"/><child link="little_spread"/>'
    start = text.rindex("<origin", 0, text.index(parent))
    moved = '<origin xyz="0.06 -0.015 0" rpy="0 0 0"/>' + parent.replace("wrist", "little_carpal")
    text = text[:start] + moved + text[text.index(parent) + len(parent) :]
    urdf = folder / "hand.urdf"
    urdf.write_text(text.replace("</robot>", CARPAL + "</robot>"))
    return urdf


@pytest.mark.parametrize("factor", [0.86, 1.13])
def test_it_comes_back(tmp_path, factor):
    urdf, other, rng = with_carpal(tmp_path), tmp_path / "other.urdf", np.random.default_rng(2)
    other.write_bytes(scaled_urdf(urdf, {"little_carpal": factor}))
    skeleton = load_skeleton(other)
    angles, roots = motion(skeleton, 120)
    points = openxr_points(skeleton, angles, roots)
    log = write_points(tmp_path / "log.mcap", points + rng.normal(0, 0.001, points.shape))
    found = measure_points(log, load_world(write_scene(tmp_path)), Config())["hand"]
    assert found.links["little_carpal"] == pytest.approx(factor, abs=0.02)
    assert found.branches["little_carpal"] == found.links["little_carpal"]
    one = load_world(write_scene(tmp_path, 'topic = "/hand", layout = "openxr", scale = "hand"'))
    assert "little_carpal" not in measure_points(log, one, Config())["hand"].branches


def test_a_hand_whose_links_all_have_points_has_none(tmp_path):
    skeleton = write_hand(tmp_path)
    names = [link.name for link in skeleton.links]
    bodies = np.array([k for k, n in enumerate(names) if "spread" not in n and "twist" not in n])
    model = make_model(load_world(write_scene(tmp_path)).scene, 0, bodies, np.ones(len(bodies)), fits_root=True)
    assert hidden_links(model, branch_names(model.parent, model.column, names)) == []
