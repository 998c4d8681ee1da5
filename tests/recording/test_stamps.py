"""Times of all encodings become integer nanoseconds, against Python's own calendar; what is no time is refused."""

from __future__ import annotations

import random
from datetime import UTC, datetime, timedelta, timezone
from typing import Any

import pytest

from geomphys.recording.stamps import NANOSECONDS_FROM, STAMP_LIMIT, json_stamp, stamp_of

NOW = 1_760_601_601_208_333_333  # ns


def test_seconds_and_nanoseconds_are_added_up_exactly() -> None:
    assert stamp_of(1_760_601_601, 208_333_333) == NOW
    assert stamp_of(0, 0) == 0
    assert stamp_of(STAMP_LIMIT // 10**9, STAMP_LIMIT % 10**9 - 1) == STAMP_LIMIT - 1


@pytest.mark.parametrize("sec", [-1, STAMP_LIMIT // 10**9 + 1])
def test_times_that_cannot_be_are_refused(sec: int) -> None:
    with pytest.raises(ValueError, match="stamp"):
        stamp_of(sec, 0)


@pytest.mark.parametrize(
    ("time", "expected"),
    [
        ({"sec": 1_760_601_601, "nsec": 208_333_333}, NOW),
        ({"sec": 1_760_601_601, "nanosec": 208_333_333}, NOW),
        ({"secs": 1_760_601_601, "nsecs": 208_333_333}, NOW),
        ({"seconds": "1760601601", "nanos": 208_333_333}, NOW),
        ({"seconds": 1_760_601_601}, 1_760_601_601 * 10**9),
        ({"nanoseconds": NOW}, NOW),
        ({"seconds": 1.5}, 1_500_000_000),
        ({"seconds": 1.5, "nanos": 7}, 1_500_000_007),
        ({}, 0),
        (None, None),
        (12.25, 12_250_000_000),
        (12, 12 * 10**9),
        (NOW, NOW),
        (str(NOW), NOW),
        ("12", 12 * 10**9),
        (NANOSECONDS_FROM, NANOSECONDS_FROM),
    ],
)
def test_the_ways_json_writes_a_time(time: Any, expected: int | None) -> None:
    assert json_stamp(time) == expected


@pytest.mark.parametrize(
    "time", [{"frame": 3}, [1, 2], True, "yesterday", {"sec": "x", "nsec": 1}, {"sec": 1.5, "nsec": 0.5}, -1, "-5"]
)
def test_what_is_no_time_is_refused(time: Any) -> None:
    with pytest.raises((KeyError, TypeError, ValueError)):
        json_stamp(time)


def test_texts_of_a_time_are_those_of_the_calendar() -> None:
    rng = random.Random(3)
    for _ in range(200):
        whole = rng.randrange(0, 2**31)
        nanoseconds, digits = rng.randrange(10**9), rng.randrange(10)
        zone = timezone(timedelta(minutes=rng.choice([0, 60, 330, -210, -720])))
        when = datetime.fromtimestamp(whole, UTC).astimezone(zone)
        fraction = f".{nanoseconds:09d}"[: digits + 1] if digits else ""
        shift = when.strftime("%z")
        text = when.strftime("%Y-%m-%dT%H:%M:%S") + fraction
        text += "Z" if shift == "+0000" and whole % 2 else f"{shift[:3]}:{shift[3:]}"
        expected = whole * 10**9 + (int(fraction[1:].ljust(9, "0")) if digits else 0)
        assert json_stamp(text) == expected
    assert json_stamp("2025-10-16T08:00:01.2083333339999Z") == NOW  # nine digits count
    assert json_stamp("2016-12-31T23:59:60Z") == json_stamp("2017-01-01T00:00:00Z")  # a leap second


@pytest.mark.parametrize(
    "text", ["2025-13-01T00:00:00Z", "2025-10-16T08:00:61Z", "2025-10-16T08:00:00", "1969-12-31T23:59:59Z"]
)
def test_texts_that_are_no_time_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"time|stamp|month"):
        json_stamp(text)
