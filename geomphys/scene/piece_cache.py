"""Disk cache of convex decompositions, keyed by the mesh's arrays and the parameters."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.scene.coacd_process import SEARCHES
from geomphys.scene.meshes import Mesh
from geomphys.storage.cache import Store

_FORMAT_VERSION = 7
"""Raised when the same mesh and parameters give other pieces than before."""


class ConvexPieces(NamedTuple):
    """Convex pieces of a mesh."""

    hulls: tuple[NDArray[np.float64], ...]  # corners (k, 3), m
    method: str  # "hull", "parts" or "coacd"
    uncovered_m: float  # largest distance of the surface outside the hulls


def archive_name(mesh: Mesh, threshold: float, seed: int) -> str:
    """File name of a mesh's pieces in the cache."""
    from importlib.metadata import version

    makers = [version("coacd"), version("manifold3d"), SEARCHES]
    text = f"{_FORMAT_VERSION} {makers} {threshold!r} {seed} {mesh.vertices.shape} {mesh.faces.shape} "
    digest = hashlib.sha256(text.encode())
    digest.update(np.ascontiguousarray(mesh.vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(mesh.faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def read_pieces(archive: Path) -> ConvexPieces | None:
    """Pieces from the cache; None if there are none or the file is damaged (they are then recomputed)."""
    found = Store(archive.parent, (ConvexPieces,)).load(archive.name)
    return found if isinstance(found, ConvexPieces) else None


def write_pieces(archive: Path, pieces: ConvexPieces) -> None:
    """Write pieces to the cache, atomically; a failure is ignored: the next run recomputes them."""
    Store(archive.parent).save(archive.name, pieces)
