"""Runs a batch: plans the logs, replays them and keeps the manifest."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from geomphys.batch.executors import Control, Finished, run_in_processes, run_on_cluster
from geomphys.batch.job import STOP, Job, Outcome
from geomphys.batch.manifest import Entry, Manifest
from geomphys.batch.plan import PlannedLog, plan_logs
from geomphys.batch.remote_lock import LOCK, lock_or_refuse, remote_lock_held
from geomphys.config import Config, OutputOptions
from geomphys.errors import OutputError, RefusedTargetError
from geomphys.load import load_world
from geomphys.output.provenance import files_of_log, sha256_of_file, sha256_of_log, sha256_of_world
from geomphys.scene.world import World
from geomphys.storage.child_process import available_cores
from geomphys.storage.output_file import InputFiles, check_target
from geomphys.storage.remote_files import AnyPath, as_path, is_remote
from geomphys.version import __version__

if TYPE_CHECKING:
    from geomphys.scene.decomposition import Progress

RUNNING = ".running"
"""Name of the folder for incomplete files, in the batch's folder."""


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """How the logs of a batch are worked through."""

    rrd: bool = False
    """``NAME.rrd`` is written too."""
    jobs: int | None = None
    """Most processes at once; None: one a processor."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers run the jobs instead of processes of this machine; log, scene and folder
    must have the same paths there."""
    resume: bool = False
    """Logs that the manifest has as done are left alone if their input, the scene with its meshes and URDFs, all parameters,
    the version, and the bytes of the outputs are the same still."""
    keep_going: bool = True
    """Go on if a log fails; otherwise no further job is started."""
    force: bool = False
    """Replace outputs that no batch in this folder has made."""


@dataclass(frozen=True, kw_only=True)
class BatchCallbacks:
    """Functions that are called while a batch is at work. What one raises ends the batch."""

    loading: Progress | None = None
    """During the first convex decomposition of meshes, with a description and the fraction done; finished decompositions
    stay in the cache."""
    progress: Callable[[int, int | None], None] | None = None
    """With the logs done and their number."""
    ended: Callable[[Entry], None] | None = None
    """With the entry of each log that ends."""


@dataclass(frozen=True, kw_only=True)
class BatchReport:
    """Outcome of a batch: the entries of its logs, sorted by name."""

    folder: str
    manifest: str
    entries: tuple[Entry, ...]
    up_to_date: tuple[str, ...]  # outputs that `resume` left as they are

    def count(self, status: str) -> int:
        """How many logs have that status: ``done``, ``failed``, ``interrupted`` or ``pending``."""
        return sum(entry.status == status for entry in self.entries)

    def as_dict(self) -> dict[str, Any]:
        """Everything by name, of plain Python types: fit for JSON."""
        return dataclasses.asdict(self)


def run_batch(
    logs: Sequence[AnyPath | str],
    scene: AnyPath | str,
    folder: AnyPath | str,
    *,
    config: Config | None = None,
    options: BatchOptions | None = None,
    outputs: OutputOptions | None = None,
    callbacks: BatchCallbacks | None = None,
) -> BatchReport:
    """Replay many logs in a scene; ``FOLDER/NAME.mcap`` holds the bytes that `geomphys.run` gives for each.

    ``FOLDER/manifest.json`` is written before the first log begins and after each one ends (of thousands of logs after
    some: see `Manifest.set`), so that a batch that was killed can be resumed. Processes are spawned: a script that calls
    this needs ``if __name__ == "__main__":``.

    Parameters
    ----------
    logs : sequence of Path or str
        MCAP files, ROS 2 bag folders, and folders of either; see `geomphys.batch.plan.plan_logs` for the names.
    scene : Path or str
        The scene file.
    folder : Path or str
        Where the outputs go; made if it is not there. Like logs and scene it may be a URL; see `geomphys.storage.remote_files`.
    config : Config, optional
        All parameters; None: the defaults.
    options : BatchOptions, optional
        How the logs are worked through; None: the defaults.
    outputs : OutputOptions, optional
        What each output holds, as in `geomphys.run`.
    callbacks : BatchCallbacks, optional
        Called while it is at work.

    Raises
    ------
    LogError
        There is no such log, or none in a folder. (What is wrong in a log is in its entry, `status` ``failed``.)
    SceneError, ModelError, MeshError
        The scene is wrong.
    OutputError
        Two logs have one output, an output exists without `resume` or `force`, another batch is at work in the folder,
        or it cannot be written.
    ClusterError
        The Dask scheduler cannot be reached.
    """
    folder, scene, config = as_path(folder).resolve(), as_path(scene).absolute(), config or Config()
    options, outputs, callbacks = options or BatchOptions(), outputs or OutputOptions(), callbacks or BatchCallbacks()
    planned = plan_logs(logs, folder)
    _check_outputs(planned, folder, options=options)
    world, scene_sha256 = (
        load_world(scene, mode=config.mode, seed=config.seed, progress=callbacks.loading),
        sha256_of_file(scene),
    )
    _check_outputs(planned, folder, options=options, inputs=world.source_files)
    world_sha256 = sha256_of_world(world)
    parameters = {**json.loads(json.dumps(config.as_dict())), **dataclasses.asdict(outputs)}
    requested = [
        Entry(
            log=str(plan.log),
            out=f"{plan.name}.mcap",
            rrd=f"{plan.name}.rrd" if options.rrd else None,
            version=__version__,
            scene_sha256=scene_sha256,
            world_sha256=world_sha256,
            parameters=parameters,
        )
        for plan in planned
    ]
    with _working_folder(folder) as running:
        manifest = Manifest.load(folder)
        up_to_date = tuple(
            e.out
            for e, plan in zip(requested, planned, strict=True)
            if options.resume and _is_up_to_date(manifest.entries.get(e.out), e, plan.log, folder)
        )
        log_of = {entry.out: plan.log for entry, plan in zip(requested, planned, strict=True)}
        todo = [entry for entry in requested if entry.out not in up_to_date]
        manifest.entries |= {entry.out: entry for entry in todo}
        manifest.save()
        for made in dict.fromkeys((folder / entry.out).parent for entry in todo):
            _make_folder(made)
        tasks = [
            Job(
                log=log_of[entry.out],
                scene=scene,
                scene_sha256=scene_sha256,
                world_sha256=world_sha256,
                out=folder / entry.out,
                rrd=None if entry.rrd is None else folder / entry.rrd,
                config=config,
                options=outputs,
                running=running,
            )
            for entry in todo
        ]
        failed = False

        control = Control(
            may_start=lambda: options.keep_going or not failed,
            request_stop=(running / STOP).touch,
            ends_at_failure=not options.keep_going,
        )
        finished = _execute(tasks, world, options, control)
        done = len(up_to_date)
        if callbacks.progress is not None:
            callbacks.progress(done, len(requested))
        with closing(finished), _saved_at_last(manifest):
            for index, outcome in finished:
                entry = _finished_entry(todo[index], outcome)
                failed = failed or entry.status == "failed"
                manifest.set(entry)
                done += 1
                if callbacks.ended is not None:
                    callbacks.ended(entry)
                if callbacks.progress is not None:
                    callbacks.progress(done, len(requested))
    return BatchReport(
        folder=str(folder),
        manifest=str(manifest.path),
        entries=tuple(manifest.entries[entry.out] for entry in requested),
        up_to_date=up_to_date,
    )


