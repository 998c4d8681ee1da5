"""Guesses the up axis and the length unit of recorded poses from their extents and speeds.

A log states neither, so typical human motion is the prior: hands and bodies are above the floor, move over decimetres to
metres, at decimetres per second. A wrong guess is worse than none: what is plausible in metres with z up is taken as such.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.numerics.even_samples import EvenSamples
from geomphys.recording.name_words import words
from geomphys.scene.scene_facts import RecordingFacts, facts_of_recording

Corner = tuple[float, float, float]
LengthUnit = Literal["m", "cm", "mm"]

METRES_PER_UNIT: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Unit of length -> metres."""

SAMPLES = 1024
"""Fewer positions of a pose are sampled."""
PLAUSIBLE_SPEED = 2.0
"""m/s; people's hands and bodies do not go faster on the average."""
PLAUSIBLE_DISTANCE = 5.0
"""m; a recording in which nothing leaves this distance from the origin, at plausible speeds, is in metres."""
SUSPICIOUS_DISTANCE = 50.0
"""m; positions further from the origin are suspicious by themselves."""
MIN_SPEED_SAMPLES = 20
"""Least number of positions for a meaningful speed."""
FLOOR_MARGIN = 0.05
"""m; tolerance for positions below the floor at 0."""
MIN_BODY_HEIGHT = 0.5
"""m; least height of hands and bodies of people who sit or stand."""

_PRIORS = {"m": 0.0, "cm": -3.0, "mm": -1.0}
_Y_UP_WORDS = {"optitrack", "motive", "natnet", "openxr", "unity", "steamvr", "openvr", "oculus", "quest"}
"""Words of systems in which y is up."""


class PoseExtent(NamedTuple):
    """Where a pose was, as recorded: rare outliers do not count."""

    low: Corner
    high: Corner
    speed: float  # mean, per second; 0 if it is not known
    samples: int
    frame: str = ""  # that it is given in; "" where none is named


class SpaceGuess(NamedTuple):
    """The space of a log. A reason is "" for the defaults: z up, metres."""

    up: Literal["y", "z"] = "z"
    up_reason: str = ""
    is_up_certain: bool = True  # else it is only a suggestion
    unit: LengthUnit = "m"
    unit_reason: str = ""
    is_unit_certain: bool = True

    @property
    def table(self) -> RecordingFacts:
        """The `[recording]` table of this space, without uncertain guesses."""
        from geomphys.scene.recording_tables import RecordingTable

        up = self.up if self.is_up_certain else "z"
        return facts_of_recording(RecordingTable(up=up, unit=self.unit if self.is_unit_certain else "m"))


@dataclass
class MotionSamples:
    """Positions of one pose over time, evenly thinned out so that memory stays bounded."""

    samples: EvenSamples[tuple[int, Corner]] = field(default_factory=lambda: EvenSamples(SAMPLES))  # ns, position
    frame: str = ""

    def add(self, time: int, x: float, y: float, z: float) -> None:
        """Add a position at a time [ns]."""
        self.samples.offer((time, (x, y, z)))

    def extend(self, times: Sequence[int], positions: NDArray[np.float64]) -> None:
        """Add positions (n, 3) at times [ns]."""
        self.samples.extend([(time, (x, y, z)) for time, (x, y, z) in zip(times, positions.tolist(), strict=True)])

    def motion(self) -> PoseExtent | None:
        """Sum up; None without a sample."""
        if not self.samples.items:
            return None
        positions = np.array([position for _, position in self.samples.items])
        times = np.array([time for time, _ in self.samples.items], dtype=np.float64) / 1e9
        ordered, outermost = np.sort(positions, axis=0), len(positions) // 50
        low, high = ordered[outermost], ordered[-1 - outermost]
        distances, durations = np.linalg.norm(np.diff(positions, axis=0), axis=1), np.diff(times)
        speeds = np.sort(distances[durations > 0] / durations[durations > 0])
        outliers = len(speeds) // 20
        speed = float(speeds[: len(speeds) - outliers].mean()) if len(speeds) else 0.0
        a, b, c = low.tolist()
        d, e, f = high.tolist()
        return PoseExtent((a, b, c), (d, e, f), speed, len(positions), self.frame)


