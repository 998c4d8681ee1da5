"""Replays one log of a batch in a worker process: idempotent, and safe to run twice concurrently."""

from __future__ import annotations

import ctypes
import dataclasses
import gc
import time
import traceback
import uuid
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

from geomphys.config import Callbacks, Config, OutputOptions
from geomphys.errors import GeomphysError, OutputError, SceneError
from geomphys.load import load_world
from geomphys.output.provenance import sha256_of_file, sha256_of_world
from geomphys.scene.world import World
from geomphys.storage.output_file import flushed_later, partial_path, publish
from geomphys.storage.remote_files import AnyPath, is_remote
from geomphys.storage.temporary_folders import TemporaryFolder
from geomphys.version import __version__

STOP = "stop"
"""File in the folder of running jobs; once it exists they end at their current frame."""

POLL_S = 0.2
"""s; interval between checks for `STOP`."""
REMOTE_POLL_S = 5.0
"""s; the same for a folder behind a URL."""
GC_THRESHOLD = 50_000
"""Allocations between garbage collections of a worker; the default is 700."""
M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3  # of `mallopt`
FREE_MEMORY_BYTES = 1 << 27
"""A worker gives free memory back beyond this."""
MAPPED_BYTES = 1 << 25
"""Arrays from this size on are of the system, and go back to it at once."""