def _check_outputs(
    planned: Sequence[PlannedLog], folder: AnyPath, *, options: BatchOptions, inputs: Sequence[AnyPath] = ()
) -> None:
    """Raise OutputError if an output is a log, one of the other `inputs`, or exists and may not be replaced.

    With `options.resume` those that the folder's manifest names may.
    """
    if is_remote(folder) and not folder.lists:
        raise RefusedTargetError(
            f"{folder}: a web server takes no files; choose a local folder or a store such as s3://"
        )
    claimed = set(Manifest.load(folder).entries) if options.resume else set[str]()
    read = InputFiles([*(file for plan in planned for file in _files_of(plan.log)), *inputs])
    for plan in planned:
        for suffix in (".mcap", ".rrd") if options.rrd else (".mcap",):
            path = folder / f"{plan.name}{suffix}"
            if is_remote(path) or path.parent.is_dir():
                may_replace = options.force or f"{plan.name}.mcap" in claimed
                if not may_replace and path.exists():
                    check_target(path, force=True, inputs=read)
                    raise RefusedTargetError(f"{path}: exists; choose another folder, or add --resume or --force")
                check_target(path, force=may_replace, inputs=read, partial=True)


def _files_of(log: AnyPath) -> tuple[AnyPath, ...]:
    """The files of a log; itself alone if they cannot be listed, which its replay reports."""
    try:
        return files_of_log(log)
    except OSError:
        return (log,)


def _execute(
    jobs: Sequence[Job], world: World, options: BatchOptions, control: Control
) -> Generator[Finished, None, None]:
    if options.scheduler is not None and jobs:
        return run_on_cluster(jobs, options.scheduler, control)
    return run_in_processes(jobs, world, max(1, min(options.jobs or available_cores(), len(jobs))), control)


def _is_up_to_date(entry: Entry | None, requested: Entry, log: AnyPath, folder: AnyPath) -> bool:
    """Whether an entry of an earlier batch matches the request and its outputs are intact.

    False for files that cannot be read; the replay then reports the problem.
    """
    if entry is None or entry.status != "done":
        return False
    try:
        return entry.is_made_from(requested, sha256_of_log(log)) and entry.outputs_are_complete(folder)
    except OSError:
        return False


def _finished_entry(requested: Entry, outcome: Outcome) -> Entry:
    facts = {field.name: getattr(outcome, field.name) for field in dataclasses.fields(outcome)}
    return dataclasses.replace(requested, **{**facts, "scene_sha256": outcome.scene_sha256 or requested.scene_sha256})


def _make_folder(folder: AnyPath) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror})") from problem


@contextmanager
def _saved_at_last(manifest: Manifest) -> Iterator[None]:
    """Save a manifest when the block ends, however it ends."""
    try:
        yield
    finally:
        if not manifest.is_saved:
            manifest.save()


@contextmanager
def _working_folder(folder: AnyPath) -> Iterator[AnyPath]:
    """Create and lock the batch's folder; yields an empty folder in it for incomplete files.

    A folder behind a URL is locked by an object, see `geomphys.batch.remote_lock`.
    """
    if is_remote(folder):
        remote = folder / RUNNING
        with remote_lock_held(remote / LOCK):
            try:
                (remote / STOP).unlink(missing_ok=True)
            except OSError as problem:
                raise OutputError(f"{folder}: cannot be written to ({problem.strerror})") from problem
            yield remote
        return
    running = folder / RUNNING
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder, os.O_RDONLY)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror})") from problem
    try:
        lock_or_refuse(lock, f"{folder}: another batch is at work there")
        try:
            shutil.rmtree(running, ignore_errors=True)
            running.mkdir()
        except OSError as problem:
            raise OutputError(f"{folder}: cannot be written to ({problem.strerror})") from problem
        try:
            yield running
        except BaseException:
            if {path.name for path in running.iterdir()} <= {STOP}:  # else remote workers have yet to see it
                shutil.rmtree(running)
            raise
        shutil.rmtree(running)
    finally:
        os.close(lock)
