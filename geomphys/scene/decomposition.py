"""Convex decomposition of meshes: the convex hull where that is close enough, else CoACD; results are cached on disk.

A mesh of several closed shells is decomposed shell by shell, so a table made of boxes becomes exactly those boxes. A
shell that is nearly convex is replaced by its hull (`geomphys.scene.convexity`). CoACD's pieces are grown until they
cover the whole surface (`geomphys.scene.coverage`), so a body outside the pieces is outside the mesh. Several meshes
are decomposed in parallel, each in its own process; the number of processes does not change the result.
"""

from __future__ import annotations

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
from geomphys.scene.coacd_process import CutOptions, convex_parts
from geomphys.scene.congruence import translation_between
from geomphys.scene.convexity import is_nearly_convex
from geomphys.scene.coverage import REACH, grow_to_cover, piece_protrusion, uncovered_distance
from geomphys.scene.face_cuts import cut_along_faces
from geomphys.scene.hulls import polytope
from geomphys.scene.meshes import Mesh, oriented_outwards, require_closed
from geomphys.scene.piece_cache import ConvexPieces, archive_name, read_pieces, write_pieces
from geomphys.scene.scene_values import Decomposition
from geomphys.scene.screw_holes import hole_radius, simplified, without_screw_holes
from geomphys.storage.cache import user_cache_folder
from geomphys.storage.child_process import available_cores

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[str, float], None]
"""Progress callback: description of the current work, fraction done (0 to 1)."""

RELATIVE_CONCAVITY = 0.02
"""Default concavity of a piece, of half the mesh's longest side ..."""
MIN_CONCAVITY, MAX_CONCAVITY = 1e-3, 5e-3
"""... but at least and at most these, m. Less: more pieces that protrude less."""
MIN_THRESHOLD = 0.01
"""CoACD goes no finer, of half the longest side of what it cuts"""
SIMPLER = 0.1
"""Of the concavity: how far the surface that CoACD cuts may lie from the mesh's"""
MANY_TRIANGLES, VERY_MANY_TRIANGLES = 2_000, 10_000
"""Parts of more triangles are made simpler and searched less thoroughly; of very many, or with screw holes, quickly."""
MAX_UNCOVERED = 1e-4
"""Of the mesh's longest side: how far its surface may protrude from its pieces"""
MAX_PROTRUSION = 3.0
"""Of the concavity: pieces that protrude farther are those of a mesh that really intersects itself"""
MAX_SHELLS = 1000
"""shells of a mesh that are cut one by one; a mesh of more is cut as a whole"""
PROGRESS_INTERVAL = 0.2
"""s between two reports of progress"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Decomposed:
    """The convex decomposition of a mesh."""

    name: str
    hulls: tuple[Floats, ...]  # corners (k, 3) of each piece, m, frame of the mesh
    method: str  # "hull", "parts" (the hulls of its closed parts) or "coacd" (cut, also if along faces only)
    threshold: float  # allowed concavity, of half the mesh's longest side
    seed: int
    uncovered_m: float  # m, largest distance of the mesh's surface outside the pieces
    seconds: float  # of this call; near 0 for a cached result
    cached: bool


class DecompositionTask(NamedTuple):
    """A mesh and the decomposition method requested for it."""

    mesh: Mesh
    how: Decomposition


def decompose(
    mesh: Mesh,
    how: Decomposition = "auto",
    *,
    threshold: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Decomposed:
    """Convex pieces of a mesh.

    Parameters
    ----------
    mesh
        Watertight or convex, but for ``how="hull"``.
    how
        ``hull``: its convex hull. ``auto`` and ``coacd``: its hull if it is convex or nearly so
        (`geomphys.scene.convexity`, within the threshold), else CoACD.
    threshold
        Allowed concavity of a piece, 0.01 to 1 of half the mesh's longest side; None: `default_threshold`.
    seed
        Of CoACD's search.
    progress
        See `decompose_all`.

    Raises
    ------
    MeshError
        A mesh that is flat, or neither watertight nor convex; a decomposition that fails or leaves surface uncovered.
    ConfigError
        A threshold out of its range.
    """
    return decompose_all([DecompositionTask(mesh, how)], threshold=threshold, seed=seed, progress=progress)[0]


def decompose_all(
    meshes: Sequence[DecompositionTask],
    *,
    threshold: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    processes: int | None = None,
) -> tuple[Decomposed, ...]:
    """Convex pieces of several meshes, in their order; see `decompose`.

    Each result is written to the cache as soon as it is done, even if another mesh fails later.

    Parameters
    ----------
    progress
        Called five times a second while meshes that are not in the cache are decomposed. An exception from it ends the
        work.
    processes
        Number of meshes decomposed at a time; None: the number of cores.

    Raises
    ------
    MeshError, ConfigError
        As `decompose`, for the first mesh that fails; unfinished ones are stopped.
    """
    found: dict[int, Decomposed] = {}
    jobs: dict[Path, _Job] = {}
    pending: dict[int, Path] = {}
    for number, (mesh, how) in enumerate(meshes):
        start = time.perf_counter()
        part_threshold = _valid_threshold(mesh, threshold)
        if how != "hull":
            require_closed(mesh)
        if how == "hull" or mesh.is_convex:
            cut = ConvexPieces((mesh.hull_vertices,), "hull", 0.0)
            found[number] = _pieces(mesh, part_threshold, seed, cut, time.perf_counter() - start, cached=False)
            continue
        solid = oriented_outwards(mesh)
        archive = user_cache_folder("pieces") / archive_name(solid, part_threshold, seed)
        cached_pieces = read_pieces(archive)
        if cached_pieces is not None:
            found[number] = _pieces(mesh, part_threshold, seed, cached_pieces, time.perf_counter() - start, cached=True)
            continue
        jobs.setdefault(archive, _Job(solid, part_threshold, seed, archive))
        pending[number] = archive
    made = dict(zip(jobs, _run(list(jobs.values()), progress, processes or available_cores()), strict=True))
    for number, archive in pending.items():
        cut, seconds = made[archive]
        found[number] = _pieces(meshes[number].mesh, jobs[archive].threshold, seed, cut, seconds, cached=False)
    return tuple(found[number] for number in range(len(meshes)))


def _valid_threshold(mesh: Mesh, threshold: float | None) -> float:
    part_threshold = default_threshold(mesh) if threshold is None else threshold
    if not MIN_THRESHOLD <= part_threshold <= 1.0:
        raise ConfigError(f"threshold = {part_threshold}: must lie between {MIN_THRESHOLD} and 1")
    return part_threshold


def _pieces(mesh: Mesh, threshold: float, seed: int, cut: ConvexPieces, seconds: float, *, cached: bool) -> Decomposed:
    return Decomposed(
        name=mesh.name,
        hulls=cut.hulls,
        method=cut.method,
        threshold=threshold,
        seed=seed,
        uncovered_m=cut.uncovered_m,
        seconds=seconds,
        cached=cached,
    )


def default_threshold(mesh: Mesh) -> float:
    """Allowed concavity as a share of half the mesh's longest side: `RELATIVE_CONCAVITY`, clipped to the absolute limits."""
    half = 0.5 * mesh.size
    return min(max(min(max(RELATIVE_CONCAVITY * half, MIN_CONCAVITY), MAX_CONCAVITY) / half, MIN_THRESHOLD), 1.0)


