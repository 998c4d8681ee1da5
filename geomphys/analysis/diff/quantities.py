"""Lengths, angles and measures of motion as a reader of a comparison sees them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from geomphys.analysis.output_motion import OutputMotion


def length_text(metres: float) -> str:
    """Return a length in the unit that fits it."""
    for limit, unit in ((1e-6, "nm"), (1e-3, "µm"), (1.0, "mm")):
        if metres < limit:
            return f"{metres / limit * 1e3:.3g} {unit}"
    return f"{metres:.3g} m"


def angle_text(radians: float) -> str:
    """Return an angle in degrees."""
    return f"{math.degrees(radians):.3g}°"


def motion_table(a: OutputMotion, b: OutputMotion) -> Iterator[tuple[str, str, str]]:
    """Yield name, value of a and value of b of the measures of two motions; those that neither has are left out."""
    rows = (
        ("contacts of fingertips, recorded", "contacts_recorded", "{:,}"),
        ("contacts of fingertips, kept", "contacts_kept", "{:,}"),
        ("grasps, recorded", "grasps_recorded", "{:,}"),
        ("grasps, kept", "grasps_kept", "{:,}"),
        ("frames recorded over 2 mm deep", "deep_share", "{:.1%}"),
        ("deepest recorded overlap, volume in common [m³]", "intersection_volume_m3", "{:.3g}"),
        ("spikes", "spikes", "{:,}"),
        ("jerk of links over recorded, RMS", "jerk_rms_ratio", "{:.2f}"),
        ("jerk of links over recorded, p99", "jerk_p99_ratio", "{:.2f}"),
        ("jerk of joints over recorded, RMS", "joint_jerk_rms_ratio", "{:.2f}"),
        ("jerk of joints over recorded, p99", "joint_jerk_p99_ratio", "{:.2f}"),
    )
    for name, key, form in rows:
        values = (getattr(a, key), getattr(b, key))
        if values != (None, None):
            text_a, text_b = ("" if value is None else form.format(value) for value in values)
            yield name, text_a, text_b
