"""Cyclic coordinate descent: closed forms, goals, limits, mimic and prismatic joints, cones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from geomphys.driven.ccd import wanted_turn
from geomphys.driven.reach_cones import cone_angle
from tests.driven.compound import CONE, shoulder
from tests.driven.rig import Rig, rig
from tests.scene.models import joint, link

CHAIN = '[[avatar.chain]]\nname = "c"\nbase = "base"\ntip = "tip"\n'
ROD = '<origin xyz="{0} 0 0" rpy="0 1.5707963267948966 0"/><geometry><cylinder radius="0.01" length="0.1"/></geometry>'


def inside(axis: str, low: float = -3.0, high: float = 3.0, extra: str = "") -> str:
    return f'<axis xyz="{axis}"/><limit lower="{low}" upper="{high}" effort="1" velocity="1"/>{extra}'


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Rig:
    """Two links of 0.3 and 0.2 m that turn about z."""
    return rig(
        tmp_path_factory.mktemp("planar"),
        (
            link("base"), link("one", ROD.format(0.15)), link("tip", ROD.format(0.1)),
            joint("q1", "base", "one", xyz="0 0 0", inside=inside("0 0 1")),
            joint("q2", "one", "tip", xyz="0.3 0 0", inside=inside("0 0 1", -2.8, 2.8)),
        ),
        CHAIN,
    )  # fmt: skip


AXES = ("0 0 1", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "0 1 0", "1 0 0")


@pytest.fixture(scope="module")
def spatial(tmp_path_factory) -> Rig:
    """Seven joints with limits of ±1.2 rad, some of them turned the other way round."""
    names = ("base", *(f"l{k}" for k in range(1, 7)), "tip")
    return rig(
        tmp_path_factory.mktemp("spatial"),
        (
            *(link(name, ROD.format(0.05)) for name in names),
            *(
                joint(f"q{k}", names[k], names[k + 1], xyz=f'0.15 0 0.02" rpy="0.1 {0.1 * k} 0', inside=inside(axis, -1.2, 1.2))
                for k, axis in enumerate(AXES)
            ),
        ),
        CHAIN,
    )  # fmt: skip


def test_one_joint_turns_by_equation_5():
    """A point off the plane of the joint counts by its projection (4)."""
    turn = wanted_turn((0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (2.0, 1.0, 5.0), (1.0, 4.0, -3.0))
    assert turn == pytest.approx(math.pi / 2, abs=1e-15)
    assert wanted_turn((0.0, 0.0, -1.0), (1.0, 1.0, 0.0), (2.0, 1.0, 5.0), (1.0, 4.0, -3.0)) == pytest.approx(
        -math.pi / 2
    )
    assert wanted_turn((0.0, 0.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0, 5.0), (1.0, 4.0, -3.0)) == 0.0
    rng = np.random.default_rng(0)
    for _ in range(50):
        a, o, e, g = rng.normal(size=(4, 3))
        a /= np.linalg.norm(a)
        e1, g1 = (p - a @ (p - o) * a for p in (e, g))
        u, v = (e1 - o) / np.linalg.norm(e1 - o), (g1 - o) / np.linalg.norm(g1 - o)
        expected = np.arccos(np.clip(u @ v, -1, 1)) * np.sign(a @ np.cross(u, v))
        assert wanted_turn(*map(tuple, (a, o, e, g))) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("goal", [(0.3, 0.2), (0.1, 0.35), (-0.2, 0.3), (0.45, -0.1), (0.2, -0.15)])
def test_planar_arm_in_closed_form(planar, goal):
    """The law of cosines gives the elbow; its sign is that of the posture begun with."""
    error, _, angles = planar.descend("tip", (0.2, 0, 0), (*goal, 0.0), bend=(0.2, 0.5))
    assert error < 1e-9
    x, y = goal
    elbow = math.acos((x * x + y * y - 0.3**2 - 0.2**2) / (2 * 0.3 * 0.2))
    assert abs(angles[1]) == pytest.approx(elbow, abs=1e-6)
    elbow = angles[1]
    upper = math.atan2(y, x) - math.atan2(0.2 * math.sin(elbow), 0.3 + 0.2 * math.cos(elbow))
    assert math.remainder(angles[0] - upper, 2 * math.pi) == pytest.approx(0, abs=1e-6)


def test_a_goal_out_of_reach_is_come_near_to(planar):
    error, _, angles = planar.descend("tip", (0.2, 0, 0), (0.0, 0.8, 0.3), bend=(0.2, 0.5), sweeps=400)
    assert error == pytest.approx(math.hypot(0.3, 0.3), abs=1e-6)
    assert angles == pytest.approx([math.pi / 2, 0], abs=1e-3)


def test_at_the_goal_nothing_moves(planar):
    poses = planar.pose([0.2, 0.5])
    tip = poses[planar.body("tip")]
    error, bend, _ = planar.descend("tip", (0, 0, 0), tip[:3], bend=(0.2, 0.5), tolerance=1e-12)
    assert bend.tolist() == [0.2, 0.5]
    assert error < 1e-12


def test_reaches_goals_in_space_within_limits(spatial):
    rng, reached = np.random.default_rng(5), 0
    for _ in range(40):
        goal = spatial.pose(rng.uniform(-1.1, 1.1, 7))[spatial.body("tip"), :3]
        start = rng.uniform(-1.1, 1.1, 7)
        error, bend, angles = spatial.descend("tip", (0, 0, 0), goal, recorded=start, sweeps=300, tolerance=1e-3)
        assert np.all(np.abs(angles) <= 1.2 + 1e-15)
        assert angles == pytest.approx(start + bend, abs=1e-15)
        reached += error <= 1e-3
    assert reached >= 36


def test_what_was_recorded_beyond_a_limit_gets_no_farther(spatial):
    rng = np.random.default_rng(6)
    for _ in range(20):
        recorded = rng.uniform(-1.8, 1.8, 7)
        _, _, angles = spatial.descend("tip", (0, 0, 0), rng.uniform(-1.5, 1.5, 3), recorded=recorded, sweeps=50)
        assert np.all(angles <= np.maximum(recorded, 1.2) + 1e-15)
        assert np.all(angles >= np.minimum(recorded, -1.2) - 1e-15)


def test_joints_that_move_the_obstacle_too_are_not_used(spatial):
    still = spatial.body("l4")
    _, bend, _ = spatial.descend("tip", (0, 0, 0), (0.3, 0.3, 0.3), still=still)
    assert bend[:4].tolist() == [0.0] * 4
    assert np.all(bend[4:6] != 0)


def test_prismatic_joints_slide_and_stop_at_their_limits(tmp_path):
    sliding = rig(
        tmp_path,
        (
            link("base"), link("x", ROD.format(0.05)), link("tip", ROD.format(0.05)),
            joint("sx", "base", "x", "prismatic", xyz="0.1 0 0", inside=inside("1 0 0", -0.5, 0.5)),
            joint("sy", "x", "tip", "prismatic", xyz="0 0 0", inside=inside("0 -1 0", -0.2, 0.1)),
        ),
        CHAIN,
    )  # fmt: skip
    error, bend, _ = sliding.descend("tip", (0, 0, 0), (0.4, 0.15, 0.07))
    assert bend == pytest.approx([0.3, -0.15], abs=1e-12)
    assert error == pytest.approx(0.07, abs=1e-12)
    error, bend, _ = sliding.descend("tip", (0, 0, 0), (0.4, -0.4, 0.0))
    assert bend == pytest.approx([0.3, 0.1], abs=1e-12)
    assert error == pytest.approx(0.3, abs=1e-12)


@pytest.mark.parametrize("ratio", [1.0, 0.5, -0.7])
def test_mimic_joints_move_with_their_master(tmp_path, ratio):
    """A finger of three joints with two degrees of freedom: every reachable goal found by sampling is reached."""
    finger = rig(
        tmp_path,
        (
            link("base"), *(link(name, ROD.format(0.05)) for name in ("one", "two", "tip")),
            joint("q1", "base", "one", xyz="0 0 0", inside=inside("0 0 1", -1.5, 1.5)),
            joint("q2", "one", "two", xyz="0.1 0 0", inside=inside("0 0 1", 0.0, 1.6)),
            joint("q3", "two", "tip", xyz="0.1 0 0", inside=inside("0 0 1", -3, 3, f'<mimic joint="q2" multiplier="{ratio}"/>')),
        ),
        CHAIN,
    )  # fmt: skip
    rng = np.random.default_rng(2)
    for _ in range(12):
        truth = np.array([rng.uniform(-1.2, 1.2), rng.uniform(0.2, 1.5)])
        first, second, third = np.cumsum([truth[0], truth[1], ratio * truth[1]])
        goal = [0.1 * sum(f(a) for a in (first, second, third)) for f in (np.cos, np.sin)]
        error, _, angles = finger.descend("tip", (0.1, 0, 0), (*goal, 0.0), bend=(0.1, 0.6), sweeps=2000)
        assert error < 1e-6
        assert 0.0 <= angles[1] <= 1.6
        assert len(angles) == 2


def test_compound_joints_stay_in_their_cones(tmp_path):
    arm = Rig(shoulder(tmp_path, CONE))
    rng, at_the_edge = np.random.default_rng(4), 0
    for _ in range(25):
        recorded = np.append(rng.uniform(-0.2, 0.2, 3), -0.4)
        goal = np.array([0, 0.2, 0.4]) + 0.4 * rng.normal(size=3) / np.sqrt(3)
        _, _, angles = arm.descend("lower", (0, 0, -0.25), goal, recorded=recorded, sweeps=40)
        g = cone_angle(arm.packs.scene, 0, angles)
        assert g >= 0.0
        at_the_edge += g < 1e-4
        assert np.all(np.abs(angles[:3]) <= 2.6)
    assert at_the_edge >= 4
