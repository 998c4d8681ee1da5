"""Parses message time stamps of all encodings to integer nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from itertools import takewhile
from typing import Any

NEVER = -(2**62)
"""ns; a time before all others."""
STAMP_LIMIT = 2**62
"""ns; a stamp from here on (the year 2116) is none."""
WRITABLE_TIMES = range(2**31 * 10**9)
"""ns; times of frames that an output can have: a ROS 2 stamp counts seconds in 31 bits, to 2038."""
NANOSECONDS_FROM = 10**17
"""A bare whole number from here on counts nanoseconds (since 1973 or later), one below counts seconds."""
_SECONDS = ("sec", "secs", "seconds")
_NANOSECONDS = ("nsec", "nanosec", "nsecs", "nanos", "nanoseconds")
_RFC_3339 = re.compile(r"(\d{4}-\d\d-\d\d)[Tt ](\d\d:\d\d):(\d\d)(?:\.(\d+))?(?:[Zz]|([+-])(\d\d):(\d\d))", re.ASCII)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def stamp_of(sec: int, nanosec: int) -> int:
    """Stamp in ns; raises ValueError if it is none that can be."""
    stamp = sec * 10**9 + nanosec
    if not 0 <= stamp < STAMP_LIMIT:
        raise ValueError(f"stamp {stamp}")
    return stamp


def json_stamp(time: Any) -> int | None:
    """Stamp in ns of a time in JSON; None for ``null``.

    An object has its seconds as sec, secs or seconds and the rest as nsec, nanosec, nsecs, nanos or nanoseconds; without
    the first, the second is the whole. A number is seconds, or nanoseconds if whole and too large for seconds. A text is a
    time by RFC 3339 with any number of digits behind the point, of which nine count, or a whole number.

    Raises
    ------
    KeyError, TypeError, ValueError
        It is none of these, or no time that can be.
    """
    if time is None:
        return None
    if isinstance(time, dict):
        sec = time.get("sec")
        nanosec = time.get("nsec", time.get("nanosec"))
        if type(sec) is int and type(nanosec) is int:  # the common case
            return stamp_of(sec, nanosec)
        seconds = next((time[k] for k in _SECONDS if k in time), None)
        rest = next((time[k] for k in _NANOSECONDS if k in time), None)
        if seconds is None and rest is None:
            if time:
                raise KeyError("seconds")
            return 0
        nanoseconds = 0 if rest is None else _whole(rest)
        if isinstance(seconds, float):
            return stamp_of(0, round(seconds * 1e9) + nanoseconds)
        return stamp_of(0 if seconds is None else _whole(seconds), nanoseconds)
    if isinstance(time, float):
        return stamp_of(0, round(time * 1e9))
    if isinstance(time, str) and not time.isdigit():
        return _rfc_3339(time)
    whole = _whole(time)
    return stamp_of(0, whole) if whole >= NANOSECONDS_FROM else stamp_of(whole, 0)


def _whole(value: Any) -> int:
    """A whole number, or the digits of one: 64-bit numbers are text in protobuf's JSON."""
    if isinstance(value, str) and len(value) <= 20 and value.isascii():
        return int(value)
    if isinstance(value, float) and value.is_integer():
        return int(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError("not a whole number")
    return value


def _rfc_3339(text: str) -> int:
    """Stamp of a time as text; a leap second is the second after the one before it."""
    found = _RFC_3339.fullmatch(text)
    if found is None:
        raise ValueError("not a time")
    day, minute, second, fraction, sign, hours, minutes = found.groups()
    when = datetime.fromisoformat(f"{day}T{minute}:00+00:00") + timedelta(seconds=int(second))
    if sign:
        offset = timedelta(hours=int(hours), minutes=int(minutes))
        when += offset if sign == "-" else -offset
    if int(second) > 60:
        raise ValueError("not a time")
    apart = when - _EPOCH
    nanoseconds = int((fraction or "")[:9].ljust(9, "0"))
    return stamp_of(apart.days * 86400 + apart.seconds, nanoseconds)


def count_equal(frames: Iterable[int], samples: Iterable[int], good: Iterable[bool]) -> int:
    """How many of the frames' times are those of samples, from the first on, which are good."""
    equal = (frame == sample and fine for frame, sample, fine in zip(frames, samples, good, strict=False))
    return sum(takewhile(bool, equal))
