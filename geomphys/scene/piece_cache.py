"""Convex pieces kept in the user's cache, found again by the bytes of the mesh and what it was cut with."""

from __future__ import annotations

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.coacd_process import SEARCHES
from geomphys.scene.meshes import Mesh

_RECIPE = 4
"""Raised when the same mesh and parameters give other pieces than before."""
_METHODS = ("hull", "parts", "coacd")


class CutMesh(NamedTuple):
    """What a mesh was cut into."""

    hulls: tuple[NDArray[np.float64], ...]  # corners (k, 3), m
    method: str  # one of `_METHODS`
    uncovered: float  # m


def archive_name(mesh: Mesh, threshold: float, seed: int) -> str:
    """Name of the file that keeps the pieces of a mesh."""
    from importlib.metadata import version

    makers = [version("coacd"), version("manifold3d"), SEARCHES]
    text = f"{_RECIPE} {makers} {threshold!r} {seed} {mesh.vertices.shape} {mesh.faces.shape} "
    digest = hashlib.sha256(text.encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype="<i8").tobytes())
    return f"{digest.hexdigest()}.npz"


def read_pieces(archive: Path) -> CutMesh | None:
    """Pieces of the cache; None where there are none or the file is damaged, which computing them again repairs."""
    try:
        with archive.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            points, starts, bare = data["points"], data["starts"], float(data["bare"])
            method = _METHODS[int(data["method"])]
    except (OSError, ValueError, KeyError, IndexError, EOFError, zipfile.BadZipFile):
        return None
    if points.ndim != 2 or points.dtype != np.float64 or not np.isfinite(points).all() or len(starts) < 2:
        return None
    return CutMesh(tuple(points[a:b] for a, b in pairwise(starts)), method, bare)


def write_pieces(archive: Path, cut: CutMesh) -> None:
    """Keep pieces; a full disk costs the next run the time, not this one its result."""
    starts = starts_of(cut.hulls)
    method = _METHODS.index(cut.method)
    try:
        handle, name = tempfile.mkstemp(dir=archive.parent, suffix=".npz")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(stream, points=np.concatenate(cut.hulls), starts=starts, bare=cut.uncovered, method=method)
            os.replace(name, archive)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        return


def starts_of(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Where each part begins among the points of all, and their number."""
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
