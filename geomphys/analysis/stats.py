"""Statistics of one or more outputs: percentiles of penetration, correction, speeds, jerks and stage times."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.analysis.metric_values import Distribution, MetricValues, distribution
from geomphys.analysis.output_motion import OutputMotion, OutputMotionMeter
from geomphys.errors import LogError
from geomphys.numerics.motion_rates import MotionMeter
from geomphys.numerics.quantiles import Quantiles
from geomphys.output.output_log import OutputFrame, open_output
from geomphys.output.summary import FLAG_NAMES, RESIDUAL_LIMIT_M
from geomphys.output.worst_moments import WorstMoments
from geomphys.results import Moment
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOTIONS = ("recorded", "corrected", "correction")


@dataclass(frozen=True, kw_only=True)
class OutputStatistics:
    """Statistics of an output, or of all together, in SI units.

    `values` holds, over frames: ``recorded_penetration_m``, ``correction_m``, ``correction_rad``, ``shape_change_rad``,
    ``contact_precision_m`` and ``contact_alignment_rad`` where they are above 0, ``amplification`` of the frames recorded
    deeper than 0.5 mm, ``fingertip_error_m`` of all frames and ``fingertip_error_in_contact_m`` of those with recorded
    contacts of fingertips, ``contacts`` of the frames in contact, ``residual_penetration_m`` and ``iterations`` of all; and
    of the fastest driven body of a frame ``recorded_speed_m_s``, ``corrected_speed_m_s``, ``correction_speed_m_s`` (of the
    offset between the two) and the same three as ``…_jerk_m_s3``. `stages` holds ns by stage.
    """

    name: str
    complete: bool
    frames: int
    duration_s: float
    frames_in_contact: int
    frames_penetrating: int
    frames_with_residual: int
    impacts: int
    fallbacks: int
    held_frames: int
    flags: dict[str, int]
    values: dict[str, Distribution]
    stages: dict[str, Distribution]
    motion: OutputMotion | None
    """Measures of the whole motion; None of several outputs together."""
    worst: tuple[Moment, ...]
    """The moments to look at first; none of several outputs together."""


@dataclass(frozen=True, kw_only=True)
class Statistics:
    """Statistics of each output, and of all together."""

    outputs: tuple[OutputStatistics, ...]
    all: OutputStatistics

    def as_dict(self) -> dict[str, Any]:
        """Everything by name, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)


def statistics_of(
    outputs: Sequence[AnyPath | str], *, progress: Callable[[int, int | None], None] | None = None
) -> Statistics:
    """Read outputs and return their figures; memory does not grow with their length.

    Parameters
    ----------
    outputs : sequence of Path or str
        Output logs, at least one.
    progress : callable, optional
        Called with the frames read and their number.

    Raises
    ------
    LogError
        A file is no output, is damaged, or has no frame.
    ValueError
        `outputs` is empty.
    """
    if not outputs:
        raise ValueError("statistics of no output at all")
    logs = [open_output(path) for path in outputs]
    total, done = sum(log.frame_count for log in logs), 0
    combined = _OutputTotals()
    found: list[OutputStatistics] = []
    for log in logs:
        series = _OutputTotals() if len(logs) > 1 else combined
        rates_of, motion, worst = _MotionRates(), OutputMotionMeter(log), WorstMoments()
        for frame in log.frames(["/tf", "/recorded/tf", "/metrics", "/penetration", "/timing"]):
            rates = rates_of.add(frame)
            motion.add(frame)
            worst.add_output(frame)
            series.add(frame, rates)
            if series is not combined:
                combined.add(frame, rates)
            done += 1
            if progress is not None:
                progress(done, total)
        if series.frames == 0:
            raise LogError(f"{log.path}: holds no frame")
        duration = (log.end_ns - log.start_ns) / 1e9
        series.duration_s = duration
        if series is not combined:
            combined.duration_s += duration
        found.append(
            series.statistics(str(log.path), log.complete, motion.motion(), worst.moments(log.intersection_volume_m3))
        )
    return Statistics(outputs=tuple(found), all=combined.statistics("all", all(o.complete for o in found)))


