"""Meshes as unions of convex pieces: their hull where that is near enough, else CoACD, kept on disk.

A mesh of several closed parts is cut part by part, so that a table of boxes becomes exactly its boxes. A part whose hull
stands for it within the concavity a piece may keep is not cut (`geomphys.scene.convexity`). Pieces of CoACD are grown
until they hold the whole surface of the mesh (`geomphys.scene.coverage`): what stays out of the pieces stays out of the
mesh. Several meshes are cut at once, each in a process of its own; how many at a time changes no piece.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import ConfigError, MeshError
from geomphys.scene.coacd_process import convex_parts
from geomphys.scene.convexity import is_nearly_convex
from geomphys.scene.coverage import ROUNDING, covering, uncovered
from geomphys.scene.hulls import polytope
from geomphys.scene.meshes import Mesh, require_closed, wound_outwards
from geomphys.scene.piece_cache import CutMesh, archive_name, read_pieces, write_pieces
from geomphys.scene.scene_values import Decomposition
from geomphys.scene.screw_holes import hole_radius, simplified, without_screw_holes
from geomphys.storage.cache import user_folder

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done, 0 to 1."""

SHARE = 0.02
"""Concavity a piece may keep where nothing else is asked for, of half the mesh's longest side ..."""
LEAST, MOST = 1e-3, 5e-3
"""... but at least and at most these, m. Less: more pieces that stand out less."""
FINEST = 0.01
"""CoACD goes no finer, of half the longest side of what it cuts"""
SIMPLER = 0.1
"""Of the concavity: how far the surface that CoACD cuts may lie from the mesh's"""
MANY_TRIANGLES = 10_000
"""Meshes of more, or with screw holes, are made simpler first, and searched for cuts quickly."""
MOST_PARTS = 1000
"""shells of a mesh that are cut one by one; a mesh of more is cut as a whole"""
LOOK_EVERY = 0.2
"""s between two reports of progress"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A mesh as convex pieces."""

    name: str
    hulls: tuple[Floats, ...]  # corners (k, 3) of each piece, m, frame of the mesh
    method: str  # "hull", "parts" (the hulls of its closed parts) or "coacd"
    threshold: float  # concavity a piece may keep, of half the mesh's longest side
    seed: int
    uncovered: float  # m, how far the mesh's surface sticks out of the pieces
    seconds: float  # spent on it, now
    cached: bool


class Uncut(NamedTuple):
    """A mesh, and how it is to become convex pieces."""

    mesh: Mesh
    how: Decomposition


