"""Names of a log in messages: no control characters, bounded in length and number, and the nearest known one."""

from __future__ import annotations

import pytest

from geomphys.recording.display_names import (
    MAX_LENGTH,
    MAX_LISTED,
    MAX_REMEMBERED,
    add_names,
    closest_name,
    did_you_mean,
    join_names,
    printable,
)


@pytest.mark.parametrize("name", ["a\nb", "\x1b[31mred", "\u202eevil", "tab\there", "\ud800", "bell\x07"])
def test_nothing_that_a_terminal_obeys_is_printed(name: str) -> None:
    assert printable(name).isprintable()
    assert printable(name) != name


def test_readable_names_stay_as_they_are() -> None:
    for name in ("/tf", "hand_left/α1", "a b"):
        assert printable(name) == name
    assert printable("x" * MAX_LENGTH) == "x" * MAX_LENGTH
    assert printable("x" * (MAX_LENGTH + 1)) == "x" * MAX_LENGTH + "…"


def test_a_list_says_how_many_are_left_out() -> None:
    assert join_names([]) == "none"
    assert join_names(["a", "b"]) == "a, b"
    assert join_names(list("abcde"), 3) == "a, b, c and 2 more"
    assert join_names([str(k) for k in range(MAX_LISTED)]).count(",") == MAX_LISTED - 1


def test_what_is_remembered_is_bounded() -> None:
    known: set[str] = set()
    for k in range(0, 3 * MAX_REMEMBERED, 1000):
        add_names(known, (str(n) for n in range(k, k + 1000)))
    assert len(known) == MAX_REMEMBERED


def test_the_nearest_name_is_proposed_if_it_is_near() -> None:
    names = ["index_mcp", "middle_mcp", "thumb_cmc"]
    assert closest_name("indx_mcp", names) == "index_mcp"
    assert closest_name("wrist", names) == ""
    assert did_you_mean("indx_mcp", names) == " (did you mean 'index_mcp'?)"
    assert did_you_mean("wrist", names) == did_you_mean("x", []) == ""
