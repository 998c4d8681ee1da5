"""Loads triangle meshes and checks whether they can be used for collision.

trimesh parses the bytes and never gets a path: files are read here, of an allowed format and size, and references
(materials, textures, other folders) are not followed. Errors name the mesh and never quote its content.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.scene.collada_file import ColladaFile, check_collada
from geomphys.scene.gltf_file import BufferResolver, gltf_problem
from geomphys.scene.mesh_header import (
    announced_faces,
    is_ascii_stl,
    mesh_problem,
    stl_count,
    without_many_materials,
    without_trailer,
)
from geomphys.scene.shells import all_enclose_volume, outward_shells, shell_labels, shell_volumes
from geomphys.scene.source_files import path_exists, track_contents
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SUFFIXES = ("stl", "obj", "dae", "glb", "gltf", "ply", "off")
MAX_FILE_BYTES = 128 * 2**20
"""bytes"""
MAX_TRIANGLES = 500_000
"""triangles"""
MAX_HULL_VERTICES = 10_000
"""vertices of the convex hull of a collision mesh"""
MAX_INVERTED_SHELLS = 2_000
"""shells of a mesh that are inside out: whether one is a cavity takes time with the number of all triangles"""
CONVEX_TOLERANCE = 1e-6
"""Share of the mesh's size: a mesh within this distance of its hull is convex."""
FLAT_TOLERANCE = 1e-9
"""Share of the mesh's size: a thinner mesh counts as flat."""

# exceptions of the parsers on malformed files
_PARSER_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    ImportError,
    LookupError,
    MemoryError,
    NameError,
    OSError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
)


