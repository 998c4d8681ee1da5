"""Stages of a coupled step: targets, warm start, stiffness of joints in series, attached points, slip, length of a step."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.driven.coupling import relax
from geomphys.engine.coupled_contacts import add_effect
from geomphys.engine.coupled_impacts import load_coupled
from geomphys.engine.coupled_motion import (
    CORRECTION_FACTOR,
    FASTEST_CORRECTION,
    FEWEST,
    MIN_IMPEDANCE_SCALE,
    ROTATION,
    STUCK,
    advance_together,
    apply_gravity_at_once,
    attached_point,
    begin_with_forces,
    fastest_motion,
    fit_stiffness,
    longest_step,
    move_bodies,
    set_targets,
    solve_step,
    store_slip,
)
from geomphys.engine.state import make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.load import load_world
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from geomphys.scene.world import World
from tests.driven.compound import limit
from tests.engine.coupled_stages import GAP, HALF, RADIUS, STEP, Substep, ball_over_plate
from tests.scene.models import joint, link, urdf
from tests.simulated.scenes import GRAVITY, Thing, make_scene

M, K, R = 0.4, 1000.0, 40.0  # of the plate's coupling


@pytest.mark.parametrize("clearance", [1e-3, GAP, 0.0, -1e-4, -0.02])
def test_targets_close_a_gap_in_the_step_and_take_back_part_of_an_overlap(clearance: float) -> None:
    stage = ball_over_plate(GAP).find_contacts()
    r, c = stage.contacts[0], stage.data.coupled
    r["clearance"], r["slip_debt"] = clearance, 1e-4 * r["tangent"] - 3e-4 * r["binormal"] + 0.1 * r["normal"]
    c.solve["inequalities"], c.inequalities[0]["clearance"] = 1, clearance
    set_targets(stage.packed.simulated, stage.packed.coupled, STEP, False)
    distance = clearance - GAP
    target = -distance / STEP if distance > 0.0 else min(-CORRECTION_FACTOR * distance / STEP, FASTEST_CORRECTION)
    assert r["target_speed"] == pytest.approx(target, abs=1e-15)
    assert c.inequalities[0]["target_speed"] == pytest.approx(target, abs=1e-15)
    assert r["tangent_target"] == pytest.approx([-CORRECTION_FACTOR * 1e-4 / STEP, CORRECTION_FACTOR * 3e-4 / STEP])
    assert r["mode"] == 1
    if clearance > GAP:  # a body at that speed is where the gap ends, and no farther
        assert clearance + STEP * r["target_speed"] == pytest.approx(GAP, abs=1e-12)


@pytest.mark.parametrize("to_impact", [True, False])
def test_a_row_that_ends_the_step_by_an_impact_may_approach(to_impact: bool) -> None:
    stage = ball_over_plate(GAP).find_contacts()
    stage.contacts["mode"] = 2
    set_targets(stage.packed.simulated, stage.packed.coupled, STEP, to_impact)
    assert stage.contacts["mode"].tolist() == [0 if to_impact else 1]


@pytest.mark.parametrize("mode", [0, 1])
def test_a_warm_start_gives_the_impulse_of_the_last_force_over_the_step(mode: int) -> None:
    """The ball gets it, the plate the opposite."""
    stage = ball_over_plate(GAP).find_contacts()
    load_coupled(stage.packed.simulated)
    r, sim = stage.contacts[0], stage.data.simulated
    slot = sim.slots[int(r["pair"]), int(r["slot"])]
    slot["normal_force"], slot["friction_force"] = 3.0, 0.5 * r["tangent"] - 0.25 * r["binormal"]
    r["mode"] = mode
    for axis in range(3):
        stage.unknown(0, axis)["new_rate"], stage.unknown(0, axis)["inverse_mass"] = 0.0, 1.0 / M
        for e in range(int(r["first_effect"]), int(r["end_effect"])):
            stage.data.coupled.effects[e]["response"] = stage.data.coupled.effects[e]["jacobian"] / M
    begin_with_forces(stage.packed.simulated, stage.packed.coupled, STEP)
    impulse = STEP * (3.0 * r["normal"] + 0.5 * r["tangent"] - 0.25 * r["binormal"]) if mode else np.zeros(3)
    assert 0.5 * sim.velocity[1, :3] == pytest.approx(impulse, abs=1e-15)
    plate = [M * float(stage.unknown(0, axis)["new_rate"]) for axis in range(3)]
    assert plate == pytest.approx(list(-impulse), abs=1e-15)


def test_gravity_is_applied_at_once_only_once() -> None:
    stage = ball_over_plate(GAP, 0.3)
    motion = stage.data.simulated.motion[1]
    motion["acceleration"] = (0.0, 0.0, -GRAVITY)
    for _ in range(2):
        apply_gravity_at_once(stage.packed.simulated, 1, STEP)
        assert motion["velocity"] == pytest.approx([0, 0, -0.3 - GRAVITY * STEP])
        assert not motion["acceleration"].any()


def poses_at(position: tuple[float, ...], turn: tuple[float, ...]) -> np.ndarray:
    return np.array([*position, *Rotation.from_rotvec(turn).as_quat()])


def carried(before: np.ndarray, after: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Where a point of a body goes that moves from a pose to another."""
    turn = Rotation.from_quat(after[3:]) * Rotation.from_quat(before[3:]).inv()
    return np.asarray(after[:3] + turn.apply(point - before[:3]))


