"""The coupled contact solve: frictionless inequalities of unknowns, by visits and all together; contacts with friction."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from geomphys.engine.coupled_contacts import add_effect, add_inequality
from geomphys.engine.coupled_impulses import set_inequality_response
from geomphys.engine.coupled_motion import solve_step
from geomphys.engine.coupled_newton import natural_residual, newton_step, proximal_step, set_residual
from geomphys.engine.coupled_solve import (
    CREEPS,
    IMPACT_PRECISION,
    IMPACT_STEPS,
    MOST_YIELDS,
    PRECISION,
    PROXIMAL_STEPS,
    YIELD_GROWTH,
    YIELDS,
    make_proximal_steps,
    solve_contacts,
)
from geomphys.engine.coupled_state import CONSTRAINT, ROW
from geomphys.engine.coupled_sweeps import extrapolate, residual_of, update_inequality
from geomphys.engine.coupled_system import apply_solution, include_nearly_pressed, include_violated, make_system
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from tests.engine.coupled_stages import GAP, STEP, Substep, ball_over_plate
from tests.simulated.scenes import GRAVITY, Thing, floor, make_scene


@pytest.fixture
def data() -> ReplayData:
    """Of a driven ball, a simulated one and a floor; the unknowns 0 and 1 have inverse masses of 2 and 0.5."""
    things = [Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0, 0, 1)), Thing(shape=Sphere(0.05), at=(1, 0, 1)), floor()]
    made = make_replay_data(make_scene(things))
    made.coupled.unknowns["inverse_mass"][:2] = (2.0, 0.5)
    return made


def inequality(data: ReplayData, *speeds: tuple[int, float], prescribed: float = 0.0, target: float = 0.0) -> int:
    """Add an inequality with these effects of unknowns; returns its number."""
    c, packed = data.coupled, pack(data.coupled)
    first, k = int(c.solve["effects"]), int(c.solve["inequalities"])
    for unknown, speed in speeds:
        add_effect(packed, first, unknown, (speed, 0.0, 0.0))
    add_inequality(packed, first, 0.1, prescribed)
    c.inequalities[k]["target_speed"] = target
    set_inequality_response(packed, k)
    return k


def rate(data: ReplayData, k: int) -> float:
    """Rate of the clearance of an inequality."""
    c, g = data.coupled, data.coupled.inequalities[k]
    effects = c.effects[int(g["first_effect"]) : int(g["end_effect"])]
    return float(g["prescribed"] + (effects["jacobian"][:, 0] * c.unknowns["new_rate"][effects["unknown"]]).sum())


def test_effects_of_one_unknown_are_added_up(data: ReplayData) -> None:
    k = inequality(data, (0, 1.0), (0, 0.5), (1, -1.0))
    assert data.coupled.solve["effects"] == 2
    assert data.coupled.inequalities[k]["response"] == pytest.approx(1.5**2 * 2.0 + 0.5)


@pytest.mark.parametrize("target", [0.0, -0.3])
def test_a_visit_takes_the_rate_to_its_target(data: ReplayData, target: float) -> None:
    k = inequality(data, (0, 1.0), (1, -1.0), prescribed=-1.0, target=target)
    change = update_inequality(pack(data.coupled), k)
    assert rate(data, k) == pytest.approx(target)
    assert change == pytest.approx(target + 1.0)
    assert data.coupled.inequalities[k]["impulse"] == pytest.approx((target + 1.0) / 2.5)
    assert update_inequality(pack(data.coupled), k) == pytest.approx(0.0, abs=1e-15)


def test_an_inequality_never_pulls_and_gives_back_only_what_it_pressed(data: ReplayData) -> None:
    k, packed = inequality(data, (0, 1.0), prescribed=0.5), pack(data.coupled)
    assert update_inequality(packed, k) == 0.0
    assert data.coupled.inequalities[k]["impulse"] == 0.0
    data.coupled.inequalities[k]["impulse"] = 0.1
    update_inequality(packed, k)
    assert data.coupled.inequalities[k]["impulse"] == 0.0
    assert data.coupled.unknowns["new_rate"][0] == pytest.approx(-0.2)


def test_an_extrapolated_impulse_does_not_pull(data: ReplayData) -> None:
    k, packed = inequality(data, (0, 1.0)), pack(data.coupled)
    g = data.coupled.inequalities[k]
    g["impulse"], g["previous_impulse"] = 0.1, 0.5
    extrapolate(pack(data.simulated), packed, 2.0)
    assert (g["impulse"], g["previous_impulse"], g["extrapolated"]) == (0.0, 0.1, 0.0)
    g["impulse"] = 0.3
    extrapolate(pack(data.simulated), packed, 0.5)
    assert g["impulse"] == pytest.approx(0.3 + 0.5 * 0.2)


def test_inequalities_that_oppose_each_other_in_part_are_solved_together(data: ReplayData) -> None:
    """x + y >= 1 and x - y >= 0 by least kinetic energy: x = y = 1/2 with these masses, as the second binds too."""
    one = inequality(data, (0, 1.0), (1, 1.0), prescribed=-1.0)
    other = inequality(data, (0, -1.0), (1, 1.0))
    sim, c = pack(data.simulated), pack(data.coupled)
    assert solve_contacts(sim, c, IMPACT_STEPS, IMPACT_PRECISION, IMPACT_PRECISION) <= IMPACT_PRECISION
    assert rate(data, one) == pytest.approx(0.0, abs=1e-9)
    assert rate(data, other) == pytest.approx(0.0, abs=1e-9)
    assert data.coupled.unknowns["new_rate"][:2] == pytest.approx([0.5, 0.5], abs=1e-9)
    assert data.coupled.solve["unconverged"] == 0


def test_an_inequality_far_from_pressing_is_left_out_until_the_solution_violates_it(data: ReplayData) -> None:
    """The first one takes unknown 0 to a rate of 1, beyond what the other, of the opposite sign, allows."""
    inequality(data, (0, 1.0), prescribed=-1.0)
    far = inequality(data, (0, -1.0), (1, 1.0), prescribed=0.5)
    sim, c = pack(data.simulated), pack(data.coupled)
    include_nearly_pressed(sim, c)
    assert data.coupled.inequalities["included"][:2].tolist() == [1, 0]
    assert make_system(sim, c)
    assert proximal_step(c, 1e3, PRECISION)
    apply_solution(sim, c)
    assert include_violated(sim, c, PRECISION)
    assert data.coupled.inequalities["included"][:2].tolist() == [1, 1]
    assert solve_contacts(sim, c, IMPACT_STEPS, IMPACT_PRECISION, IMPACT_PRECISION) <= IMPACT_PRECISION
    assert rate(data, far) == pytest.approx(0.0, abs=1e-9)


def pressed_cube(friction: float, across: float) -> Substep:
    """A cube of 0.2 kg that stands on a driven plate and slides on it with a speed `across`, its four corners in contact."""
    box = Box((0.05, 0.05, 0.02))
    things = [
        Thing(shape=Box((0.2, 0.2, 0.02)), role=s.DRIVEN),
        Thing(shape=box, at=(0, 0, 0.04 + GAP), v=(across, 0, 0), mass=0.2),
    ]
    stage = Substep(make_scene(things)).begin().find_contacts()
    assert len(stage.contacts) == 4
    stage.contacts["friction"] = friction
    return stage


def forces(stage: Substep) -> np.ndarray:
    """World force on the cube [N]."""
    r = stage.contacts
    j = (
        r["normal_impulse"] @ r["normal"]
        + r["tangent_impulse"][:, 0] @ r["tangent"]
        + r["tangent_impulse"][:, 1] @ r["binormal"]
    )
    return np.asarray(j / STEP)


def test_redundant_contacts_share_a_load_and_stick() -> None:
    """Of four corners three are enough: all press, none slides, and the cube goes with the plate."""
    stage = pressed_cube(0.5, 0.001)
    stage.call(solve_step, 0.0, STEP, False)
    assert residual_of(stage.packed.simulated, stage.packed.coupled) <= PRECISION
    plate = [float(stage.unknown(0, axis)["new_rate"]) for axis in range(3)]
    assert stage.data.simulated.velocity[1, :3] == pytest.approx(plate, abs=3 * PRECISION)
    assert stage.contacts["normal_impulse"].min() > 0.0


def test_what_slides_is_slowed_by_the_friction_of_its_load() -> None:
    stage = pressed_cube(0.3, 0.5)
    stage.call(solve_step, 0.0, STEP, False)
    assert residual_of(stage.packed.simulated, stage.packed.coupled) <= PRECISION
    x, _, z = forces(stage)
    assert x == pytest.approx(-0.3 * z, rel=1e-6)
    assert z > 0.5 * 0.2 * GRAVITY


def test_targets_that_no_motion_meets_are_solved_by_forces_within_the_bound_of_friction() -> None:
    """Two sides of a rigid cube are to slide apart: friction strains against that up to its bound."""
    stage = pressed_cube(0.5, 0.0)
    stage.contacts["slip_debt"] = np.where(stage.contacts["arm_a"][:, :1] > 0.0, 1e-4, -1e-4) * [1.0, 0.0, 0.0]
    stage.call(solve_step, 0.0, STEP, False)
    r = stage.contacts
    assert np.all(np.linalg.norm(r["tangent_impulse"], axis=1) <= 0.5 * r["normal_impulse"] * (1 + 1e-12))
    assert np.all(np.isfinite(stage.data.simulated.velocity[1]))
    assert residual_of(stage.packed.simulated, stage.packed.coupled) <= CREEPS
    assert stage.data.coupled.solve["unconverged"] == 0


def test_too_many_bodies_for_the_tables_are_solved_by_sweeps() -> None:
    found = []
    for rows in (128, 1):
        stage = ball_over_plate(GAP, 0.01).find_contacts()
        c = stage.data.coupled._replace(rows=np.zeros(rows, ROW))
        stage.packed = pack(stage.data._replace(coupled=c))
        stage.call(solve_step, 0.0, STEP, False)
        assert c.solve["unconverged"] == 0
        found.append(stage.data.simulated.velocity[1].copy())
    assert found[0] == pytest.approx(found[1], abs=CREEPS)
    assert not np.array_equal(found[0], found[1])


def random_contacts(data: ReplayData, seed: int) -> Any:
    """Three contacts, with a friction of 1, of six velocities of unit masses, in random directions: the packed tables."""
    c, random = data.coupled, np.random.default_rng(seed)
    jacobian, off_target = random.normal(size=(3, 3, 6)), random.normal(size=(3, 3))
    c.solve["rows"], c.solve["terms"], c.solve["constraints"], c.solve["indexed"] = 6, 18, 3, 0
    c.rows[:6], c.constraints[:3], c.sticking[:] = np.zeros(6, ROW), np.zeros(3, CONSTRAINT), 0.0
    c.rows["mass"][:6], c.constraints["index"][:3] = 1.0, -1
    for i, r in enumerate(c.constraints[:3]):
        terms, (n, t, b) = slice(6 * i, 6 * i + 6), jacobian[i]
        c.terms["row"][terms], c.terms["jacobian"][terms] = np.arange(6), jacobian[i].T
        r["first_term"], r["end_term"], r["friction"], r["off_target"] = terms.start, terms.stop, 1.0, off_target[i]
        r["mass_n"], r["mass_t"] = 1.0 / (n @ n), 1.0 / np.linalg.norm([[t @ t, t @ b], [t @ b, b @ b]], 2)
    return pack(c)


def plain_proximal_steps(tables: Any) -> tuple[float, bool]:
    """Proximal steps in which contacts yield ever less: the residual that is left, and whether all were solved."""
    residual, s = natural_residual(tables), YIELDS
    for _ in range(PROXIMAL_STEPS):
        if not proximal_step(tables, s, PRECISION):
            return residual, False
        residual, s = natural_residual(tables), min(MOST_YIELDS, YIELD_GROWTH * s)
    return residual, True


@pytest.mark.parametrize(
    ("seed", "solved"), [(94, False), (150, False), (222, False), (18, True), (81, True), (87, True)]
)
def test_contacts_yield_more_where_newtons_method_fails_and_steps_go_on_while_the_residual_is_large(
    data: ReplayData, seed: int, solved: bool
) -> None:
    residual, all_solved = plain_proximal_steps(random_contacts(data, seed))
    assert residual > CREEPS
    assert all_solved == solved
    assert make_proximal_steps(random_contacts(data, seed), PROXIMAL_STEPS, PRECISION) <= CREEPS


def impulse_of(r: Any, g: np.ndarray, s: float) -> np.ndarray:
    """P(-s m g): normal impulse >= 0, friction in a disc of that radius."""
    n, t = max(0.0, -s * r["mass_n"] * g[0]), -s * r["mass_t"] * g[1:]
    return np.array([n, *(t * min(1.0, n / np.linalg.norm(t)))])


@pytest.mark.parametrize(("pressed", "reduced"), [(1, 1), (2, 0), (3, 0)])
@pytest.mark.parametrize("seed", range(4))
def test_newton_steps_solve_the_linearised_equation_of_rows_or_of_the_pressed_contacts(
    data: ReplayData, seed: int, pressed: int, reduced: int
) -> None:
    """(M + Jᵀ B J) x = -r, with B by differences of the impulses; in the second step some contacts slide that stuck, or stick."""
    tables, c, s, random = random_contacts(data, seed), data.coupled, 30.0, np.random.default_rng(seed)
    c.rows["mass"][:6] = mass = random.uniform(0.5, 2.0, 6)
    normal = c.constraints["off_target"][:3, 0]
    c.constraints["off_target"][:3, 0] = np.where(np.arange(3) < pressed, -3.0, 3.0) * np.abs(normal)
    jacobian = c.terms["jacobian"][:18].reshape(3, 6, 3).transpose(0, 2, 1)
    for change in (random.normal(size=6) * 1e-3, random.normal(size=6) * 0.1):
        c.rows["change"][:6] = change
        size = set_residual(tables, s)
        matrix, residual = np.diag(mass), c.rows["residual"][:6].copy()
        for r, j in zip(c.constraints[:3], jacobian, strict=True):
            g, d = r["off_target"] + j @ change, 1e-7 * np.eye(3)
            by = [(impulse_of(r, g - e, s) - impulse_of(r, g + e, s)) / 2e-7 for e in d]
            matrix += j.T @ np.transpose(by) @ j
        newton_step(tables, s, size)
        assert c.solve["reduced"] == reduced
        assert matrix @ c.step[:6] == pytest.approx(-residual, rel=1e-6, abs=1e-6 * np.abs(residual).max())
