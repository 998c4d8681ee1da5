"""Times the frames of an experiment: repeated passes through the step, interleaved with other physics engines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from geomphys.bench.experiments import Experiment
from geomphys.bench.fingertip_meter import TipFigures
from geomphys.bench.report import Distribution, ExperimentResult, Fidelity, PeerResult, Stage, distribution_of
from geomphys.config import Config
from geomphys.engine.frame_buffer import FRAMES, Block
from geomphys.engine.pipeline import Pipeline
from geomphys.results import Frame, FrameResult
from geomphys.scene.arrays import DRIVEN
from geomphys.scene.world import World

Floats = NDArray[np.float64]

WARM_UP_FRAMES = 1
"""Frames at the start that are not timed: engines allocate their persistent state in them."""


class PeerFrame(NamedTuple):
    """A frame of a peer."""

    ns: float
    steps: int
    residual: float  # m
    tips: TipFigures


class Peer(Protocol):
    """Another physics engine that holds the same scene and follows the same recording."""

    name: str

    @property
    def warnings(self) -> int:
        """Number of warnings so far."""

    def frame(self, result: FrameResult) -> PeerFrame:
        """Simulate up to the frame's time with the recorded poses of `result` as targets."""


PeerMaker = Callable[[World, FrameResult], Peer]
Collector = Callable[[World, FrameResult], None]


class TimedPipeline(Pipeline):
    """A pipeline that sums the processor time of its calls of the compiled step."""

    busy_ns = 0

    def run(self, roots: Floats, angles: Floats, dts: Floats, block: Block) -> int:
        """Step as `Pipeline` does."""
        start = time.thread_time_ns()
        count = super().run(roots, angles, dts, block)
        self.busy_ns += time.thread_time_ns() - start
        return count


class _PassTotals:
    """Times and totals of one pass over the frames."""

    def __init__(self) -> None:
        self.times: list[tuple[int, ...]] = []
        self.counts: list[tuple[int, ...]] = []
        self.peers: list[list[PeerFrame]] = []
        self.contacts = 0
        self.recorded = 0.0
        self.residual: list[float] = []
        self.tips: list[TipFigures] = []
        self.names: tuple[str, ...] = ()
        self.call_ns = self.result_ns = 0.0
        self.engines: list[str] = []
        self.warnings: list[int] = []


def measure(
    experiment: Experiment,
    config: Config,
    repeats: int,
    peers: Sequence[PeerMaker] = (),
    collect: Collector | None = None,
) -> ExperimentResult:
    """Times of an experiment.

    Every frame is run `repeats` times, each time from the start with a fresh pipeline; as its results are the same to
    the bit, its time is the smallest of them, which is the one least disturbed by others on the machine. A peer runs
    the same frames, alternating with the step in blocks of 64, and its times are measured likewise.

    Parameters
    ----------
    peers
        Make the peers from the world and the first frame.
    collect
        Called with every frame's result in the first pass.

    Raises
    ------
    GeomphysError
        From the pipeline.
    """
    passes = [_run(experiment, config, peers, collect if k == 0 else None) for k in range(repeats)]
    last = passes[-1]
    times = np.min([np.array(p.times, dtype=np.float64) for p in passes], axis=0)[WARM_UP_FRAMES:]
    counts = np.array(last.counts, dtype=np.float64)
    step = distribution_of(times[:, last.names.index("step")])
    stages = [
        Stage(name=name, ns=distribution_of(times[:, k]), count=float(np.mean(counts[:, k])))
        for k, name in enumerate(last.names)
        if name.startswith("step")
    ]
    if len(experiment.decode_ns):
        stages.insert(0, Stage(name="decode", ns=distribution_of(experiment.decode_ns), count=1.0))
    scene, frames = experiment.world.scene, experiment.frames
    span = (frames[-1].time_ns - frames[0].time_ns) * 1e-9
    return ExperimentResult(
        name=experiment.name,
        scene=experiment.world.facts.name,
        frames=len(frames),
        hertz=(len(frames) - 1) / span if span > 0 else 0.0,
        trees=len(scene.trees.role),
        pieces=len(scene.pieces.kind),
        vertices=len(scene.pieces.vertices),
        driven_pieces=int(np.sum(scene.bodies.role[scene.pieces.body] == DRIVEN)),
        step=step,
        stages=tuple(stages),
        call_ns=min(p.call_ns for p in passes),
        result_ns=min(p.result_ns for p in passes),
        contacts=last.contacts / len(frames),
        recorded_m=last.recorded,
        residual_m=distribution_of(np.array(last.residual)),
        fidelity=_fidelity(last.tips),
        peers=tuple(_peer_figures(passes, k, step) for k in range(len(peers))),
    )


