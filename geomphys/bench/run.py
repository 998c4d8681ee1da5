"""The benchmark: experiments, penetration depths and curves, one after the other in one process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from geomphys.bench.depths import EncounteredPairs, compare_depths, random_pairs
from geomphys.bench.experiments import experiment_files, load_experiment
from geomphys.bench.figures import Curve, DepthFigures, ExperimentFigures, Report
from geomphys.bench.machine import compile_seconds, describe_machine, kernels_are_compiled
from geomphys.bench.measure import PeerMaker, measure
from geomphys.bench.scaling import HANDS, OBJECTS, PIECES, curves, warm_up
from geomphys.config import Config
from geomphys.errors import ConfigError, InputError

REPEATS = 3


def run_bench(
    folder: Path | None = None,
    *,
    only: Sequence[str] = (),
    peers: bool = False,
    depths: bool = True,
    scaling: bool = True,
    compiling: bool = False,
    repeats: int = REPEATS,
    config: Config | None = None,
    progress: Callable[[int, int | None], None] | None = None,
) -> Report:
    """Measure frame times of the recorded experiments, penetration depths, and how times grow with the scene.

    Parameters
    ----------
    folder
        Holds `recordings` and `assets`; None: the checkout the package stands in.
    only
        Names of experiments, see `geomphys.bench.experiments.NAMES`; empty: all that are there.
    peers
        Also through MuJoCo, coal and FCL, in turn with the step.
    depths, scaling, compiling
        Whether to measure penetration depths of pairs; made-up scenes of growing size; compilation from nothing.
    repeats
        How often each is run; the smallest time counts.
    config
        Parameters of the replays; None: the defaults.
    progress
        Called after each part with the number of parts done and of all.

    Raises
    ------
    ConfigError
        A name that is none, or a peer that is not installed.
    InputError
        No experiment is there, or its files are wrong.
    """
    if repeats < 1:
        raise ConfigError(f"repeats = {repeats}: must be at least 1")
    config = config or Config()
    found = experiment_files(folder, only)
    present = [source for source in found if source.exists]
    if not present:
        wanted = found[0]
        raise InputError(f"{wanted.log}: no such recording; name the folder that holds recordings/ and assets/")
    engines = _mujoco() if peers else ()
    parts = len(present) + (1 if depths else 0) + (len(OBJECTS) + len(HANDS) + len(PIECES) if scaling else 0)
    done = 0

    def report() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, parts)

    machine = describe_machine()
    were_cached = kernels_are_compiled()
    ready = warm_up()
    experiments: list[ExperimentFigures] = []
    met = []
    for source in present:
        pairs = EncounteredPairs(source.name)
        experiment = load_experiment(source, config)
        bends = bool(experiment.world.scene.trees.chains.any())  # nothing of one body could yield as it does
        fitting = engines[1:] if bends else engines
        experiments.append(measure(experiment, config, repeats, fitting, pairs if depths else None))
        met.append(pairs.pairs())
        report()
    compared: list[DepthFigures] = []
    if depths:
        sets = [*random_pairs(config.seed), *(pairs for pairs in met if pairs is not None)]
        compared = [compare_depths(pairs, repeats, peers) for pairs in sets]
        report()
    scaling_curves: list[Curve] = list(curves(config, repeats, engines[:1], report)) if scaling else []
    return Report(
        machine=machine,
        kernels_were_cached=were_cached,
        ready_s=ready,
        compile_s=compile_seconds() if compiling else None,
        repeats=repeats,
        experiments=tuple(experiments),
        missing=tuple(source.name for source in found if not source.exists),
        depths=tuple(compared),
        curves=tuple(scaling_curves),
    )


def _mujoco() -> tuple[PeerMaker, PeerMaker]:
    """The peers of whole frames, with rigid and with jointed hands; raises ConfigError if it is not installed."""
    from geomphys.bench.mujoco_peer import MujocoPeer
    from geomphys.bench.mujoco_scene import load_mujoco

    load_mujoco()
    return MujocoPeer.rigid, MujocoPeer.jointed
