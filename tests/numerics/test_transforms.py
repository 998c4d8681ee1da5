"""Rigid transforms, against scipy's rotations and the laws of a group."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from geomphys.numerics import transforms as tf

angles = st.floats(-20.0, 20.0)
quaternions = (
    arrays(np.float64, (5, 4), elements=st.floats(-1, 1))
    .filter(lambda q: bool(np.all(np.linalg.norm(q, axis=1) > 1e-2)))
    .map(lambda q: q / np.linalg.norm(q, axis=1, keepdims=True))
)


@given(quaternions)
def test_rotations_are_scipys(q: np.ndarray) -> None:
    np.testing.assert_allclose(tf.rotation_from_quaternion(q), Rotation.from_quat(q).as_matrix(), atol=1e-14)


@given(st.tuples(angles, angles, angles))
def test_roll_pitch_and_yaw_are_scipys_about_fixed_axes(rpy: tuple[float, float, float]) -> None:
    degrees = tuple(20.0 * a for a in rpy)
    found = Rotation.from_quat(tf.quaternion_from_rpy(degrees)).as_matrix()
    np.testing.assert_allclose(found, Rotation.from_euler("xyz", degrees, degrees=True).as_matrix(), atol=1e-13)


@pytest.mark.parametrize("axis", range(3))
def test_quarter_turns_are_exact(axis: int) -> None:
    root = np.sqrt(0.5)
    for degrees, sine, cosine in ((0, 0, 1), (90, root, root), (180, 1, 0), (-90, -root, root), (270, root, -root)):
        expected = [0.0, 0.0, 0.0, cosine]
        expected[axis] = sine
        assert tf.quaternion_from_rpy([degrees if k == axis else 0.0 for k in range(3)]) == tuple(expected)


@given(quaternions)
def test_a_rotation_gives_its_quaternion_back(q: np.ndarray) -> None:
    back = tf.quaternion_from_rotation(tf.rotation_from_quaternion(q))
    assert np.all(back[:, 3] >= 0)
    assert np.all(tf.angle_between(q, back) < 1e-13)


@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-6, np.pi - 1e-9, np.pi])
@pytest.mark.parametrize("axis", np.vstack([np.eye(3), -np.eye(3)]).tolist())
def test_tiny_and_half_turns_lose_no_digits(turn: float, axis: list[float]) -> None:
    q = tf.quaternion_from_rotation(tf.rotation_about(axis, turn))
    assert tf.angle_between(q, Rotation.from_rotvec(turn * np.array(axis)).as_quat()) < 1e-15


@given(angles, quaternions)
def test_turns_about_an_axis_are_scipys(angle: float, q: np.ndarray) -> None:
    axis = tf.rotation_from_quaternion(q)[0, 0]
    np.testing.assert_allclose(
        tf.rotation_about(axis, angle), Rotation.from_rotvec(angle * axis).as_matrix(), atol=3e-14
    )


@given(quaternions, quaternions)
def test_products_turn_one_after_the_other(a: np.ndarray, b: np.ndarray) -> None:
    both = tf.rotation_from_quaternion(a) @ tf.rotation_from_quaternion(b)
    np.testing.assert_allclose(tf.rotation_from_quaternion(tf.quaternion_product(a, b)), both, atol=1e-14)


@given(quaternions, st.floats(0.0, 3.0))
def test_the_angle_between_turns_is_the_angle_turned(q: np.ndarray, angle: float) -> None:
    turned = tf.quaternion_product(q, Rotation.from_rotvec([0.0, angle, 0.0]).as_quat())
    np.testing.assert_allclose(tf.angle_between(q, -turned), angle, atol=1e-14)


@given(quaternions, arrays(np.float64, (5, 3), elements=st.floats(-10, 10)))
def test_all_forms_hold_the_same_pose(q: np.ndarray, p: np.ndarray) -> None:
    pose = np.concatenate([p, q], axis=1)
    matrix = tf.matrix_from_pose(pose)
    assert np.array_equal(tf.matrix_from_frame(tf.frame_from_matrix(matrix)), matrix)
    again = tf.pose_from_matrix(matrix)
    assert np.array_equal(again[:, :3], p)
    assert np.all(tf.angle_between(again[:, 3:], q) < 1e-13)
    np.testing.assert_allclose(tf.compose(matrix, tf.invert(matrix)), np.tile(np.eye(4), (5, 1, 1)), atol=1e-13)


def test_the_identity_is_exact() -> None:
    identity = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    assert np.array_equal(tf.matrix_from_pose(identity), np.eye(4))
    assert tf.pose_from_matrix(np.eye(4)).tolist() == identity
    assert np.array_equal(tf.rotation_about([0.0, 0.0, 1.0], 0.0), np.eye(3))


def test_points_are_taken_along() -> None:
    world_from_link = tf.matrix_from_pose([1.0, 2.0, 3.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(tf.apply(world_from_link, [[1.0, 0.0, 0.0]]), [[1.0, 3.0, 3.0]], atol=1e-15)
