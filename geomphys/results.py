"""Records of frames: the recorded input and the corrected result, shared by all stages, sinks and callers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_T = TypeVar("_T")

METHODS = ("global", "least_distance", "interpolated")


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame of the recording, on the frame clock."""

    index: int
    time_ns: int
    roots: Floats  # (T, 7) world pose of every tree's root as recorded (rest pose where no topic moves it)
    angles: Floats  # (Q,) rad or m as recorded
    held: bool  # a stream has no good sample at this frame: its last good value is used
    flags: int = 0  # bits of `FLAG_*`


FLAG_HELD = 1  # a stream had no good sample: its last good value is used
FLAG_BEFORE_FIRST = 2  # a stream has not begun yet: its first value is used
FLAG_CLAMPED = 4  # an angle was clamped to its limit (`clamp_limits`)
FLAG_OUTSIDE_LIMITS = 8  # a recorded angle lies outside its limits and was kept
FLAG_NOT_CONVERGED = 16  # no free pose was found within the bounds of the search: an overlap may remain
FLAG_IMPACT_BOUND = 32  # the simulated loop reached its limit of impacts
FLAG_QUARANTINED = 64  # a body became non-finite and was reset to its last good state
FLAG_BLOCKED = 128  # the recorded pose is free, but the path to it is obstructed
FLAG_STARTED_INSIDE = 256  # the first frame overlapped
FLAG_SHAPE_CHANGED = 512  # mode rigid: shape or rotation changed too: a translation would go too far, or off a grip
FLAG_CATCHING_UP = 1024  # after a gap or a jump of a tracker, the way missed is made up at a bounded speed
FLAG_SWEEP_BOUND = 2048  # contact forces of driven and simulated bodies ended at their bound of sweeps, not converged
FLAG_TABLE_FULL = 4096  # pairs, contact points or rows of the solvers found their table full and were left out


class Contacts(NamedTuple):
    """n contact points of a frame, world frame. Bodies are indices into `World.body_names`."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    point: Floats  # (n, 3) m
    normal: Floats  # (n, 3) unit, out of b into a
    depth: Floats  # (n,) m, how far the correction moved the point; for simulated bodies the overlap
    normal_impulse: Floats  # (n,) N s
    tangential_impulse: Floats  # (n,) N s


class Penetrations(NamedTuple):
    """n pairs of objects (trees or avatar links) whose recorded poses overlapped in a frame."""

    body_a: Ints  # (n,)
    body_b: Ints  # (n,)
    pd: Floats  # (n, 3) m, PD_g of (1): displacement of body_a that ends the overlap
    convex_pairs: Ints  # (n,) overlapping pairs of convex pieces
    largest: Floats  # (n,) m, of the deepest convex pair
    method: Ints  # (n,) index into METHODS


class Metrics(NamedTuple):
    """Metrics of a frame; the fields of geomphys.FrameMetrics."""

    contacts: int
    recorded_penetration_m: float
    residual_penetration_m: float
    iterations: int
    impacts: int
    fallbacks: int
    correction_m: float  # largest distance of a body's origin from its recorded position
    correction_rad: float  # largest angle of a body from its recorded orientation
    held: bool
    flags: int
    recorded_speed_m_s: float  # largest of the driven bodies, since the frame before; 0 in the first
    correction_speed_m_s: float  # the same of the offset from the recorded positions
    recorded_jerk_m_s3: float  # third derivatives over the last four frames; 0 in the first three
    correction_jerk_m_s3: float
    shape_change_rad: (
        float  # largest rotation of a link of a tree in rigid mode from its recorded one; 0 if only translated
    )
    amplification: (
        float  # largest offset of a driven link over the recorded depth; 0 in frames recorded less than 0.5 mm deep
    )
    contacts_recorded: int  # fingertips recorded within 2 mm of something of another tree, or inside
    contacts_kept: int  # of these, those that are within 1 mm, or no farther than recorded
    grasps_recorded: int  # hands whose thumb and another finger were recorded in contact
    grasps_kept: int  # of these, those where both still are
    fingertip_error_m: (
        float  # mean distance of fingertips recorded in contact from where they were recorded; of all if none was
    )
    contact_precision_m: float  # mean distance of the points of kept contacts on the other thing from the recorded ones
    contact_alignment_rad: float  # mean angle of the normals of kept contacts from the recorded ones


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A frame of a replay that is worth a look."""

    kind: str  # recorded_penetration | correction | amplification | contacts_lost | fallbacks
    frame: int
    time_ns: int
    time_s: float  # since the first frame
    bodies: tuple[str, ...]  # the pair that overlapped most, or the body that was corrected most
    value: float
    unit: str  # "m", or "" of a ratio or a number
    volume_m3: float | None = None  # of the deepest recorded overlap: volume common to the two bodies, if it is known


