"""Vertex normals for rendering: smooth over curved surfaces, split at sharp edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SHARP_ANGLE_DEG = 40.0
"""Degrees between two faces above which the edge between them stays sharp."""


def with_vertex_normals(vertices: Floats, faces: Ints, sharp: float = SHARP_ANGLE_DEG) -> tuple[Floats, Ints, Floats]:
    """Vertices, faces and unit vertex normals of a mesh to draw.

    A vertex that lies on a sharp edge is split, one copy for each normal there.

    Parameters
    ----------
    vertices : (n, 3) m
    faces : (m, 3) indices, counter-clockwise seen from outside
    sharp : degrees

    Returns
    -------
    vertices (k, 3), faces (m, 3), normals (k, 3)
    """
    if len(faces) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3))
    positions, position_of = np.unique(vertices, axis=0, return_inverse=True)
    corner_position = position_of.reshape(-1)[faces].ravel()  # (3m,)
    corner_face = np.repeat(np.arange(len(faces)), 3)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    areas = np.cross(b - a, c - a)
    lengths = np.linalg.norm(areas, axis=1, keepdims=True)
    units = np.divide(areas, lengths, out=np.zeros_like(areas), where=lengths > 0)
    # all pairs of corners at one position: the normal there averages over neighbouring faces of similar normal
    order = np.argsort(corner_position, kind="stable")
    counts = np.bincount(corner_position, minlength=len(positions))
    starts = np.concatenate([[0], np.cumsum(counts)])
    repeats = counts[corner_position]
    first = np.repeat(np.arange(len(corner_position)), repeats)
    within = np.arange(len(first)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    second = order[starts[corner_position[first]] + within]
    smooth = np.einsum("ij,ij->i", units[corner_face[first]], units[corner_face[second]]) > np.cos(np.radians(sharp))
    smooth |= first == second
    first, second = first[smooth], second[smooth]
    sums = np.stack(
        [np.bincount(first, areas[corner_face[second], i], minlength=len(corner_position)) for i in range(3)], axis=1
    )
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    normals = np.divide(sums, lengths, out=np.tile([0.0, 0.0, 1.0], (len(sums), 1)), where=lengths > 0)
    keys = np.concatenate([corner_position[:, None], np.round(normals * 1e6).astype(np.int64)], axis=1)
    _, chosen, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return positions[corner_position[chosen]], index.reshape(-1, 3), normals[chosen]
