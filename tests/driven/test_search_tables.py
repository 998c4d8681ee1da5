"""The table of recorded contacts, and the spots where pairs touched in iterations of a search before."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.driven.constraints import _cache_spot, clear_spots, least_change
from geomphys.driven.contacts_kept import drop_touches, store_touch
from geomphys.driven.state import SPOTS
from geomphys.engine.state import ReplayData

UP, DOWN = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)


def touches(data: ReplayData) -> list[tuple[int, int, float]]:
    """(tip, other body, gap) of what is noted."""
    work = data.workspace.work
    noted = work.touches[: int(work.counts["touches"])]
    return [(int(touch["tip"]), int(touch["body"]), float(touch["gap"])) for touch in noted]


def test_a_contact_is_noted_once_with_its_smallest_gap(table: tuple[object, object, ReplayData]) -> None:
    _, ws, data = table
    for tip, gap, n in ((0, 2e-3, UP), (1, 1e-3, UP), (0, -1e-3, DOWN), (0, 5e-4, UP)):
        store_touch(ws, tip, 3, gap, n)
    store_touch(ws, 0, 2, 1e-3, UP)
    assert touches(data) == [(0, 3, -1e-3), (1, 3, 1e-3), (0, 2, 1e-3)]
    assert [tuple(n) for n in data.workspace.work.touches["normal"][:3].tolist()] == [DOWN, UP, UP]


@pytest.mark.parametrize("tree", range(3))
def test_the_contacts_of_one_tree_are_forgotten_and_the_others_stay(
    table: tuple[object, object, ReplayData], tree: int
) -> None:
    scene, ws, data = table
    noted = [(0, 3, 1e-3), (1, 3, 2e-3), (2, 3, 3e-3), (1, 2, 4e-3), (0, 1, 5e-3)]
    for tip, other, gap in noted:
        store_touch(ws, tip, other, gap, UP)
    drop_touches(scene, ws, tree)
    assert touches(data) == [touch for touch in noted if touch[0] != tree]


def test_a_contact_of_every_tip_with_every_body_finds_a_row(table: tuple[object, object, ReplayData]) -> None:
    _, ws, data = table
    every = [(tip, other) for tip in range(3) for other in range(4)]
    for tip, other in every:
        store_touch(ws, tip, other, 1e-3, UP)
    assert [touch[:2] for touch in touches(data)] == every
    assert len(data.workspace.work.touches) == len(every)


def test_spots_are_remembered_once_each_and_the_oldest_goes_first(table: tuple[object, object, ReplayData]) -> None:
    scene, ws, data = table
    near, work, poses = data.workspace.near, data.workspace.work, data.recorded
    near.a[0], near.b[0], near.normal[0] = 0, 3, (0.0, 0.0, 1.0)
    clear_spots(ws)

    def touch_at(x: float) -> None:
        near.point_a[0] = near.point_b[0] = (x, 0.0, 0.01)
        _cache_spot(scene, ws, poses, 0)

    touch_at(0.0)
    touch_at(2e-4)  # the same spot: replaced
    touch_at(0.01)
    assert (work.spots["a"] >= 0).sum() == 2
    assert work.spots["point_a"][:2, 0].tolist() == pytest.approx([2e-4, 0.01])
    assert np.array_equal(work.spots["normal"][0], [0.0, 0.0, 1.0])
    for k in range(SPOTS - 2 + 1):
        touch_at(0.1 + 0.01 * k)
    assert (work.spots["a"] >= 0).all()
    assert work.spots["point_a"][0, 0] == pytest.approx(0.1 + 0.01 * (SPOTS - 2))
    assert work.spots["point_a"][1, 0] == pytest.approx(0.01)
    clear_spots(ws)
    assert (work.spots["a"] == -1).all()
    assert work.counts["next_spot"] == 0


@pytest.mark.parametrize(
    ("apart", "expected"), [(-1e-3, 1.1e-3), (0.0, 0.0), (5e-5, 0.0), (1e-4, 0.0), (1.0, 1e-4 - 1.0)]
)
def test_a_pair_has_to_come_apart_by_its_overlap_and_the_gap_or_not_nearer_than_it(
    apart: float, expected: float
) -> None:
    assert least_change(1e-4, apart) == pytest.approx(expected, abs=1e-15)
