"""Compound joints and their cones: the limb's direction, how joints move it, and the smallest way back."""

from __future__ import annotations

import numpy as np
import pytest
import yourdfpy
from scipy.optimize import minimize

from geomphys.driven.reach_cones import (
    cone_angle,
    cone_bound,
    cone_row,
    fit_angles,
    limb_direction,
    signed_angle,
)
from geomphys.jit.packed_records import pack
from tests.driven.compound import CONE, NOTCHED, joints_of, shoulder


@pytest.fixture(scope="module", params=[CONE, NOTCHED], ids=["convex", "notched"])
def world(request, tmp_path_factory):
    return shoulder(tmp_path_factory.mktemp("arm"), request.param)


def corners(world):
    return world.scene.cones.directions


def random_angles(seed, count=4, spread=2.6):
    angles = np.random.default_rng(seed).uniform(-spread, spread, count)
    angles[3] = -0.5
    return angles


def fit(world, recorded, bend, yields=None):
    bend = np.array(bend, float)
    angles = recorded + bend
    yields = np.ones(4, np.int64) if yields is None else np.array(yields)
    changed = fit_angles(pack(world.scene), 0, yields, recorded, bend, angles, np.zeros(4))
    return changed, bend, angles


def test_limb_direction_is_what_forward_kinematics_says(world):
    """yourdfpy is the oracle: the limb vector of the last link, seen from the frame the first joint sits in."""
    model = yourdfpy.URDF.load(str(world.urdfs["arm"]), load_meshes=False)
    for seed in range(5):
        angles = random_angles(seed)
        model.update_cfg(dict(zip(world.dof_names, angles, strict=True)))
        limb = model.get_transform("upper", "torso")[:3, :3] @ (np.array([0.1, 0, -1]) / np.sqrt(1.01))
        seat = model.joint_map["sy"].origin[:3, :3]
        assert limb_direction(pack(world.scene), 0, angles) == pytest.approx(seat.T @ limb, abs=1e-12)


def test_row_against_finite_differences(world):
    scene, joints = pack(world.scene), joints_of(world)
    checked = 0
    for seed in range(60):
        angles = random_angles(seed)
        column, row = np.array([2, 3, 4, -1]), np.zeros(6)
        row[:2] = 7.0, 8.0  # unknowns of others
        g = cone_row(scene, joints.lever, 0, angles, column, row)
        assert g == cone_angle(scene, 0, angles)
        assert row[:2].tolist() == [7.0, 8.0]
        assert row[5] == 0.0
        h = 1e-6
        for q in range(3):
            step = np.eye(4)[q] * h
            ahead, back = cone_angle(scene, 0, angles + step) - g, g - cone_angle(scene, 0, angles - step)
            if abs(ahead - back) < 1e-9:  # not on a line where the nearest side changes
                assert row[column[q]] == pytest.approx((ahead + back) / (2 * h * 0.3), abs=1e-5)
                checked += 1
    assert checked > 150


def test_inside_nothing_changes(world):
    recorded = np.zeros(4)
    assert cone_angle(pack(world.scene), 0, recorded) > 0.1
    changed, bend, angles = fit(world, recorded, [0.05, -0.03, 0.5, -0.3])
    assert not changed
    assert bend.tolist() == [0.05, -0.03, 0.5, -0.3]
    assert np.array_equal(angles, recorded + bend)


def outside(world, count):
    scene, seed = pack(world.scene), 100
    while count:
        seed += 1
        recorded, there = random_angles(seed, spread=0.3), random_angles(seed + 5000, spread=2.0)
        if cone_angle(scene, 0, recorded) > 0 and cone_angle(scene, 0, there) < -0.01:
            count -= 1
            yield recorded, there


def test_comes_back_by_the_smallest_change(world):
    """Against a general solver started from many places."""
    scene, near, total = pack(world.scene), 0, 0
    for recorded, there in outside(world, 25):
        changed, bend, angles = fit(world, recorded, there - recorded)
        assert changed
        assert np.array_equal(angles, np.where(bend == 0, recorded, recorded + bend))
        assert cone_angle(scene, 0, angles) >= 0
        assert angles[3] == pytest.approx(there[3], abs=1e-15)
        assert np.all(np.abs(angles[:3]) <= 2.6)
        best = np.inf
        for k in range(8):
            start = angles if k == 0 else there + np.random.default_rng(k).normal(size=4) * 0.3
            found = minimize(
                lambda x, there=there: np.sum((x - there[:3]) ** 2), start[:3], method="SLSQP", bounds=[(-2.6, 2.6)] * 3,
                constraints={"type": "ineq", "fun": lambda x: cone_angle(scene, 0, np.append(x, 0.0))},
            )  # fmt: skip
            if found.success and cone_angle(scene, 0, np.append(found.x, 0.0)) > -1e-6:
                best = min(best, np.linalg.norm(found.x - there[:3]))
        total += 1
        near += np.linalg.norm(angles - there) <= 1.03 * best + 1e-6
    assert near >= 0.85 * total


def test_limits_hold_and_the_recorded_excess_is_no_way_further_out(tmp_path_factory):
    tight = shoulder(tmp_path_factory.mktemp("tight"), CONE, limits=1.1)
    scene = pack(tight.scene)
    beyond = 0
    for seed in range(80):
        recorded, there = random_angles(seed, spread=1.6), random_angles(seed + 9000, spread=1.6)
        low, high = np.minimum(recorded, -1.1), np.maximum(recorded, 1.1)
        there = np.clip(there, low, high)
        bound = cone_bound(scene, 0, recorded)
        beyond += bound < 0
        _, _, angles = fit(tight, recorded, there - recorded)
        assert cone_angle(scene, 0, angles) >= bound
        assert np.all(angles[:3] >= low[:3] - 1e-15)
        assert np.all(angles[:3] <= high[:3] + 1e-15)
    assert beyond > 20


def test_joints_that_do_not_yield_stay(world):
    for recorded, there in outside(world, 6):
        there[1] = recorded[1]
        _, _, angles = fit(world, recorded, there - recorded, yields=[1, 0, 1, 1])
        assert angles[1] == recorded[1]
        assert cone_angle(pack(world.scene), 0, angles) >= 0


def test_clockwise_corners_mean_the_same_cone(tmp_path_factory):
    """The polygon's inside is the smaller part of the sphere, in whatever order its corners are given."""
    forth, back = (
        shoulder(tmp_path_factory.mktemp("order"), directions).scene.cones.directions
        for directions in (CONE, CONE[::-1])
    )
    for d in np.random.default_rng(3).normal(size=(20, 3)):
        d /= np.linalg.norm(d)
        assert signed_angle(forth, 0, 5, tuple(d))[0] == pytest.approx(signed_angle(back, 0, 5, tuple(d))[0], abs=1e-12)
