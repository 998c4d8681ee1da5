"""Cyclic coordinate descent against closed forms: one joint, two joints in a plane, limits, reach cones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.config import Config
from geomphys.driven.paper.descent import descend, fit_cone, joint_rotation
from geomphys.driven.paper.state import PaperWorkspace, make_paper_workspace
from geomphys.driven.reach_cones import cone_angle
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.scene.kinematics import pose_tree
from geomphys.scene.world import World
from tests.driven.compound import CONE, NOTCHED, limit, shoulder
from tests.scene.models import ball, joint, link, urdf

UPPER, LOWER = 0.3, 0.2  # m


def workspace(world: World, angles: np.ndarray, low: float = -3.0, high: float = 3.0) -> PaperWorkspace:
    """The method's workspace with an iterate at `angles` and these limits."""
    data = make_replay_data(world.scene)
    w = make_paper_workspace(world.scene, data.workspace, Config())
    w.iterate.angles[:] = angles
    w.lower[:], w.upper[:] = low, high
    w.cone_limit[:] = -math.pi
    scene = pack(world.scene)
    pose_tree(scene, w.origins, 0, w.iterate.roots, w.iterate.angles, w.iterate.poses)
    return w


def planar_arm(folder: Path) -> World:
    """Two links along x with joints about z."""
    urdf(
        folder / "arm.urdf",
        link("base"),
        ball("upper"),
        ball("lower"),
        ball("tip", at=f"{LOWER} 0 0"),
        joint("shoulder", "base", "upper", xyz="0 0 0", inside=limit(-3, 3, "0 0 1")),
        joint("elbow", "upper", "lower", xyz=f"{UPPER} 0 0", inside=limit(-3, 3, "0 0 1")),
        joint("fix", "lower", "tip", "fixed", xyz="0 0 0"),
    )
    (folder / "scene.toml").write_text(
        '[[avatar]]\nname="arm"\nurdf="arm.urdf"\nmode="chains"\nmaterial="human"\n'
        '[[avatar.chain]]\nname="arm"\nbase="base"\ntip="tip"\n'
    )
    return load_world(folder / "scene.toml")


def test_a_joint_rotates_the_point_to_face_the_goal() -> None:
    """(4) and (5): after the rotation both lie in one half plane of the axis."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        origin, ee, goal = rng.normal(size=(3, 3))
        angle = joint_rotation(tuple(axis), tuple(origin), tuple(ee), tuple(goal))
        moved = Rotation.from_rotvec(angle * axis).apply(ee - origin)
        flat = [p - (axis @ p) * axis for p in (moved, goal - origin)]
        cosine = flat[0] @ flat[1] / np.linalg.norm(flat[0]) / np.linalg.norm(flat[1])
        assert cosine == pytest.approx(1.0, abs=1e-12)
        assert abs(angle) <= math.pi


def test_a_point_on_the_axis_asks_for_no_rotation() -> None:
    assert joint_rotation((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.4), (1.0, 0.0, 0.0)) == 0.0


@pytest.mark.parametrize("goal", [(0.3, 0.2), (-0.1, 0.3), (0.2, -0.35)])
def test_two_joints_in_a_plane_reach_what_the_law_of_cosines_says(tmp_path: Path, goal: tuple[float, float]) -> None:
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.3, 0.6]))
    scene, packed, tip = pack(world.scene), pack(w), world.body_names.index("arm/tip")
    for _ in range(60):
        missed = descend(scene, packed, tip, -1, (LOWER, 0.0, 0.0), (*goal, 0.0), 1e-11)
    assert missed <= 1e-9
    square = goal[0] ** 2 + goal[1] ** 2
    elbow = math.acos((square - UPPER**2 - LOWER**2) / (2 * UPPER * LOWER))
    assert abs(w.iterate.angles[1]) == pytest.approx(elbow, abs=1e-6)
    e = w.iterate.angles[1]
    first = math.atan2(goal[1], goal[0]) - math.atan2(LOWER * math.sin(e), UPPER + LOWER * math.cos(e))
    assert math.remainder(w.iterate.angles[0] - first, 2 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_a_goal_out_of_reach_leaves_the_arm_stretched_towards_it(tmp_path: Path) -> None:
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.3, 0.6]))
    scene, packed, tip = pack(world.scene), pack(w), world.body_names.index("arm/tip")
    for _ in range(100):
        missed = descend(scene, packed, tip, -1, (LOWER, 0.0, 0.0), (0.0, 0.7, 0.0), 1e-9)
    assert missed == pytest.approx(0.7 - UPPER - LOWER, abs=1e-6)


def test_joints_stop_at_their_limits(tmp_path: Path) -> None:
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.0, 0.1]), low=-0.2, high=0.25)
    descend(
        pack(world.scene), pack(w), world.body_names.index("arm/tip"), -1, (LOWER, 0.0, 0.0), (-0.3, 0.3, 0.0), 1e-6
    )
    assert w.iterate.angles == pytest.approx([0.25, 0.25], abs=0.0)


def test_a_link_of_the_same_avatar_that_is_the_obstacle_is_not_moved(tmp_path: Path) -> None:
    """Only the elbow parts the lower arm from the upper one."""
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.3, 0.6]))
    tip, upper = (world.body_names.index(f"arm/{name}") for name in ("tip", "upper"))
    descend(pack(world.scene), pack(w), tip, upper, (LOWER, 0.0, 0.0), (0.0, 0.4, 0.0), 1e-6)
    assert w.iterate.angles[0] == 0.3
    assert w.iterate.angles[1] != 0.6


@pytest.mark.parametrize("directions", [CONE, NOTCHED], ids=["convex", "notched"])
def test_limbs_end_in_their_reach_cones(tmp_path: Path, directions: list[list[float]]) -> None:
    """Goals all round the shoulder: the limb follows to the edge of its cone and no farther."""
    world = shoulder(tmp_path, directions)
    scene, lower = pack(world.scene), world.body_names.index("arm/lower")
    stopped = 0
    for goal in np.random.default_rng(2).normal(size=(40, 3)):
        w = workspace(world, np.array([0.1, -0.1, 0.0, -0.3]))
        w.cone_limit[:] = 0.0
        packed = pack(w)
        assert cone_angle(scene, 0, w.iterate.angles) > 0.0
        descend(scene, packed, lower, -1, (0.0, 0.0, -0.2), tuple(0.4 * goal), 1e-3)
        inside = cone_angle(scene, 0, w.iterate.angles)
        assert inside >= 0.0
        stopped += inside < 0.01
        assert (np.abs(w.iterate.angles) <= 3.0).all()
    assert stopped > 5


def test_a_limb_outside_goes_back_to_the_edge_of_its_cone_by_a_small_change(tmp_path: Path) -> None:
    world = shoulder(tmp_path, CONE)
    scene = pack(world.scene)
    angles = np.array([0.1, -0.1, 0.0, 0.0])
    while cone_angle(scene, 0, angles) > -0.05:
        angles[0] += 0.01
    w = workspace(world, angles)
    w.cone_limit[:] = 0.0
    outside = -cone_angle(scene, 0, angles)
    assert fit_cone(scene, pack(w), 0)
    assert 0.0 <= cone_angle(scene, 0, w.iterate.angles) <= 1e-6
    assert np.linalg.norm(w.iterate.angles - angles) <= 3.0 * outside
    assert w.iterate.angles[3] == 0.0
