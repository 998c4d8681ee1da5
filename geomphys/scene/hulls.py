"""Convex hulls: vertices, edges, maximal faces, volume centroid and smallest width."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.scene.arrays import Floats, Ints
from geomphys.scene.direction_cells import farthest_in_cells

MIN_THICKNESS_SHARE = 1e-9
"""Share of the size below which a hull counts as flat."""
COPLANAR_SHARE = 2e-6
"""Vertices within this share of the size of a face's plane belong to the face (rounding of single-precision meshes)."""
COPLANAR_THICKNESS_SHARE = 1e-3
"""... and within this share of the thickness, so that the two sides of a thin plate stay separate faces."""

WIDTH_ROUNDING = 1e-12
"""Share of the size by which the lower bound of an edge's width may exceed the smallest face width (rounding)."""

MAX_EDGES_ALL_PAIRS = 1_000
"""Up to this many edges all pairs are tested; beyond, only those with a small enough lower bound."""


class Polytope(NamedTuple):
    """A convex polytope of V vertices and F faces."""

    vertices: Floats  # (V, 3) m
    neighbour_count: Ints  # (V,)
    neighbours: Ints  # vertices adjacent in a triangulation of the surface, vertex by vertex
    planes: Floats  # (F, 4) outward unit normal n and offset d of each maximal face: n·x <= d for every corner
    loop_count: Ints  # (F,)
    loops: Ints  # vertices of the faces, counter-clockwise seen from outside
    centre: Floats  # (3,) volume centroid
    thickness: float  # m, smallest width over all directions


def polytope(points: NDArray[np.float64]) -> Polytope:
    """Convex hull of points (n, 3), n >= 4.

    Raises
    ------
    MeshError
        If there are fewer than four points, a value is not finite, or the points lie in a plane: the smallest width
        is below 1e-9 of the size.
    """
    from scipy.spatial import ConvexHull, QhullError

    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        raise MeshError(f"hull of an array of shape {points.shape}: needs at least four points (n, 3)")
    if not np.all(np.isfinite(points)):
        raise MeshError("hull: a corner is NaN or infinite")
    origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
    size = float(np.ptp(points, axis=0).max())
    if size == 0.0:
        raise MeshError("hull: all corners are one point; needs a solid")
    try:
        hull = ConvexHull((points - origin) / size, qhull_options="Qt")
    except QhullError:
        raise MeshError(f"hull of {len(points)} points is flat: needs a solid, or give the plate a thickness") from None
    corners, normals = np.sort(hull.vertices), hull.equations[:, :3]
    renumber = np.full(len(points), -1)
    renumber[corners] = np.arange(len(corners))
    vertices = np.ascontiguousarray(points[corners])
    triangles = _oriented_outwards(renumber[hull.simplices], (vertices - origin) / size, normals)
    edges, sides = _edges(triangles)
    thickness = _smallest_width(vertices - origin, normals, edges, sides)
    if thickness < MIN_THICKNESS_SHARE * size:
        raise MeshError(
            f"hull of {len(points)} points is flat ({thickness:.3g} m thick): needs a solid, so give it a thickness"
        )
    tolerance = min(COPLANAR_SHARE * size, COPLANAR_THICKNESS_SHARE * thickness)
    loops = _faces(vertices, triangles, normals, sides, tolerance)
    order = np.lexsort((np.concatenate([edges[:, 1], edges[:, 0]]), np.concatenate([edges[:, 0], edges[:, 1]])))
    return Polytope(
        vertices=vertices,
        neighbour_count=np.bincount(edges.reshape(-1), minlength=len(vertices)),
        neighbours=np.concatenate([edges[:, 1], edges[:, 0]])[order],
        planes=_planes(vertices, loops, origin),
        loop_count=np.array([len(loop) for loop in loops]),
        loops=np.concatenate(loops),
        centre=_centroid(vertices, triangles, origin),
        thickness=thickness,
    )