HELD_FOR = 0.2  # s: a body supported by driven ones alone for so long is held
LIFTED_BY = 0.01  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class Grasp:
    """Outcome of a simulated object that driven bodies touched. Forces are means over a frame."""

    body: str
    touched_s: float  # how long driven bodies pressed it
    held_s: float  # how long they alone carried it; 0: touched but not held
    lifted_m: float  # how far against gravity while it was held, at most
    dropped: int  # how often it was released in the air
    grip_force_n: float  # median of the sum of normal forces while it was held, else while it was touched
    margin: float
    """Least share of available over needed friction while it was held, but for the last 0.2 s before it was released; inf where
    none was needed."""

    @property
    def outcome(self) -> str:
        """One of dropped, lifted, held, touched."""
        if self.dropped:
            return "dropped"
        if self.held_s < HELD_FOR:
            return "touched"
        return "lifted" if self.lifted_m > LIFTED_BY else "held"


@dataclass(frozen=True, slots=True)
class FrameResult:
    """A corrected frame. No other frame has its arrays: they stay as they are when the next is computed."""

    frame: Frame
    recorded: Floats  # (B, 7) world pose of every body as recorded
    corrected: Floats  # (B, 7) world pose of every body
    angles: Floats  # (Q,) corrected joint values
    contacts: Contacts
    penetrations: Penetrations
    metrics: Metrics
    timing: tuple[tuple[str, int, int], ...]  # (dotted stage name, ns, count)
    messages: tuple[tuple[str, str], ...] = ()  # (level: "info" | "warning" | "error", text)
    moments: tuple[Moment, ...] = ()  # with the last frame: the worst moments of the replay
    grasps: tuple[Grasp, ...] = ()  # with the last frame: outcomes of the simulated bodies that driven ones touched


