"""Types of values of a scene file: what they take, what they make of it, what they refuse."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pydantic import ConfigDict, TypeAdapter, ValidationError
from scipy.spatial.transform import Rotation

from geomphys.scene import scene_values as v


def made(kind: Any, value: Any) -> Any:
    return TypeAdapter(kind, config=ConfigDict(allow_inf_nan=False)).validate_python(value)  # as the models have it


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        (v.Length, [1e-6, 1.0, 1e5], [0.0, -1.0, 1e6, math.nan, math.inf]),
        (v.Position, [[0, 0, 0], [1e6, -1e6, 0.5]], [[0, 0], [0, 0, 0, 0], [1e7, 0, 0], [math.nan, 0, 0], "0 0 0"]),
        (v.Lengths3, [[1, 2, 3]], [[1, 2], [1, 2, 0]]),
        (v.Seconds, [0.0, -600.0, 600.0], [601.0, math.nan]),
        (v.Sign, [1, -1, 1.0], [0, 2, True, 0.5]),
        (v.Factor, [2.0, -0.5], [0, 0.0, 1e7]),
        (v.Name, ["hand", "left hand", "α"], ["", " a", "a ", "a/b", "a#b", "world", "recorded", "a\nb", "x" * 513]),
        (v.Text, ["a/b#c", "world"], ["", "a\x1b", "x" * 513]),
        (v.Mass, [1e-9, 70.0], [0.0, -1.0]),
        (v.Degrees, [-3600.0, 90], [3601.0]),
    ],
)
def test_bounds(kind: Any, good: list[Any], bad: list[Any]) -> None:
    for value in good:
        made(kind, value)
    for value in bad:
        with pytest.raises(ValidationError):
            made(kind, value)


def test_lists_become_tuples_and_a_single_text_a_tuple_of_one() -> None:
    assert made(v.Position, [1, 2, 3]) == (1.0, 2.0, 3.0)
    assert made(v.FrameIds, "map") == ("map",)
    assert made(v.FrameIds, ["map", "odom"]) == ("map", "odom")
    assert made(v.Sign, -1.0) == -1


def test_quaternions_are_normalised_where_they_are_nearly_of_unit_length() -> None:
    exact = (0.0, 0.6, 0.0, 0.8)
    assert made(v.Quaternion, list(exact)) == exact
    rough = made(v.Quaternion, [0.0, 0.603, 0.0, 0.8])
    assert math.hypot(*rough) == pytest.approx(1.0, abs=1e-15)
    for bad in ([0.0, 0.0, 0.0, 0.0], [0.0, 0.62, 0.0, 0.8], [0.0, 0.0, 0.0, math.nan], [1.0, 0.0, 0.0]):
        with pytest.raises(ValidationError):
            made(v.Quaternion, bad)


@pytest.mark.parametrize(("axis", "up"), [("z", (0, 0, 1)), ("y", (0, 1, 0))])
def test_the_rotation_to_z_up_takes_the_axis_there(axis: str, up: tuple[int, int, int]) -> None:
    turn = Rotation.from_quat(v.rotation_to_z_up(axis))  # type: ignore[arg-type]
    assert turn.apply(up) == pytest.approx([0, 0, 1], abs=1e-12)
    assert turn.apply([1, 0, 0]) == pytest.approx([1, 0, 0], abs=1e-12)
