"""The squeeze of a driven tree: K times what it is recorded deeper, shared by the points of a link."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.engine.coupled_squeeze import add_squeeze, largest_squeeze, nearest_clearance, points_within
from geomphys.engine.coupled_unknowns import begin_step
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box
from tests.engine.coupled_stages import GAP, HALF, STEP, Substep
from tests.simulated.scenes import Thing, make_scene

K, SQUEEZE = 1000.0, 2e-3
IMPLICIT = 0.4 + STEP * (40.0 + STEP * K)


def cube_on_plate(clearance: float, squeeze: float = SQUEEZE) -> Substep:
    """A cube with four contact points on a driven plate that squeezes."""
    made = make_scene(
        [
            Thing(shape=Box((0.2, 0.2, HALF)), role=s.DRIVEN),
            Thing(shape=Box((0.05, 0.05, 0.05)), at=(0, 0, HALF + 0.05 + clearance)),
        ]
    )
    made.trees.squeeze[0] = squeeze
    stage = Substep(made).begin().find_contacts()
    assert len(stage.contacts) == 4
    begin_step(stage.packed.coupled, 0, 3, STEP)
    return stage


def pushed(stage: Substep) -> np.ndarray:
    """Impulses [N s] that the squeeze gives the three offsets of the plate."""
    add_squeeze(stage.scene, stage.packed.simulated, stage.packed.coupled, STEP)
    return np.array([float(stage.unknown(0, axis)["new_rate"]) * IMPLICIT for axis in range(3)])


def test_a_link_that_touches_presses_by_k_times_its_squeeze() -> None:
    assert pushed(cube_on_plate(GAP)) == pytest.approx([0, 0, K * SQUEEZE * STEP], abs=1e-12)


@pytest.mark.parametrize("short", [0.5e-3, 1.5e-3])
def test_one_that_is_short_of_touching_is_drawn_by_the_rest(short: float) -> None:
    assert pushed(cube_on_plate(short)) == pytest.approx([0, 0, K * (SQUEEZE - short) * STEP], abs=1e-9)


@pytest.mark.parametrize("squeeze", [0.0, 0.5e-3])
def test_one_that_is_farther_than_its_squeeze_is_not_drawn(squeeze: float) -> None:
    assert pushed(cube_on_plate(1e-3, squeeze)).tolist() == [0, 0, 0]


def test_the_nearest_points_share_the_force() -> None:
    """Three of four points are lifted: the fourth alone passes it on, and the whole stays the same."""
    stage = cube_on_plate(GAP)
    stage.contacts["clearance"][1:] = 1e-3
    a, b = int(stage.contacts["a"][0]), int(stage.contacts["b"][0])
    sim = stage.packed.simulated
    assert nearest_clearance(sim, a, b) == stage.contacts["clearance"][0]
    assert nearest_clearance(sim, a, a) == np.inf
    assert points_within(sim, a, b, 5 * GAP) == 1
    assert points_within(sim, a, b, 1e-3) == 4
    assert points_within(sim, b, a, 1e-3) == 0
    assert pushed(stage) == pytest.approx([0, 0, K * SQUEEZE * STEP], abs=1e-12)


def test_the_largest_squeeze_is_of_trees_in_the_group_that_yield() -> None:
    stage = cube_on_plate(GAP)
    c = stage.packed.coupled
    assert largest_squeeze(stage.scene, c) == SQUEEZE
    stage.data.coupled.trees["solved"][0] = 0
    assert largest_squeeze(stage.scene, c) == 0.0
    stage.data.coupled.trees["solved"][0] = 1
    stage.made.trees.stiffness[0] = np.inf
    assert largest_squeeze(stage.scene, c) == 0.0
    assert pushed(stage).tolist() == [0, 0, 0]
