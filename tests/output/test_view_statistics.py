"""What the point of view of a recording is chosen from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from geomphys.output.view_statistics import MAX_FRAMES, ViewStatistics
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.world import World
from tests.output.made_world import frames


def columns(results: list[FrameResult]) -> ResultColumns:
    return ResultColumns.joined([ResultColumns.of(result) for result in results])


def test_the_eye_looks_where_things_touch_wherever_else_they_go(world: World) -> None:
    statistics = ViewStatistics(world)
    results = frames(world, 240)
    away = np.array([30.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    idle = [r for r in results if not len(r.contacts.depth)]
    for k in range(1, 4):
        statistics.add(columns([replace(r, corrected=r.corrected + k * away) for r in idle]))
    statistics.add(columns(results))
    touched = np.concatenate([r.contacts.point for r in results])
    assert np.linalg.norm(statistics.viewpoint().target - touched.mean(axis=0)) < 0.3


def test_without_a_touch_all_motion_is_in_view(world: World) -> None:
    statistics = ViewStatistics(world)
    quiet = [r for r in frames(world, 240) if not len(r.contacts.depth)]
    moved = [replace(r, corrected=r.corrected + np.array([0.01 * k, 0, 0, 0, 0, 0, 0])) for k, r in enumerate(quiet)]
    statistics.add(columns(moved))
    assert abs(statistics.viewpoint().target[0] - 0.005 * len(quiet)) < 0.3


def test_memory_is_bounded(world: World) -> None:
    statistics = ViewStatistics(world)
    results = frames(world, 60)
    for _ in range(3 * MAX_FRAMES // len(results)):
        statistics.add(columns(results))
    assert MAX_FRAMES // 3 < len(statistics._all.items) <= MAX_FRAMES
