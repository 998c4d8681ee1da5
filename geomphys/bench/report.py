"""Records of a benchmark's results: distributions, experiments, penetration depths and scaling curves."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.machine import Machine

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """Distribution of a series, in the unit of the field that holds it; all 0 for an empty series."""

    count: int
    mean: float
    median: float
    p95: float
    p99: float
    max: float


def distribution_of(values: Floats) -> Distribution:
    """Distribution of a series (n,)."""
    if len(values) == 0:
        return Distribution(count=0, mean=0.0, median=0.0, p95=0.0, p99=0.0, max=0.0)
    median, p95, p99 = (float(v) for v in np.percentile(values, [50, 95, 99]))
    return Distribution(
        count=len(values), mean=float(np.mean(values)), median=median, p95=p95, p99=p99, max=float(np.max(values))
    )


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage of the frames of an experiment."""

    name: str  # dotted call path
    ns: Distribution  # a frame
    count: float  # of what the stage counts (bodies, overlapping pairs, rounds, impacts, contacts), mean a frame


@dataclass(frozen=True, kw_only=True)
class Fidelity:
    """How near fingertips stay to the recording: mean distance of a frame's from where they were recorded."""

    touching_m: Distribution  # of fingertips recorded in contact, in frames that have such
    free_m: Distribution  # of all fingertips, in the other frames
    retained: float | None  # share of the recorded contacts of fingertips that are kept; None without any


@dataclass(frozen=True, kw_only=True)
class PeerResult:
    """The same frames by another engine."""

    engine: str
    ns: Distribution  # a frame
    steps_a_frame: float
    residual_m: (
        Distribution  # deepest overlap of a driven body that it left in a frame, by its own contacts on its final poses
    )
    fidelity: Fidelity
    warnings: int  # of the engine: unstable, out of memory
    ratio_mean: float  # ours over its
    ratio_median: float
    ratio_p99: float
    ratio_max: float
    ratio_call: float  # our mean processor time, over its mean


@dataclass(frozen=True, kw_only=True)
class ExperimentResult:
    """One experiment: `step` is the sum of the stages below it, without decoding and sinks."""

    name: str
    scene: str
    frames: int
    hertz: float
    trees: int
    pieces: int
    vertices: int
    driven_pieces: int
    step: Distribution  # ns a frame, by the clock inside the step
    stages: tuple[Stage, ...]
    call_ns: float  # processor time of the calls that step, mean a frame
    result_ns: float  # wall time of making the result objects, mean a frame
    contacts: float  # mean a frame
    recorded_m: float  # deepest overlap as recorded
    residual_m: Distribution  # left, a frame
    fidelity: Fidelity
    peers: tuple[PeerResult, ...]


@dataclass(frozen=True, kw_only=True)
class DepthEngine:
    """Penetration depths by one engine."""

    engine: str
    ns: Distribution  # a pair, means over blocks of pairs
    ratio: float  # the compiled loop's median over this one's; 1 for itself
    missed: int  # overlapping pairs it reports no contact for
    deviation: Distribution  # of its depth, relative to the exact one
    residual_m: Distribution  # overlap left once A is moved along its normal by its depth; by `judge`
    judge: str


@dataclass(frozen=True, kw_only=True)
class DepthResult:
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
    points: tuple[ExperimentResult, ...]
    growth: float  # median step of the largest over that of the smallest


@dataclass(frozen=True, kw_only=True)
class Share:
    """What a part of a process took."""

    name: str  # starting, importing, reading, computing, writing
    seconds: float


@dataclass(frozen=True, kw_only=True)
class ProcessTime:
    """A whole replay, from the command line to its files on disk."""

    name: str
    frames: int
    recorded_s: float
    wall_s: float
    cpu_s: float
    shares: tuple[Share, ...]  # of `wall_s`

    @property
    def real_time_ratio(self) -> float:
        """Seconds of the recording in a second."""
        return self.recorded_s / self.wall_s


@dataclass(frozen=True, kw_only=True)
class BatchTime:
    """A whole batch."""

    clips: int
    jobs: int
    recorded_s: float
    wall_s: float
    cpu_s: float

    @property
    def real_time_ratio(self) -> float:
        """Seconds of the recordings in a second of a job."""
        return self.recorded_s / self.wall_s / self.jobs


@dataclass(frozen=True, kw_only=True)
class Report:
    """All results of a benchmark, in SI units except for times whose names say ns."""

    machine: Machine
    kernels_were_cached: bool
    ready_s: float  # until the first frame was done: loading the kernels, or compiling them if they were not cached
    compile_s: float | None  # with an empty cache, in a process of its own; None: not measured
    repeats: int
    experiments: tuple[ExperimentResult, ...]
    missing: tuple[str, ...]  # experiments whose files are not there
    depths: tuple[DepthResult, ...]
    curves: tuple[Curve, ...]
    processes: tuple[ProcessTime, ...]
    batches: tuple[BatchTime, ...]

    def as_dict(self) -> dict[str, Any]:
        """All fields by name, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)