def decompose(
    mesh: Mesh,
    how: Decomposition = "auto",
    *,
    threshold: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Pieces:
    """Convex pieces of a mesh.

    Parameters
    ----------
    mesh
        Watertight or convex, but for ``how="hull"``.
    how
        ``hull``: its convex hull. ``auto`` and ``coacd``: its hull if it is convex or nearly so
        (`geomphys.scene.convexity`, within the threshold), else CoACD.
    threshold
        Concavity a piece may keep, 0.01 to 1 of half the mesh's longest side; None: `default_threshold`.
    seed
        Of CoACD's search.
    progress
        See `decompose_all`.

    Raises
    ------
    MeshError
        A mesh that is flat, or neither watertight nor convex; a decomposition that fails or leaves surface bare.
    ConfigError
        A threshold out of its range.
    """
    return decompose_all([Uncut(mesh, how)], threshold=threshold, seed=seed, progress=progress)[0]


def decompose_all(
    meshes: Sequence[Uncut],
    *,
    threshold: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    processes: int | None = None,
) -> tuple[Pieces, ...]:
    """Convex pieces of several meshes, in their order; see `decompose`.

    A mesh that is done is kept in the cache at once, whatever becomes of the others.

    Parameters
    ----------
    progress
        Called while meshes are cut that are not in the cache, five times a second, with the name of one that is being
        cut and which of how many it is, and the share of them that is done. What it raises ends the work.
    processes
        How many are cut at a time; None: as many as there are cores.

    Raises
    ------
    MeshError, ConfigError
        As `decompose`, of a mesh that fails; those that are not done by then are not finished.
    """
    found: dict[int, Pieces] = {}
    jobs: dict[Path, _Job] = {}
    waiting: dict[int, Path] = {}
    for number, (mesh, how) in enumerate(meshes):
        start = time.perf_counter()
        share = _checked(mesh, threshold)
        if how != "hull":
            require_closed(mesh)
        if how == "hull" or mesh.is_convex:
            cut = CutMesh((mesh.hull_vertices,), "hull", 0.0)
            found[number] = _pieces(mesh, share, seed, cut, time.perf_counter() - start, cached=False)
            continue
        solid = wound_outwards(mesh)
        archive = user_folder("pieces") / archive_name(solid, share, seed)
        kept = read_pieces(archive)
        if kept is not None:
            found[number] = _pieces(mesh, share, seed, kept, time.perf_counter() - start, cached=True)
            continue
        jobs.setdefault(archive, _Job(solid, share, seed, archive))
        waiting[number] = archive
    made = dict(zip(jobs, _run(list(jobs.values()), progress, processes or cores()), strict=True))
    for number, archive in waiting.items():
        cut, seconds = made[archive]
        found[number] = _pieces(meshes[number].mesh, jobs[archive].threshold, seed, cut, seconds, cached=False)
    return tuple(found[number] for number in range(len(meshes)))


def cores() -> int:
    """How many processes may run at once here."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _checked(mesh: Mesh, threshold: float | None) -> float:
    share = default_threshold(mesh) if threshold is None else threshold
    if not FINEST <= share <= 1.0:
        raise ConfigError(f"threshold = {share}: must lie between {FINEST} and 1")
    return share


def _pieces(mesh: Mesh, threshold: float, seed: int, cut: CutMesh, seconds: float, *, cached: bool) -> Pieces:
    return Pieces(
        name=mesh.name,
        hulls=cut.hulls,
        method=cut.method,
        threshold=threshold,
        seed=seed,
        uncovered=cut.uncovered,
        seconds=seconds,
        cached=cached,
    )


def default_threshold(mesh: Mesh) -> float:
    """Concavity a piece may keep, of half the mesh's longest side: `SHARE`, kept between `LEAST` and `MOST`."""
    half = 0.5 * mesh.size
    return min(max(min(max(SHARE * half, LEAST), MOST) / half, FINEST), 1.0)


class _Job(NamedTuple):
    """A closed mesh wound outwards that is to be cut and kept."""

    mesh: Mesh
    threshold: float
    seed: int
    archive: Path


def _run(jobs: list[_Job], progress: Progress | None, processes: int) -> list[tuple[CutMesh, float]]:
    """Cut meshes, so many at a time; the pieces and the seconds of each, in the order of the jobs."""
    if not jobs:
        return []
    at_once = min(processes, len(jobs))
    threads = max(1, processes // at_once)
    stop = Event()
    largest_first = sorted(range(len(jobs)), key=lambda k: (-len(jobs[k].mesh.faces), k))
    with ThreadPoolExecutor(at_once) as pool:
        try:
            futures = {k: pool.submit(_timed, jobs[k], threads, stop) for k in largest_first}
            _watch([(jobs[k], futures[k]) for k in largest_first], progress)
            failed = (f for f in futures.values() if f.done() and f.exception() is not None)
            next(failed, futures[0]).result()
            return [futures[k].result() for k in range(len(jobs))]
        finally:  # nothing is left running, however this ends
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _watch(work: list[tuple[_Job, Future[tuple[CutMesh, float]]]], progress: Progress | None) -> None:
    """Report until all is done or something failed."""
    count = len(work)
    while True:
        done = sum(future.done() for _, future in work)
        if progress is not None:
            number, name = next(
                ((k, job.mesh.name) for k, (job, future) in enumerate(work, 1) if not future.done()),
                (count, work[-1][0].mesh.name),
            )
            progress(f"convex decomposition of {Path(name).name} ({number} of {count})", done / count)
        if done == count or any(future.done() and future.exception() is not None for _, future in work):
            return
        wait([future for _, future in work if not future.done()], LOOK_EVERY, FIRST_COMPLETED)


def _timed(job: _Job, threads: int, stop: Event) -> tuple[CutMesh, float]:
    start = time.perf_counter()
    cut = _cut(job, threads, stop)
    write_pieces(job.archive, cut)
    return cut, time.perf_counter() - start


def _cut(job: _Job, threads: int, stop: Event) -> CutMesh:
    solid, parts = job.mesh, _closed_parts(job.mesh)
    concavity = [min(0.5 * job.threshold * solid.size, 0.5 * part.size) for part in parts]
    filled = [
        part if part.is_convex else without_screw_holes(part, hole_radius(limit))
        for part, limit in zip(parts, concavity, strict=True)
    ]
    whole = [mesh.is_convex or is_nearly_convex(mesh, limit) for mesh, limit in zip(filled, concavity, strict=True)]
    if all(whole):
        return CutMesh(tuple(part.hull_vertices for part in parts), "hull" if len(parts) == 1 else "parts", 0.0)
    hulls: list[Floats] = []
    for part, mesh, limit, is_whole in zip(parts, filled, concavity, whole, strict=True):
        if is_whole:
            hulls.append(part.hull_vertices)
            continue
        share = min(max(job.threshold * solid.size / part.size, FINEST), 1.0)
        costly = mesh is not part or len(mesh.faces) > MANY_TRIANGLES
        plain = simplified(mesh, SIMPLER * limit) if costly else mesh
        reach = ROUNDING * part.size + (SIMPLER * limit if costly else 0.0)
        search = "quick" if costly else "thorough"
        corners, faces = plain.vertices, plain.faces
        made = convex_parts(solid.name, corners, faces, share, job.seed, search=search, threads=threads, stop=stop)
        hulls += covering(part.vertices, part.faces, [points for points in made if _has_volume(points)], reach)
    bare = uncovered(solid.vertices, solid.faces, hulls)
    if bare > 1e-4 * solid.size:
        raise MeshError(
            f"{solid.name}: its convex pieces leave {bare * 1e3:.3g} mm of it bare: repair the mesh (does it cut "
            'through itself?) or use decomposition = "hull"'
        )
    return CutMesh(tuple(hulls), "coacd", bare)


def _closed_parts(mesh: Mesh) -> list[Mesh]:
    """The closed shells of a mesh wound outwards, also of those that touch; the mesh as it is if one is a cavity."""
    parts = mesh.shells()
    return parts if len(parts) <= MOST_PARTS and all(part.signed_volume > 0 for part in parts) else [mesh]


def _has_volume(points: Floats) -> bool:
    """Whether a part of CoACD has a hull; flat leftovers of a cut have none, and what they covered others take in."""
    try:
        polytope(points)
    except MeshError:
        return False
    return True
