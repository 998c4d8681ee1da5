"""The unit and the sign of recorded angles: one function for all commands."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geomphys.recording.angle_units import guess_angle_unit, mirrored_joints

FINGER = {f"j{k}": (-0.3, 1.6) for k in range(8)}
NOTHING = {f"j{k}": (0.0, 0.0) for k in range(8)}
NONE = {f"j{k}": (-math.inf, math.inf) for k in range(8)}


@pytest.mark.parametrize("limits", [FINGER, NOTHING, NONE])
@pytest.mark.parametrize("factor", [1.0, math.degrees(1.0)])
def test_radians_and_degrees_are_told_apart(factor, limits):
    guess = guess_angle_unit(dict.fromkeys(limits, (-0.1 * factor, 1.2 * factor)), limits)
    assert guess.unit == ("rad" if factor == 1.0 else "deg")
    assert f"{1.2 * factor:.3g}" in guess.reason
    assert guess.doubt == ""


@given(
    st.lists(st.tuples(st.floats(-6.2, 6.2), st.floats(-6.2, 6.2)), min_size=1, max_size=20),
    st.sampled_from([(0.0, 0.0), (-0.2, 1.6), (0.0, 0.1), (-math.inf, math.inf), (1.0, 0.5)]),
)
def test_values_within_a_turn_are_never_degrees(spans, limit):
    ranges = {f"j{k}": (min(s), max(s)) for k, s in enumerate(spans)}
    assert guess_angle_unit(ranges, dict.fromkeys(ranges, limit)).unit == "rad"


def test_a_wheel_that_turns_on_does_not_make_the_limited_joints_degrees():
    ranges = {"wheel": (0.0, 60.0), "arm": (-1.0, 1.2)}
    assert guess_angle_unit(ranges, {"wheel": (-math.inf, math.inf), "arm": (-1.5, 1.5)}).unit == "rad"
    assert guess_angle_unit({"wheel": (0.0, 60.0)}, {"wheel": (-math.inf, math.inf)}).unit == "deg"
    assert guess_angle_unit({}, {}).unit == "rad"


@pytest.mark.parametrize(
    ("full", "limits"), [(1.0, FINGER), (100.0, FINGER), (255.0, NONE), (1023.0, NOTHING), (4095.0, FINGER)]
)
def test_full_scales_of_sensors_are_no_angles(full, limits):
    assert guess_angle_unit(dict.fromkeys(limits, (0.0, full)), limits).doubt


@pytest.mark.parametrize("limits", [FINGER, NOTHING, NONE])
def test_raw_values_fit_in_neither_unit(limits):
    guess = guess_angle_unit(dict.fromkeys(limits, (213.0, 780.0)), limits)
    assert "neither radians nor degrees" in guess.doubt


def test_a_glove_in_degrees_that_bends_beyond_a_robots_limits_is_a_glove():
    for top in (40.0, 90.0, 110.0):
        assert guess_angle_unit(dict.fromkeys(FINGER, (-15.0, top)), FINGER)[::2] == ("deg", "")


def test_a_joint_is_mirrored_where_the_opposite_sign_fits_far_better():
    limits = {
        "flex": (-0.2, 1.6),
        "spread": (-0.4, 0.4),
        "still": (-0.2, 1.6),
        "free": (-math.inf, math.inf),
        "none": (0.0, 0.0),
    }
    there = {"flex": (0.0, 1.5), "spread": (-0.3, 0.2), "still": (0.0, 0.02), "free": (-2.0, 0.0), "none": (-1.0, 0.0)}
    back = {n: (-high, -low) for n, (low, high) in there.items()}
    assert mirrored_joints(there, limits) == ()
    assert mirrored_joints(back, limits) == ("flex",)


def test_one_joint_among_many_has_odd_limits():
    ranges = {f"j{k}": (0.0, 1.2) for k in range(30)} | {"odd": (-1.2, 0.0)}
    assert mirrored_joints(ranges, dict.fromkeys(ranges, (-0.1, 1.5))) == ()
    few = {n: ranges[n] for n in ("j0", "j1", "odd")}
    assert mirrored_joints(few, dict.fromkeys(few, (-0.1, 1.5))) == ("odd",)


def test_no_recording_of_random_people_within_their_limits_is_mirrored():
    random = np.random.default_rng(5)
    for _ in range(300):
        low, high = sorted(random.uniform(-2, 2, 2))
        a, b = sorted(random.uniform(low - 0.2, high + 0.2, 2))
        assert mirrored_joints({"j": (a, b)}, {"j": (low, high)}) == ()