class _Job(NamedTuple):
    """A closed, outward-oriented mesh to decompose, and the archive for the result."""

    mesh: Mesh
    threshold: float
    seed: int
    archive: Path


def _run(jobs: list[_Job], progress: Progress | None, processes: int) -> list[tuple[ConvexPieces, float]]:
    """Decompose meshes in parallel; the pieces and the seconds of each, in the order of the jobs."""
    if not jobs:
        return []
    at_once = min(processes, len(jobs))
    threads = max(1, processes // at_once)
    stop = Event()
    largest_first = sorted(range(len(jobs)), key=lambda k: (-len(jobs[k].mesh.faces), k))
    with ThreadPoolExecutor(at_once) as pool:
        try:
            futures = {k: pool.submit(_decompose_timed, jobs[k], threads, stop) for k in largest_first}
            _report_progress([(jobs[k], futures[k]) for k in largest_first], progress)
            failed = (f for f in futures.values() if f.done() and f.exception() is not None)
            next(failed, futures[0]).result()
            return [futures[k].result() for k in range(len(jobs))]
        finally:  # stops all subprocesses, also after an exception
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _report_progress(work: list[tuple[_Job, Future[tuple[ConvexPieces, float]]]], progress: Progress | None) -> None:
    """Report progress until all is done or one failed."""
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
        wait([future for _, future in work if not future.done()], PROGRESS_INTERVAL, FIRST_COMPLETED)


def _decompose_timed(job: _Job, threads: int, stop: Event) -> tuple[ConvexPieces, float]:
    start = time.perf_counter()
    cut = _decompose_job(job, threads, stop)
    write_pieces(job.archive, cut)
    return cut, time.perf_counter() - start


def _decompose_job(job: _Job, threads: int, stop: Event) -> ConvexPieces:
    solid, parts = job.mesh, _closed_parts(job.mesh)
    concavity = [min(0.5 * job.threshold * solid.size, 0.5 * part.size) for part in parts]
    filled = [
        part if part.is_convex else without_screw_holes(part, hole_radius(limit))
        for part, limit in zip(parts, concavity, strict=True)
    ]
    whole = [mesh.is_convex or is_nearly_convex(mesh, limit) for mesh, limit in zip(filled, concavity, strict=True)]
    if all(whole):
        return ConvexPieces(tuple(part.hull_vertices for part in parts), "hull" if len(parts) == 1 else "parts", 0.0)
    hulls: list[Floats] = []
    uncovered_m = 0.0
    cut: list[tuple[Mesh, list[Floats]]] = []
    for part, mesh, limit, is_whole in zip(parts, filled, concavity, whole, strict=True):
        if is_whole:
            hulls.append(part.hull_vertices)
            continue
        twins = ((pieces, translation_between(other, part)) for other, pieces in cut)
        found = next(((pieces, offset) for pieces, offset in twins if offset is not None), None)
        if found is not None:  # motors and screws come in sets
            hulls += [points + found[1] for points in found[0]]
            continue
        made, left = _cut(job, part, mesh, limit, threads, stop)
        cut.append((part, made))
        hulls, uncovered_m = hulls + made, max(uncovered_m, left)
    return ConvexPieces(tuple(hulls), "coacd", uncovered_m)


def _cut(
    job: _Job, part: Mesh, filled: Mesh, concavity: float, threads: int, stop: Event
) -> tuple[list[Floats], float]:
    """Pieces of a closed part that cover it, from CoACD on the part with its screw holes filled; and how far, m, it protrudes.

    Where CoACD would take long, it is cut along its own faces if a few cuts make it convex (`geomphys.scene.face_cuts`).
    CoACD takes thin triangles, of which CAD meshes are full, for a mesh that intersects itself, and would cut a surface of
    voxels in its place: three times as slow, for pieces that protrude twice as far. So it does that only where it fails
    at the mesh as it is, or its pieces protrude much too far.
    """
    share = min(max(job.threshold * job.mesh.size / part.size, MIN_THRESHOLD), 1.0)
    search = "medium" if len(filled.faces) > MANY_TRIANGLES else "thorough"
    if filled is not part or len(filled.faces) > VERY_MANY_TRIANGLES:
        search = "quick"
    tolerance = 0.0 if search == "thorough" else SIMPLER * concavity
    plain = simplified(filled, tolerance) if tolerance else filled
    reach, limit = REACH * part.size + tolerance, MAX_PROTRUSION * concavity
    if tolerance and (solids := cut_along_faces(filled, concavity)):
        hulls = grow_to_cover(part.vertices, part.faces, solids, reach)
        uncovered_m = uncovered_distance(part.vertices, part.faces, hulls)
        if uncovered_m <= MAX_UNCOVERED * job.mesh.size and not _stand_out(part, hulls, limit):
            return hulls, uncovered_m
    uncovered_m = job.mesh.size
    coarse: tuple[list[Floats], float] | None = None  # pieces that cover the part and protrude too far
    for remesh in (False, True):
        try:
            cut = CutOptions(share, job.seed, search, remesh)
            made = convex_parts(job.mesh.name, plain.vertices, plain.faces, cut, threads=threads, stop=stop)
        except MeshError:
            if coarse is not None and not stop.is_set():
                return coarse
            if remesh or stop.is_set():
                raise
            continue
        solid = [points for points in made if _has_volume(points)]
        if not solid:
            continue
        hulls = grow_to_cover(part.vertices, part.faces, solid, reach)
        uncovered_m = uncovered_distance(part.vertices, part.faces, hulls)
        if uncovered_m <= MAX_UNCOVERED * job.mesh.size:
            if remesh or not _stand_out(part, hulls, limit):
                return hulls, uncovered_m
            coarse = hulls, uncovered_m
    if coarse is not None:
        return coarse
    raise MeshError(
        f"{job.mesh.name}: its convex pieces leave {uncovered_m * 1e3:.3g} mm of it uncovered: repair the mesh (does it cut "
        'through itself?) or use decomposition = "hull"'
    )


def _stand_out(part: Mesh, hulls: list[Floats], limit: float) -> bool:
    return piece_protrusion(part.vertices, part.faces, hulls, beyond=limit) > 0.0


def _closed_parts(mesh: Mesh) -> list[Mesh]:
    """The closed shells of an outward-oriented mesh, also where they touch; the mesh itself if one is a cavity."""
    parts = mesh.shells()
    return parts if len(parts) <= MAX_SHELLS and all(part.signed_volume > 0 for part in parts) else [mesh]


def _has_volume(points: Floats) -> bool:
    """Whether a part from CoACD has a volume; flat parts are dropped, and `grow_to_cover` covers their surface."""
    try:
        polytope(points)
    except MeshError:
        return False
    return True
