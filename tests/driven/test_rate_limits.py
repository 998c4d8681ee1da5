"""Rate limits of offsets: the step length at which a link is as far off its path as it may be in a frame."""

from __future__ import annotations

import pytest

from geomphys.driven.stepping import _step_length_within


@pytest.mark.parametrize(
    ("before", "after", "most", "step_length"),
    [
        (0.0, 1e-3, 2e-3, 1.0),  # stays below
        (0.0, 4e-3, 1e-3, 0.25),
        (1e-3, 5e-3, 2e-3, 0.25),
        (2e-3, 5e-3, 1e-3, 0.0),  # was beyond: goes no farther
        (5e-3, 3e-3, 1e-3, 1.0),  # comes back
        (2e-3, 2e-3, 1e-3, 1.0),  # stays as it was
    ],
)
def test_a_step_ends_where_the_limit_is_reached(before: float, after: float, most: float, step_length: float) -> None:
    assert _step_length_within(before, after, most) == pytest.approx(step_length)
    if after > before:
        assert before + _step_length_within(before, after, most) * (after - before) <= max(most, before) + 1e-12
