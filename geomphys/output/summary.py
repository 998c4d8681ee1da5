"""Summary statistics of a replay, accumulated frame by frame in bounded memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.engine.log_messages import is_of_flag
from geomphys.numerics.quantiles import Quantiles
from geomphys.results import (
    FLAG_BEFORE_FIRST,
    FLAG_BLOCKED,
    FLAG_CATCHING_UP,
    FLAG_CLAMPED,
    FLAG_HELD,
    FLAG_IMPACT_BOUND,
    FLAG_NOT_CONVERGED,
    FLAG_OUTSIDE_LIMITS,
    FLAG_QUARANTINED,
    FLAG_SHAPE_CHANGED,
    FLAG_STARTED_INSIDE,
    FLAG_SWEEP_BOUND,
    FLAG_TABLE_FULL,
    FrameResult,
    Grasp,
    Moment,
    ResultColumns,
)
from geomphys.scene.findings import Findings
from geomphys.storage.remote_files import AnyPath

RESIDUAL_LIMIT_M = 1e-5
"""A driven body that overlaps by no more than this is free (m)."""

MAX_MESSAGES = 100
"""Number of different messages stored; further ones are only counted."""

_COUNTED = ("contacts_recorded", "contacts_kept", "grasps_recorded", "grasps_kept")

FLAG_NAMES = {
    FLAG_HELD: "held",
    FLAG_BEFORE_FIRST: "before_first",
    FLAG_CLAMPED: "clamped",
    FLAG_OUTSIDE_LIMITS: "outside_limits",
    FLAG_NOT_CONVERGED: "not_converged",
    FLAG_IMPACT_BOUND: "impact_bound",
    FLAG_QUARANTINED: "quarantined",
    FLAG_BLOCKED: "blocked",
    FLAG_STARTED_INSIDE: "started_inside",
    FLAG_SHAPE_CHANGED: "shape_changed",
    FLAG_CATCHING_UP: "catching_up",
    FLAG_SWEEP_BOUND: "sweep_bound",
    FLAG_TABLE_FULL: "table_full",
}
"""Name of each bit of `Metrics.flags`."""


@dataclass(frozen=True, kw_only=True)
class DeepestPenetration:
    """The frame and pair of bodies with the deepest recorded penetration."""

    frame: int
    body_a: str
    body_b: str
    depth_m: float


@dataclass(frozen=True, kw_only=True)
class Message:
    """A message of a replay: its text, number of occurrences and first frame."""

    level: str  # "info", "warning" or "error"
    text: str
    first_frame: int
    count: int


@dataclass(frozen=True, kw_only=True)
class StageTime:
    """Times of one stage: per frame the mean, percentiles and the largest, and the sum (ns)."""

    mean_ns: float
    median_ns: float
    p95_ns: float
    p99_ns: float
    max_ns: float
    total_ns: float


@dataclass(frozen=True, kw_only=True)
class MotionSummary:
    """Measures of motion quality over the frames of a replay; see the fields of the same names in `Metrics`."""

    amplification_median: float  # over the frames recorded at least 0.5 mm deep; 0 if there is none
    amplification_p95: float
    contacts_recorded: int  # of fingertips, over all frames
    contacts_kept: int
    grasps_recorded: int
    grasps_kept: int
    fingertip_error_mean_m: float  # over the frames with recorded contacts; 0 if there is none
    shape_change_max_rad: float
    shape_change_frames: int  # in which a tree in rigid mode yielded in its shape or orientation


@dataclass(frozen=True, kw_only=True)
class Summary:
    """Summary of a replay, in SI units. Frames are counted from 0; depths are >= 0, 0 without overlap."""

    log: str
    scene: str
    out: str | None
    rrd: str | None
    method: str  # "exact" or "paper", as in `Config`
    frames: int
    start_s: float  # time of the first frame
    duration_s: float  # from the first frame to the last
    contacts: int  # contact points of all frames
    frames_in_contact: int  # with a contact point
    frames_penetrating: int  # the recording overlapped by more than RESIDUAL_LIMIT_M
    recorded_penetration_max_m: float  # of driven bodies as recorded, the deepest convex pair
    recorded_penetration_median_m: float  # over the frames that penetrate
    deepest: DeepestPenetration | None  # where that was; None without overlap
    residual_penetration_max_m: float  # the same, measured on the corrected poses
    residual_penetration_frame: int | None  # where it is largest; None if it is 0 everywhere
    frames_with_residual: int  # more than RESIDUAL_LIMIT_M
    correction_max_m: float  # largest distance of a body's origin from where it was recorded
    correction_max_rad: float  # largest angle of a body from how it was recorded
    quality: MotionSummary  # measures of motion quality
    held_frames: int  # in which a stream had no good sample, and its last good value was used
    impacts: int  # of simulated bodies
    fallbacks: int  # corrections that fell back on the last free state
    flags: dict[str, int]  # name of a flag: frames that carry it; only flags that occurred
    timing: dict[str, StageTime]  # the stages `decode`, `step`, `encode`, as far as they were measured
    elapsed_s: float  # on the wall clock, reading and writing included, compiling the kernels not
    messages: tuple[Message, ...]  # of `/log`, each text once
    worst: tuple[Moment, ...]  # where to look first
    grasps: tuple[Grasp, ...]  # outcomes of simulated bodies that driven ones touched
    findings: Findings  # of the scene: geometry not shown, bodies without contact, renamed bodies, defaults
    messages_dropped: int  # messages beyond the first MAX_MESSAGES different texts

    @property
    def warnings(self) -> tuple[Message, ...]:
        """Messages of level warning or error."""
        return tuple(message for message in self.messages if message.level != "info")

    @property
    def information(self) -> tuple[Message, ...]:
        """Messages of level info that repeat neither a flag nor a grasp, such as the transforms that were applied."""
        grasped = tuple(f"{grasp.body}: " for grasp in self.grasps)
        return tuple(
            m for m in self.messages if m.level == "info" and not is_of_flag(m.text) and not m.text.startswith(grasped)
        )

    def as_dict(self) -> dict[str, Any]:
        """Every figure by name, nested, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)


