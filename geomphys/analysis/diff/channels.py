"""The protocol of channel comparers, the tolerance they take and the record they return."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

from geomphys.analysis.diff.measures import Measure
from geomphys.output.output_log import OutputFrame


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Differences up to these bounds count as equal.

    With both 0 everything has to be equal. With one above 0 only lengths, angles and the presence of frames, bodies and
    joints decide; pairs gained and lost, counts, flags, impulses and texts are reported but do not decide, as the frame
    of a first contact may depend on rounding.
    """

    m: float = 0.0
    rad: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether everything has to be equal."""
        return self.m == 0.0 and self.rad == 0.0


@dataclass(frozen=True, kw_only=True)
class SetDifference:
    """Elements present in only one output: counts over all frames."""

    gained: int = 0  # in b alone
    lost: int = 0  # in a alone
    first_frame: int | None = None


@dataclass(frozen=True, kw_only=True)
class ChannelDifference:
    """Result of comparing a channel. Its `parts` are bodies, joints, pairs of bodies or fields.

    `metres`, `radians` and `others` (other units) hold the parts that have differences in that unit.
    """

    channel: str
    kind: str  # "bodies", "joints", "pairs", "fields" or "lines"
    equal: bool
    first_frame: int | None
    metres: dict[str, Measure] = field(default_factory=dict)
    radians: dict[str, Measure] = field(default_factory=dict)
    others: dict[str, Measure] = field(default_factory=dict)
    overall_m: Measure | None = None
    overall_rad: Measure | None = None
    sets: dict[str, SetDifference] = field(default_factory=dict)
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()

    def parts(self) -> tuple[str, ...]:
        """Names of all parts."""
        return tuple(dict.fromkeys([*self.metres, *self.radians, *self.others, *self.sets]))

    def largest_differences(self) -> tuple[str, ...]:
        """Names of the parts that differ, by their best rank among the differences of each unit and the numbers of gained
        and lost elements.
        """
        measures = (self.metres, self.radians, self.others)
        scales = [{name: measure.max for name, measure in group.items() if measure.max > 0.0} for group in measures]
        scales.append({name: float(sets.gained + sets.lost) for name, sets in self.sets.items()})
        index_of: dict[str, int] = {}
        for scale in scales:
            ordered = sorted(set(scale.values()), reverse=True)
            for name, value in scale.items():
                rank = ordered.index(value)
                index_of[name] = min(rank, index_of.get(name, rank))
        return tuple(sorted((name for name in self.parts() if name in index_of), key=lambda name: index_of[name]))


class Channel(Protocol):
    """Compares one channel."""

    def add(self, a: OutputFrame, b: OutputFrame) -> float:
        """Take two frames of the same time; returns the largest difference of a length, m."""

    def result(self) -> ChannelDifference:
        """The result over all frames added."""


def earliest(*frames: int | None) -> int | None:
    """The smallest frame number, ignoring None; None if there is none."""
    return min((frame for frame in frames if frame is not None), default=None)
