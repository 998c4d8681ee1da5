"""Transforms over time: interpolated within gaps, held while nothing moves, composed along a path as matrices are."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.recording.transform_chain import ChainLink, TransformChain, TransformTrack
from tests.recording.log_files import IDENTITY, S

GAP = S // 4  # ns


def pose(x: float, angle: float = 0.0) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


def track(times: list[float], poses: list[tuple[float, ...]], static: bool = False) -> TransformTrack:
    made = TransformTrack(GAP, static=static)
    for time, value in zip(times, poses, strict=True):
        made.add(round(time * S), value)
    return made


def matrix(value: tuple[float, ...]) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat(value[3:]).as_matrix(), value[:3]
    return out


def at(made: TransformTrack, time: float) -> tuple[float, ...] | None:
    return made.at(round(time * S))


def test_between_two_transforms_position_and_rotation_are_interpolated() -> None:
    made = track([1.0, 1.2], [pose(1.0, 0.2), pose(2.0, 0.6)])
    assert at(made, 1.0) == pose(1.0, 0.2)
    assert at(made, 1.05) == pytest.approx(pose(1.25, 0.3), abs=1e-12)


def test_a_gap_that_is_too_long_and_times_outside_are_not_known() -> None:
    made = track([1.0, 1.25, 1.51], [pose(1.0), pose(2.0), pose(3.0)])
    assert at(made, 1.1) is not None  # a gap as long as may be
    assert at(made, 1.3) is None
    assert at(made, 0.99) is None
    assert at(made, 1.52) is None
    assert at(made, 1.51) == pose(3.0)


def test_what_has_not_moved_is_known_at_all_times_and_over_all_gaps() -> None:
    made = track([1.0, 9.0], [pose(1.0), pose(1.0)])
    assert [at(made, t) for t in (0.0, 5.0, 20.0)] == [pose(1.0)] * 3
    made.add(10 * S, pose(2.0))
    assert at(made, 20.0) is None
    assert at(made, 5.0) == pose(1.0)  # the ends of a long gap are equal


def test_a_static_transform_has_the_last_value_or_the_first() -> None:
    made = track([1.0, 3.0], [pose(1.0), pose(2.0)], static=True)
    assert [at(made, t) for t in (0.0, 1.0, 2.9, 3.0, 99.0)] == [pose(1.0)] * 3 + [pose(2.0)] * 2
    assert TransformTrack(GAP, static=True, first=pose(7.0)).at(0) == pose(7.0)


def test_order_does_not_matter_and_of_one_time_the_first_counts() -> None:
    made = track([1.2, 1.0, 1.1, 1.1], [pose(3.0), pose(1.0), pose(2.0), pose(9.0)])
    assert made.times == [S, round(1.1 * S), round(1.2 * S)]
    assert at(made, 1.1) == pose(2.0)
    made.add(round(1.05 * S), (math.nan,) * 7)
    assert len(made.times) == 3


def test_what_is_discarded_was_needed_only_before() -> None:
    made = track([1.0, 1.1, 1.2], [pose(1.0), pose(2.0), pose(3.0)])
    inside = at(made, 1.15)
    made.discard_before(round(1.15 * S))
    assert len(made.times) == 2
    assert at(made, 1.15) == inside


def test_a_chain_is_the_product_of_its_matrices_with_inverses_where_it_goes_down() -> None:
    rng = np.random.default_rng(3)
    values = [(*rng.normal(size=3), *Rotation.random(random_state=k).as_quat()) for k in range(4)]
    inverse = [False, True, False, True]
    links = tuple(
        ChainLink(track([1.0], [tuple(map(float, v))], static=True), back)
        for v, back in zip(values, inverse, strict=True)
    )
    chain = TransformChain(links)
    expected = np.eye(4)
    for value, back in zip(values, inverse, strict=True):
        step = matrix(value)
        expected = (np.linalg.inv(step) if back else step) @ expected
    found = chain.at(S)
    assert found is not None
    assert matrix(found) == pytest.approx(expected, abs=1e-12)
    assert not chain.moving
    assert TransformChain(()).at(0) == IDENTITY


def test_a_chain_is_unknown_where_one_of_its_transforms_is() -> None:
    still, moving = track([1.0], [pose(1.0)], static=True), track([1.0, 1.2], [pose(1.0), pose(2.0)])
    chain = TransformChain((ChainLink(still, False), ChainLink(moving, True)))
    assert chain.moving
    assert chain.at(round(1.1 * S)) == pytest.approx(pose(1.0 - 1.5), abs=1e-12)
    assert chain.at(2 * S) is None
