"""Compiled forward kinematics against the skeleton's own and yourdfpy's."""

from __future__ import annotations

import numpy as np
import pytest
import yourdfpy
from scipy.spatial.transform import Rotation

from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.numerics.transforms import compose, frame_from_matrix, matrix_from_frame, matrix_from_pose
from geomphys.scene.kinematics import joint_origins, pose_pieces_of_tree, pose_tree
from geomphys.scene.skeleton import load_skeleton
from geomphys.scene.world import World
from tests.scene.models import joint, link, urdf

BALL = '<origin xyz="0.01 0.02 0.03" rpy="0.4 0.5 0.6"/><geometry><box size="0.02 0.03 0.04"/></geometry>'


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    """A branched model with every kind of joint, a mimic joint, links without geometry and half turns."""
    folder = tmp_path_factory.mktemp("model")
    urdf(
        folder / "model.urdf",
        *(link(n, BALL) for n in ("base", "a", "c", "d", "f")),
        *(link(n) for n in ("b", "e")),
        joint("ja", "base", "a", inside='<axis xyz="0.6 0 0.8"/>', xyz='0.1 0.2 0.3" rpy="0.3 -0.4 3.1'),
        joint("jb", "a", "b", "prismatic", inside='<axis xyz="0 0.6 -0.8"/>', xyz='0 0 0.1" rpy="3.14159265358979 0 0'),
        joint("jc", "b", "c", "continuous", inside='<axis xyz="1 2 2"/>', xyz='0.1 0 0" rpy="0 3.14159265358979 0'),
        joint("jd", "base", "d", inside='<axis xyz="0 1 0"/><mimic joint="ja" multiplier="-0.5" offset="0.2"/>'),
        joint("je", "d", "e", "fixed", xyz='0 0.1 0" rpy="0 0 3.14159265358979'),
        joint("jf", "e", "f", inside='<axis xyz="0 0 -1"/>', xyz='0 0 0.1" rpy="1.57 1.57 -1.57'),
    )
    scene = '[[avatar]]\nname="m"\nurdf="model.urdf"\nmaterial="human"\njoints={topic="/j"}\nroot={topic="/r"}\n'
    (folder / "scene.toml").write_text(scene)
    return load_world(folder / "scene.toml")


def random_state(world: World, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    root = np.concatenate([rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_quat()])
    return root[None], rng.uniform(-3, 3, len(world.dof_names))


@pytest.mark.parametrize("seed", range(20))
def test_poses_are_those_of_yourdfpy_and_of_the_skeleton(world: World, seed: int) -> None:
    roots, angles = random_state(world, seed)
    poses = np.zeros((len(world.body_names), 7))
    pose_tree(pack(world.scene), joint_origins(world.scene), 0, roots, angles, poses)
    assert poses[0].tobytes() == roots[0].tobytes()
    assert np.linalg.norm(poses[:, 3:], axis=1) == pytest.approx(1.0, abs=1e-12)
    path = world.urdfs["m"]
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    values = dict(zip(world.dof_names, angles, strict=True))
    robot.update_cfg(values)
    for name in robot.link_map:
        expected = compose(matrix_from_pose(roots[0]), robot.get_transform(name, "base"))
        assert matrix_from_pose(poses[world.body_names.index(f"m/{name}")]) == pytest.approx(expected, abs=1e-12)
    skeleton = load_skeleton(path)
    assert skeleton.dof_names == world.dof_names
    own = skeleton.forward(angles, matrix_from_pose(roots[0]))
    for k, expected in enumerate(own):
        assert matrix_from_pose(poses[k]) == pytest.approx(expected, abs=1e-12)


def test_pieces_stand_where_their_bodies_carry_them(world: World) -> None:
    roots, angles = random_state(world, 99)
    scene = world.scene
    poses, frames = np.zeros((len(world.body_names), 7)), np.zeros((len(scene.pieces.kind), 12))
    pose_tree(pack(scene), joint_origins(scene), 0, roots, angles, poses)
    pose_pieces_of_tree(pack(scene), 0, poses, frames)
    for k, body in enumerate(scene.pieces.body):
        expected = compose(matrix_from_pose(poses[body]), matrix_from_frame(scene.pieces.local[k]))
        assert frames[k] == pytest.approx(frame_from_matrix(expected), abs=1e-12)


def test_origins_are_unit_quaternions_of_the_same_rotation(world: World) -> None:
    for row, pose in zip(world.scene.bodies.origin, joint_origins(world.scene), strict=True):
        assert matrix_from_pose(pose) == pytest.approx(matrix_from_frame(row), abs=1e-12)
