"""Lengths, angles and measures of motion as a reader of a comparison sees them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from geomphys.analysis.diff.difference import OutputDifference
from geomphys.analysis.metric_values import Distribution
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


def volume_text(cubic_metres: float) -> str:
    """Return a volume in cubic centimetres."""
    return f"{1e6 * cubic_metres:.3g} cm³"


def measure_table(difference: OutputDifference) -> list[tuple[str, str, str]]:
    """Name, value of a and value of b of the measures of both motions; those that neither has are left out."""
    frames = [] if difference.values is None else list(_frame_measures(*difference.values))
    return frames + ([] if difference.motion is None else list(_motion_measures(*difference.motion)))


def _frame_measures(a: dict[str, Distribution], b: dict[str, Distribution]) -> Iterator[tuple[str, str, str]]:
    """Statistics of the measures of frames."""
    rows: tuple[tuple[str, str, str, Callable[[float], str]], ...] = (
        ("recorded penetration, largest", "recorded_penetration_m", "max", length_text),
        ("correction, p95", "correction_m", "p95", length_text),
        ("correction, largest", "correction_m", "max", length_text),
        ("amplification, median", "amplification", "p50", "{:.2f}".format),
        ("amplification, p95", "amplification", "p95", "{:.2f}".format),
        ("fingertip error in contact, mean", "fingertip_error_in_contact_m", "mean", length_text),
        ("contact precision, p95", "contact_precision_m", "p95", length_text),
        ("contact alignment, p95", "contact_alignment_rad", "p95", angle_text),
        ("change of shape (rigid), largest", "shape_change_rad", "max", angle_text),
    )
    for name, key, statistic, text in rows:
        if a[key].count or b[key].count:
            text_a, text_b = (text(getattr(side[key], statistic)) if side[key].count else "" for side in (a, b))
            yield name, text_a, text_b


def _motion_measures(a: OutputMotion, b: OutputMotion) -> Iterator[tuple[str, str, str]]:
    """Measures of the whole motions."""
    rows: tuple[tuple[str, str, Callable[[float], str]], ...] = (
        ("contacts of fingertips, recorded", "contacts_recorded", "{:,}".format),
        ("contacts of fingertips, kept", "contacts_kept", "{:,}".format),
        ("grasps, recorded", "grasps_recorded", "{:,}".format),
        ("grasps, kept", "grasps_kept", "{:,}".format),
        ("frames recorded over 2 mm deep", "deep_share", "{:.1%}".format),
        ("deepest recorded overlap, volume in common", "intersection_volume_m3", volume_text),
        ("spikes", "spikes", "{:,}".format),
        ("jerk of links over recorded, RMS", "jerk_rms_ratio", "{:.2f}".format),
        ("jerk of links over recorded, p99", "jerk_p99_ratio", "{:.2f}".format),
        ("jerk of joints over recorded, RMS", "joint_jerk_rms_ratio", "{:.2f}".format),
        ("jerk of joints over recorded, p99", "joint_jerk_p99_ratio", "{:.2f}".format),
    )
    for name, key, text in rows:
        values = (getattr(a, key), getattr(b, key))
        if values != (None, None):
            text_a, text_b = ("" if value is None else text(value) for value in values)
            yield name, text_a, text_b
