"""Limits of the coupled contact solve: frictionless inequalities of unknowns, one visit at a time and all together."""

from __future__ import annotations

import pytest

from geomphys.engine.coupled_contacts import add_effect, add_inequality
from geomphys.engine.coupled_solve import (
    IMPACT_PRECISION,
    extrapolate,
    set_inequality_response,
    solve_contacts,
    sweep_contacts,
    update_inequality,
)
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.simulated.scenes import Thing, floor, make_scene


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
        add_effect(packed, first, unknown, 0, speed)
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


def test_an_idle_limit_is_visited_in_full_sweeps_alone_and_is_idle_no_more_once_it_presses(data: ReplayData) -> None:
    g = data.coupled.inequalities[inequality(data, (0, 1.0), prescribed=-1.0)]
    g["idle"], g["previous_impulse"] = 1, 3.0
    sim, c = pack(data.simulated), pack(data.coupled)
    assert sweep_contacts(sim, c, False, False, 1.0) == 0.0
    assert sweep_contacts(sim, c, False, True, 1.0) == pytest.approx(1.0)
    assert (g["idle"], g["impulse"], g["previous_impulse"]) == (0, 0.5, 0.5)


def test_inequalities_that_oppose_each_other_in_part_are_solved_together(data: ReplayData) -> None:
    """x + y >= 1 and x - y >= 0 by least kinetic energy: x = y = 1/2 with these masses, as the second binds too."""
    one = inequality(data, (0, 1.0), (1, 1.0), prescribed=-1.0)
    other = inequality(data, (0, -1.0), (1, 1.0))
    assert solve_contacts(pack(data.simulated), pack(data.coupled), 50, IMPACT_PRECISION) > 2
    assert rate(data, one) == pytest.approx(0.0, abs=1e-9)
    assert rate(data, other) == pytest.approx(0.0, abs=1e-9)
    assert data.coupled.unknowns["new_rate"][:2] == pytest.approx([0.5, 0.5], abs=1e-9)
    assert data.coupled.solve["unconverged"] == 0
