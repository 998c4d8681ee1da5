"""Fields of decoded messages: by attributes or keys, strict or lenient, numbers as JSON's writers mean them."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from geomphys.recording.field_access import FieldAccess, checked_names, checked_text, floats, with_default

POSITION = tuple(f"pose.position.{k}" for k in "xyz")
ORIENTATION = tuple(f"pose.orientation.{k}" for k in "xyzw")
MESSAGE = {"pose": {"position": {"x": 1.0, "y": 2, "z": None}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}}


def json(lenient: bool = False, points: bool = False) -> FieldAccess:
    return FieldAccess("json", lenient=lenient, points=points)


def attributes(value: Any) -> Any:
    return SimpleNamespace(**{k: attributes(v) for k, v in value.items()}) if isinstance(value, dict) else value


@pytest.mark.parametrize("lenient", [False, True])
def test_numbers_come_in_the_order_of_their_paths_and_null_is_nan(lenient: bool) -> None:
    found = json(lenient).numbers(POSITION + ORIENTATION)(MESSAGE)
    assert found[:2] == (1.0, 2.0)
    assert math.isnan(found[2])
    assert found[3:] == (0.0, 0.0, 0.0, 1.0)
    assert all(type(x) is float for x in found)
    paths = ("pose.orientation.w", "pose.orientation.z", "pose.position.y", "pose.position.x")
    assert json(lenient).numbers(paths)(MESSAGE) == (1.0, 0.0, 2.0, 1.0)


def test_attributes_and_keys_give_the_same() -> None:
    paths = (*POSITION[:2], *ORIENTATION)
    assert FieldAccess("cdr", lenient=False).numbers(paths)(attributes(MESSAGE)) == json().numbers(paths)(MESSAGE)


def test_what_is_absent_is_zero_only_where_writers_leave_zeros_out() -> None:
    partial = {"pose": {"position": {"y": 2.0}}}
    with pytest.raises(KeyError):
        json().numbers(POSITION)(partial)
    assert json(lenient=True).numbers(POSITION)(partial) == (0.0, 2.0, 0.0)
    assert json(lenient=True).numbers(POSITION)({}) == (0.0, 0.0, 0.0)
    with pytest.raises(KeyError):  # a rotation of zeros is none
        json(lenient=True).numbers(ORIENTATION)({"pose": {}})


def test_points_need_a_position_alone() -> None:
    numbers = json(points=True).numbers(POSITION + ORIENTATION)
    whole = {"x": 1.0, "y": 2.0, "z": 3.0}
    assert numbers({"pose": {"position": whole}}) == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)
    assert all(math.isnan(x) for x in numbers({"pose": {"position": None}}))
    assert all(math.isnan(x) for x in numbers({}))


def test_names_of_protobuf_are_found_in_its_spelling_of_json() -> None:
    fetch = json(lenient=True).required("frame_id")
    assert fetch({"frameId": "world"}) == fetch({"frame_id": "world"}) == "world"
    assert json(lenient=True).optional("header.frame_id")({"header": {"frameId": "a"}}) == "a"
    assert json(lenient=True).optional("header.frame_id.more")({"header": {}}) is None


@pytest.mark.parametrize(
    ("encoding", "time"),
    [("cdr", {"sec": 3, "nanosec": 5}), ("ros1", {"secs": 3, "nsecs": 5}), ("json", {"sec": 3, "nsec": 5})],
)
def test_stamps_of_all_encodings(encoding: str, time: dict[str, int]) -> None:
    access = FieldAccess(encoding, lenient=False)
    message = {"header": {"stamp": time}}
    assert access.stamp("header.stamp")(attributes(message) if encoding != "json" else message) == 3 * 10**9 + 5
    assert access.stamp("")(message) is None


def test_texts_are_joined_without_repeats() -> None:
    fetch = json(lenient=True).text(("a", "b", "c"))
    assert fetch({"a": "left", "b": None, "c": "thumb"}) == "left/thumb"
    assert fetch({"a": "left", "b": "left"}) == "left"
    assert json().text(())({}) == ""


def test_numbers_written_as_text_and_what_is_none() -> None:
    found = floats([1, 2.5, None, "NaN", "-Infinity"])
    assert found[:2] == [1.0, 2.5]
    assert math.isnan(found[2])
    assert math.isnan(found[3])
    assert found[4] == -math.inf
    for bad in ("1.5", True, [1.0], {}):
        with pytest.raises(TypeError):
            floats([bad])


def test_texts_and_names_are_checked() -> None:
    assert checked_text(None) == ""
    assert checked_names(["a", "b"]) == ["a", "b"]
    for bad in (3, ["a"]):
        with pytest.raises(TypeError):
            checked_text(bad)
    for bad_names in ("ab", ["a", 3], None):
        with pytest.raises(TypeError):
            checked_names(bad_names)


def test_a_field_that_some_versions_lack_has_its_default() -> None:
    access = FieldAccess("cdr", lenient=False)
    assert with_default(access.required("a"), 7)(SimpleNamespace()) == 7
    assert with_default(access.required("a"), 7)(SimpleNamespace(a=3)) == 3