def test_attached_points_move_with_their_bodies() -> None:
    things = [
        Thing(shape=Box((0.2, 0.2, HALF)), role=s.DRIVEN), Thing(shape=Sphere(RADIUS), at=(0, 0, HALF + RADIUS + GAP)),
        Thing(shape=Sphere(RADIUS), role=s.FIXED, at=(1, 0, 0)),
    ]  # fmt: skip
    stage = Substep(make_scene(things)).begin().find_contacts()
    sim, c = stage.packed.simulated, stage.packed.coupled
    before, after = poses_at((0.1, 0.2, 0.3), (0.2, 0.1, 0.0)), poses_at((0.15, 0.1, 0.3), (0.0, 0.3, -0.2))
    point = np.array([0.07, 0.21, 0.33])
    expected = carried(before, after, point)
    motion = stage.data.simulated.motion[1]
    motion["saved_pose"], motion["position"], motion["orientation"] = before, after[:3], after[3:]
    assert attached_point(sim, c, 1, tuple(point), 0.0, STEP) == pytest.approx(expected, abs=1e-14)
    stage.data.coupled.now.poses[0], stage.data.coupled.after.poses[0] = before, after
    assert attached_point(sim, c, 0, tuple(point), 0.0, STEP) == pytest.approx(expected, abs=1e-14)
    assert attached_point(sim, c, 2, tuple(point), 0.0, STEP) == tuple(point)


@pytest.mark.parametrize(("share", "sticks"), [(0.5, True), (0.99 * STUCK, True), (1.0, False)])
def test_slip_of_a_point_that_sticks_is_owed_and_of_one_that_slides_is_not(share: float, sticks: bool) -> None:
    stage = ball_over_plate(GAP).find_contacts()
    r, sim = stage.contacts[0], stage.data.simulated
    motion = sim.motion[1]
    r["normal_impulse"], r["tangent_impulse"], r["slip_debt"] = 1.0, (0.3 * share, 0.0), (1e-5, 0.0, 0.0)
    motion["saved_pose"] = [*motion["position"], *motion["orientation"]]
    motion["position"] += (2e-5, -1e-5, 3e-5)
    motion["orientation"] = Rotation.from_rotvec([0, 0, 0.5 * np.pi]).as_quat()
    store_slip(stage.packed, 0.0, STEP)
    slot = sim.slots[int(r["pair"]), int(r["slot"])]
    owed = np.array([3e-5, -1e-5, 0.0])  # what it owed, and the new slip across the normal
    owed = Rotation.from_quat(motion["orientation"]).inv().apply(owed) if sticks else np.zeros(3)
    assert slot["slip_debt"] == pytest.approx(owed, abs=1e-12)
    assert sim.pairs["touching"][int(r["pair"])] == 1
    assert r["normal_impulse"] == 0.0


@pytest.mark.parametrize(("clearance", "touching"), [(2.9 * GAP, 1), (3.1 * GAP, 0)])
def test_what_is_near_enough_counts_as_having_touched(clearance: float, touching: int) -> None:
    stage = ball_over_plate(GAP).find_contacts()
    stage.contacts["clearance"] = clearance
    stage.data.simulated.pairs["touching"] = 1 - touching
    store_slip(stage.packed, 0.0, STEP)
    assert stage.data.simulated.pairs["touching"][0] == touching


