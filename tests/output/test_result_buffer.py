"""Frames are put together to batches: the same frames as went in, so many in each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from geomphys.output.result_buffer import ResultBuffer
from geomphys.results import FrameResult, ResultColumns
from geomphys.scene.world import World
from tests.output.made_world import frames


def columns(results: list[FrameResult]) -> ResultColumns:
    return ResultColumns.joined([ResultColumns.of(result) for result in results])


def assert_same(found: FrameResult, given: FrameResult) -> None:
    assert found.frame is given.frame
    assert (found.metrics, found.timing, found.messages) == (given.metrics, given.timing, given.messages)
    for name in ("recorded", "corrected", "angles"):
        assert np.array_equal(getattr(found, name), getattr(given, name))
    for ours, theirs in ((found.contacts, given.contacts), (found.penetrations, given.penetrations)):
        assert all(np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("sizes", [[1] * 60, [60], [7, 30, 23], [25, 25, 10]])
def test_batches_hold_the_frames_that_were_added(world: World, sizes: list[int]) -> None:
    results, buffer, start, batches = frames(world, 60), ResultBuffer(25), 0, []
    for size in sizes:
        batches += list(buffer.add(columns(results[start : start + size])))
        start += size
    assert [len(batch) for batch in batches] == [25, 25]
    batches += list(buffer.rest())
    assert list(buffer.rest()) == []
    found = [batch.result(row) for batch in batches for row in range(len(batch))]
    for ours, given in zip(found, results, strict=True):
        assert_same(ours, given)


def test_a_batch_ends_where_stages_change(world: World) -> None:
    results, buffer = frames(world, 6), ResultBuffer(4)
    other = [replace(result, timing=(("step", 1, 1),)) for result in results]
    added = [ResultColumns.of(result) for result in (*results[:2], *other[2:4], *results[4:])]
    batches = [batch for part in added for batch in buffer.add(part)] + list(buffer.rest())
    assert [len(batch) for batch in batches] == [2, 2, 2]
    assert [batch.stages for batch in batches] == [("decode", "step", "step.overlap"), ("step",), batches[0].stages]


def test_a_record_is_made_once(world: World) -> None:
    block = columns(frames(world, 3))
    assert block.result(1) is block.result(1)
    assert block.rows(0, 3) is block