def _oriented_outwards(triangles: Ints, vertices: Floats, normals: Floats) -> Ints:
    """Triangles (F, 3) reordered counter-clockwise seen from outside."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals) < 0.0
    triangles = triangles.astype(np.int64)
    triangles[inward] = triangles[inward][:, [0, 2, 1]]
    return _consistently_oriented(triangles)


def _consistently_oriented(triangles: Ints) -> Ints:
    """The same triangles with consistent orientation: slivers, whose normals are noise, follow their neighbours."""
    directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    count = int(triangles.max()) + 1
    keys = directed[:, 0] * count + directed[:, 1]
    if len(np.unique(keys)) == len(keys):
        return triangles
    owner: dict[tuple[int, int], list[int]] = {}
    for t, corners in enumerate(triangles):
        for k in range(3):
            u, v = int(corners[k]), int(corners[(k + 1) % 3])
            owner.setdefault((min(u, v), max(u, v)), []).append(t)
    oriented, queue, seen = triangles.copy(), [0], {0}
    while queue:
        t = queue.pop()
        for k in range(3):
            u, v = int(oriented[t, k]), int(oriented[t, (k + 1) % 3])
            for other in owner[(min(u, v), max(u, v))]:
                if other in seen:
                    continue
                seen.add(other)
                queue.append(other)
                row = oriented[other]
                if any(row[j] == u and row[(j + 1) % 3] == v for j in range(3)):
                    oriented[other] = row[[0, 2, 1]]
    return oriented


def _edges(triangles: Ints) -> tuple[Ints, Ints]:
    """Edges (E, 2), each once with the smaller vertex first, and the two triangles (E, 2) adjacent to each.

    Raises MeshError if the triangles do not close.
    """
    directed = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    owner = np.repeat(np.arange(len(triangles)), 3)
    low, high = directed.min(axis=1), directed.max(axis=1)
    order = np.lexsort((directed[:, 0] > directed[:, 1], high, low))
    first, second = order[0::2], order[1::2]
    closed = len(order) % 2 == 0 and np.array_equal(directed[first], directed[second][:, ::-1])
    if not closed or len(np.unique(low[first] * (int(high.max()) + 1) + high[first])) != len(first):
        raise MeshError("hull: its surface does not close; the points are too close to a plane or to each other")
    return directed[first], np.stack([owner[first], owner[second]], axis=1)


def _smallest_width(vertices: Floats, normals: Floats, edges: Ints, sides: Ints) -> float:
    """Smallest extent over all directions: it lies at a face's normal or at a normal common to two antipodal edges.

    Two edges are antipodal if the arc of the normals of one crosses the mirrored arc of the other. Of many edges only
    those are paired whose arc may contain a smaller width than the faces: see `_width_lower_bounds`. The partner of such an
    edge has the same width where the arcs cross, so it is among them too. Bounds from a few vertices that lie far out
    come first; extents are found of the faces that these leave.
    """
    is_crease = np.einsum("ij,ij->i", normals[sides[:, 0]], normals[sides[:, 1]]) < 1.0 - 1e-12
    edges, sides = edges[is_crease], sides[is_crease]
    if len(edges) <= MAX_EDGES_ALL_PAIRS:
        return _smallest_between_edges(vertices, normals, edges, sides, float(np.min(_extents(vertices, normals)[0])))
    outer = np.unique(farthest_in_cells(vertices))
    least, opposite = _extents(vertices[outer], normals)
    slack = WIDTH_ROUNDING * float(np.ptp(vertices, axis=0).max())
    first = np.argmin(least, keepdims=True)
    near = least <= _extents(vertices, normals[first])[0] + slack
    width = float(np.min(_extents(vertices, normals[near])[0]))
    opposite = outer[opposite]
    for is_exact in (False, True):
        if is_exact:
            left = np.unique(sides)
            opposite[left] = _extents(vertices, normals[left])[1]
        may_be_thinner = _width_lower_bounds(vertices, normals, edges, sides, opposite) <= width + slack
        edges, sides = edges[may_be_thinner], sides[may_be_thinner]
    return _smallest_between_edges(vertices, normals, edges, sides, width)


def _extents(vertices: Floats, normals: Floats) -> tuple[Floats, Ints]:
    """Extent (F,) of the vertices along each normal, and the vertex (F,) farthest in the opposite direction."""
    extents, opposite = np.empty(len(normals)), np.empty(len(normals), dtype=np.int64)
    rows = max(1, 4_000_000 // len(vertices))
    for start in range(0, len(normals), rows):
        part = slice(start, start + rows)
        along = np.ascontiguousarray((vertices @ normals[part].T).T)
        opposite[part] = along.argmin(axis=1)
        extents[part] = along.max(axis=1) - along.min(axis=1)
    return extents, opposite


def _width_lower_bounds(vertices: Floats, normals: Floats, edges: Ints, sides: Ints, opposite: Ints) -> Floats:
    """Lower bounds (E,) of the width over all directions of the arc of each edge, from one side's normal to the other's.

    An edge through p supports the hull in every direction u of its arc, so the width there is at least (p - x)·u for
    any vertex x. Along the arc that is A cos t + B sin t, concave where it is positive, so it runs above the chord between
    its values at the arc's ends. Here x are vertices opposite (F,) to both ends, the farthest ones or others far out; the
    bound is the lowest point of the higher of the two chords.
    """
    first, last = sides[:, 0], sides[:, 1]
    one, other = (vertices[edges[:, 0]] - vertices[opposite[side]] for side in (first, last))
    near, end = (np.einsum("ij,ij->i", one, normals[side]) for side in (first, last))  # of the chord of the first's x
    start, far = (np.einsum("ij,ij->i", other, normals[side]) for side in (first, last))  # ... of the last's
    falls, rises = near - end, far - start
    lower_bounds: Floats = np.maximum(np.minimum(near, end), np.minimum(far, start))
    crossing = (falls > 0.0) & (rises > 0.0) & (near > start) & (far > end)
    fraction = (near - start)[crossing] / (falls + rises)[crossing]
    lower_bounds[crossing] = near[crossing] - fraction * falls[crossing]
    lower_bounds[np.minimum(end, start) < 0.0] = 0.0  # a sinusoid that goes below zero may run below its chord there
    return lower_bounds


def _smallest_between_edges(vertices: Floats, normals: Floats, edges: Ints, sides: Ints, width: float) -> float:
    """The smallest of `width` and the widths between all pairs of antipodal edges."""
    direction = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rows = max(1, 2_000_000 // max(1, len(edges)))
    for start in range(0, len(edges), rows):
        part = slice(start, start + rows)
        height = direction[part] @ normals.T
        across = height[:, sides[:, 0]] * height[:, sides[:, 1]] <= 1e-12
        height = direction @ normals[sides[part]].reshape(-1, 3).T
        across &= (height[:, 0::2] * height[:, 1::2] <= 1e-12).T
        i, j = np.nonzero(across)
        i, j = i[i + start < j] + start, j[i + start < j]
        n = np.cross(direction[i], direction[j])
        length = np.linalg.norm(n, axis=1)
        # arcs that cross on the same side have normals alike, not opposite: their edges are not antipodal
        mirrored = np.einsum("ij,ij->i", normals[sides[i]].sum(axis=1), normals[sides[j]].sum(axis=1)) < 0.5
        good = (length > 1e-12) & mirrored
        n = n[good] / length[good, None]
        gap = np.abs(np.einsum("ij,ij->i", n, vertices[edges[i[good], 0]] - vertices[edges[j[good], 0]]))
        n = n[gap < width]
        for chunk in range(0, len(n), 4096):
            along = vertices @ n[chunk : chunk + 4096].T
            width = min(width, float(np.min(along.max(axis=0) - along.min(axis=0))))
    return width


def _faces(vertices: Floats, triangles: Ints, normals: Floats, sides: Ints, tolerance: float) -> list[list[int]]:
    """Loops of the maximal faces: from the largest triangle on, all connected triangles that lie in its plane."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    adjacent: list[list[int]] = [[] for _ in triangles]
    for s, t in sides.tolist():
        adjacent[s].append(t)
        adjacent[t].append(s)
    corners: list[list[int]] = triangles.tolist()
    has_flat_neighbour = _has_coplanar_neighbour(vertices, triangles, normals, sides, tolerance).tolist()
    face = [-1] * len(triangles)
    groups: list[list[int]] = []
    for seed in np.argsort(-area, kind="stable").tolist():
        if face[seed] >= 0:
            continue
        group, queue = [seed], [seed]
        face[seed] = len(groups)
        groups.append(group)
        if not has_flat_neighbour[seed]:
            continue
        n = normals[seed]
        level = (vertices @ n) - vertices[triangles[seed]].dot(n).max()
        flat: list[bool] = (np.abs(level) <= tolerance).tolist()
        while queue:
            for t in adjacent[queue.pop()]:
                if face[t] < 0 and all(flat[corner] for corner in corners[t]):
                    face[t] = face[seed]
                    group.append(t)
                    queue.append(t)
    return [_loop([corners[t] for t in group]) for group in groups]


