"""Meshes as unions of convex pieces: their hull where they are convex, else CoACD, kept on disk.

A mesh of several closed parts is cut part by part, so that a table of boxes becomes exactly its boxes. Pieces of CoACD
are grown until they hold the whole surface of the mesh (`geomphys.world.coverage`): what stays out of the pieces stays
out of the mesh.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from geomphys.cache import user_folder
from geomphys.errors import ConfigError, MeshError
from geomphys.world.coacd_process import ITERATIONS, convex_parts
from geomphys.world.coverage import covering, uncovered
from geomphys.world.hulls import polytope
from geomphys.world.meshes import Mesh, require_closed, wound_outwards
from geomphys.world.scene_values import Decomposition

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
MOST_PARTS = 1000
"""shells of a mesh that are cut one by one; a mesh of more is cut as a whole"""
_RECIPE = 2
"""Raised when the same mesh and parameters give other pieces than before."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A mesh as convex pieces."""

    name: str
    hulls: tuple[Floats, ...]  # corners (k, 3) of each piece, m, frame of the mesh
    method: str  # "hull", "parts" (every closed part of it is convex) or "coacd"
    threshold: float  # concavity a piece may keep, of half the mesh's longest side
    seed: int
    uncovered: float  # m, how far the mesh's surface sticks out of the pieces
    seconds: float  # spent on it, now
    cached: bool


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
        ``hull``: its convex hull. ``auto`` and ``coacd``: itself if it is convex, else CoACD.
    threshold
        Concavity a piece may keep, 0.01 to 1 of half the mesh's longest side; None: `default_threshold`.
    seed
        Of CoACD's search.
    progress
        Called before and after a decomposition that is not in the cache.

    Raises
    ------
    MeshError
        A mesh that is flat, or neither watertight nor convex; a decomposition that fails or leaves surface bare.
    ConfigError
        A threshold out of its range.
    """
    start = time.perf_counter()
    if threshold is None:
        threshold = default_threshold(mesh)
    if not FINEST <= threshold <= 1.0:
        raise ConfigError(f"threshold = {threshold}: must lie between {FINEST} and 1")
    if how != "hull":
        require_closed(mesh)
    hulls: tuple[Floats, ...]
    if how == "hull" or mesh.is_convex:
        hulls, method, bare, cached = (mesh.hull_vertices,), "hull", 0.0, False
    else:
        hulls, method, bare, cached = _decomposed(mesh, threshold, seed, progress)
    return Pieces(
        name=mesh.name,
        hulls=hulls,
        method=method,
        threshold=threshold,
        seed=seed,
        uncovered=bare,
        seconds=time.perf_counter() - start,
        cached=cached,
    )


def default_threshold(mesh: Mesh) -> float:
    """Concavity a piece may keep, of half the mesh's longest side: `SHARE`, kept between `LEAST` and `MOST`."""
    half = 0.5 * mesh.size
    return min(max(min(max(SHARE * half, LEAST), MOST) / half, FINEST), 1.0)


def _decomposed(
    mesh: Mesh, threshold: float, seed: int, progress: Progress | None
) -> tuple[tuple[Floats, ...], str, float, bool]:
    solid = wound_outwards(mesh)
    parts = _closed_parts(solid)
    if all(part.is_convex for part in parts):
        return tuple(part.hull_vertices for part in parts), "parts", 0.0, False
    archive = user_folder("pieces") / f"{_key(solid, threshold, seed)}.npz"
    kept = _read(archive)
    if kept is not None:
        return kept[0], "coacd", kept[1], True
    if progress is not None:
        progress(f"convex decomposition of {mesh.name}", 0.0)
    hulls: list[Floats] = []
    for k, part in enumerate(parts):
        if part.is_convex:
            hulls.append(part.hull_vertices)
        else:
            share = min(max(threshold * mesh.size / part.size, FINEST), 1.0)
            cut = [p for p in convex_parts(mesh.name, part.vertices, part.faces, share, seed) if _has_volume(p)]
            hulls += covering(part.vertices, part.faces, cut)
        if progress is not None:
            progress(f"convex decomposition of {mesh.name}", (k + 1) / (len(parts) + 1))
    bare = uncovered(solid.vertices, solid.faces, hulls)
    if bare > 1e-4 * solid.size:
        raise MeshError(
            f"{mesh.name}: its convex pieces leave {bare * 1e3:.3g} mm of it bare: repair the mesh (does it cut "
            'through itself?) or use decomposition = "hull"'
        )
    _write(archive, hulls, bare)
    if progress is not None:
        progress(f"convex decomposition of {mesh.name}", 1.0)
    return tuple(hulls), "coacd", bare, False


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


def _key(mesh: Mesh, threshold: float, seed: int) -> str:
    from importlib.metadata import version

    text = f"{_RECIPE} {version('coacd')} {threshold!r} {seed} {ITERATIONS} {mesh.vertices.shape} {mesh.faces.shape} "
    digest = hashlib.sha256(text.encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def _read(archive: Path) -> tuple[tuple[Floats, ...], float] | None:
    """Pieces of the cache; None where there are none or the file is damaged, which computing them again repairs."""
    try:
        with archive.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            points, starts, bare = data["points"], data["starts"], float(data["bare"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    if points.ndim != 2 or points.dtype != np.float64 or not np.isfinite(points).all() or len(starts) < 2:
        return None
    return tuple(points[a:b] for a, b in pairwise(starts)), bare


def _write(archive: Path, hulls: list[Floats], bare: float) -> None:
    """Keep pieces; a full disk costs the next run the time, not this one its result."""
    starts = np.concatenate([[0], np.cumsum([len(h) for h in hulls])]).astype(np.int64)
    try:
        handle, name = tempfile.mkstemp(dir=archive.parent, suffix=".npz")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, points=np.concatenate(hulls), starts=starts, bare=bare)
            os.replace(name, archive)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        return
