"""Runs the benchmark in one process: experiments, penetration depths, scaling curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from geomphys.bench.depths import RecordedPairs, compare_depths, random_pairs
from geomphys.bench.experiments import GRIPS, experiment_files, load_experiment
from geomphys.bench.machine import compile_seconds, describe_machine, kernels_are_compiled
from geomphys.bench.measure import PeerMaker, measure
from geomphys.bench.report import BatchTime, Curve, DepthResult, ExperimentResult, ProcessTime, Report
from geomphys.bench.scaling import BALLS, BOXES, HANDS, OBJECTS, PIECES, curves, warm_up
from geomphys.bench.whole import time_batches, time_process
from geomphys.config import Config
from geomphys.errors import ConfigError, InputError
from geomphys.storage.child_process import available_cores

WHOLE = "gallery"
"""The experiment of which whole processes and batches are timed."""


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """What a benchmark measures, and how often."""

    peers: bool = False
    """MuJoCo, coal and FCL too, alternating with the step."""
    depths: bool = True
    """Penetration depths of pairs."""
    scaling: bool = True
    """Made-up scenes of growing size."""
    compiling: bool = False
    """Compilation from nothing."""
    whole: bool = False
    """Whole processes of the gallery's replay, and batches of clips cut from it with one job and with one a processor."""
    clips: int = 100
    """Clips of 5 s in a batch."""
    repeats: int = 3
    """How often each is run; the smallest time counts."""

    def __post_init__(self) -> None:
        """Raise ConfigError for what cannot be run."""
        if self.repeats < 1:
            raise ConfigError(f"repeats = {self.repeats}: must be at least 1")


def run_bench(
    folder: Path | None = None,
    *,
    only: Sequence[str] = (),
    options: BenchOptions | None = None,
    config: Config | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> Report:
    """Measure frame times of the recorded experiments, penetration depths, and how times grow with the scene.

    Parameters
    ----------
    folder
        Holds `recordings` and `assets`; None: the checkout that holds the package.
    only
        Names of experiments, see `geomphys.bench.experiments.NAMES`; empty: all that are there.
    options
        What is measured, and how often; None: the defaults.
    config
        Parameters of the replays; None: the defaults.
    progress
        Called after each part with the number of parts done and of all.

    Raises
    ------
    ConfigError
        An unknown name, or a peer that is not installed.
    InputError
        No experiment is there, or its files are wrong.
    """
    config, options = config or Config(), options or BenchOptions()
    depths, whole, repeats = options.depths, options.whole, options.repeats
    found = experiment_files(folder, only)
    available = [source for source in found if source.exists]
    if not available:
        raise InputError(f"{found[0].log}: no such recording; name the folder that holds recordings/ and assets/")
    engines = _mujoco() if options.peers else ()
    parts = (
        len(available)
        + (1 if depths else 0)
        + (sum(map(len, (OBJECTS, HANDS, PIECES, BALLS, BOXES))) if options.scaling else 0)
    )
    whole_files = experiment_files(folder, [WHOLE])[0]
    if whole and not whole_files.exists:
        raise InputError(f"{whole_files.log}: no such recording; --whole needs it")
    jobs = tuple(dict.fromkeys((1, available_cores())))
    parts += 2 + len(jobs) if whole else 0
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, parts)

    machine = describe_machine()
    were_cached = kernels_are_compiled()
    ready = warm_up()
    experiments: list[ExperimentResult] = []
    recorded_pairs = []
    for source in available:
        pairs = RecordedPairs(source.name)
        experiment = load_experiment(source, config)
        has_chains = bool(
            experiment.world.scene.trees.chains.any()
        )  # a rigid hand in the other engine would not be comparable
        applicable = engines[1:2] if has_chains else engines[:2]
        if source.name in GRIPS:
            applicable = engines[2:]
        experiments.append(measure(experiment, config, repeats, applicable, pairs if depths else None))
        recorded_pairs.append(pairs.pairs())
        report()
    compared: list[DepthResult] = []
    if depths:
        sets = [*random_pairs(config.seed), *(pairs for pairs in recorded_pairs if pairs is not None)]
        compared = [compare_depths(pairs, repeats, options.peers) for pairs in sets]
        report()
    scaling_curves: list[Curve] = list(curves(config, repeats, engines[:1], report)) if options.scaling else []
    processes: list[ProcessTime] = []
    batches: list[BatchTime] = []
    if whole:
        for rrd in (False, True):
            processes.append(time_process(whole_files, repeats, rrd=rrd))
            report()
        batches = time_batches(whole_files, options.clips, jobs, report)
    return Report(
        machine=machine,
        kernels_were_cached=were_cached,
        ready_s=ready,
        compile_s=compile_seconds() if options.compiling else None,
        repeats=repeats,
        experiments=tuple(experiments),
        missing=tuple(source.name for source in found if not source.exists),
        depths=tuple(compared),
        curves=tuple(scaling_curves),
        processes=tuple(processes),
        batches=tuple(batches),
    )


def _mujoco() -> tuple[PeerMaker, PeerMaker, PeerMaker]:
    """The peers for frame times, with rigid, with jointed, and with yielding hands; raises ConfigError if it is not installed."""
    from geomphys.bench.mujoco_grip import MujocoGripPeer
    from geomphys.bench.mujoco_peer import MujocoPeer
    from geomphys.bench.mujoco_scene import load_mujoco

    load_mujoco()
    return MujocoPeer.rigid, MujocoPeer.jointed, MujocoGripPeer