class _Hull(NamedTuple):
    corners: Ints  # (k,) vertices on it, ascending
    planes: Floats  # (f, 4) n·x + d <= 0 inside
    volume: float  # m³
    area: float  # m²


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the frame of its body, vertices merged. Arrays are read-only."""

    name: str  # name in error messages
    vertices: Floats  # (n, 3) m
    faces: Ints  # (m, 3)

    @cached_property
    def size(self) -> float:
        """Longest side of the bounding box, m."""
        return float(np.ptp(self.vertices, axis=0).max())

    @cached_property
    def hull_vertices(self) -> Floats:
        """Vertices (k, 3) of the convex hull, in the order of `vertices`; MeshError if the mesh is flat."""
        return self.vertices[self._hull.corners]

    @property
    def hull_planes(self) -> Floats:
        """Planes (f, 4) of the triangles of the convex hull, n·x + d <= 0 inside; MeshError if the mesh is flat."""
        return self._hull.planes

    @cached_property
    def _hull(self) -> _Hull:
        from scipy.spatial import ConvexHull, QhullError

        flat = f"{self.name}: the mesh is flat, it has no volume to collide with: use a box of some thickness"
        centred = self.vertices - self.vertices.mean(axis=0)
        if np.linalg.svd(centred, compute_uv=False)[-1] <= FLAT_TOLERANCE * self.size * np.sqrt(len(centred)):
            raise MeshError(flat)
        try:
            hull = ConvexHull(self.vertices)
        except QhullError:
            raise MeshError(flat) from None
        if len(hull.vertices) > MAX_HULL_VERTICES:
            raise MeshError(
                f"{self.name}: its convex hull has {len(hull.vertices)} corners, at most {MAX_HULL_VERTICES} can collide: "
                "simplify the mesh"
            )
        return _Hull(np.sort(hull.vertices).astype(np.int64), np.asarray(hull.equations), hull.volume, hull.area)

    @cached_property
    def is_convex(self) -> bool:
        """Whether the whole mesh lies on its convex hull, within `CONVEX_TOLERANCE` of the size.

        Vertices alone do not decide: those of an L-shape all lie on its hull. So a closed mesh must also have the
        volume of its hull, and an open one must have all face centroids on it. A convex mesh is replaced by its hull.
        """
        is_interior = np.ones(len(self.vertices), dtype=bool)
        is_interior[self._hull.corners] = False
        if not self._lies_on_hull(self.vertices[is_interior]):
            return False
        if self.is_closed:
            return abs(self._hull.volume - abs(self.signed_volume)) <= CONVEX_TOLERANCE * self.size * self._hull.area
        return self._lies_on_hull(self.vertices[self.faces].mean(axis=1))

    def _lies_on_hull(self, points: Floats) -> bool:
        planes, slack = self._hull.planes, CONVEX_TOLERANCE * self.size
        start, length, max_block = 0, 64, max(1, 4_000_000 // len(planes))
        while start < len(points):
            block = points[start : start + min(length, max_block)]
            if np.min(np.max(block @ planes[:, :3].T + planes[:, 3], axis=1)) <= -slack:
                return False
            start, length = start + len(block), 2 * length
        return True

    @cached_property
    def is_watertight(self) -> bool:
        """Whether every edge belongs to exactly two triangles."""
        edges = self._edges()
        low, high = edges.min(axis=1), edges.max(axis=1)
        return bool(np.all(np.unique(low * len(self.vertices) + high, return_counts=True)[1] == 2))

    @cached_property
    def is_closed(self) -> bool:
        """Whether it is watertight, or consists of touching watertight shells that enclose volume (`shell_labels`)."""
        if self.is_watertight:
            return True
        label = shell_labels(self.vertices, self.faces)
        return label is not None and all_enclose_volume(self.vertices, self.faces, label)

    def shells(self) -> list[Mesh]:
        """The closed shells of a closed mesh, in the order of their first vertices; itself if it is a single shell."""
        label = shell_labels(self.vertices, self.faces)
        if label is None or label.max() == 0:
            return [self]
        return [merge_vertices(self.name, self.vertices, self.faces[label == k]) for k in range(int(label.max()) + 1)]

    @cached_property
    def has_consistent_winding(self) -> bool:
        """Whether adjacent triangles have the same orientation: no directed edge occurs twice."""
        edges = self._edges()
        return len(np.unique(edges[:, 0] * len(self.vertices) + edges[:, 1])) == len(edges)

    def _edges(self) -> Ints:
        return self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)

    @cached_property
    def signed_volume(self) -> float:
        """Enclosed volume of a closed mesh, m³: positive if triangles are counter-clockwise seen from outside."""
        shift = self.vertices.mean(axis=0)
        a, b, c = (self.vertices[self.faces[:, k]] - shift for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def load_mesh(path: AnyPath, scale: float | Floats = 1.0, name: str | None = None) -> Mesh:
    """Read a mesh file: all its parts in one mesh, scaled, equal vertices merged, degenerate triangles dropped.

    The unit of a COLLADA file is applied; glTF is in metres; other formats have no unit and are taken as metres. The
    up axis that a file names is ignored.

    Parameters
    ----------
    path
        A local file whose suffix is one of `SUFFIXES`.
    scale
        One factor or three, applied to the coordinates in m.
    name
        Name of the mesh in error messages; default: the path.

    Raises
    ------
    MeshError
        Missing, too large, unreadable, cut off, empty, without area, NaN or infinite vertices, too many triangles.
    """
    name = name or str(path)
    vertices, faces = _parse(_read_mesh_file(path, name), path, name)
    if len(faces) == 0 or len(vertices) == 0:
        points = f", only {len(vertices)} points" if len(vertices) else ""
        raise MeshError(f"{name}: holds no triangles{points}: save it as a triangle mesh")
    if len(faces) > MAX_TRIANGLES:
        raise MeshError(
            f"{name}: has {len(faces)} triangles, at most {MAX_TRIANGLES} are read: "
            'simplify it, or replace it by its hull first (decomposition = "hull" then gives the same)'
        )
    if not np.isfinite(vertices).all():
        raise MeshError(f"{name}: has vertices that are NaN or infinite: repair the file")
    with np.errstate(over="ignore"):
        vertices = vertices * np.asarray(scale, dtype=np.float64)
    if np.abs(vertices).max() > 1e6:
        raise MeshError(f"{name}: reaches further than 1000 km from its origin: check scale and units")
    return merge_vertices(name, vertices, faces)


def merge_vertices(name: str, vertices: Floats, faces: Ints) -> Mesh:
    """A mesh with vertices equal within 1e-8 m merged, and degenerate and duplicate triangles removed.

    Raises MeshError if no triangle has an area.
    """
    first, inverse = _unique_rows(np.round(vertices * 1e8))
    order = np.argsort(first, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    faces = rank[inverse[faces]]
    vertices = vertices[first[order]] + 0.0
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    if len(faces) == 0 or not np.any(_doubled_areas(vertices, faces) > 0):
        raise MeshError(f"{name}: all its triangles have zero area: check scale and units")
    faces = _without_duplicates(faces, len(vertices))
    used, index = np.unique(faces, return_inverse=True)
    mesh = Mesh(name, np.ascontiguousarray(vertices[used]), np.ascontiguousarray(index.reshape(faces.shape), np.int64))
    mesh.vertices.flags.writeable = mesh.faces.flags.writeable = False
    return mesh


def _without_duplicates(faces: Ints, count: int) -> Ints:
    """Triangles (m, 3) without duplicates of the same orientation; `count` is the number of vertices."""
    lead = faces.argmin(axis=1)
    a, b, c = (faces[np.arange(len(faces)), (lead + k) % 3] for k in range(3))
    _, first = np.unique((a * count + b) * count + c, return_index=True)
    return faces if len(first) == len(faces) else faces[np.sort(first)]


def _unique_rows(rows: Floats) -> tuple[Ints, Ints]:
    """Index (u,) of the first of each group of equal rows (n, 3), and the group (n,) of each row."""
    kind = np.zeros(len(rows), dtype=np.int64)
    first = np.zeros(1, dtype=np.int64)
    for column in rows.T:
        values, index = np.unique(column, return_inverse=True)
        _, first, kind = np.unique(kind * len(values) + index, return_index=True, return_inverse=True)
    return first, kind


def _doubled_areas(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas: Floats = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return areas


def _read_mesh_file(path: AnyPath, name: str) -> bytes:
    suffix = path.suffix.lower().removeprefix(".")
    if suffix not in SUFFIXES:
        kinds = ", ".join(SUFFIXES)
        raise MeshError(f"{name}: not a mesh file that is read here, expected a name that ends in one of {kinds}")
    try:
        if not path.is_file():
            path_exists(path)
            missing = (
                "no such file; paths are relative to the file that names the mesh"
                if not path.exists()
                else "is not a file"
            )
            raise MeshError(f"{name}: {missing}")
        if path.stat().st_size > MAX_FILE_BYTES:
            raise MeshError(f"{name}: is larger than {MAX_FILE_BYTES // 2**20} MiB: simplify the mesh")
        data = track_contents(path, path.read_bytes())
    except OSError as error:
        raise MeshError(f"{name}: cannot be read: {error.strerror}") from error
    except ValueError:
        raise MeshError(f"{name}: is not a path") from None
    return data


def _parse(data: bytes, path: AnyPath, name: str) -> tuple[Floats, Ints]:
    import trimesh

    suffix = path.suffix.lower().removeprefix(".")
    problem, unit = mesh_problem(data, suffix), 1.0
    if problem:
        raise MeshError(f"{name}: {problem}")
    if suffix == "stl" and not is_ascii_stl(data):
        if (count := stl_count(data)) > MAX_TRIANGLES:
            raise MeshError(f"{name}: has {count} triangles, at most {MAX_TRIANGLES} are read: simplify it")
        data = without_trailer(data)
    if suffix == "obj":
        data = without_many_materials(data)
    if suffix == "dae":
        unit, problem = _check_collada(data, name)
    if suffix in ("gltf", "glb"):
        try:
            problem = gltf_problem(data, suffix, 3 * MAX_TRIANGLES)
        except (*_PARSER_ERRORS, RecursionError) as error:
            raise MeshError(f"{name}: {_unreadable(suffix, error)}") from None
    if problem:
        raise MeshError(f"{name}: {problem}")
    parser_errors: tuple[type[Exception], ...] = _PARSER_ERRORS
    if suffix == "dae":
        try:
            from collada.common import DaeError  # type: ignore[import-untyped]
        except ImportError:
            raise MeshError(f"{name}: a .dae mesh needs the package pycollada: install it, or convert to glb") from None
        parser_errors = (*parser_errors, DaeError)
    resolver: Any = BufferResolver(path.parent, MAX_FILE_BYTES)
    try:
        with np.errstate(all="ignore"):
            loaded: Any = trimesh.load(
                BytesIO(data), file_type=suffix, resolver=resolver, process=False, skip_materials=True
            )
            if isinstance(loaded, trimesh.Scene):
                loaded = loaded.to_mesh() if len(loaded.geometry) else None
            if not isinstance(loaded, trimesh.Trimesh):
                points = len(getattr(loaded, "vertices", ()))
                raise MeshError(f"{name}: holds no triangles" + (f", only {points} points" if points else ""))
            vertices = unit * np.array(loaded.vertices, dtype=np.float64).reshape(-1, 3)
            faces = np.array(loaded.faces, dtype=np.int64).reshape(-1, 3)
    except FileNotFoundError:
        raise MeshError(
            f"{name}: names a buffer that is no .bin file beside it; nothing else is read: save it as .glb"
        ) from None
    except parser_errors as error:
        raise MeshError(f"{name}: {_unreadable(suffix, error)}") from None
    if len(faces) < (announced := announced_faces(data, suffix)):
        raise MeshError(f"{name}: is cut off: {announced} faces announced, {len(faces)} there: fetch or save it again")
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise MeshError(f"{name}: a triangle names a vertex that is not there: repair the file")
    return vertices, faces


def _unreadable(suffix: str, error: Exception) -> str:
    """Error text for a file that a parser rejected."""
    return f"is not a readable .{suffix} mesh ({type(error).__name__}): it may be cut off or of another kind; save it again"


def _check_collada(data: bytes, name: str) -> ColladaFile:
    """Unit and problem of a COLLADA file; MeshError for entities, malformed XML or an invalid unit."""
    from xml.etree.ElementTree import ParseError

    try:
        return check_collada(data, 2 * MAX_TRIANGLES)
    except (ParseError, ValueError, LookupError) as error:
        raise MeshError(f"{name}: {_unreadable('dae', error)}") from None


def require_closed(mesh: Mesh) -> None:
    """Raise MeshError unless the mesh is convex or closed (`Mesh.is_closed`)."""
    if not (mesh.is_convex or mesh.is_closed):
        raise MeshError(
            f"{mesh.name}: is neither watertight nor convex, so it encloses no volume: "
            'close its holes, or use decomposition = "hull" (its convex hull)'
        )


def oriented_outwards(mesh: Mesh) -> Mesh:
    """A closed mesh with triangles counter-clockwise seen from outside; the same object if they are already.

    Inconsistently oriented triangles are flipped, then the whole mesh if it is inside out, then each inside-out shell
    that is not inside another shell (a cavity).
    """
    if not mesh.has_consistent_winding and mesh.is_watertight:
        import trimesh

        solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        fix_normals: Any = trimesh.repair.fix_normals
        fix_normals(solid, multibody=True)
        return Mesh(mesh.name, mesh.vertices, np.array(solid.faces, dtype=np.int64))
    faces = mesh.faces if mesh.signed_volume >= 0 else np.ascontiguousarray(mesh.faces[:, ::-1])
    label = shell_labels(mesh.vertices, faces)
    if (
        label is not None
        and label.max() > 0
        and (inverted := int(np.sum(shell_volumes(mesh.vertices, faces, label) < 0)))
    ):
        if inverted > MAX_INVERTED_SHELLS:
            raise MeshError(
                f"{mesh.name}: has {inverted} parts that are inside out, at most {MAX_INVERTED_SHELLS} are turned"
            )
        faces = outward_shells(mesh.vertices, faces, label)
    return mesh if faces is mesh.faces else Mesh(mesh.name, mesh.vertices, faces)