@dataclass
class Summarizer:
    """Accumulates a `Summary` over the frames of a replay; memory does not grow with their number.

    `body_names` and `findings` are those of the world that is replayed, `method` that of the configuration.
    """

    body_names: tuple[str, ...]
    findings: Findings = field(default_factory=Findings)
    method: str = "exact"
    frames: int = 0
    _first_ns: int = 0
    _earliest_ns: int = 0
    _latest_ns: int = 0
    _contacts: int = 0
    _frames_in_contact: int = 0
    _recorded: Quantiles = field(default_factory=Quantiles)
    _deepest: DeepestPenetration | None = None
    _residual: float = 0.0
    _residual_frame: int | None = None
    _frames_with_residual: int = 0
    _correction_m: float = 0.0
    _correction_rad: float = 0.0
    _amplification: Quantiles = field(default_factory=Quantiles)
    _fingertip_error: Quantiles = field(default_factory=Quantiles)
    _counts: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_COUNTED, 0))
    _shape_change: float = 0.0
    _shape_change_frames: int = 0
    _worst: tuple[Moment, ...] = ()
    _grasps: tuple[Grasp, ...] = ()
    _held: int = 0
    _impacts: int = 0
    _fallbacks: int = 0
    _flags: dict[int, int] = field(default_factory=dict)
    _stages: dict[str, Quantiles] = field(default_factory=dict)
    _messages: dict[tuple[str, str], tuple[int, int]] = field(default_factory=dict)
    _messages_dropped: int = 0

    def add(self, result: FrameResult) -> None:
        """Count one more frame."""
        self.add_columns(ResultColumns.of(result))

    def add_columns(self, columns: ResultColumns) -> None:
        """Count n more frames."""
        metrics, times = columns.metrics, columns.times_ns
        if self.frames == 0:
            self._first_ns = self._earliest_ns = self._latest_ns = int(times[0])
        self._earliest_ns = min(self._earliest_ns, int(times.min()))
        self._latest_ns = max(self._latest_ns, int(times.max()))
        self.frames += len(columns)
        self._contacts += int(metrics["contacts"].sum())
        self._frames_in_contact += int(np.count_nonzero(metrics["contacts"]))
        self._held += int(np.count_nonzero(metrics["held"]))
        self._impacts += int(metrics["impacts"].sum())
        self._fallbacks += int(metrics["fallbacks"].sum())
        self._correction_m = max(self._correction_m, float(metrics["correction_m"].max()))
        self._correction_rad = max(self._correction_rad, float(metrics["correction_rad"].max()))
        self._add_quality(metrics)
        for moments in columns.moments.values():
            self._worst = moments or self._worst
        for grasps in columns.grasps.values():
            self._grasps = grasps or self._grasps
        self._add_depths(columns)
        flags = metrics["flags"]
        if flags.any():
            for bit in FLAG_NAMES:
                if count := int(np.count_nonzero(flags & bit)):
                    self._flags[bit] = self._flags.get(bit, 0) + count
        for stage, ns in zip(columns.stages, columns.stage_ns.T, strict=True):
            if "." not in stage:
                self._stages.setdefault(stage, Quantiles()).add_all(ns.astype(np.float64))
        for row, messages in sorted(columns.messages.items()):
            for level, text in messages:
                self.add_message(level, text, columns.frames[row].index)

    def _add_quality(self, metrics: Mapping[str, NDArray[Any]]) -> None:
        """Count the measures of motion quality."""
        amplification = metrics["amplification"]
        self._amplification.add_all(amplification[amplification > 0.0])
        self._fingertip_error.add_all(metrics["fingertip_error_m"][metrics["contacts_recorded"] != 0])
        for name in _COUNTED:
            self._counts[name] += int(metrics[name].sum())
        self._shape_change = max(self._shape_change, float(metrics["shape_change_rad"].max()))
        self._shape_change_frames += int(np.count_nonzero(metrics["flags"] & FLAG_SHAPE_CHANGED))

    def _add_depths(self, columns: ResultColumns) -> None:
        """Count the depths recorded and left, and update the deepest pair of bodies."""
        recorded, residual = columns.metrics["recorded_penetration_m"], columns.metrics["residual_penetration_m"]
        self._recorded.add_all(recorded[recorded > RESIDUAL_LIMIT_M])
        row = int(residual.argmax())
        if residual[row] > self._residual:
            self._residual = float(residual[row])
            self._residual_frame = columns.frames[row].index
        self._frames_with_residual += int(np.count_nonzero(residual > RESIDUAL_LIMIT_M))
        pairs = columns.penetrations
        if len(pairs.largest) == 0:
            return
        pair = int(pairs.largest.argmax())
        depth = float(pairs.largest[pair])
        if self._deepest is None or depth > self._deepest.depth_m:
            row = int(np.searchsorted(columns.penetration_end, pair, side="right")) - 1
            self._deepest = DeepestPenetration(
                frame=columns.frames[row].index,
                body_a=self.body_names[int(pairs.body_a[pair])],
                body_b=self.body_names[int(pairs.body_b[pair])],
                depth_m=depth,
            )

    def add_message(self, level: str, text: str, frame: int) -> None:
        """Count a message; a text that came before only counts up."""
        key = (level, text)
        if key in self._messages:
            first, count = self._messages[key]
            self._messages[key] = (first, count + 1)
        elif len(self._messages) < MAX_MESSAGES:
            self._messages[key] = (frame, 1)
        else:
            self._messages_dropped += 1

    def summary(
        self,
        *,
        log: AnyPath,
        scene: AnyPath,
        out: AnyPath | None = None,
        rrd: AnyPath | None = None,
        elapsed_s: float = 0.0,
    ) -> Summary:
        """Return the summary so far, with the paths of the files and the elapsed time [s]."""
        return Summary(
            log=str(log),
            scene=str(scene),
            out=None if out is None else str(out),
            rrd=None if rrd is None else str(rrd),
            method=self.method,
            frames=self.frames,
            start_s=self._first_ns / 1e9,
            duration_s=(self._latest_ns - self._earliest_ns) / 1e9,
            contacts=self._contacts,
            frames_in_contact=self._frames_in_contact,
            frames_penetrating=self._recorded.count,
            recorded_penetration_max_m=self._recorded.largest,
            recorded_penetration_median_m=self._recorded.median(),
            deepest=self._deepest,
            residual_penetration_max_m=self._residual,
            residual_penetration_frame=self._residual_frame,
            frames_with_residual=self._frames_with_residual,
            correction_max_m=self._correction_m,
            correction_max_rad=self._correction_rad,
            quality=MotionSummary(
                amplification_median=self._amplification.median(),
                amplification_p95=self._amplification.quantile(0.95),
                **self._counts,
                fingertip_error_mean_m=self._fingertip_error.total / max(self._fingertip_error.count, 1),
                shape_change_max_rad=self._shape_change,
                shape_change_frames=self._shape_change_frames,
            ),
            held_frames=self._held,
            impacts=self._impacts,
            fallbacks=self._fallbacks,
            flags={FLAG_NAMES[bit]: self._flags[bit] for bit in FLAG_NAMES if bit in self._flags},
            timing={
                name: StageTime(
                    mean_ns=times.total / max(times.count, 1),
                    median_ns=times.median(),
                    p95_ns=times.quantile(0.95),
                    p99_ns=times.quantile(0.99),
                    max_ns=times.largest,
                    total_ns=times.total,
                )
                for name, times in sorted(self._stages.items())
            },
            elapsed_s=elapsed_s,
            messages=tuple(
                Message(level=level, text=text, first_frame=first, count=count)
                for (level, text), (first, count) in self._messages.items()
            ),
            worst=self._worst,
            grasps=self._grasps,
            findings=self.findings,
            messages_dropped=self._messages_dropped,
        )