def _has_coplanar_neighbour(
    vertices: Floats, triangles: Ints, normals: Floats, sides: Ints, tolerance: float
) -> NDArray[np.bool_]:
    """Whether each triangle (F,) has a neighbour within the tolerance of its plane (up to rounding)."""
    found = np.zeros(len(triangles), dtype=bool)
    top = np.max(np.einsum("tkj,tj->tk", vertices[triangles], normals), axis=1)
    margin = 1.001 * tolerance + 1e-12 * float(np.abs(vertices).max())
    for face, other in (sides.T, sides.T[::-1]):
        level = np.einsum("tkj,tj->tk", vertices[triangles[other]], normals[face]) - top[face, None]
        found[face[np.max(np.abs(level), axis=1) <= margin]] = True
    return found


def _loop(triangles: list[list[int]]) -> list[int]:
    """Boundary loop of connected triangles; MeshError if it is not a single loop."""
    if len(triangles) == 1:
        first = triangles[0].index(min(triangles[0]))
        return triangles[0][first:] + triangles[0][:first]
    next_vertex: dict[int, int] = {}
    directed = {edge for a, b, c in triangles for edge in ((a, b), (b, c), (c, a))}
    for u, v in sorted(directed):
        if (v, u) not in directed:
            if u in next_vertex:
                raise MeshError("hull: a face touches itself; the points are too close to each other")
            next_vertex[u] = v
    start = min(next_vertex)
    loop, vertex = [start], next_vertex[start]
    while vertex != start:
        loop.append(vertex)
        vertex = next_vertex[vertex]
    if len(loop) != len(next_vertex):
        raise MeshError("hull: a face has a hole; the points are too close to each other")
    return loop


def _planes(vertices: Floats, loops: list[list[int]], origin: Floats) -> Floats:
    """Planes (F, 4) of faces: the area-weighted normals of their outlines, the offsets of the farthest vertices."""
    planes = np.empty((len(loops), 4))
    for length in {len(loop) for loop in loops}:
        rows = [row for row, loop in enumerate(loops) if len(loop) == length]
        corners = vertices[[loops[row] for row in rows]] - origin
        spokes = corners - corners[:, :1]
        for row, n in zip(rows, np.cross(spokes[:, 1:-1], spokes[:, 2:]).sum(axis=1), strict=True):
            n /= math.sqrt(n.dot(n))
            planes[row, :3], planes[row, 3] = n, (vertices @ n).max()
    return planes


def _centroid(vertices: Floats, triangles: Ints, origin: Floats) -> Floats:
    a, b, c = (vertices[triangles[:, k]] - origin for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    centre: Floats = origin + (volume[:, None] * (a + b + c)).sum(axis=0) / (4.0 * volume.sum())
    return centre