Status = Literal["done", "failed", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class Job:
    """Parameters of a worker's job. Paths are absolute and valid on every machine."""

    log: AnyPath
    scene: AnyPath
    scene_sha256: str
    world_sha256: str
    """Hashes computed by the batch's own process; a worker that computes others fails."""
    out: AnyPath
    rrd: AnyPath | None
    config: Config
    options: OutputOptions
    running: AnyPath
    """Folder on the outputs' file system for incomplete files; behind a URL it holds only `STOP`."""
    version: str = __version__


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Result of a job. Hashes are SHA-256 in hexadecimal."""

    status: Status
    error: str | None = None
    traceback: str | None = None  # of an internal error; expected errors have none
    input_sha256: str | None = None
    scene_sha256: str | None = None
    out_sha256: str | None = None
    rrd_sha256: str | None = None
    metrics: dict[str, Any] | None = None  # the replay's `Summary`


def failure(error: BaseException) -> Outcome:
    """Outcome of a job that ended in an exception, which may come from another process."""
    text = "; ".join([str(error), *getattr(error, "__notes__", ())])
    if isinstance(error, GeomphysError):
        return Outcome(status="failed", error=text)
    trace = "".join(traceback.format_exception(error))
    return Outcome(status="failed", error=f"internal error: {type(error).__name__}: {text}", traceback=trace)


class _Output(NamedTuple):
    """A file of a job."""

    work: Path  # where it is written
    target: AnyPath


class Replayed(NamedTuple):
    """What a replay left."""

    outcome: Outcome
    outputs: Sequence[_Output] = ()  # complete files that have yet to be published


def run_job(job: Job) -> Outcome:
    """Replay a log and publish its outputs.

    They are written under a name unique to this call and renamed when complete, so a job that runs twice concurrently,
    after a network failure for example, leaves no torn file. A replay that ends early leaves ``STEM.partial.mcap``.
    """
    return publish_outputs(replay_job(job))


def replay_job(job: Job) -> Replayed:
    """Replay a log; another process of this machine may publish what is complete. To a URL it is published already."""
    if job.version != __version__:
        raise GeomphysError(
            f"this worker has geomphys {__version__}, the batch was started by {job.version}; install the same version"
        )
    with TemporaryFolder() if is_remote(job.running) else nullcontext(job.running) as folder:
        name = uuid.uuid4().hex
        targets = [target for target in (job.out, job.rrd) if target is not None]
        outputs = [_Output(folder / f"{name}{target.suffix}", target) for target in targets]
        is_complete = False
        try:
            with flushed_later():
                outcome = _outcome_of(lambda: _replay(job, outputs), job.out)
            is_complete = outcome.status == "done"
        finally:
            _move_partials(outputs)
            if not is_complete:
                _remove(outputs)
        replayed = Replayed(outcome, outputs if is_complete else ())
        return Replayed(publish_outputs(replayed)) if is_remote(job.running) else replayed


def publish_outputs(replayed: Replayed) -> Outcome:
    """Move complete outputs to their final paths, replacing those of an earlier attempt and removing its partial ones."""
    outcome, outputs = replayed
    if not outputs:
        return outcome

    def publish_all() -> Outcome:
        try:
            for work, target in outputs:
                try:
                    publish(work, target)
                except OSError as problem:
                    raise OutputError(f"{target}: cannot be written ({problem.strerror or problem})") from problem
                partial_path(target).unlink(missing_ok=True)
            return outcome
        finally:
            _remove(outputs)

    return _outcome_of(publish_all, outputs[0].target)


def _outcome_of(call: Callable[[], Outcome], out: AnyPath) -> Outcome:
    """The outcome of a call that may raise expected errors."""
    try:
        return call()
    except GeomphysError as error:
        return failure(error)
    except OSError as error:
        return Outcome(status="failed", error=f"{error.filename or out}: {error.strerror or error}")


class _StopRequestedError(Exception):
    """The file `STOP` exists."""


def _replay(job: Job, outputs: Sequence[_Output]) -> Outcome:
    from geomphys.replays import run  # the batch's own process needs none of it

    out, rrd = outputs[0].work, None if job.rrd is None else outputs[1].work
    hashes: list[str] = []
    try:
        summary = run(
            job.log,
            _load_world_cached(job.scene, job.config.mode, job.config.seed, job.world_sha256),
            out=out,
            rrd=rrd,
            config=job.config,
            options=job.options,
            callbacks=Callbacks(
                hashed=lambda *found: hashes.extend(found), progress=_StopFileCheck(job.running / STOP)
            ),
        )
    except _StopRequestedError:
        return Outcome(status="interrupted", error="stopped before its end")
    input_sha256, scene_sha256 = hashes
    if scene_sha256 != job.scene_sha256:
        raise _world_changed(job.scene)
    summary = dataclasses.replace(summary, out=str(job.out), rrd=None if job.rrd is None else str(job.rrd))
    return Outcome(
        status="done",
        input_sha256=input_sha256,
        scene_sha256=scene_sha256,
        out_sha256=sha256_of_file(out),
        rrd_sha256=None if rrd is None else sha256_of_file(rrd),
        metrics=summary.as_dict(),
    )


_preloaded_worlds: dict[str, World] = {}


def preload_world(world: World) -> None:
    """Make a world available to the jobs of this process, which then need not load its meshes.

    What is loaded by now stays: garbage is collected among what comes after it, and seldom. Memory that is freed
    stays in the process for the next log; otherwise the system would clear every page of it anew for each.
    """
    import geomphys.replays  # noqa: F401  # with all that a job needs

    _preloaded_worlds[sha256_of_world(world)] = world
    gc.freeze()
    gc.set_threshold(GC_THRESHOLD, 20, 20)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # of the GNU C library
    if mallopt is not None:
        mallopt(M_TRIM_THRESHOLD, FREE_MEMORY_BYTES)
        mallopt(M_MMAP_THRESHOLD, MAPPED_BYTES)


@lru_cache(maxsize=2)
def _load_world_cached(scene: AnyPath, mode: str | None, seed: int, world_sha256: str) -> World:
    """The world of a scene file: preloaded, or loaded once; SceneError if its hash differs."""
    if world_sha256 in _preloaded_worlds:
        return _preloaded_worlds[world_sha256]
    world = load_world(scene, mode=mode, seed=seed)
    if sha256_of_world(world) != world_sha256:
        raise _world_changed(scene)
    return world


def _world_changed(scene: AnyPath) -> SceneError:
    return SceneError(
        f"{scene}: is not what the batch began with: it, a mesh or a URDF was changed or differs on this machine; "
        "start the batch again"
    )


def _move_partials(outputs: Sequence[_Output]) -> None:
    for work, target in outputs:
        if (partial := work.with_name(partial_path(work).name)).is_file():
            publish(partial, partial_path(target))


def _remove(outputs: Sequence[_Output]) -> None:
    for output in outputs:
        output.work.unlink(missing_ok=True)


class _StopFileCheck:
    """Progress callback that ends the replay once a file exists; it is checked at intervals."""

    def __init__(self, stop_file: AnyPath) -> None:
        self._stop_file = stop_file
        self._next = 0.0

    def __call__(self, done: int, total: int | None) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + (REMOTE_POLL_S if is_remote(self._stop_file) else POLL_S)
            if self._stop_file.exists():
                raise _StopRequestedError