def _fidelity(tips: Sequence[TipFigures]) -> Fidelity:
    """How near fingertips stay to the recording."""
    recorded = sum(frame.recorded for frame in tips)
    return Fidelity(
        touching_m=distribution_of(np.array([frame.error_m for frame in tips if frame.recorded])),
        free_m=distribution_of(np.array([frame.error_m for frame in tips if not frame.recorded])),
        retained=sum(frame.retained for frame in tips) / recorded if recorded else None,
    )


def _peer_figures(passes: Sequence[_PassTotals], k: int, step: Distribution) -> PeerResult:
    """Figures of the k-th peer's frames beside ours [ns]."""
    ns = distribution_of(np.min([[f.ns for f in p.peers[k]] for p in passes], axis=0))
    last = passes[-1]
    return PeerResult(
        engine=last.engines[k],
        ns=ns,
        steps_a_frame=float(np.mean([f.steps for f in last.peers[k]])),
        residual_m=distribution_of(np.array([f.residual for f in last.peers[k]])),
        fidelity=_fidelity([f.tips for f in last.peers[k]]),
        warnings=last.warnings[k],
        ratio_mean=step.mean / ns.mean,
        ratio_median=step.median / ns.median,
        ratio_p99=step.p99 / ns.p99,
        ratio_max=step.max / ns.max,
        ratio_call=min(p.call_ns for p in passes) / ns.mean,
    )


def _run(experiment: Experiment, config: Config, makers: Sequence[PeerMaker], collect: Collector | None) -> _PassTotals:
    """One pass over the frames."""
    done = _PassTotals()
    peers: list[Peer] = []
    pipeline = TimedPipeline(experiment.world, config)
    for chunk in pipeline.chunks(_batches(experiment.frames)):
        start = time.perf_counter_ns()
        columns = pipeline.results(chunk)
        done.result_ns += time.perf_counter_ns() - start
        results = [columns.result(row) for row in range(len(columns))]
        for result in results:
            _record_result(done, result)
            if collect is not None:
                collect(experiment.world, result)
        if not peers:
            peers = [make(experiment.world, results[0]) for make in makers]
            done.peers = [[] for _ in peers]
            results = results[WARM_UP_FRAMES:]
        for frames, peer in zip(done.peers, peers, strict=True):
            frames += [peer.frame(result) for result in results]
    done.engines, done.warnings = [peer.name for peer in peers], [peer.warnings for peer in peers]
    done.call_ns = pipeline.busy_ns / len(experiment.frames)
    done.result_ns /= len(experiment.frames)
    return done


def _record_result(done: _PassTotals, result: FrameResult) -> None:
    """Add a frame's times and metrics to the totals of its pass."""
    done.names = tuple(name for name, _, _ in result.timing)
    done.times.append(tuple(ns for _, ns, _ in result.timing))
    done.counts.append(tuple(count for _, _, count in result.timing))
    done.contacts += result.metrics.contacts
    done.recorded = max(done.recorded, result.metrics.recorded_penetration_m)
    done.residual.append(result.metrics.residual_penetration_m)
    metrics = result.metrics
    done.tips.append(TipFigures(metrics.contacts_recorded, metrics.contacts_kept, metrics.fingertip_error_m))


def _batches(frames: Sequence[Frame]) -> Iterator[tuple[list[Frame], int]]:
    for first in range(0, len(frames), FRAMES):
        yield list(frames[first : first + FRAMES]), 0
