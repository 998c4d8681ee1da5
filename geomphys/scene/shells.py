"""Splits a triangle mesh into closed shells, also where shells touch each other.

A surface is closed if every edge is traversed equally often in both directions (zero boundary). At an edge with more
than two triangles, two triangles are adjacent if the inside lies between them; so shells that touch in a face, an edge
or a vertex are separated, and each is closed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_RELATIVE_VOLUME = 1e-9
"""Share of area times size: a shell of less volume is a sheet without an inside."""
COINCIDENT_ANGLE = 1e-7
"""rad; triangles at an edge with a smaller angle between them coincide."""


def shell_labels(vertices: Floats, faces: Ints) -> Ints | None:
    """Shell index of each triangle.

    Parameters
    ----------
    vertices, faces
        (n, 3) m, equal ones merged, and (m, 3).

    Returns
    -------
    ndarray or None
        (m,) numbers from 0, in the order of the shells' first vertices; None if the surface has a boundary, or an edge
        of more than two triangles is not traversed equally often in both directions.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    start, end = faces.reshape(-1), faces[:, [1, 2, 0]].reshape(-1)  # half-edge 3 f + k begins at corner k
    key = np.minimum(start, end) * len(vertices) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    if np.any(count % 2):
        return None
    pairs = [np.stack([order[first[count == 2]], order[first[count == 2] + 1]], axis=1)]
    for edge_first, edge_count in zip(first[count > 2].tolist(), count[count > 2].tolist(), strict=True):
        edge_pairs = _pairs_around_edge(vertices, faces, start, end, order[edge_first : edge_first + edge_count])
        if edge_pairs is None:
            return None
        pairs.append(edge_pairs)
    joined = np.concatenate(pairs) // 3
    graph = coo_array((np.ones(len(joined), dtype=np.int8), (joined[:, 0], joined[:, 1])), shape=(len(faces),) * 2)
    shell_count, label = connected_components(graph, directed=False)
    first_vertex = np.full(shell_count, len(vertices))
    np.minimum.at(first_vertex, label, faces.min(axis=1))
    rank = np.empty(shell_count, dtype=np.int64)
    rank[np.argsort(first_vertex, kind="stable")] = np.arange(shell_count)
    labels: Ints = rank[label]
    return labels


def _pairs_around_edge(vertices: Floats, faces: Ints, start: Ints, end: Ints, edges: Ints) -> Ints | None:
    """Pairs (k / 2, 2) of the half-edges `edges` (k,) of one edge: adjacent triangles with the inside between them."""
    forward = start[edges] < end[edges]
    if 2 * int(forward.sum()) != len(edges):
        return None
    low, high = vertices[min(start[edges[0]], end[edges[0]])], vertices[max(start[edges[0]], end[edges[0]])]
    axis = (high - low) / np.linalg.norm(high - low)
    spokes = vertices[faces[edges // 3, (edges + 2) % 3]] - low
    spokes = spokes - np.outer(spokes @ axis, axis)
    reference = spokes[0] / max(float(np.linalg.norm(spokes[0])), 1e-300)
    angle = np.arctan2(spokes @ np.cross(axis, reference), spokes @ reference) % (2.0 * np.pi)
    # Around the axis, the inside begins at a backward half-edge and ends at the next forward one. Of two coincident
    # triangles the one that ends comes first.
    step = np.round(angle / COINCIDENT_ANGLE).astype(np.int64) % round(2.0 * np.pi / COINCIDENT_ANGLE)
    order = np.lexsort((~forward, step))
    depth = np.cumsum(np.where(forward[order], -1, 1))
    order = np.roll(order, -(int(np.argmin(depth)) + 1))
    open_edges: list[int] = []
    found = []
    for k in order.tolist():
        if forward[k]:
            found.append((edges[open_edges.pop()], edges[k]))
        else:
            open_edges.append(k)
    return np.array(found, dtype=np.int64)


def shell_volumes(vertices: Floats, faces: Ints, label: Ints) -> Floats:
    """Signed volume of each shell (s,), m³: negative if its triangles are clockwise seen from outside."""
    shift = vertices.mean(axis=0)
    a, b, c = (vertices[faces[:, k]] - shift for k in range(3))
    volumes: Floats = np.bincount(label, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0).astype(np.float64)
    return volumes


def all_enclose_volume(vertices: Floats, faces: Ints, label: Ints) -> bool:
    """Whether every shell encloses a volume; a two-sided sheet does not."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = np.bincount(label, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))
    size = float(np.ptp(vertices, axis=0).max())
    return bool(np.all(np.abs(shell_volumes(vertices, faces, label)) > MIN_RELATIVE_VOLUME * area * size))


def outward_shells(vertices: Floats, faces: Ints, label: Ints) -> Ints:
    """The triangles (m, 3) with inside-out shells flipped, except those inside another shell (cavities)."""
    volume = shell_volumes(vertices, faces, label)
    solid = np.flatnonzero(volume > 0)
    order = np.argsort(label, kind="stable")
    start = np.searchsorted(label[order], np.arange(len(volume) + 1))
    corners = vertices[faces[order]].reshape(-1, 3)
    low, high = (bound.reduceat(corners, 3 * start[:-1])[solid] for bound in (np.minimum, np.maximum))
    flipped = faces.copy()
    for shell in np.flatnonzero(volume < 0).tolist():
        rows = order[start[shell] : start[shell + 1]]
        point = vertices[faces[rows[0]]].mean(axis=0)
        around = solid[np.all((low <= point) & (point <= high), axis=1)]
        others = np.concatenate([order[start[k] : start[k + 1]] for k in around] or [rows[:0]])
        if not _is_inside_any(point, vertices[faces[others]], label[others]):
            flipped[rows] = faces[rows][:, ::-1]
    return flipped


def _is_inside_any(point: Floats, triangles: Floats, label: Ints) -> bool:
    """Whether a point (3,) is inside one of several closed surfaces (n, 3, 3), by label: a winding number is not 0.

    The solid angles of the triangles of a surface seen from the point sum to 4 pi times that number (van Oosterom and
    Strackee 1983).
    """
    if len(triangles) == 0:
        return False
    a, b, c = (triangles[:, k] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(edge, axis=1) for edge in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    flat = la * lb * lc
    flat += np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    return bool(np.any(np.abs(np.bincount(label, np.arctan2(volume, flat))) / (2.0 * np.pi) > 0.5))
