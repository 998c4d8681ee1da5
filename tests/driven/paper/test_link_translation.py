"""A link along a surface is translated: the closed form, orientation, limits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.driven.paper.link_translation import rotation_for, translate_link
from geomphys.jit.packed_records import pack
from tests.driven.paper.test_descent import UPPER, planar_arm, workspace


def test_the_smaller_of_two_rotations_moves_the_base_by_the_distance() -> None:
    rng = np.random.default_rng(3)
    for a, b, distance in rng.normal(size=(100, 3)):
        exists, angle = rotation_for(a, b, distance)
        assert exists == (abs(a + distance) <= math.hypot(a, b))
        if exists:
            assert a * math.cos(angle) + b * math.sin(angle) - a == pytest.approx(distance, abs=1e-12)
            grid = np.linspace(-abs(angle), abs(angle), 101)[1:-1]
            assert (np.diff(np.sign(a * np.cos(grid) + b * np.sin(grid) - a - distance)) == 0).all()


def test_a_translated_link_keeps_its_orientation(tmp_path: Path) -> None:
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.4, -0.4]))
    lower = world.body_names.index("arm/lower")
    before = w.iterate.poses[lower].copy()
    assert translate_link(pack(world.scene), pack(w), lower, -1, (0.0, 1.0, 0.0), 0.02)
    after = w.iterate.poses[lower]
    assert after[1] - before[1] == pytest.approx(0.02, abs=1e-12)
    assert (Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()).magnitude() <= 1e-12
    assert math.sin(w.iterate.angles[0]) * UPPER == pytest.approx(UPPER * math.sin(0.4) + 0.02, abs=1e-12)
    assert w.iterate.angles.sum() == pytest.approx(0.0, abs=1e-12)


def test_what_limits_forbid_changes_nothing(tmp_path: Path) -> None:
    world = planar_arm(tmp_path)
    w = workspace(world, np.array([0.4, -0.4]), low=-0.41, high=3.0)
    before = w.iterate.poses.copy(), w.iterate.angles.copy()
    lower = world.body_names.index("arm/lower")
    assert not translate_link(pack(world.scene), pack(w), lower, -1, (0.0, 1.0, 0.0), 0.02)
    assert not translate_link(pack(world.scene), pack(w), lower, -1, (0.0, 1.0, 0.0), 1.0)
    assert w.iterate.poses == pytest.approx(before[0], abs=1e-15)
    assert w.iterate.angles.tobytes() == before[1].tobytes()
