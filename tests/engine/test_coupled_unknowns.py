"""Offsets as unknowns of the contact solve: a step is equation (6) solved implicitly, up to the limit of effort."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from geomphys.driven.coupling import relax
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import (
    begin_impact,
    begin_step,
    end_impact,
    end_step,
    forget_bad_rates,
    load_unknowns,
    relax_rotation,
)
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.driven.compound import CONE, shoulder
from tests.simulated.scenes import Thing, floor, make_scene

M, K, R, H = 0.4, 300.0, 9.0, 1 / 240


@pytest.fixture
def coupled() -> Coupled:
    """Of a driven ball; its first unknown has the constants above and no limit of effort."""
    data = make_replay_data(make_scene([Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0, 0, 1)), floor()]))
    x = data.coupled.unknowns[0]
    x["mass"], x["stiffness"], x["damping"], x["effort"] = M, K, R, math.inf
    return data.coupled


@pytest.mark.parametrize("scale", [1.0, 0.3])
@pytest.mark.parametrize(("offset", "rate"), [(0.01, 0.0), (-0.02, 0.3), (0.0, -0.5)])
def test_a_step_without_contact_is_the_implicit_one_of_the_coupling(
    coupled: Coupled, offset: float, rate: float, scale: float
) -> None:
    x = coupled.unknowns[0]
    x["offset"], x["rate"], x["impedance_scale"] = offset, rate, scale
    begin_step(pack(coupled), 0, 1, H)
    v = float(x["new_rate"])
    assert scale * M * (v - rate) / H == pytest.approx(-scale * K * (offset + H * v) - scale * R * v, abs=1e-9)
    impulse, before = 0.01, v
    x["new_rate"] += impulse * x["inverse_mass"]
    v = float(x["new_rate"])
    assert v != before
    force = impulse / H
    assert scale * M * (v - rate) / H == pytest.approx(-scale * K * (offset + H * v) - scale * R * v + force, abs=1e-9)


@pytest.mark.parametrize("offset", [0.1, -0.1])
def test_the_spring_pulls_with_no_more_than_its_effort(coupled: Coupled, offset: float) -> None:
    x = coupled.unknowns[0]
    x["offset"], x["rate"], x["effort"] = offset, 0.0, 5.0
    begin_step(pack(coupled), 0, 1, H)
    v = float(x["new_rate"])
    assert M * v / H == pytest.approx(-math.copysign(5.0, offset) - R * v, abs=1e-9)


def test_an_unknown_without_mass_follows_the_recording(coupled: Coupled) -> None:
    x = coupled.unknowns[0]
    x["mass"], x["offset"], x["rate"], x["new_rate"] = 0.0, 0.1, 1.0, 2.0
    packed = pack(coupled)
    begin_step(packed, 0, 1, H)
    assert (x["new_rate"], x["inverse_mass"]) == (0.0, 0.0)
    end_step(packed, 0, 1, H, True)
    assert (x["offset"], x["rate"]) == (0.1, 1.0)


@pytest.mark.parametrize("pressed", [True, False])
def test_a_step_ends_as_solved_where_it_was_pressed_and_in_closed_form_elsewhere(
    coupled: Coupled, pressed: bool
) -> None:
    x = coupled.unknowns[0]
    x["offset"], x["rate"], x["new_rate"] = 0.01, 0.2, -0.7
    end_step(pack(coupled), 0, 1, H, pressed)
    expected = (0.01 + H * -0.7, -0.7) if pressed else relax(0.01, 0.2, M, K, R, H)
    assert (float(x["offset"]), float(x["rate"])) == pytest.approx(expected, rel=1e-12)


def test_an_impact_meets_the_real_mass(coupled: Coupled) -> None:
    x = coupled.unknowns[0]
    x["rate"] = 0.2
    packed = pack(coupled)
    begin_impact(packed, 0, 1)
    assert (float(x["new_rate"]), float(x["inverse_mass"])) == pytest.approx((0.2, 1.0 / M))
    x["new_rate"] = -0.1
    end_impact(packed, 0, 1)
    assert x["rate"] == -0.1


def test_rates_that_are_not_finite_are_cleared(coupled: Coupled) -> None:
    coupled.unknowns["rate"][:3] = (math.nan, 1.0, math.inf)
    forget_bad_rates(pack(coupled), 0, 3)
    assert np.array_equal(coupled.unknowns["rate"][:3], [0.0, 1.0, 0.0])


@pytest.mark.parametrize("steps", [1, 3, 24])
def test_a_rotation_left_by_something_else_relaxes_by_the_coupling_in_steps_of_any_length(
    tmp_path: Path, steps: int
) -> None:
    world = shoulder(tmp_path, CONE)
    scene = world.scene
    m, k, r = (float(v[0]) for v in (scene.trees.mass, scene.trees.stiffness, scene.trees.damping))
    coupled = make_replay_data(scene).coupled
    axis, tree = np.array([0.6, 0.0, 0.8]), coupled.trees[0]
    tree["rotation_offset"] = Rotation.from_rotvec(0.2 * axis).as_quat()
    tree["rotation_offset_rate"] = -0.5 * axis
    packed = pack(coupled)
    for _ in range(steps):
        relax_rotation(pack(scene), packed, 0, 0.1 / steps)
    matrix = np.array([[0.0, 1.0], [-k / m, -r / m]])  # (6) as a system of first order
    x, v = expm(0.1 * matrix) @ [0.2, -0.5]
    assert Rotation.from_quat(tree["rotation_offset"]).as_rotvec() == pytest.approx(x * axis, abs=1e-9)
    assert tree["rotation_offset_rate"] == pytest.approx(v * axis, abs=1e-9)


@pytest.mark.parametrize("solved", [0, 1])
def test_the_rate_of_a_joint_that_nothing_touched_is_that_of_its_offset_over_the_whole_substep(
    tmp_path: Path, solved: int
) -> None:
    """Whether a contact solve left the offset of the substep's end in the unknown or not."""
    scene = shoulder(tmp_path, CONE).scene
    data = make_replay_data(scene)
    q = 2
    c, k = data.coupled, 3 * len(scene.trees.role) + q
    packed = pack(scene), pack(data)
    roots, angles = data.driven.recorded.roots.copy(), data.driven.recorded.angles.copy()
    data.driven.last.angles[q] = angles[q] + 0.12
    load_unknowns(*packed, roots, angles, H)
    c.trees[0]["solved"] = solved
    if solved:
        c.unknowns[k]["offset"] = 0.1
    data.driven.last.angles[q] = angles[q] + 0.1
    load_unknowns(*packed, roots, angles, H)
    assert c.unknowns[k]["rate"] == pytest.approx((0.1 - 0.12) / H, rel=1e-9)
