"""Limits of the coupled contact solve: frictionless inequalities of unknowns, one visit at a time and all together."""

from __future__ import annotations

import pytest

from geomphys.engine.coupled_contacts import add_effect, add_limit
from geomphys.engine.coupled_solve import (
    IMPACT_PRECISION,
    extrapolate,
    set_limit_response,
    solve_contacts,
    sweep_contacts,
    visit_limit,
)
from geomphys.engine.state import Machine, make_machine
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.simulated.scenes import Thing, floor, make_scene


@pytest.fixture
def machine() -> Machine:
    """Of a driven ball, a simulated one and a floor; the unknowns 0 and 1 have inverse masses of 2 and 0.5."""
    things = [Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0, 0, 1)), Thing(shape=Sphere(0.05), at=(1, 0, 1)), floor()]
    made = make_machine(make_scene(things))
    made.coupled.unknowns["inverse_mass"][:2] = (2.0, 0.5)
    return made


def limit(machine: Machine, *speeds: tuple[int, float], prescribed: float = 0.0, target: float = 0.0) -> int:
    """Add a limit with these effects of unknowns; returns its number."""
    c, packed = machine.coupled, pack(machine.coupled)
    first, k = int(c.solve["effects"]), int(c.solve["limits"])
    for unknown, speed in speeds:
        add_effect(packed, first, unknown, 0, speed)
    add_limit(packed, first, 0.1, prescribed)
    c.limits[k]["target_speed"] = target
    set_limit_response(packed, k)
    return k


def rate(machine: Machine, k: int) -> float:
    """Rate of the clearance of a limit."""
    c, g = machine.coupled, machine.coupled.limits[k]
    effects = c.effects[int(g["first_effect"]) : int(g["end_effect"])]
    return float(g["prescribed"] + (effects["speed"][:, 0] * c.unknowns["solved"][effects["unknown"]]).sum())


def test_effects_of_one_unknown_are_added_up(machine: Machine) -> None:
    k = limit(machine, (0, 1.0), (0, 0.5), (1, -1.0))
    assert machine.coupled.solve["effects"] == 2
    assert machine.coupled.limits[k]["response"] == pytest.approx(1.5**2 * 2.0 + 0.5)


@pytest.mark.parametrize("target", [0.0, -0.3])
def test_a_visit_takes_the_rate_to_its_target(machine: Machine, target: float) -> None:
    k = limit(machine, (0, 1.0), (1, -1.0), prescribed=-1.0, target=target)
    change = visit_limit(pack(machine.coupled), k)
    assert rate(machine, k) == pytest.approx(target)
    assert change == pytest.approx(target + 1.0)
    assert machine.coupled.limits[k]["impulse"] == pytest.approx((target + 1.0) / 2.5)
    assert visit_limit(pack(machine.coupled), k) == pytest.approx(0.0, abs=1e-15)


def test_a_limit_never_pulls_and_gives_back_only_what_it_pressed(machine: Machine) -> None:
    k, packed = limit(machine, (0, 1.0), prescribed=0.5), pack(machine.coupled)
    assert visit_limit(packed, k) == 0.0
    assert machine.coupled.limits[k]["impulse"] == 0.0
    machine.coupled.limits[k]["impulse"] = 0.1
    visit_limit(packed, k)
    assert machine.coupled.limits[k]["impulse"] == 0.0
    assert machine.coupled.unknowns["solved"][0] == pytest.approx(-0.2)


def test_an_extrapolated_impulse_does_not_pull(machine: Machine) -> None:
    k, packed = limit(machine, (0, 1.0)), pack(machine.coupled)
    g = machine.coupled.limits[k]
    g["impulse"], g["swept"] = 0.1, 0.5
    extrapolate(pack(machine.simulated), packed, 2.0)
    assert (g["impulse"], g["swept"], g["extrapolated"]) == (0.0, 0.1, 0.0)
    g["impulse"] = 0.3
    extrapolate(pack(machine.simulated), packed, 0.5)
    assert g["impulse"] == pytest.approx(0.3 + 0.5 * 0.2)


def test_an_idle_limit_is_visited_in_full_sweeps_alone_and_is_idle_no_more_once_it_presses(machine: Machine) -> None:
    g = machine.coupled.limits[limit(machine, (0, 1.0), prescribed=-1.0)]
    g["idle"], g["swept"] = 1, 3.0
    sim, c = pack(machine.simulated), pack(machine.coupled)
    assert sweep_contacts(sim, c, False, False, 1.0) == 0.0
    assert sweep_contacts(sim, c, False, True, 1.0) == pytest.approx(1.0)
    assert (g["idle"], g["impulse"], g["swept"]) == (0, 0.5, 0.5)


def test_limits_that_oppose_each_other_in_part_are_solved_together(machine: Machine) -> None:
    """x + y >= 1 and x - y >= 0 by least kinetic energy: x = y = 1/2 with these masses, as the second binds too."""
    one = limit(machine, (0, 1.0), (1, 1.0), prescribed=-1.0)
    other = limit(machine, (0, -1.0), (1, 1.0))
    assert solve_contacts(pack(machine.simulated), pack(machine.coupled), 50, IMPACT_PRECISION) > 2
    assert rate(machine, one) == pytest.approx(0.0, abs=1e-9)
    assert rate(machine, other) == pytest.approx(0.0, abs=1e-9)
    assert machine.coupled.unknowns["solved"][:2] == pytest.approx([0.5, 0.5], abs=1e-9)
    assert machine.coupled.solve["unsettled"] == 0
