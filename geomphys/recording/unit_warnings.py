"""Warnings about angles and positions that appear to be in another unit, sign or up axis than the scene says."""

from __future__ import annotations

import math
from collections.abc import Iterator

from geomphys.recording.angle_units import guess_angle_unit, is_informative, mirrored_joints
from geomphys.recording.channels import kind_of
from geomphys.recording.diagnostics import Diagnostic
from geomphys.recording.display_names import join_names, printable
from geomphys.recording.log_pass import LogPass
from geomphys.recording.prepared_log import PreparedLog
from geomphys.recording.routes import JointRoute
from geomphys.recording.space_guess import guess_space
from geomphys.scene.arrays import DRIVEN

MAX_NAMES = 8  # names listed in a warning
MIN_EXTENT = 0.02  # m; a recording that stays closer to its origin was read in too small a unit
UNIT_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}


def angle_warnings(source: PreparedLog, log_pass: LogPass) -> Iterator[str]:
    """One line for each topic whose angles are of another unit or sign than the scene says, by `guess_angle_unit`."""
    for route in log_pass.joints:
        ranges, limits = _angle_ranges(source, log_pass, route)
        joint_input = route.input
        scale = math.pi / 180.0 if joint_input.degrees else 1.0
        mapped = {n for n, f in joint_input.source.factors.items() if abs(f) != 1.0} | set(joint_input.source.offsets)
        recorded = {n: (low / scale, high / scale) for n, (low, high) in ranges.items() if n not in mapped}
        if not recorded:
            continue
        guess = guess_angle_unit(recorded, {n: limits[n] for n in recorded})
        topic = f"topic {printable(joint_input.topic)}"
        if guess.doubt:
            yield Diagnostic(
                f"{topic}: {guess.doubt} Convert them, or map them to rad by `scale` and `offset`", "no_angles"
            )
        elif guess.unit == "deg" and not joint_input.degrees:
            yield Diagnostic(f'{topic}: {guess.reason}; say unit = "deg" if these are degrees', "angle_unit")
        elif guess.unit == "rad" and joint_input.source.unit == "deg" and not _is_glove(route) and _moves(recorded):
            text = f'{topic}: read as degrees, but {guess.reason}; say unit = "rad" if these are radians'
            yield Diagnostic(text, "angle_unit")
        else:
            mirrored = mirrored_joints(ranges, limits)
            if mirrored:
                signs = ", ".join(f"{printable(n)} = -1" for n in mirrored[:MAX_NAMES])
                more = ", …" if len(mirrored) > MAX_NAMES else ""
                yield Diagnostic(
                    f"{topic}: {join_names(mirrored, MAX_NAMES)} would be within their limits with the opposite sign: "
                    f"sign = {{ {signs}{more} }}",
                    "angle_sign",
                )


def space_warnings(source: PreparedLog, log_pass: LogPass) -> Iterator[str]:
    """Warnings if the up axis or unit of the poses differs from the scene's, by `guess_space`."""
    table = source.world.facts.recording
    stated = set(table.stated)
    motions = [m for r in log_pass.poses if (m := r.samples.motion()) is not None]
    names = [n for p in source.plan.poses for n in (p.topic, p.child, p.channels[0].schema_name)]
    guess = guess_space(motions, names)
    if guess.unit_reason and "unit" not in stated and (guess.is_unit_certain or not stated):
        text = f'{guess.unit_reason}; say unit = "{guess.unit}" in [recording] if these are {UNIT_NAMES[guess.unit]}'
        yield Diagnostic(text, "position_unit")
    elif table.unit != "m" and motions:
        farthest = max(abs(v) for m in motions for v in (*m.low, *m.high))
        if 0 < farthest < MIN_EXTENT:
            yield Diagnostic(
                f"poses are read in {table.unit}, and never more than {1000 * farthest:.3g} mm from the origin: "
                'say unit = "m" in [recording] if these are metres',
                "position_unit",
            )
    if guess.up_reason and not stated & {"up", "orientation", "rpy"} and (guess.is_up_certain or not stated - {"unit"}):
        yield Diagnostic(f'{guess.up_reason}; say up = "y" in [recording] if y is up there', "up_axis")


def _moves(recorded: dict[str, tuple[float, float]]) -> bool:
    """Whether there is anything to judge: a hand that lies still is of either unit."""
    return any(max(-low, high) > 0.0 for low, high in recorded.values()) and all(
        max(-low, high) <= math.pi for low, high in recorded.values()
    )


def _is_glove(route: JointRoute) -> bool:
    """Whether the messages are of a type that has degrees, however little the hand moves."""
    kind = kind_of(route.input.channels[0])
    return kind is not None and kind.content == "glove"


def _angle_ranges(
    source: PreparedLog, log_pass: LogPass, route: JointRoute
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Ranges [rad] of revolute joints, and their limits; of objects only joints with limits."""
    world = source.world
    driven = world.scene.trees.role[route.input.source.tree] == DRIVEN
    ranges, limits = {}, {}
    for c in (*map(int, route.columns), *route.constants):
        limit = (float(log_pass.lower[c]), float(log_pass.upper[c]))
        if (
            log_pass.prismatic[c]
            or log_pass.min_angles[c] > log_pass.max_angles[c]
            or not (driven or is_informative(limit))
        ):
            continue
        ranges[world.dof_names[c]] = (float(log_pass.min_angles[c]), float(log_pass.max_angles[c]))
        limits[world.dof_names[c]] = limit
    return ranges, limits
