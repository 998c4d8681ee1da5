"""Rows of the driven loop's problem against finite differences of forward kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.driven.postures import copy_tree, joint_jacobian, make_posture, point_of
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import JOINT_PRISMATIC
from geomphys.scene.kinematics import joint_origins, pose_tree
from tests.driven.compound import NOTCHED, shoulder

STEP = 1e-6


@pytest.mark.parametrize("prismatic", [False, True])
@pytest.mark.parametrize("multiplier", [1.0, -0.5])
def test_a_point_moves_with_a_joint_as_its_jacobian_says(tmp_path: Path, prismatic: bool, multiplier: float) -> None:
    scene = shoulder(tmp_path, NOTCHED).scene
    joint = int(np.flatnonzero(scene.bodies.dof == 1)[0])
    if prismatic:
        scene.bodies.joint[joint] = JOINT_PRISMATIC
    scene.bodies.multiplier[joint] = multiplier
    packed, origins = pack(scene), joint_origins(scene)
    last = len(scene.bodies.parent) - 1
    rng = np.random.default_rng(4)
    angles, inside = rng.uniform(-1.0, 1.0, len(scene.dofs.lower)), (0.1, -0.2, 0.3)

    def point(change: float) -> np.ndarray:
        moved = angles.copy()
        moved[1] += change
        posture = make_posture(scene, make_replay_data(scene).recorded)
        pose_tree(packed, origins, 0, posture.roots, moved, posture.poses)
        return np.array(point_of(posture.poses, last, inside))

    posture = make_posture(scene, make_replay_data(scene).recorded)
    pose_tree(packed, origins, 0, posture.roots, angles, posture.poses)
    velocity = (point(STEP) - point(-STEP)) / (2.0 * STEP)
    for n in np.eye(3):
        found = joint_jacobian(packed, posture.poses, joint, tuple(point(0.0)), tuple(n))
        assert found == pytest.approx(velocity @ n, abs=1e-8)


def test_a_copied_tree_is_whole_and_no_other_is_touched(tmp_path: Path) -> None:
    scene = shoulder(tmp_path, NOTCHED).scene
    source, target = (make_posture(scene, make_replay_data(scene).recorded) for _ in range(2))
    source.roots[:], source.angles[:], source.poses[:] = 1.0, 2.0, 3.0
    copy_tree(pack(scene), pack(source), 0, pack(target))
    assert (target.roots[0] == 1.0).all()
    assert (target.angles == 2.0).all()
    assert (target.poses[: scene.trees.body_start[1]] == 3.0).all()
