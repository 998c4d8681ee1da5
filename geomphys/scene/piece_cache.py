"""Disk cache of convex decompositions, keyed by the mesh's arrays and the parameters."""

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

_FORMAT_VERSION = 5
"""Raised when the same mesh and parameters give other pieces than before."""
_METHODS = ("hull", "parts", "coacd")


class ConvexPieces(NamedTuple):
    """Convex pieces of a mesh."""

    hulls: tuple[NDArray[np.float64], ...]  # corners (k, 3), m
    method: str  # one of `_METHODS`
    uncovered_m: float  # largest distance of the surface outside the hulls


def archive_name(mesh: Mesh, threshold: float, seed: int) -> str:
    """File name of a mesh's pieces in the cache."""
    from importlib.metadata import version

    makers = [version("coacd"), version("manifold3d"), SEARCHES]
    text = f"{_FORMAT_VERSION} {makers} {threshold!r} {seed} {mesh.vertices.shape} {mesh.faces.shape} "
    digest = hashlib.sha256(text.encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype="<i8").tobytes())
    return f"{digest.hexdigest()}.npz"


def read_pieces(archive: Path) -> ConvexPieces | None:
    """Pieces from the cache; None if there are none or the file is damaged (they are then recomputed)."""
    try:
        with archive.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            points, starts, uncovered_m = data["points"], data["starts"], float(data["uncovered_m"])
            method = _METHODS[int(data["method"])]
    except (OSError, ValueError, KeyError, IndexError, EOFError, zipfile.BadZipFile):
        return None
    if points.ndim != 2 or points.dtype != np.float64 or not np.isfinite(points).all() or len(starts) < 2:
        return None
    return ConvexPieces(tuple(points[a:b] for a, b in pairwise(starts)), method, uncovered_m)


def write_pieces(archive: Path, pieces: ConvexPieces) -> None:
    """Write pieces to the cache, atomically; a failure is ignored: the next run recomputes them."""
    starts = start_offsets(pieces.hulls)
    method = _METHODS.index(pieces.method)
    try:
        handle, name = tempfile.mkstemp(dir=archive.parent, suffix=".npz")
        try:
            with os.fdopen(handle, "wb") as stream:
                np.savez(
                    stream,
                    points=np.concatenate(pieces.hulls),
                    starts=starts,
                    uncovered_m=pieces.uncovered_m,
                    method=method,
                )
            os.replace(name, archive)
        except OSError:
            Path(name).unlink(missing_ok=True)
    except OSError:
        return


def start_offsets(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.int64]:
    """Start index of each part in the concatenated points, and the total: (n + 1,)."""
    return np.concatenate([[0], np.cumsum([len(part) for part in parts])]).astype(np.int64)
