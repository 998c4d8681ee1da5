"""The fit of joint values to points: what the points show is found, within limits; what they do not show stays at rest."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.jit.packed_records import pack
from geomphys.keypoints.fit import add_points, add_priors, objective, pose_links
from geomphys.keypoints.fitter import KeypointFitter
from geomphys.keypoints.setup import make_model, make_state
from geomphys.load import load_world
from geomphys.numerics.transforms import (
    angle_between,
    quaternion_from_rotation,
    quaternion_from_rpy,
    rotation_about,
    rotation_from_quaternion,
)
from tests.keypoints.hands import motion, write_hand, write_scene


@pytest.fixture(scope="module")
def hand(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hand")
    skeleton = write_hand(folder)
    world = load_world(write_scene(folder))
    links = [link.name for link in skeleton.links]
    named = [k for k, name in enumerate(links) if "spread" not in name and "twist" not in name]
    return world, skeleton, links, np.array(named)


def model_of(hand, fits_root=True):
    world, _, _, bodies = hand
    return make_model(world.scene, 0, bodies, np.ones(len(bodies)), fits_root=fits_root)


def points_of(model, root, angles):
    poses = np.zeros((len(model.parent), 7))
    pose_links(model, root, angles, poses)
    return poses[model.body, :3].copy()


def all_seen(model):
    return np.ones(len(model.body), dtype=np.int64)


def joint(hand, name):
    return hand[1].dof_names.index(f"{name}_j")


def test_links_are_posed_as_by_the_skeleton(hand):
    model, skeleton = model_of(hand), hand[1]
    angles, _ = motion(skeleton, 5)
    expected = skeleton.forward(angles[3])[hand[3], :3, 3]
    found = points_of(model, np.array([0, 0, 0, 0, 0, 0, 1.0]), angles[3])
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_gradient_is_that_of_the_objective(hand):
    model = model_of(hand)
    state = make_state(model)
    packed, work = pack(model), pack(state)
    angles, roots = motion(hand[1], 40)
    points, seen = points_of(model, roots[0], angles[0]), all_seen(model)
    state.root[:], state.angles[:], state.target[:], state.weights["smoothness"] = (
        roots[30],
        angles[30],
        angles[20],
        0.3,
    )
    pose_links(packed, state.root, state.angles, state.poses)
    add_points(packed, work, points, seen, (0.1, 0.2, 0.3))
    add_priors(packed, work)
    for j in range(len(model.rest)):
        values = []
        for change in (-1e-6, 1e-6):
            trial = state.angles.copy()
            trial[j] += change
            pose_links(packed, state.root, trial, state.trial_poses)
            values.append(objective(packed, work, points, seen, trial, state.trial_poses))
        assert state.gradient[j] == pytest.approx((values[1] - values[0]) / 2e-6, rel=1e-4, abs=1e-9)


def test_the_gradient_of_the_rotation_is_that_of_the_objective_with_an_orientation(hand):
    model = model_of(hand)
    state = make_state(model)
    packed, work = pack(model), pack(state)
    angles, roots = motion(hand[1], 40)
    points, seen = points_of(model, roots[0], angles[0]), all_seen(model)
    state.angles[:], state.root[:] = angles[10], roots[10]
    state.orientation[:], state.weights["orientation"] = quaternion_from_rpy((10.0, -20.0, 30.0)), 0.01
    pose_links(packed, state.root, state.angles, state.poses)
    centre = np.array([0.1, 0.2, 0.3])
    add_points(packed, work, points, seen, tuple(centre))
    add_priors(packed, work)
    for k in range(3):
        values = []
        for change in (-1e-6, 1e-6):
            rotation = rotation_about(np.eye(3)[k], change)
            root = np.array([*(centre + rotation @ (state.root[:3] - centre)), *state.root[3:]])
            root[3:] = quaternion_from_rotation(rotation @ rotation_from_quaternion(state.root[3:]))
            pose_links(packed, root, state.angles, state.trial_poses)
            values.append(objective(packed, work, points, seen, state.angles, state.trial_poses))
        slope = (values[1] - values[0]) / 2e-6
        assert state.gradient[len(model.rest) + 3 + k] == pytest.approx(slope, rel=1e-4, abs=1e-8)


def test_one_point_of_the_palm_and_an_orientation_show_the_root(hand):
    model, links = model_of(hand), hand[2]
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 40)
    for k in range(20):
        fitter.fit(points_of(model, roots[k], angles[k]), all_seen(model), roots[k])
    lost = np.array([links[b].endswith("proximal") or links[b] == "thumb_metacarpal" for b in hand[3]])
    seen = np.where(lost, 0, 1)
    after = fitter.fit(points_of(model, roots[25], angles[25]), seen, roots[25], roots[25][3:], 0.2)
    np.testing.assert_allclose(after.root[:3], roots[25][:3], atol=0.003)
    assert angle_between(after.root[3:], roots[25][3:]) < 0.02


def test_points_without_noise_give_the_posture_they_come_from(hand):
    model = model_of(hand)
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 60)
    for k in range(60):
        points = points_of(model, roots[k], angles[k])
        found = fitter.fit(points, all_seen(model), roots[0])
        assert not found.held
        error = np.linalg.norm(points_of(model, found.root, found.angles) - points, axis=1)
        assert error.max() < 2e-3
        assert np.median(error) < 3e-4
        assert (found.angles >= model.lower).all()
        assert (found.angles <= model.upper).all()


def test_a_known_root_is_left_as_it_is(hand):
    model = model_of(hand, fits_root=False)
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 10)
    for k in range(10):
        found = fitter.fit(points_of(model, roots[k], angles[k]) + 0.01, all_seen(model), roots[k])
        assert (found.root == roots[k]).all()


def test_values_stay_within_limits_where_the_points_come_from_beyond(hand):
    model = model_of(hand)
    fitter = KeypointFitter(model)
    _, roots = motion(hand[1], 1)
    beyond = np.where(np.arange(len(model.rest)) % 2 == 0, model.upper + 0.3, model.lower - 0.2)
    found = fitter.fit(points_of(model, roots[0], beyond), all_seen(model), roots[0])
    assert (found.angles >= model.lower).all()
    assert (found.angles <= model.upper).all()


@pytest.mark.parametrize(("beyond", "frames"), [(0.3, 13), (0.0, 0), (-0.05, 0)])
def test_a_joint_that_the_points_take_beyond_its_limit_is_counted(hand, beyond, frames):
    model, rng = model_of(hand), np.random.default_rng(2)
    fitter, bent, root = KeypointFitter(model), motion(hand[1], 1)[0][0], np.array([0, 0, 1, 0, 0, 0, 1.0])
    k = joint(hand, "index_proximal")
    bent[k] = model.upper[k] + beyond
    for _ in range(200):
        points = points_of(model, root, bent) + rng.normal(0, 0.0005, (len(model.body), 3))
        fitter.fit(points, all_seen(model), root)
    assert fitter.limited[k] == frames
    assert fitter.limited.sum() == frames


def test_the_twist_of_a_straight_thumb_stays_at_rest_and_is_reported(hand):
    model = model_of(hand)
    fitter, rng = KeypointFitter(model), np.random.default_rng(1)
    twist = joint(hand, "thumb_twist")
    straight = model.rest.copy()
    for _ in range(200):
        points = points_of(model, np.array([0, 0, 1, 0, 0, 0, 1.0]), straight) + rng.normal(
            0, 0.001, (len(model.body), 3)
        )
        found = fitter.fit(points, all_seen(model), model.rest)
        assert abs(found.angles[twist]) < 0.2
    assert fitter.unshown[twist] == fitter.probed
    assert fitter.unshown[joint(hand, "index_middle")] == 0


def test_a_bent_thumb_shows_its_twist(hand):
    model = model_of(hand)
    fitter = KeypointFitter(model)
    bent = model.rest.copy()
    bent[joint(hand, "thumb_proximal")], bent[joint(hand, "thumb_twist")] = 0.9, 0.5
    root = np.array([0, 0, 1, 0, 0, 0, 1.0])
    found = fitter.fit(points_of(model, root, bent), all_seen(model), root)
    assert found.angles[joint(hand, "thumb_twist")] == pytest.approx(0.5, abs=0.02)
    assert fitter.unshown[joint(hand, "thumb_twist")] == 0


def test_a_finger_that_is_lost_is_held_and_the_others_go_on(hand):
    model, links = model_of(hand), hand[2]
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 40)
    lost = np.array([links[body].startswith("index") for body in hand[3]])
    for k in range(20):
        before = fitter.fit(points_of(model, roots[k], angles[k]), all_seen(model), roots[k])
    after = fitter.fit(points_of(model, roots[25], angles[25]), np.where(lost, 0, 1), roots[25])
    index = [joint(hand, f"index_{part}") for part in ("spread", "proximal", "middle", "distal")]
    ring = [joint(hand, f"ring_{part}") for part in ("proximal", "middle", "distal")]
    assert after.held
    assert not before.held
    assert (after.angles[index] == before.angles[index]).all()
    np.testing.assert_allclose(after.angles[ring], angles[25][ring], atol=0.08)


def test_a_tip_that_is_lost_holds_the_last_joint_only(hand):
    model, links = model_of(hand), hand[2]
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 40)
    for k in range(20):
        before = fitter.fit(points_of(model, roots[k], angles[k]), all_seen(model), roots[k])
    seen = np.array([int(links[body] != "index_tip") for body in hand[3]])
    after = fitter.fit(points_of(model, roots[24], angles[24]), seen, roots[24])
    assert after.angles[joint(hand, "index_distal")] == before.angles[joint(hand, "index_distal")]
    assert after.angles[joint(hand, "index_middle")] == pytest.approx(angles[24][joint(hand, "index_middle")], abs=0.03)


def test_without_the_palm_everything_is_held(hand):
    model, links = model_of(hand), hand[2]
    fitter = KeypointFitter(model)
    angles, roots = motion(hand[1], 40)
    for k in range(20):
        before = fitter.fit(points_of(model, roots[k], angles[k]), all_seen(model), roots[k])
    palm = np.array(
        [links[b] == "wrist" or links[b].endswith("proximal") or links[b] == "thumb_metacarpal" for b in hand[3]]
    )
    after = fitter.fit(points_of(model, roots[25], angles[25]), np.where(palm, 0, 1), roots[25])
    assert after.held
    assert (after.root == before.root).all()
    assert (after.angles == before.angles).all()


def test_noise_gives_no_jump_that_the_points_do_not_have(hand):
    model = model_of(hand)
    fitter, rng = KeypointFitter(model), np.random.default_rng(2)
    angles, roots = motion(hand[1], 200)
    last = None
    for k in range(200):
        points = points_of(model, roots[k], angles[k]) + rng.normal(0, 0.001, (len(model.body), 3))
        found = fitter.fit(points, all_seen(model), roots[k])
        reached = points_of(model, found.root, found.angles)
        if last is not None:
            shown = np.linalg.norm(points - last[0], axis=1).max()
            assert np.linalg.norm(reached - last[1], axis=1).max() < shown + 0.004
            assert np.abs(found.angles - last[2]).max() < 0.35
        last = points, reached, found.angles
