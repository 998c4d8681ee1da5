"""Cuts a solid along the planes of its own flat faces, where a few such cuts make it convex.

A housing with a shaft on it or a block on a plate is two or three convex parts that meet in the plane of a face. CoACD
tries planes at even distances along the axes, misses that one, and makes a dozen pieces of it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.scene.convexity import is_nearly_convex
from geomphys.scene.meshes import Mesh
from geomphys.scene.screw_holes import from_manifold, to_manifold

Floats = NDArray[np.float64]

MAX_PIECES = 4
"""Solids that need more are left to CoACD, which then makes fewer."""
MAX_PLANES = 16
"""Planes that are tried for a cut, those of the largest faces"""
MARGIN = 0.02
"""Of the concavity: how far outside a face it is cut, so that no thin layer at the face is cut off"""
MIN_AREA = 1e-3
"""Of the size squared: area of a face, or of several in one plane, that a cut is tried along"""
MIN_HEIGHT = 0.01
"""Of the size: a cut removes at least that much."""
MIN_VOLUME = 1e-5
"""Of the cubed size: less are slivers of faces that are not quite flat; pieces are grown over them afterwards."""
MIN_GAIN = 0.3
"""Share of the volume between hull and solid that a cut is to remove"""
PART_COST = 0.03
"""Of that volume: what each further part has to remove besides"""
SAME_PLANE = 1e-3
"""Normals, and offsets as shares of the tenfold size, that differ by less are of one plane."""


def cut_along_faces(mesh: Mesh, concavity: float) -> list[Floats] | None:
    """Convex parts, corners (k, 3), of a watertight mesh that is not convex: the hulls of its parts after cuts along its faces.

    None where a few cuts do not make it convex. Each part may be replaced by its hull (`is_nearly_convex`, with this
    concavity, m). Together they hold the mesh, but for slivers.
    """
    import manifold3d

    solid = to_manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        return None
    waiting, found = [solid], list[Floats]()
    while waiting:
        parts = _best_cut(waiting.pop(), mesh.size, MARGIN * concavity)
        if not parts or len(found) + len(waiting) + len(parts) > MAX_PIECES:
            return None
        for solid in parts:
            part = from_manifold(solid, mesh)
            try:
                is_whole = part.is_convex or is_nearly_convex(part, concavity)
            except MeshError:  # flat
                return None
            if is_whole:
                found.append(part.hull_vertices)
            else:
                waiting.append(solid)
    return found


def _best_cut(solid: Any, size: float, margin: float) -> list[Any]:
    """The parts of a solid after the cut with the least volume between them and their hulls; none if all leave too much."""
    whole = _filled_by_hull(solid)
    best, least = list[Any](), (1.0 - MIN_GAIN) * whole
    for normal, offset in _face_planes(solid, size):
        sides = solid.split_by_plane(normal, offset + margin)
        parts = [part for side in sides for part in side.decompose() if part.volume() > MIN_VOLUME * size**3]
        left = sum(map(_filled_by_hull, parts)) + PART_COST * whole * len(parts)
        if 2 <= len(parts) <= MAX_PIECES and left < least:
            best, least = parts, left
    return best


def _filled_by_hull(solid: Any) -> float:
    """Volume between a solid and its convex hull, m³."""
    return float(solid.hull().volume() - solid.volume())


def _face_planes(solid: Any, size: float) -> list[tuple[tuple[float, float, float], float]]:
    """Unit normal and offset, n·x = d, of planes of faces that cut the solid, those of the largest area first."""
    made = solid.to_mesh64()
    vertices, faces = np.array(made.vert_properties)[:, :3], np.array(made.tri_verts).astype(np.int64)
    corners = vertices[faces]
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(crossed, axis=1)
    flat = area > 0
    planes = crossed[flat] / area[flat, None]
    offsets = np.einsum("ij,ij->i", planes, corners[flat, 0])
    rounded = np.rint(np.column_stack([planes, 10.0 * offsets / size]) / SAME_PLANE)
    _, first, group = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    total = np.bincount(group.reshape(-1), 0.5 * area[flat])
    largest = [k for k in np.argsort(-total, kind="stable") if total[k] > MIN_AREA * size**2]
    found = []
    for k in first[largest]:
        height = vertices @ planes[k] - offsets[k]
        if height.max() > MIN_HEIGHT * size and height.min() < -MIN_HEIGHT * size:
            x, y, z = planes[k].tolist()
            found.append(((x, y, z), float(offsets[k])))
    return found[:MAX_PLANES]