@dataclass(frozen=True, kw_only=True)
class ResultColumns:
    """The results of n frames in a row, as columns; `result` makes the record of one. No other frames have their arrays."""

    frames: Sequence[Frame]  # (n,)
    recorded: Floats  # (n, B, 7) world pose of every body as recorded
    corrected: Floats  # (n, B, 7) world pose of every body
    angles: Floats  # (n, Q) corrected joint values
    contacts: Contacts  # of all frames, one after another
    contact_end: Ints  # (n + 1,) rows of `contacts` up to each frame; [0] is 0
    penetrations: Penetrations  # of all frames, one after another
    penetration_end: Ints  # (n + 1,)
    metrics: Mapping[str, NDArray[Any]]  # field of `Metrics` -> (n,)
    stages: tuple[str, ...]  # s dotted names
    stage_ns: Ints  # (n, s)
    stage_counts: Ints  # (n, s)
    messages: Mapping[int, tuple[tuple[str, str], ...]]  # row -> (level, text)
    moments: Mapping[int, tuple[Moment, ...]]  # row -> the worst moments of the replay
    grasps: Mapping[int, tuple[Grasp, ...]]  # row -> outcomes

    def __len__(self) -> int:
        return len(self.frames)

    @cached_property
    def times_ns(self) -> Ints:
        """Times (n,)."""
        return np.array([frame.time_ns for frame in self.frames], np.int64)

    @cached_property
    def indices(self) -> Ints:
        """Numbers (n,) of the frames."""
        return np.array([frame.index for frame in self.frames], np.int64)

    @property
    def contact_counts(self) -> Ints:
        """Contacts (n,) of each frame."""
        return np.diff(self.contact_end)

    @property
    def penetration_counts(self) -> Ints:
        """Penetrations (n,) of each frame."""
        return np.diff(self.penetration_end)

    @cached_property
    def _metrics(self) -> list[Metrics]:
        return [Metrics(*row) for row in zip(*(self.metrics[name].tolist() for name in Metrics._fields), strict=True)]

    @cached_property
    def _results(self) -> dict[int, FrameResult]:
        return {}

    def result(self, row: int) -> FrameResult:
        """The record of a frame, the same whenever it is asked for; its arrays are views of the columns."""
        if row not in self._results:
            self._results[row] = self._make_result(row)
        return self._results[row]

    def _make_result(self, row: int) -> FrameResult:
        touching = slice(*self.contact_end[row : row + 2].tolist())
        overlapping = slice(*self.penetration_end[row : row + 2].tolist())
        stages = zip(self.stages, self.stage_ns[row].tolist(), self.stage_counts[row].tolist(), strict=True)
        return FrameResult(
            frame=self.frames[row],
            recorded=self.recorded[row],
            corrected=self.corrected[row],
            angles=self.angles[row],
            contacts=Contacts._make(column[touching] for column in self.contacts),
            penetrations=Penetrations._make(column[overlapping] for column in self.penetrations),
            metrics=self._metrics[row],
            timing=tuple(stages),
            messages=self.messages.get(row, ()),
            moments=self.moments.get(row, ()),
            grasps=self.grasps.get(row, ()),
        )

    def rows(self, start: int, stop: int) -> ResultColumns:
        """The frames of some rows, as views."""
        if (start, stop) == (0, len(self)):
            return self
        rows = slice(start, stop)
        contacts, pairs = self.contact_end[start : stop + 1], self.penetration_end[start : stop + 1]
        return ResultColumns(
            frames=self.frames[rows],
            recorded=self.recorded[rows],
            corrected=self.corrected[rows],
            angles=self.angles[rows],
            contacts=Contacts._make(column[contacts[0] : contacts[-1]] for column in self.contacts),
            contact_end=contacts - contacts[0],
            penetrations=Penetrations._make(column[pairs[0] : pairs[-1]] for column in self.penetrations),
            penetration_end=pairs - pairs[0],
            metrics={name: column[rows] for name, column in self.metrics.items()},
            stages=self.stages,
            stage_ns=self.stage_ns[rows],
            stage_counts=self.stage_counts[rows],
            messages=_of_rows(self.messages, start, stop),
            moments=_of_rows(self.moments, start, stop),
            grasps=_of_rows(self.grasps, start, stop),
        )

    @staticmethod
    def joined(parts: Sequence[ResultColumns]) -> ResultColumns:
        """The frames of parts one after another. Parts that have a stage have the same stages."""
        if len(parts) == 1:
            return parts[0]
        starts = [0, *accumulate(len(part) for part in parts)]
        return ResultColumns(
            frames=[frame for part in parts for frame in part.frames],
            recorded=np.concatenate([part.recorded for part in parts]),
            corrected=np.concatenate([part.corrected for part in parts]),
            angles=np.concatenate([part.angles for part in parts]),
            contacts=Contacts._make(map(np.concatenate, zip(*(part.contacts for part in parts), strict=True))),
            contact_end=_ends(np.concatenate([part.contact_counts for part in parts])),
            penetrations=Penetrations._make(
                map(np.concatenate, zip(*(part.penetrations for part in parts), strict=True))
            ),
            penetration_end=_ends(np.concatenate([part.penetration_counts for part in parts])),
            metrics={name: np.concatenate([part.metrics[name] for part in parts]) for name in Metrics._fields},
            stages=parts[0].stages,
            stage_ns=np.concatenate([part.stage_ns for part in parts]),
            stage_counts=np.concatenate([part.stage_counts for part in parts]),
            messages=_shifted([part.messages for part in parts], starts),
            moments=_shifted([part.moments for part in parts], starts),
            grasps=_shifted([part.grasps for part in parts], starts),
        )

    @staticmethod
    def of(result: FrameResult) -> ResultColumns:
        """The columns of one frame."""
        values = zip(Metrics._fields, result.metrics, strict=True)
        return ResultColumns(
            frames=(result.frame,),
            recorded=result.recorded[None],
            corrected=result.corrected[None],
            angles=result.angles[None],
            contacts=result.contacts,
            contact_end=np.array([0, len(result.contacts.depth)], np.int64),
            penetrations=result.penetrations,
            penetration_end=np.array([0, len(result.penetrations.largest)], np.int64),
            metrics={name: np.array([value]) for name, value in values},
            stages=tuple(name for name, _, _ in result.timing),
            stage_ns=np.array([[ns for _, ns, _ in result.timing]], np.int64),
            stage_counts=np.array([[count for _, _, count in result.timing]], np.int64),
            messages={0: result.messages} if result.messages else {},
            moments={0: result.moments} if result.moments else {},
            grasps={0: result.grasps} if result.grasps else {},
        )


def _ends(counts: Ints) -> Ints:
    """Ends (n + 1,) of stretches of so many rows (n,); [0] is 0."""
    return np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])


def _of_rows(values: Mapping[int, _T], start: int, stop: int) -> dict[int, _T]:
    return {row - start: value for row, value in values.items() if start <= row < stop}


def _shifted(parts: Sequence[Mapping[int, _T]], starts: Sequence[int]) -> dict[int, _T]:
    return {start + row: value for part, start in zip(parts, starts, strict=False) for row, value in part.items()}