IMPLICIT = M + STEP * (R + STEP * K)


@pytest.mark.parametrize(
    ("mass", "spin", "expected"),
    [
        (1.0, 0.0, STEP),
        (1.01 * IMPLICIT / 50.0, 0.0, STEP),
        (0.99 * IMPLICIT / 50.0, 0.0, 0.5 * STEP),
        (1.0, 2.0 * ROTATION / STEP, 0.5 * STEP),
        (1.0, 100.0 * ROTATION / STEP, FEWEST * STEP),
    ],
)
def test_steps_are_shorter_for_light_and_for_fast_bodies(mass: float, spin: float, expected: float) -> None:
    stage = ball_over_plate(GAP, mass=mass)
    stage.data.simulated.motion["angular_velocity"][1] = (0.0, spin, 0.0)
    assert stage.call(longest_step) == pytest.approx(expected, rel=1e-12)


def test_the_fastest_motion_bounds_that_of_any_two_points() -> None:
    stage = ball_over_plate(GAP, 0.5)
    stage.roots[0, 0] = 0.01
    stage.begin().find_contacts()
    motion = stage.data.simulated.motion[1]
    motion["angular_velocity"] = (3.0, 0.0, 4.0)
    expected = STEP * (0.5 + 5.0 * float(motion["reach"])) + 0.01
    assert stage.call(fastest_motion, STEP) == pytest.approx(expected, rel=1e-12)


# joints in series


def limb(folder: Path, count: int) -> World:
    """Unknowns of an arm of so many hinges about y, 0.1 m apart, behind one contact; a ball and the arm."""
    links = [link(f"l{k}", '<geometry><box size="0.02 0.02 0.02"/></geometry>') for k in range(count + 1)]
    hinges = [joint(f"j{k}", f"l{k}", f"l{k + 1}", xyz="0.1 0 0", inside=limit(-3, 3, "0 1 0")) for k in range(count)]
    urdf(folder / "arm.urdf", *links, *hinges)
    arm = '[[avatar]]\nname="arm"\nurdf="arm.urdf"\nmode="chains"\nmaterial="human"\n'
    arm += f'[[avatar.chain]]\nname="arm"\nbase="l0"\ntip="l{count}"\n'
    ball = '[[object]]\nname="ball"\nclass="simulated"\nsphere=0.05\nposition=[1,1,1]\nmaterial="wood"\n'
    (folder / "scene.toml").write_text(arm + ball)
    return load_world(folder / "scene.toml")


@pytest.mark.parametrize("count", [1, 2, 3])
def test_joints_in_series_yield_together_by_the_stiffness_of_the_coupling(tmp_path: Path, count: int) -> None:
    """1 / K = Σ arm² / k over the joints behind the contact, whatever its lever arms."""
    world = limb(tmp_path, count)
    data = make_replay_data(world.scene)
    scene, packed, c = pack(world.scene), pack(data), data.coupled
    c.trees["solved"][0] = 1
    sim, first = data.simulated, 3 * len(world.scene.trees.role)
    sim.counts["contacts"], r = 1, sim.contacts[0]
    r["pair"], r["slot"] = 0, 0
    sim.slots[0, 0]["normal_force"] = 2.5
    arms = np.random.default_rng(count).uniform(0.05, 0.3, count)
    for q, arm in enumerate(arms):
        add_effect(packed.coupled, 0, first + q, (-arm, 0.0, 0.0))
    add_effect(packed.coupled, 0, 2, (-1.0, 0.0, 0.0))  # the root's offset does not count among the joints
    r["first_effect"], r["end_effect"] = 0, count + 1
    for _ in range(200):
        fit_stiffness(scene, packed.simulated, packed.coupled)
    joints = c.unknowns[first : first + count]
    stiffness = joints["impedance_scale"] * K * joints["lever"] ** 2
    assert (joints["impedance_scale"] > MIN_IMPEDANCE_SCALE).all()
    assert (arms**2 / stiffness).sum() == pytest.approx(1.0 / K, rel=1e-9)
    sim.slots[0, 0]["normal_force"] = 0.0
    for _ in range(200):
        fit_stiffness(scene, packed.simulated, packed.coupled)
    assert joints["impedance_scale"] == pytest.approx(1.0, abs=1e-9)


