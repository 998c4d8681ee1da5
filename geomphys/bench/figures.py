"""Figures of a benchmark: times as percentiles, and what is reported of an experiment, a pair depth and a curve."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.machine import Machine

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Figures:
    """A series in figures, in the unit of its name; all 0 for an empty one."""

    count: int
    mean: float
    median: float
    p95: float
    p99: float
    max: float


def figures_of(values: Floats) -> Figures:
    """Figures of a series (n,)."""
    if len(values) == 0:
        return Figures(count=0, mean=0.0, median=0.0, p95=0.0, p99=0.0, max=0.0)
    median, p95, p99 = (float(v) for v in np.percentile(values, [50, 95, 99]))
    return Figures(
        count=len(values), mean=float(np.mean(values)), median=median, p95=p95, p99=p99, max=float(np.max(values))
    )


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the frames of an experiment."""

    name: str  # dotted call path
    ns: Figures  # a frame
    count: float  # of what the stage counts (bodies, overlapping pairs, rounds, impacts, contacts), mean a frame


@dataclass(frozen=True, kw_only=True)
class PeerFrames:
    """What another engine did with the same frames."""

    engine: str
    ns: Figures  # a frame
    steps_a_frame: float
    residual_m: (
        Figures  # deepest overlap of a driven body that it left in a frame, by its own contacts on its final poses
    )
    warnings: int  # that the engine gave: unstable, out of memory
    ratio_median: float  # ours over its
    ratio_p99: float
    ratio_call: float  # our mean processor time over its mean


@dataclass(frozen=True, kw_only=True)
class ExperimentFigures:
    """One experiment: `step` is the sum of the stages below it, without decoding and sinks."""

    name: str
    scene: str
    frames: int
    hertz: float
    trees: int
    pieces: int
    vertices: int
    driven_pieces: int
    step: Figures  # ns a frame, by the clock inside the step
    stages: tuple[Stage, ...]
    call_ns: float  # processor time of the calls that step, mean a frame
    result_ns: float  # wall time of taking the results apart, mean a frame
    contacts: float  # mean a frame
    recorded_m: float  # deepest overlap as recorded
    residual_m: Figures  # left, a frame
    peers: tuple[PeerFrames, ...]


@dataclass(frozen=True, kw_only=True)
class DepthEngine:
    """Penetration depths by one engine."""

    engine: str
    ns: Figures  # a pair, means over blocks of pairs
    ratio: float  # the compiled loop's median over this one's; 1 for itself
    missed: int  # overlapping pairs it reports no contact for
    deviation: Figures  # of its depth, relative to the exact one
    residual_m: Figures  # overlap left once A is moved along its normal by its depth; by `judge`
    judge: str


@dataclass(frozen=True, kw_only=True)
class DepthFigures:
    """Penetration depths of a set of overlapping pairs."""

    name: str
    pairs: int
    engines: tuple[DepthEngine, ...]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Frame times over the size of a scene."""

    name: str
    variable: str
    sizes: tuple[int, ...]
    points: tuple[ExperimentFigures, ...]
    growth: float  # median step of the largest over that of the smallest


@dataclass(frozen=True, kw_only=True)
class Report:
    """All of a benchmark. SI units but for times, which are ns where the name says so."""

    machine: Machine
    kernels_were_cached: bool
    ready_s: float  # until the first frame was done: loading the kernels, or compiling them if they were not cached
    compile_s: float | None  # with an empty cache, in a process of its own; None: not measured
    repeats: int
    experiments: tuple[ExperimentFigures, ...]
    missing: tuple[str, ...]  # experiments whose files are not there
    depths: tuple[DepthFigures, ...]
    curves: tuple[Curve, ...]

    def as_dict(self) -> dict[str, Any]:
        """All figures by name."""
        return dataclasses.asdict(self)
