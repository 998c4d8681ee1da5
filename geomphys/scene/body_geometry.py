"""Geometry of bodies: convex pieces for collision, mass properties, triangles for display."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import MeshError
from geomphys.numerics.transforms import apply
from geomphys.scene.decomposition import Decomposed, DecompositionTask, Progress, decompose_all
from geomphys.scene.mass import MassProperties, combined, of_mesh
from geomphys.scene.meshes import Mesh, load_mesh, oriented_outwards
from geomphys.scene.pieces import Hull
from geomphys.scene.pieces import Shape as Convex
from geomphys.scene.scene_values import Decomposition
from geomphys.scene.source_files import path_exists
from geomphys.scene.tessellation import (
    COLLISION_SEGMENTS,
    DISPLAY_SEGMENTS,
    Triangles,
    merge_surfaces,
    triangulate_faces,
)
from geomphys.scene.urdf_file import MeshShape, Shape
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]
ShapeInBody = tuple[Shape, Floats]
"""A shape and body_from_shape (4, 4)."""
MeshUse = tuple[AnyPath, tuple[float, float, float], Decomposition]
"""Cache key: mesh file, scale, decomposition method."""


@dataclass(frozen=True, eq=False)
class BodyGeometry:
    """Collision geometry and mass properties of a body of unit density, body frame."""

    pieces: tuple[tuple[Convex, Floats], ...]  # convex shapes with body_from_piece (4, 4)
    mass: MassProperties  # at 1 kg/m³; overlapping shapes count twice
    triangles: Triangles  # collision surface before convex decomposition


@dataclass(eq=False)
class GeometryLoader:
    """Loads the geometry of bodies; each mesh is read and decomposed once.

    With `surfaces_only` no mesh is decomposed: each has its convex hull as its only piece. Surfaces are as they would be
    otherwise.
    """

    seed: int
    progress: Progress | None = None
    surfaces_only: bool = False
    _meshes: dict[tuple[AnyPath, tuple[float, float, float]], Mesh] = field(default_factory=dict)
    _decompositions: dict[MeshUse, Decomposed] = field(default_factory=dict)
    _solids: dict[MeshUse, tuple[list[Convex], MassProperties, Triangles]] = field(default_factory=dict)

    def body_geometry(self, shapes: Sequence[ShapeInBody], method: Decomposition, name: str) -> BodyGeometry:
        """Collision geometry of a body that consists of these shapes.

        `name` stands for the body in error messages. Raises MeshError.
        """
        pieces: list[tuple[Convex, Floats]] = []
        masses: list[MassProperties] = []
        surfaces: list[Triangles] = []
        for shape, matrix in shapes:
            convex_shapes, mass, surface = self._solid(shape, method, name)
            pieces += [(c, matrix) for c in convex_shapes]
            is_identity = np.array_equal(matrix, np.eye(4))
            masses.append(mass if is_identity else mass.transformed(matrix))
            surfaces.append(surface if is_identity else (apply(matrix, surface[0]), surface[1]))
        mass = masses[0] if len(masses) == 1 else combined(masses)
        return BodyGeometry(tuple(pieces), mass, merge_surfaces(surfaces))

    def visual_triangles(self, shapes: Sequence[ShapeInBody], name: str) -> Triangles:
        """Display triangles of shapes in the body frame; meshes need not be closed. Raises MeshError."""
        surfaces = []
        for shape, matrix in shapes:
            if isinstance(shape, MeshShape):
                mesh = self.mesh(shape, name)
                surface = (mesh.vertices, mesh.faces)
            else:
                surface = shape.kind.triangles(shape.lengths, DISPLAY_SEGMENTS)
            is_identity = np.array_equal(matrix, np.eye(4))
            surfaces.append(surface if is_identity else (apply(matrix, surface[0]), surface[1]))
        return merge_surfaces(surfaces)

    def require_closed(self, shapes: Sequence[tuple[Shape, str]], method: Decomposition, model: AnyPath) -> None:
        """Raise one MeshError for all meshes of a model that are missing or enclose no volume.

        `shapes` are (shape, link name).
        """
        missing: dict[AnyPath, list[str]] = {}
        open_meshes: dict[AnyPath, list[str]] = {}
        count = 0
        for shape, link in shapes:
            if not isinstance(shape, MeshShape):
                continue
            count += 1
            if not path_exists(shape.path):
                missing.setdefault(shape.path, []).append(link)
            elif method != "hull":
                mesh = self.mesh(shape, f"{model}: link {link!r}")
                if not (mesh.is_convex or mesh.is_closed):
                    open_meshes.setdefault(shape.path, []).append(link)
        for found, what, remedy in (
            (missing, "are not there", "paths are relative to the URDF"),
            (
                open_meshes,
                "are neither watertight nor convex, so they enclose no volume",
                'close their holes, or use decomposition = "hull" (their convex hulls)',
            ),
        ):
            if len(found) > 1:
                names = [f"{path if found is missing else path.name} ({', '.join(found[path])})" for path in found]
                total = sum(map(len, found.values()))
                raise MeshError(f"{model}: {total} of {count} collision meshes {what}: {'; '.join(names)}: {remedy}")

    def mesh(self, shape: MeshShape, name: str) -> Mesh:
        """Mesh of a shape, read once. Raises MeshError."""
        key = (shape.path, shape.scale)
        if key not in self._meshes:
            self._meshes[key] = load_mesh(shape.path, np.array(shape.scale), name=f"{name}: {shape.path}")
        return self._meshes[key]

    def decompose_meshes(self, uses: Sequence[tuple[MeshShape, Decomposition, str]]) -> None:
        """Decompose several meshes in parallel, ahead of `body_geometry`; each with its name in error messages.

        Raises MeshError.
        """
        if self.surfaces_only:
            return
        new: dict[MeshUse, tuple[MeshShape, str]] = {}
        for shape, method, name in uses:
            key = (shape.path, shape.scale, method)
            if key not in self._decompositions:
                new.setdefault(key, (shape, name))
        meshes = [DecompositionTask(self.mesh(shape, name), method) for (_, _, method), (shape, name) in new.items()]
        decomposition = decompose_all(meshes, seed=self.seed, progress=self.progress)
        self._decompositions.update(zip(new, decomposition, strict=True))

    def _solid(self, shape: Shape, method: Decomposition, name: str) -> tuple[list[Convex], MassProperties, Triangles]:
        if isinstance(shape, MeshShape):
            key = (shape.path, shape.scale, method)
            if key not in self._solids:
                self._solids[key] = self._mesh_solid(shape, method, name)
            return self._solids[key]
        kind, lengths = shape.kind, shape.lengths
        return [kind.piece(lengths)], kind.mass(lengths, 1.0), kind.triangles(lengths, COLLISION_SEGMENTS)

    def _mesh_solid(
        self, shape: MeshShape, method: Decomposition, name: str
    ) -> tuple[list[Convex], MassProperties, Triangles]:
        mesh = self.mesh(shape, name)
        self.decompose_meshes([(shape, method, name)])
        if self.surfaces_only:
            hulls = [Hull(mesh.hull_vertices)]
        else:
            hulls = [Hull(corners) for corners in self._decompositions[shape.path, shape.scale, method].hulls]
        if mesh.is_closed and (method != "hull" or mesh.is_convex):
            solid = oriented_outwards(mesh)
            surface = (solid.vertices, solid.faces)
        else:  # the collision geometry is the hull
            hull = hulls[0].polytope
            surface = triangulate_faces(hull.vertices, hull.loops, np.concatenate([[0], np.cumsum(hull.loop_count)]))
        return list(hulls), of_mesh(*surface, 1.0), surface