# whole steps


def test_a_solved_step_keeps_the_ball_out_and_momentum_but_for_gravity_and_the_spring() -> None:
    stage = ball_over_plate(GAP, 0.01).find_contacts()
    stage.call(solve_step, 0.0, STEP, False)
    ball, plate = stage.data.simulated.velocity[1], float(stage.unknown(0)["new_rate"])
    pressed = float(stage.contacts["normal_impulse"][0])
    assert 0.5 * (ball[2] + 0.01 + GRAVITY * STEP) == pytest.approx(pressed, rel=1e-9)
    assert IMPLICIT * plate == pytest.approx(-pressed, rel=1e-9)
    assert ball[2] - plate == pytest.approx(0.0, abs=2e-6)


def test_motion_of_a_step_is_that_of_its_impulses() -> None:
    """The ball moves with its velocity at the end of the step, the plate too; forces are kept for the next one."""
    stage = ball_over_plate(GAP, 0.01).find_contacts()
    height = float(stage.data.simulated.motion["position"][1, 2])
    stage.call(solve_step, 0.0, STEP, False)
    ball, plate = float(stage.data.simulated.velocity[1, 2]), float(stage.unknown(0)["new_rate"])
    pressed = float(stage.contacts["normal_impulse"][0])
    stage.call(move_bodies, 0.0, STEP, STEP)
    motion, x = stage.data.simulated.motion[1], stage.unknown(0)
    assert motion["velocity"][2] == pytest.approx(ball, rel=1e-12)
    assert motion["position"][2] == pytest.approx(height + STEP * ball, abs=1e-15)
    assert (x["offset"], x["rate"]) == pytest.approx((STEP * plate, plate), rel=1e-12)
    r = stage.contacts[0]
    slot = stage.data.simulated.slots[int(r["pair"]), int(r["slot"])]
    assert slot["normal_force"] == pytest.approx(pressed / STEP, rel=1e-12)
    assert slot["normal_impulse"] == pytest.approx(pressed, rel=1e-12)
    trees = stage.data.coupled.trees
    assert (trees["pressed"].tolist(), trees["touched"].tolist()) == ([1, 0], [1, 0])


def test_without_contact_bodies_fall_and_offsets_relax_in_closed_form() -> None:
    stage = ball_over_plate(3e-3, -0.3)
    x = stage.unknown(0, 0)
    x["offset"], x["rate"] = 3e-3, -0.1
    height = float(stage.data.simulated.motion["position"][1, 2])
    stage.call(advance_together, stage.roots, stage.angles, STEP)
    motion = stage.data.simulated.motion[1]
    assert motion["position"][2] == pytest.approx(height + 0.3 * STEP - 0.5 * GRAVITY * STEP**2, abs=1e-14)
    assert motion["velocity"][2] == pytest.approx(0.3 - GRAVITY * STEP, rel=1e-12)
    assert (float(x["offset"]), float(x["rate"])) == pytest.approx(relax(3e-3, -0.1, M, K, R, STEP), rel=1e-12)
    assert stage.data.coupled.after.poses[0, 0] == pytest.approx(float(x["offset"]), abs=1e-15)


def test_a_step_is_split_at_an_impact() -> None:
    """The ball falls freely until it touches, then bounces: where it is at the end is known."""
    clearance, speed, mass = 2e-3, 1.5, 0.5
    stage = ball_over_plate(clearance, speed, mass, material="rubber")
    height = float(stage.data.simulated.motion["position"][1, 2])
    assert stage.call(advance_together, stage.roots, stage.angles, STEP) == 1
    t = (math.sqrt(speed**2 + 2.0 * GRAVITY * (clearance - GAP)) - speed) / GRAVITY
    v = speed + GRAVITY * t
    ball = (-mass * v + M * 0.5 * v) / (mass + M)  # of m u + M U = -m v and u - U = v / 2
    motion = stage.data.simulated.motion[1]
    left = STEP - t
    expected = height - (clearance - GAP) + ball * left - 0.5 * GRAVITY * left**2
    assert motion["velocity"][2] == pytest.approx(ball - GRAVITY * left, abs=1e-6)
    assert motion["position"][2] == pytest.approx(expected, abs=1e-8)
