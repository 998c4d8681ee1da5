"""One log of a batch, replayed in whatever process it lands in: pure, idempotent, and safe to run twice at once."""

from __future__ import annotations

import dataclasses
import shutil
import time
import traceback
import uuid
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

from geomphys import __version__
from geomphys.config import Config
from geomphys.errors import GeomphysError, OutputError, SceneError
from geomphys.load import load_world
from geomphys.output.output_log import open_output
from geomphys.output.provenance import sha256_of_file, sha256_of_world
from geomphys.replays import run
from geomphys.scene.arrays import World
from geomphys.storage.remote_files import AnyPath, is_remote, move
from geomphys.storage.temporary_folders import TemporaryFolder

STOP = "stop"
"""File in the folder of running jobs; as soon as it is there they end at the frame they are in."""

POLL_S = 0.2
"""s; between two looks for `STOP`."""
REMOTE_POLL_S = 5.0
"""s; likewise, where it lies behind a URL."""

Status = Literal["done", "failed", "interrupted"]


@dataclass(frozen=True, kw_only=True)
class Job:
    """What a worker is told. Paths are absolute and mean the same file on every machine."""

    log: AnyPath
    scene: AnyPath
    scene_sha256: str
    world_sha256: str
    """Both as the batch's own process found them: a worker that finds others fails instead of differing."""
    out: AnyPath
    rrd: AnyPath | None
    config: Config
    timing: bool
    copy_input: bool
    running: AnyPath
    """Folder on the outputs' file system for what is not complete; behind a URL only for `STOP`."""
    version: str = __version__


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a job. Hashes are SHA-256 in hexadecimal."""

    status: Status
    error: str | None = None
    traceback: str | None = None  # of a mistake of the program; expected errors have none
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


def run_job(job: Job) -> Outcome:
    """Replay a log and put its outputs in place.

    They are written in a folder of this call alone and renamed when complete, so a job that runs twice at once, after a
    network failure say, writes nothing torn. What is complete of a replay that ends early becomes ``STEM.partial.mcap``.
    """
    if job.version != __version__:
        raise GeomphysError(
            f"this worker has geomphys {__version__}, the batch was begun by {job.version}; install the same version"
        )
    output_folder: TemporaryFolder | None = None
    if is_remote(job.running):
        output_folder = TemporaryFolder()
        place = output_folder.path
    else:
        place = job.running / f"{job.out.stem}.{uuid.uuid4().hex}"
    try:
        place.mkdir(exist_ok=True)
        outcome = _replay(job, place)
        if outcome.status == "done":
            _publish(job, place)
    except GeomphysError as error:
        outcome = failure(error)
    except OSError as error:
        outcome = Outcome(status="failed", error=f"{error.filename or job.out}: {error.strerror or error}")
    finally:
        _move_partials(job, place)
        shutil.rmtree(place, ignore_errors=True)
        if output_folder is not None:
            output_folder.close()
    return outcome


class _StopRequestedError(Exception):
    """Somebody made the file `STOP`."""


def _replay(job: Job, place: Path) -> Outcome:
    out = place / job.out.name
    rrd = None if job.rrd is None else place / job.rrd.name
    try:
        summary = run(
            job.log,
            _world(job.scene, job.config.mode, job.config.seed, job.world_sha256),
            out=out,
            rrd=rrd,
            config=job.config,
            timing=job.timing,
            copy_input=job.copy_input,
            progress=_Stopping(job.running / STOP),
        )
    except _StopRequestedError:
        return Outcome(status="interrupted", error="stopped before its end")
    record = open_output(out).metadata
    if record["scene_sha256"] != job.scene_sha256:
        raise _changed(job.scene)
    summary = dataclasses.replace(summary, out=str(job.out), rrd=None if job.rrd is None else str(job.rrd))
    return Outcome(
        status="done",
        input_sha256=record["input_sha256"],
        scene_sha256=record["scene_sha256"],
        out_sha256=sha256_of_file(out),
        rrd_sha256=None if rrd is None else sha256_of_file(rrd),
        metrics=summary.as_dict(),
    )


_given: dict[str, World] = {}


def give_world(world: World) -> None:
    """Spare this process from loading the world of its jobs: reading meshes takes longer than many a log."""
    _given[sha256_of_world(world)] = world


@lru_cache(maxsize=2)
def _world(scene: AnyPath, mode: str | None, seed: int, world_sha256: str) -> World:
    """The world of a scene file: what this process was given, or loaded once."""
    if world_sha256 in _given:
        return _given[world_sha256]
    world = load_world(scene, mode=mode, seed=seed)
    if sha256_of_world(world) != world_sha256:
        raise _changed(scene)
    return world


def _changed(scene: AnyPath) -> SceneError:
    return SceneError(
        f"{scene}: is not what the batch began with: it, a mesh or a URDF was changed or differs on this machine; "
        "start the batch again"
    )


def _publish(job: Job, place: Path) -> None:
    """Give complete outputs their names; those of an earlier attempt are replaced, its partial ones removed."""
    for target in (job.out, job.rrd):
        if target is not None:
            try:
                move(place / target.name, target)
            except OSError as problem:
                raise OutputError(f"{target}: cannot be written ({problem.strerror or problem})") from problem
            _partial(target).unlink(missing_ok=True)


def _move_partials(job: Job, place: Path) -> None:
    for target in (job.out, job.rrd):
        if target is not None and (place / _partial(target).name).is_file():
            move(place / _partial(target).name, _partial(target))


def _partial(path: AnyPath) -> AnyPath:
    return path.with_name(f"{path.stem}.partial{path.suffix}")


class _Stopping:
    """Progress callback that ends the replay once a file is there, looking now and then."""

    def __init__(self, sign: AnyPath) -> None:
        self._sign = sign
        self._next = 0.0

    def __call__(self, done: int, total: int | None) -> None:
        now = time.monotonic()
        if now >= self._next:
            self._next = now + (REMOTE_POLL_S if is_remote(self._sign) else POLL_S)
            if self._sign.exists():
                raise _StopRequestedError