class _MotionRates:
    """Speeds and jerks of the driven bodies from one frame to the next."""

    def __init__(self) -> None:
        self._meter = MotionMeter()
        self._layout: tuple[tuple[str, ...], tuple[str, ...], Ints] | None = None

    def add(self, frame: OutputFrame) -> dict[str, float]:
        """Take a frame; name -> value of the body that has the largest."""
        names = (frame.recorded.names, frame.tf.names)
        if self._layout is None or self._layout[:2] != names:
            rows = [frame.tf.names.index(name.removeprefix("recorded/")) for name in frame.recorded.names]
            self._layout = (*names, np.array(rows, np.int64))
        recorded, corrected = frame.recorded.values[:, :3], frame.tf.values[self._layout[2], :3]
        positions = np.stack([recorded, corrected, corrected - recorded])
        speeds, jerks = self._meter.add(np.array([frame.time_ns], np.int64), positions[None])
        found = dict(zip((f"{name}_speed_m_s" for name in _MOTIONS), speeds[0].tolist(), strict=True))
        found |= zip((f"{name}_jerk_m_s3" for name in _MOTIONS), jerks[0].tolist(), strict=True)
        return {name: value for name, value in found.items() if not math.isnan(value)}


@dataclass
class _OutputTotals:
    """Totals accumulated over one output, or over all."""

    frames: int = 0
    duration_s: float = 0.0
    _in_contact: int = 0
    _penetrating: int = 0
    _residual: int = 0
    _impacts: int = 0
    _fallbacks: int = 0
    _held: int = 0
    _flags: dict[int, int] = field(default_factory=dict)
    _metrics: MetricValues = field(default_factory=MetricValues)
    _rates: dict[str, Quantiles] = field(default_factory=dict)
    _stages: dict[str, Quantiles] = field(default_factory=dict)

    def add(self, frame: OutputFrame, rates: dict[str, float]) -> None:
        metrics = frame.metrics
        self.frames += 1
        self._in_contact += metrics["contacts"] > 0
        self._penetrating += metrics["recorded_penetration_m"] > RESIDUAL_LIMIT_M
        self._residual += metrics["residual_penetration_m"] > RESIDUAL_LIMIT_M
        self._impacts += int(metrics["impacts"])
        self._fallbacks += int(metrics["fallbacks"])
        self._held += bool(metrics["held"])
        flags = int(metrics["flags"])
        for bit in FLAG_NAMES:
            if flags & bit:
                self._flags[bit] = self._flags.get(bit, 0) + 1
        self._metrics.add(metrics)
        for name, value in rates.items():
            self._add_value(self._rates, name, value)
        for stage in frame.timing:
            self._add_value(self._stages, stage.name, float(stage.ns))

    def statistics(
        self, name: str, complete: bool, motion: OutputMotion | None = None, worst: tuple[Moment, ...] = ()
    ) -> OutputStatistics:
        motions = [f"{motion}_{unit}" for unit in ("speed_m_s", "jerk_m_s3") for motion in _MOTIONS]
        return OutputStatistics(
            name=name,
            complete=complete,
            frames=self.frames,
            duration_s=self.duration_s,
            frames_in_contact=self._in_contact,
            frames_penetrating=self._penetrating,
            frames_with_residual=self._residual,
            impacts=self._impacts,
            fallbacks=self._fallbacks,
            held_frames=self._held,
            flags={FLAG_NAMES[bit]: self._flags[bit] for bit in FLAG_NAMES if bit in self._flags},
            values={
                **self._metrics.distributions(),
                **{key: distribution(self._rates.get(key, Quantiles(1))) for key in motions},
            },
            stages={key: distribution(values) for key, values in self._stages.items()},
            motion=motion,
            worst=worst,
        )

    @staticmethod
    def _add_value(series: dict[str, Quantiles], name: str, value: float) -> None:
        if name not in series:
            series[name] = Quantiles()
        series[name].add(value)