def guess_space(motions: Sequence[PoseExtent], names: Iterable[str]) -> SpaceGuess:
    """Judge the space that poses were recorded in.

    Parameters
    ----------
    motions
        Of poses in that space, as recorded.
    names
        What may name the system: topics, frame ids, message types.
    """
    if not motions:
        return SpaceGuess()
    unit, unit_reason, is_unit_certain = _guess_unit(motions)
    up, up_reason, is_up_certain = _guess_up(motions, METRES_PER_UNIT[unit], {w for n in names for w in words(n)})
    return SpaceGuess(up, up_reason, is_up_certain and is_unit_certain, unit, unit_reason, is_unit_certain)


def _guess_unit(motions: Sequence[PoseExtent]) -> tuple[LengthUnit, str, bool]:
    """The length unit, the reason, and whether it is certain."""
    extent = max(b - a for m in motions for a, b in zip(m.low, m.high, strict=True))
    farthest = max(abs(v) for m in motions for v in (*m.low, *m.high))
    speed = max(m.speed for m in motions)
    if speed <= PLAUSIBLE_SPEED and (speed > 0 or farthest < SUSPICIOUS_DISTANCE):
        return "m", "", True
    if farthest < SUSPICIOUS_DISTANCE and max(m.samples for m in motions) < MIN_SPEED_SAMPLES:
        return "m", "", True
    if farthest <= PLAUSIBLE_DISTANCE and speed <= 5 * PLAUSIBLE_SPEED:
        return "m", "", True
    ranked = sorted(METRES_PER_UNIT, key=lambda unit: -_likelihood(unit, extent, farthest, speed))
    best, second = (_likelihood(u, extent, farthest, speed) for u in ranked[:2])
    if ranked[0] == "m" or best - _likelihood("m", extent, farthest, speed) < 2.0:
        return "m", "", True
    reason = f"poses are up to {farthest:.4g} from the origin"
    reason += f" and move at {speed:.3g} a second" if speed > 0 else ""
    return ranked[0], reason, best - second >= 2.0 and speed > 0


def _likelihood(unit: LengthUnit, extent: float, farthest: float, speed: float) -> float:
    """Log likelihood, but for a constant, of recorded lengths and speeds in a unit."""
    total = _PRIORS[unit]
    for value, typical, low_range, high_range in (
        (extent, 0.5, 10.0, 4.0),
        (farthest, 1.0, 3.0, 3.0),
        (speed, 0.3, 10.0, 4.0),
    ):
        if value > 1e-9:
            ratio = math.log(value * METRES_PER_UNIT[unit] / typical)
            total -= 0.5 * (ratio / math.log(low_range if ratio < 0 else high_range)) ** 2
    return total


def _guess_up(motions: Sequence[PoseExtent], metres: float, named: set[str]) -> tuple[Literal["y", "z"], str, bool]:
    """The up axis, the reason for y, and whether it is certain."""
    low = [metres * min(m.low[i] for m in motions) for i in range(3)]
    high = [metres * max(m.high[i] for m in motions) for i in range(3)]
    system = sorted(named & _Y_UP_WORDS)
    if low[1] <= FLOOR_MARGIN or low[2] > FLOOR_MARGIN:
        return "z", "", True
    below = low[2] < -FLOOR_MARGIN
    over_origin = low[1] >= MIN_BODY_HEIGHT and max(map(abs, (low[0], high[0], low[2], high[2]))) <= 0.35 * low[1]
    if not (below or over_origin):
        return "z", "", True
    reason = f"y stays between {low[1]:.3g} and {high[1]:.3g} m"
    reason += f", z goes down to {low[2]:.3g} m" if below else ", x and z near 0"
    if system:
        return "y", f"{reason}; {system[0]} has y up", True
    ranges = [high[i] - low[i] for i in range(3)]
    standing = below and low[1] >= MIN_BODY_HEIGHT and high[1] <= 2.6
    return "y", reason, standing and (len(motions) > 1 or ranges[1] < 0.5 * max(ranges[0], ranges[2]))
