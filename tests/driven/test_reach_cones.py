"""Compound joints and their cones: the limb's direction, and how joints move it."""

from __future__ import annotations

import numpy as np
import pytest
import yourdfpy

from geomphys.driven.constraints import add_cones, bound_unknowns, number_unknowns, set_cone_limits
from geomphys.driven.reach_cones import (
    cone_angle,
    cone_limit,
    cone_row,
    limb_direction,
    signed_angle,
)
from geomphys.driven.state import GENERAL_MOTION
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from tests.driven.compound import CONE, NOTCHED, joints_of, shoulder


@pytest.fixture(scope="module", params=[CONE, NOTCHED], ids=["convex", "notched"])
def world(request, tmp_path_factory):
    return shoulder(tmp_path_factory.mktemp("arm"), request.param)


def random_angles(seed, count=4, spread=2.6):
    angles = np.random.default_rng(seed).uniform(-spread, spread, count)
    angles[3] = -0.5
    return angles


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


def test_clockwise_corners_mean_the_same_cone(tmp_path_factory):
    """The polygon's inside is the smaller part of the sphere, in whatever order its corners are given."""
    forth, back = (
        shoulder(tmp_path_factory.mktemp("order"), directions).scene.cones.directions
        for directions in (CONE, CONE[::-1])
    )
    for d in np.random.default_rng(3).normal(size=(20, 3)):
        d /= np.linalg.norm(d)
        assert signed_angle(forth, 0, 5, tuple(d))[0] == pytest.approx(signed_angle(back, 0, 5, tuple(d))[0], abs=1e-12)


def test_a_limb_recorded_beyond_its_cone_is_bounded_there_and_another_at_the_boundary(world):
    scene, seen = pack(world.scene), set()
    for seed in range(40):
        angles = random_angles(seed)
        g = cone_angle(scene, 0, angles)
        seen.add(g > 0)
        assert cone_limit(scene, 0, angles) == (0.0 if g > 0 else g)
    assert seen == {True, False}


def test_a_limb_without_a_row_cannot_leave_its_cone_in_the_step(world):
    """Steps to the corners of the bounds, from angles other than those at which the cone was last evaluated."""
    scene, data, rng, rows = pack(world.scene), make_replay_data(world.scene), np.random.default_rng(5), [0, 0]
    ws = pack(data.workspace)
    ws.work.mobility[0] = GENERAL_MOTION
    for seed in range(60):
        recorded = random_angles(seed, spread=0.8)
        ws.work.iterate.angles[:] = recorded + rng.uniform(-0.05, 0.05, 4)
        ws.work.low[:], ws.work.high[:] = -2.6, 2.6
        set_cone_limits(scene, ws, recorded)
        unknowns = number_unknowns(scene, ws)
        bound_unknowns(scene, ws, ws.work.iterate, 0.03, True)
        count = add_cones(scene, ws, ws.work.iterate, 0, unknowns)
        rows[count] += 1
        if count == 0:
            low, high, column = ws.problem.low, ws.problem.high, ws.work.column
            for corner in range(8):
                angles = ws.work.iterate.angles.copy()
                for q in range(3):
                    angles[q] += (high if corner >> q & 1 else low)[column[q]]
                assert cone_angle(scene, 0, angles) > 0.0
    assert min(rows) > 5
