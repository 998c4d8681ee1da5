"""Lengths and angles as a reader of a comparison sees them."""

from __future__ import annotations

import math


def length_text(metres: float) -> str:
    """Return a length in the unit that fits it."""
    for limit, unit in ((1e-6, "nm"), (1e-3, "µm"), (1.0, "mm")):
        if metres < limit:
            return f"{metres / limit * 1e3:.3g} {unit}"
    return f"{metres:.3g} m"


def angle_text(radians: float) -> str:
    """Return an angle in degrees."""
    return f"{math.degrees(radians):.3g}°"
