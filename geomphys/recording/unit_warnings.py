"""What is told of the units of a recording that was read: angles and positions that look as if they were in another one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from geomphys.recording.angle_units import guess_unit, is_telling, mirrored_joints
from geomphys.recording.channels import kind_of
from geomphys.recording.diagnostics import Diagnostic
from geomphys.recording.display_names import listed, plain
from geomphys.recording.space_guess import guess_space
from geomphys.scene.arrays import DRIVEN

if TYPE_CHECKING:
    from geomphys.recording.frames import FrameSource, Run
    from geomphys.recording.routes import JointRoute

TOLD = 8  # names told in a warning
TINY = 0.02  # m; a recording that stays closer to its origin was read in too small a unit
UNIT_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}


def angle_warnings(source: FrameSource, run: Run) -> Iterator[str]:
    """One line for each topic whose angles are of another unit or sign than the scene says, by `guess_unit`."""
    for route in run.joints:
        ranges, limits = _ranges(source, run, route)
        i = route.input
        scale = math.pi / 180.0 if i.degrees else 1.0
        mapped = {n for n, f in i.source.factors.items() if abs(f) != 1.0} | set(i.source.offsets)
        recorded = {n: (low / scale, high / scale) for n, (low, high) in ranges.items() if n not in mapped}
        if not recorded:
            continue
        guess = guess_unit(recorded, {n: limits[n] for n in recorded})
        topic = f"topic {plain(i.topic)}"
        if guess.doubt:
            yield Diagnostic(
                f"{topic}: {guess.doubt} Convert them, or map them to rad by `scale` and `offset`", "no_angles"
            )
        elif guess.unit == "deg" and not i.degrees:
            yield Diagnostic(f'{topic}: {guess.reason}; say unit = "deg" if these are degrees', "angle_unit")
        elif guess.unit == "rad" and i.source.unit == "deg" and not _is_glove(route) and _moves(recorded):
            text = f'{topic}: read as degrees, but {guess.reason}; say unit = "rad" if these are radians'
            yield Diagnostic(text, "angle_unit")
        else:
            mirrored = mirrored_joints(ranges, limits)
            if mirrored:
                signs = ", ".join(f"{plain(n)} = -1" for n in mirrored[:TOLD])
                more = ", …" if len(mirrored) > TOLD else ""
                yield Diagnostic(
                    f"{topic}: {listed(mirrored, TOLD)} would be within their limits with the opposite sign: "
                    f"sign = {{ {signs}{more} }}",
                    "angle_sign",
                )


def space_warnings(source: FrameSource, run: Run) -> Iterator[str]:
    """One line each if the space of the poses looks like another one than the scene says, by `guess_space`."""
    table = source.world.file.recording
    stated = table.model_fields_set
    motions = [m for r in run.roots if (m := r.samples.motion()) is not None]
    names = [n for p in source.plan.poses for n in (p.topic, p.child, p.channels[0].schema_name)]
    guess = guess_space(motions, names)
    if guess.unit_reason and "unit" not in stated and (guess.unit_sure or not stated):
        text = f'{guess.unit_reason}; say unit = "{guess.unit}" in [recording] if these are {UNIT_NAMES[guess.unit]}'
        yield Diagnostic(text, "position_unit")
    elif table.unit != "m" and motions:
        farthest = max(abs(v) for m in motions for v in (*m.low, *m.high))
        if 0 < farthest < TINY:
            yield Diagnostic(
                f"poses are read in {table.unit}, and never more than {1000 * farthest:.3g} mm from the origin: "
                'say unit = "m" in [recording] if these are metres',
                "position_unit",
            )
    if guess.up_reason and not stated & {"up", "orientation", "rpy"} and (guess.up_sure or not stated - {"unit"}):
        yield Diagnostic(f'{guess.up_reason}; say up = "y" in [recording] if y is up there', "up_axis")


def _moves(recorded: dict[str, tuple[float, float]]) -> bool:
    """Whether there is anything to judge: a hand that lies still is of either unit."""
    return any(max(-low, high) > 0.0 for low, high in recorded.values()) and all(
        max(-low, high) <= math.pi for low, high in recorded.values()
    )


def _is_glove(route: JointRoute) -> bool:
    """Whether the messages are of a type that has degrees, however little the hand moves."""
    kind = kind_of(route.input.channels[0])
    return kind is not None and kind.what == "glove"


def _ranges(
    source: FrameSource, run: Run, route: JointRoute
) -> tuple[dict[str, tuple[float, float]], dict[str, tuple[float, float]]]:
    """Angles [rad] that joints that turn had, and their limits; of objects without limits a wheel may turn for ever."""
    world = source.world
    driven = world.scene.trees.role[route.input.source.tree] == DRIVEN
    ranges, limits = {}, {}
    for c in (*map(int, route.columns), *route.constants):
        limit = (float(run.lower[c]), float(run.upper[c]))
        if run.prismatic[c] or run.least[c] > run.most[c] or not (driven or is_telling(limit)):
            continue
        ranges[world.dof_names[c]] = (float(run.least[c]), float(run.most[c]))
        limits[world.dof_names[c]] = limit
    return ranges, limits
