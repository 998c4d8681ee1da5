"""Groups of driven trees and simulated islands: labels merge along chains of pairs, and one group at a time is solved."""

from __future__ import annotations

import pytest

from geomphys.engine.coupled_groups import activate_group, label_groups
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from geomphys.simulated.state import AWAKE, COUPLED, IN_OTHER_GROUP
from tests.simulated.scenes import Thing, make_scene

SCENE = make_scene(
    [
        *(Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(k, 0, 0)) for k in range(3)),
        *(Thing(shape=Sphere(0.05), at=(k, 1, 0)) for k in range(3)),
    ]
)
"""Three driven balls and three simulated ones, each a tree and an island of its own."""


def machine_with(pairs: list[tuple[int, int]], near: bool = False) -> ReplayData:
    """Pairs (simulated, driven) may touch; `near`: the balls are near each other."""
    data = make_replay_data(SCENE)
    sim = data.simulated
    for body in range(6):
        middle = 0.1 * body if near else float(body)
        sim.body_boxes[body]["low"], sim.body_boxes[body]["high"] = middle - 0.05, middle + 0.05
        sim.bodies[body]["island"] = body
    sim.bodies["activation"][3:] = AWAKE
    for k, pair in enumerate(pairs):
        sim.pairs[k]["body"] = pair
    sim.counts["pairs"] = len(pairs)
    return data


def labels(data: ReplayData) -> list[int]:
    """The labels of all trees."""
    some = label_groups(pack(SCENE), pack(data))
    assert some == (data.simulated.counts["pairs"] > 0)
    return data.coupled.trees["group"].tolist()


def test_without_pairs_there_are_no_groups() -> None:
    data = machine_with([])
    assert labels(data) == [-1] * 6
    assert data.simulated.bodies["activation"][3:].tolist() == [AWAKE] * 3


def test_pairs_apart_are_groups_apart() -> None:
    data = machine_with([(3, 0), (4, 1)])
    found = labels(data)
    assert found[0] == found[3] != found[1] == found[4]
    assert found[2] == found[5] == -1
    assert data.simulated.bodies["activation"][3:].tolist() == [IN_OTHER_GROUP, IN_OTHER_GROUP, AWAKE]


def test_a_chain_of_pairs_is_one_group_in_any_order() -> None:
    for pairs in ([(3, 0), (3, 1), (4, 1), (4, 2)], [(4, 2), (3, 0), (4, 1), (3, 1)]):
        found = labels(machine_with(pairs))
        assert len(set(found[:5])) == 1
        assert found[5] == -1


def test_driven_trees_that_come_near_are_solved_together() -> None:
    found = labels(machine_with([(3, 0), (4, 1)], near=True))
    assert found[0] == found[1]


@pytest.mark.parametrize("group", [0, 1, -1])
def test_one_group_takes_part_and_the_others_wait(group: int) -> None:
    data = machine_with([(3, 0), (4, 1)])
    found = labels(data)
    label = -1 if group < 0 else found[group]
    activate_group(pack(SCENE), pack(data), label)
    takes = [group < 0 or found[k] == label for k in (0, 1)]
    assert data.coupled.trees["solved"].tolist() == [*map(int, takes), 0, 0, 0, 0]
    activation = data.simulated.bodies["activation"][3:].tolist()
    assert activation == [*(COUPLED if on else IN_OTHER_GROUP for on in takes), AWAKE]
