"""Simplifies meshes before they are cut: fills screw holes, and merges small triangles of a smooth surface.

A hole that is narrower than pieces may protrude costs CoACD dozens of cuts around it, whose parts it then joins again.
So it is found and filled here: connected triangles around a hollow that are too narrow for a ball touching them from
outside, and whose convex hull is near the mesh. Such a filling protrudes no farther than the radius. Cups, rings,
handles and the space between two walls are not filled.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.scene.coverage import Surface, winding
from geomphys.scene.hulls import polytope
from geomphys.scene.meshes import Mesh, merge_vertices

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SCREW = 1.6e-3
"""m, radius of the hole of an M3 screw: filled where the concavity is less, unless by `FINER` ..."""
FINER = 1.6
"""... times: so that a finer threshold fills less"""
NARROW = 0.97
"""Of the radius: a ball with less clearance does not fit."""
ROUND = 1.1
"""Of the diameter: largest width of a hole, by its bounding box along its principal axes"""
FACING = -0.7
"""Cosine between two walls of a hole; in a corner or along a ledge none face each other so."""
HOLLOW = -0.02
"""Sine of the angle by which a triangle may fall off from its neighbour and belong to the same hole"""
SAMPLES = 200
"""Points of a filling whose distance from the mesh is measured"""


def hole_radius(concavity: float) -> float:
    """Radius of the holes that are filled, m, for this allowed concavity, m."""
    return min(FINER * concavity, max(concavity, SCREW))


def without_screw_holes(mesh: Mesh, radius: float) -> Mesh:
    """A watertight mesh wound outwards whose holes of less than this radius, m, are filled; itself where none are."""
    fillings = screw_holes(mesh, radius)
    if not fillings:
        return mesh
    import manifold3d

    solid = to_manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        return mesh
    plugs = [manifold3d.Manifold.hull_points(points) for points in fillings]
    return from_manifold(manifold3d.Manifold.batch_boolean([solid, *plugs], manifold3d.OpType.Add), mesh)


def simplified(mesh: Mesh, tolerance: float) -> Mesh:
    """A watertight mesh with fewer triangles whose surface is nowhere farther than `tolerance`, m, from the mesh's."""
    import manifold3d

    solid = to_manifold(mesh)
    return mesh if solid.status() != manifold3d.Error.NoError else from_manifold(solid.simplify(tolerance), mesh)


def screw_holes(mesh: Mesh, radius: float) -> list[Floats]:
    """Corners (k, 3) of the convex fillings of a mesh's holes of less than this radius, m."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    normals /= np.where(length > 0, length, 1.0)[:, None]
    if not mesh.is_watertight:
        return []
    surface, middle = Surface(mesh.vertices, mesh.faces), corners.mean(axis=1)
    narrow = ~_beyond_hull(mesh, middle + radius * normals, normals, NARROW * radius)
    narrow[narrow] = surface.distance((middle + radius * normals)[narrow]) < NARROW * radius
    if not narrow.any():
        return []
    one, other, edge = _neighbours(mesh)
    across = middle[other] - edge
    rise = np.einsum("ij,ij->i", across, normals[one])
    joined = narrow[one] & narrow[other] & (rise > HOLLOW * np.linalg.norm(across, axis=1))
    links = coo_matrix((np.ones(int(joined.sum())), (one[joined], other[joined])), shape=(len(narrow),) * 2)
    label = connected_components(links, directed=False)[1]
    order = np.flatnonzero(narrow)[np.argsort(label[narrow], kind="stable")]
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    found = (_filling(mesh, surface, group, normals[group], radius) for group in groups if len(group) >= 4)
    return [points for points in found if points is not None]


def _beyond_hull(mesh: Mesh, points: Floats, normals: Floats, distance: float) -> NDArray[np.bool_]:
    """Which points (n, 3) are at least so far beyond the plane of the mesh's hull whose normal is nearest to theirs (n, 3)."""
    from scipy.spatial import cKDTree

    planes = mesh.hull_planes[cKDTree(mesh.hull_planes[:, :3]).query(normals)[1]]
    found: NDArray[np.bool_] = np.einsum("ij,ij->i", points, planes[:, :3]) + planes[:, 3] >= distance
    return found


def _neighbours(mesh: Mesh) -> tuple[Ints, Ints, Floats]:
    """Pairs of triangles that share an edge (e,), (e,), and the middles of those edges (e, 3)."""
    ends = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    low, high = ends.min(axis=1), ends.max(axis=1)
    order = np.argsort(low * len(mesh.vertices) + high, kind="stable")
    face = np.repeat(np.arange(len(mesh.faces)), 3)[order]
    return face[0::2], face[1::2], mesh.vertices[ends[order][0::2]].mean(axis=1)


def _filling(mesh: Mesh, surface: Surface, group: Ints, normals: Floats, radius: float) -> Floats | None:
    """The hull of triangles that lie around a hole; None where they do not, or where it protrudes too far."""
    if len(group) > 2000 or np.min(normals @ normals.T) > FACING:
        return None
    points = mesh.vertices[np.unique(mesh.faces[group])]
    axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
    if np.sort(np.ptp(points @ axes.T, axis=0))[1] > 2.0 * ROUND * radius:
        return None
    try:
        points = polytope(points).vertices
    except MeshError:
        return None
    shares = np.random.default_rng(0).dirichlet(np.full(len(points), 0.3), SAMPLES)
    inner = np.vstack([points.mean(axis=0), shares @ points])
    far = inner[surface.distance(inner) > 1.02 * radius]
    outside = len(far) > 0 and np.any(winding(mesh.vertices, mesh.faces, far) < 0.5)
    return None if outside else points


def to_manifold(mesh: Mesh) -> Any:
    """A mesh as a solid of manifold3d, whose `status` says whether it is one."""
    import manifold3d

    return manifold3d.Manifold(manifold3d.Mesh64(np.array(mesh.vertices), mesh.faces.astype(np.uint64)))


def from_manifold(solid: Any, mesh: Mesh) -> Mesh:
    """The mesh of a solid of manifold3d, named as the one it was made of; that one where nothing closed is left."""
    import manifold3d

    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        return mesh
    made = solid.to_mesh64()
    found = merge_vertices(mesh.name, np.array(made.vert_properties)[:, :3], np.array(made.tri_verts).astype(np.int64))
    return found if found.is_watertight else mesh
