"""The record of a comparison of two outputs, and its JSON form."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Required

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from geomphys.analysis.diff.channels import ChannelDifference, Tolerance, earliest
from geomphys.analysis.diff.measures import Measure, Peak
from geomphys.analysis.metric_values import Distribution
from geomphys.analysis.output_motion import OutputMotion
from geomphys.results import Moment

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Matching:
    """How the frames of two outputs were matched by their times."""

    a: int
    b: int
    compared: int
    only_a: int = 0
    only_b: int = 0
    first_only_a: int | None = None  # as `a` counts
    first_only_b: int | None = None  # as `b` counts
    offset_s: float  # by how much the first frame of `b` is later than that of `a`


@dataclass(frozen=True, kw_only=True)
class Curves:
    """Curves of differences over the compared frames: at most some thousand points, each the maximum of an interval."""

    position_m: tuple[Ints, Floats]  # frames, largest of /tf
    angle_rad: tuple[Ints, Floats]
    joints_rad: tuple[Ints, Floats]
    contacts: tuple[Ints, Floats]  # pairs gained and lost
    penetration_m: tuple[Ints, Floats]


@dataclass(frozen=True, kw_only=True)
class OutputDifference:
    """The comparison of two outputs. Frames are counted as `a` counts them.

    `equal`: every frame has a counterpart of the same time in the other output, and no channel differs by more than the
    tolerance. If no frames match, no channel counts as equal. Parameters, input and scene are reported but do not decide.
    """

    a: str
    b: str
    equal: bool
    tolerance: Tolerance
    frames: Matching
    channels: dict[str, ChannelDifference]
    parameters: dict[str, tuple[str | None, str | None]]  # name -> values of a and b, where they differ
    attachments: tuple[str, ...]  # names of scene file and URDFs that differ
    scene: tuple[str, ...]  # what scene files, URDFs and meshes differ in, in words
    motion: tuple[OutputMotion, OutputMotion] | None
    """Measures of the motions of a and b; None if poses or metrics were not compared."""
    values: tuple[dict[str, Distribution], dict[str, Distribution]] | None
    """Distributions of the measures of frames of a and b by name, as in `OutputStatistics`; None if metrics were not compared."""
    worst: tuple[tuple[Moment, ...], tuple[Moment, ...]]
    """The moments of a and of b to look at first; none if poses or metrics were not compared."""
    curves: Curves
    peaks: tuple[Peak, ...] = field(repr=False)
    """Frames of the largest differences of a position, largest first; each keeps its `PeakPoses`."""

    def as_dict(self) -> dict[str, Any]:
        """The comparison as JSON has it, a `DifferenceRecord`: numbers in SI units, without the curves."""
        return {
            "equal": self.equal,
            "a": self.a,
            "b": self.b,
            "tolerance_m": self.tolerance.m,
            "tolerance_rad": self.tolerance.rad,
            "frames": dataclasses.asdict(self.frames),
            "channels": {name: _channel(channel, self.equal) for name, channel in self.channels.items()},
            "parameters": {name: {"a": a, "b": b} for name, (a, b) in self.parameters.items()},
            "attachments": list(self.attachments),
            "scene": list(self.scene),
            "motion": None if self.motion is None else _sides([dataclasses.asdict(motion) for motion in self.motion]),
            "values": None if self.values is None else _sides([_distributions(values) for values in self.values]),
            "worst": _sides([[_moment(moment) for moment in moments] for moments in self.worst]),
        }


class PartRecord(TypedDict, total=False):
    """A body, joint, pair of bodies or field in JSON; measures of units that it does not have are left out."""

    max_m: float
    rms_m: float
    max_rad: float
    rms_rad: float
    max_Ns: float
    rms_Ns: float
    max: float
    rms: float
    gained: int
    lost: int
    first_frame: Required[int | None]
    worst_frame: Required[int | None]
    frames: Required[int]


class ChannelRecord(TypedDict, total=False):
    """A channel in JSON; its parts are under the name of their kind."""

    equal: Required[bool]
    max_m: float
    rms_m: float
    max_rad: float
    rms_rad: float
    first_frame: Required[int | None]
    gained: int
    lost: int
    only_a: list[str]
    only_b: list[str]
    bodies: dict[str, PartRecord]
    joints: dict[str, PartRecord]
    pairs: dict[str, PartRecord]
    fields: dict[str, PartRecord]


class ParameterRecord(TypedDict):
    """The values of a parameter; null where one has none."""

    a: str | None
    b: str | None


class MotionsRecord(TypedDict):
    """The measures of both motions."""

    a: OutputMotion
    b: OutputMotion


class ValuesRecord(TypedDict):
    """The distributions of the measures of frames by name."""

    a: dict[str, Distribution]
    b: dict[str, Distribution]


class MomentsRecord(TypedDict):
    """The moments to look at first."""

    a: tuple[Moment, ...]
    b: tuple[Moment, ...]


class DifferenceRecord(TypedDict):
    """A comparison in JSON."""

    equal: bool
    a: str
    b: str
    tolerance_m: float
    tolerance_rad: float
    frames: Matching
    channels: dict[str, ChannelRecord]
    parameters: dict[str, ParameterRecord]
    attachments: list[str]
    scene: list[str]
    motion: MotionsRecord | None
    values: ValuesRecord | None
    worst: MomentsRecord


def _moment(moment: Moment) -> dict[str, Any]:
    return dataclasses.asdict(moment) | {"bodies": list(moment.bodies)}


def _distributions(values: dict[str, Distribution]) -> dict[str, Any]:
    return {name: dataclasses.asdict(value) for name, value in values.items()}


def _sides(values: list[Any]) -> dict[str, Any]:
    """The values of a and b."""
    return dict(zip(("a", "b"), values, strict=True))


def _channel(channel: ChannelDifference, brief: bool) -> dict[str, Any]:
    """A channel: overall measures, then those of its parts (`brief`: of those that differ) under the name of their kind."""
    overall: dict[str, Any] = {"equal": channel.equal}
    overall |= _figures(channel.overall_m, "_m") | _figures(channel.overall_rad, "_rad")
    overall["first_frame"] = channel.first_frame
    if channel.kind in ("pairs", "lines"):
        overall["gained"] = sum(sets.gained for sets in channel.sets.values())
        overall["lost"] = sum(sets.lost for sets in channel.sets.values())
    if channel.only_a or channel.only_b:
        overall |= {"only_a": list(channel.only_a), "only_b": list(channel.only_b)}
    if channel.kind != "lines":
        parts = {name: _part(channel, name) for name in channel.parts()}
        shown = {name: part for name, part in parts.items() if part["frames"] or part["first_frame"] is not None}
        overall[channel.kind] = shown if brief else parts
    return overall


def _part(channel: ChannelDifference, name: str) -> dict[str, Any]:
    measures = [(channel.metres.get(name), "_m"), (channel.radians.get(name), "_rad"), (channel.others.get(name), "")]
    if channel.channel == "/contacts":
        measures[2] = (measures[2][0], "_Ns")
    part: dict[str, Any] = {}
    for measure, unit in measures:
        part |= _figures(measure, unit)
    sets = channel.sets.get(name)
    if channel.kind == "pairs":
        part |= {"gained": sets.gained if sets else 0, "lost": sets.lost if sets else 0}
    known = [measure for measure, _ in measures if measure is not None]
    part["first_frame"] = earliest(*(m.first_frame for m in known), sets.first_frame if sets else None)
    part["worst_frame"] = next((m.worst_frame for m in known if m.worst_frame is not None), None)
    part["frames"] = max((m.frames for m in known), default=0)
    return part


def _figures(measure: Measure | None, unit: str) -> dict[str, float]:
    return {} if measure is None else {f"max{unit}": measure.max, f"rms{unit}": measure.rms}
