"""The space a log was recorded in: which axis is up, and the unit of its positions, judged by where things were.

Nothing in a log of poses says either, so what people do has to: hands and bodies are above the floor, move by decimetres to
metres, at decimetres a second. A wrong guess is worse than none: what may well be in metres with z up is taken so.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np

from geomphys.recording.name_words import words
from geomphys.scene.recording_tables import RecordingTable

Corner = tuple[float, float, float]
LengthUnit = Literal["m", "cm", "mm"]

METRES: dict[LengthUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}
"""Unit of length -> metres."""

SAMPLES = 1024
"""Positions of a pose that are kept, at most."""
PLAUSIBLE_SPEED = 2.0
"""m/s; people's hands and bodies do not go faster on the average."""
PLAUSIBLE_EXTENT = 5.0
"""m; a recording in which nothing leaves this distance from the origin, at plausible speeds, is in metres."""
FAR = 50.0
"""m; positions further from the origin are suspicious by themselves."""
FEW = 20
"""Positions of a pose from which on its speed tells something."""
ABOVE = 0.05
"""m; what stays this far on one side of 0 is above a floor, what goes this far beyond it is not."""
TALL = 0.5
"""m; least height at which the hands and bodies of people who sit or stand are recorded."""

_PRIORS = {"m": 0.0, "cm": -3.0, "mm": -1.0}
_Y_UP = {"optitrack", "motive", "natnet", "openxr", "unity", "steamvr", "openvr", "oculus", "quest"}
"""Words of systems in which y is up."""


class PoseMotion(NamedTuple):
    """Where a pose was, as recorded: rare outliers do not count."""

    low: Corner
    high: Corner
    speed: float  # mean, per second; 0 if it is not known
    samples: int
    frame: str = ""  # that it is given in; "" where none is named


class SpaceGuess(NamedTuple):
    """The space of a log. A reason is "" where there is nothing to say: z is up, lengths are metres."""

    up: Literal["y", "z"] = "z"
    up_reason: str = ""
    up_sure: bool = True  # else it is only a suggestion
    unit: LengthUnit = "m"
    unit_reason: str = ""
    unit_sure: bool = True

    @property
    def table(self) -> RecordingTable:
        """What a scene file says of this space, without what is only suggested."""
        up = self.up if self.up_sure else "z"
        return RecordingTable(up=up, unit=self.unit if self.unit_sure else "m")


@dataclass
class MotionSamples:
    """Positions of one pose over time, evenly thinned out so that memory stays bounded."""

    times: list[int] = field(default_factory=list)
    places: list[Corner] = field(default_factory=list)
    frame: str = ""
    _stride: int = 1
    _skip: int = 0

    def take(self, time: int, x: float, y: float, z: float) -> None:
        """Take in a position at a time [ns]."""
        if self._skip:
            self._skip -= 1
            return
        self._skip = self._stride - 1
        self.times.append(time)
        self.places.append((x, y, z))
        if len(self.times) >= SAMPLES:
            del self.times[1::2], self.places[1::2]
            self._stride *= 2

    def motion(self) -> PoseMotion | None:
        """Sum up; None without a sample."""
        if not self.times:
            return None
        places, times = np.array(self.places), np.array(self.times, dtype=np.float64) / 1e9
        if len(places) >= 50:
            low, high = np.percentile(places, (2, 98), axis=0)
        else:
            low, high = places.min(axis=0), places.max(axis=0)
        step, spent = np.linalg.norm(np.diff(places, axis=0), axis=1), np.diff(times)
        speeds = np.sort(step[spent > 0] / spent[spent > 0])
        cut = len(speeds) // 20
        speed = float(speeds[: len(speeds) - cut].mean()) if len(speeds) else 0.0
        a, b, c = low.tolist()
        d, e, f = high.tolist()
        return PoseMotion((a, b, c), (d, e, f), speed, len(places), self.frame)


def guess_space(motions: Sequence[PoseMotion], names: Iterable[str]) -> SpaceGuess:
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
    unit, unit_reason, unit_sure = _unit(motions)
    up, up_reason, up_sure = _up(motions, METRES[unit], {w for n in names for w in words(n)})
    return SpaceGuess(up, up_reason, up_sure and unit_sure, unit, unit_reason, unit_sure)


def _unit(motions: Sequence[PoseMotion]) -> tuple[LengthUnit, str, bool]:
    """The unit of lengths, what speaks for it, and whether that is beyond doubt."""
    extent = max(b - a for m in motions for a, b in zip(m.low, m.high, strict=True))
    farthest = max(abs(v) for m in motions for v in (*m.low, *m.high))
    speed = max(m.speed for m in motions)
    if speed <= PLAUSIBLE_SPEED and (speed > 0 or farthest < FAR):
        return "m", "", True
    if farthest < FAR and max(m.samples for m in motions) < FEW:
        return "m", "", True
    if farthest <= PLAUSIBLE_EXTENT and speed <= 5 * PLAUSIBLE_SPEED:
        return "m", "", True
    ranked = sorted(METRES, key=lambda unit: -_likelihood(unit, extent, farthest, speed))
    best, second = (_likelihood(u, extent, farthest, speed) for u in ranked[:2])
    if ranked[0] == "m" or best - _likelihood("m", extent, farthest, speed) < 2.0:
        return "m", "", True
    reason = f"poses are up to {farthest:.4g} from the origin"
    reason += f" and move at {speed:.3g} a second" if speed > 0 else ""
    return ranked[0], reason, best - second >= 2.0 and speed > 0


def _likelihood(unit: LengthUnit, extent: float, farthest: float, speed: float) -> float:
    """Log likelihood, but for a constant, of recorded lengths and speeds in a unit."""
    total = _PRIORS[unit]
    for value, usual, less, more in ((extent, 0.5, 10.0, 4.0), (farthest, 1.0, 3.0, 3.0), (speed, 0.3, 10.0, 4.0)):
        if value > 1e-9:
            ratio = math.log(value * METRES[unit] / usual)
            total -= 0.5 * (ratio / math.log(less if ratio < 0 else more)) ** 2
    return total


def _up(motions: Sequence[PoseMotion], metres: float, named: set[str]) -> tuple[Literal["y", "z"], str, bool]:
    """The axis that is up, what speaks for y, and whether that is beyond doubt."""
    low = [metres * min(m.low[i] for m in motions) for i in range(3)]
    high = [metres * max(m.high[i] for m in motions) for i in range(3)]
    system = sorted(named & _Y_UP)
    if low[1] <= ABOVE or low[2] > ABOVE:
        return "z", "", True
    below = low[2] < -ABOVE
    over_origin = low[1] >= TALL and max(map(abs, (low[0], high[0], low[2], high[2]))) <= 0.35 * low[1]
    if not (below or over_origin):
        return "z", "", True
    reason = f"y stays between {low[1]:.3g} and {high[1]:.3g} m"
    reason += f", z goes down to {low[2]:.3g} m" if below else ", x and z near 0"
    if system:
        return "y", f"{reason}; {system[0]} has y up", True
    ranges = [high[i] - low[i] for i in range(3)]
    standing = below and low[1] >= TALL and high[1] <= 2.6
    return "y", reason, standing and (len(motions) > 1 or ranges[1] < 0.5 * max(ranges[0], ranges[2]))
