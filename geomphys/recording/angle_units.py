"""Guesses the unit and the sign of recorded joint angles from their ranges and the limits of the joints they map to.

`geomphys init`, `check` and `replay` use the same function. Small values never count as degrees: read as degrees, any
small values fit any limits. Limits of zero width (0 to 0, written by exporters that know none) are ignored.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

Range = tuple[float, float]

FULL_ROTATION = 2 * math.pi + 0.02
"""rad; a joint angle beyond this (more than a full turn) cannot be in radians."""
MAX_LIMIT_EXCESS = math.radians(45)
"""rad; people and calibrations leave limits by less than this."""
MAX_PLAUSIBLE_ANGLE = math.radians(200)
"""rad; largest plausible angle of a joint without limits."""
FULL_SCALES = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 65535.0)
"""Largest values of sensors and of shares of a range."""
MIN_MOTION = 0.15
"""rad; the sign of a joint that moves by less is not judged."""
SIGN_MARGIN = 0.25
"""rad; a joint that exceeds its limits by less than this is not reported as mirrored."""


class UnitGuess(NamedTuple):
    """The guessed unit of recorded angles, with the reason."""

    unit: Literal["rad", "deg"]
    reason: str
    doubt: str = ""  # why the values are probably no angles at all; "" if they may be


def guess_angle_unit(ranges: Mapping[str, Range], limits: Mapping[str, Range]) -> UnitGuess:
    """Distinguish radians, degrees, and values that are no angles.

    Parameters
    ----------
    ranges
        Joint -> least and largest value as recorded. Revolute joints only.
    limits
        The same joints -> lower and upper limit, rad; infinite where there is none.
    """
    if not ranges:
        return UnitGuess("rad", "there is no angle to judge by")
    known = {n: limits[n] for n in ranges if is_informative(limits[n])}
    candidates = known or ranges  # joints without limits (wheels) are only used where no other is there
    name, largest = max(((n, _largest(ranges[n])) for n in candidates), key=lambda item: (item[1], item[0]))
    unit: Literal["rad", "deg"] = "deg" if largest > FULL_ROTATION else "rad"
    scale = math.pi / 180.0 if unit == "deg" else 1.0
    inside = sum(limit_excess(ranges[n], known[n], scale) <= math.radians(5) for n in known)
    fits = f"{inside} of {len(known)} joints within their limits" if known else "no limits to compare with"
    if unit == "deg":
        reason = f"{name} reaches {largest:.3g}, more than a whole turn as radians; {fits} as degrees"
    else:
        reason = f"no value is above {largest:.3g}; {fits}"
    return UnitGuess(unit, reason, _angle_doubt(ranges, limits, unit))


def mirrored_joints(ranges: Mapping[str, Range], limits: Mapping[str, Range]) -> tuple[str, ...]:
    """Joints whose recorded angles fit their limits far better with the opposite sign.

    One among many that do not is more likely one of odd limits: less than a tenth of the joints is none.

    Parameters
    ----------
    ranges, limits
        Joint -> least and largest angle, and its limits; both in rad.
    """
    found, likely, candidates = [], [], 0
    for name, (low, high) in ranges.items():
        if not is_informative(limits[name]) or high - low < MIN_MOTION:
            continue
        candidates += 1
        as_is, mirrored = _share_inside((low, high), limits[name]), _share_inside((-high, -low), limits[name])
        if mirrored < 0.9 or limit_excess((low, high), limits[name], 1.0) < SIGN_MARGIN:
            continue
        if as_is <= 0.5:
            found.append(name)
        elif as_is <= 0.7:
            likely.append(name)
    if 10 * len(found) < candidates:
        return ()
    return tuple(n for n in ranges if n in found or (n in likely and len(found) > 1))


def is_informative(limits: Range) -> bool:
    """Whether limits are finite and span an interval."""
    return math.isfinite(limits[0]) and math.isfinite(limits[1]) and limits[1] - limits[0] > 1e-6


def limit_excess(span: Range, limits: Range, scale: float) -> float:
    """How far values, `scale` of them a rad, reach outside of limits, rad."""
    return max(limits[0] - scale * span[0], scale * span[1] - limits[1], 0.0)


def _angle_doubt(ranges: Mapping[str, Range], limits: Mapping[str, Range], unit: Literal["rad", "deg"]) -> str:
    """Why values are probably no angles: they fill a sensor's scale, or fit in neither unit."""
    largest = max(map(_largest, ranges.values()))
    full = next((f for f in FULL_SCALES if math.isclose(largest, f, rel_tol=1e-6)), 0.0)
    slack = 1e-6 * full
    filled = sum(abs(low) <= slack and high >= full - slack for low, high in ranges.values())
    if full and filled >= 3 and 2 * filled >= len(ranges) and min(low for low, _ in ranges.values()) >= -slack:
        return f"{filled} of {len(ranges)} joints go from 0 to exactly {full:.0f}: shares of a range, no angles?"
    if unit == "rad":
        return ""
    implausible = sum(
        limit_excess(span, limits[n], math.pi / 180.0) > MAX_LIMIT_EXCESS
        if is_informative(limits[n])
        else math.radians(_largest(span)) > MAX_PLAUSIBLE_ANGLE
        for n, span in ranges.items()
    )
    if 2 * implausible < len(ranges):
        return ""
    joints = f"{implausible} of {len(ranges)} joints"
    return f"values up to {largest:.4g} fit neither radians nor degrees ({joints}): raw sensor values?"


def _largest(span: Range) -> float:
    return max(-span[0], span[1])


def _share_inside(span: Range, limits: Range) -> float:
    """Share of a span that lies within limits widened by 5 degrees (people exceed nominal limits)."""
    slack = math.radians(5)
    return max(0.0, min(span[1], limits[1] + slack) - max(span[0], limits[0] - slack)) / (span[1] - span[0])
