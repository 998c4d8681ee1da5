"""Decomposes the meshes of a file into convex pieces, as a replay does, and writes them as mesh files."""

from __future__ import annotations

import colorsys
import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from geomphys.errors import OutputError, SceneError
from geomphys.scene.decomposition import Decomposed, DecompositionTask, Progress, decompose_all
from geomphys.scene.meshes import load_mesh
from geomphys.scene.scene_file import load_scene_file
from geomphys.scene.scene_values import Decomposition
from geomphys.scene.skeleton import load_skeleton
from geomphys.scene.source_files import tracked_sources
from geomphys.scene.urdf_file import MeshShape
from geomphys.storage.output_file import is_standard_output, write_file
from geomphys.storage.remote_files import AnyPath

FORMATS = (".glb", ".obj", ".ply", ".stl")
"""Suffixes of the formats of `write_pieces`."""


class MeshUse(NamedTuple):
    """A mesh file with its scale and decomposition method."""

    path: AnyPath
    scale: tuple[float, float, float]  # file units to m
    method: Decomposition


@dataclass(frozen=True, kw_only=True, eq=False)
class DecomposedMesh:
    """A mesh and its convex pieces."""

    path: AnyPath
    scale: tuple[float, float, float]
    triangles: int
    pieces: Decomposed
    source_files: tuple[AnyPath, ...]
    """All files that were read of the file it was named in."""

    def as_dict(self) -> dict[str, Any]:
        """The mesh as plain values, as in `MeshRecord`."""
        record = MeshRecord(
            mesh=str(self.path),
            scale=self.scale,
            triangles=self.triangles,
            method=self.pieces.method,
            pieces=len(self.pieces.hulls),
            vertices=tuple(len(hull) for hull in self.pieces.hulls),
            threshold=self.pieces.threshold,
            seed=self.pieces.seed,
            uncovered_m=self.pieces.uncovered_m,
            seconds=self.pieces.seconds,
            cached=self.pieces.cached,
        )
        return dataclasses.asdict(record)


@dataclass(frozen=True, kw_only=True)
class MeshRecord:
    """A `DecomposedMesh` as it is in JSON; its fields are those of `Decomposed`."""

    mesh: str  # path
    scale: tuple[float, float, float]  # file units to m
    triangles: int
    method: str  # "hull", "parts" or "coacd"
    pieces: int
    vertices: tuple[int, ...]  # of each piece
    threshold: float
    seed: int
    uncovered_m: float
    seconds: float
    cached: bool


MeshRecords = tuple[MeshRecord, ...]
"""What ``geomphys decompose --json`` prints."""


def meshes_of_file(path: AnyPath) -> list[MeshUse]:
    """Return the meshes of a file: a mesh itself, or the collision meshes of a scene file (.toml) or URDF.

    Raises SceneError or ModelError if the file is wrong.
    """
    if path.suffix.lower() == ".urdf":
        return _meshes_of_urdf(path, "auto")
    if path.suffix.lower() != ".toml":
        return [MeshUse(path, (1.0, 1.0, 1.0), "auto")]
    scene = load_scene_file(path)
    uses: list[MeshUse] = []
    for avatar in scene.avatar:
        uses += _meshes_of_urdf(path.parent / avatar.urdf, avatar.decomposition)
    for table in scene.object:
        if table.urdf is not None:
            uses += _meshes_of_urdf(path.parent / table.urdf, table.decomposition)
        elif table.mesh is not None:
            uses.append(MeshUse(path.parent / table.mesh, (table.scale,) * 3, table.decomposition))
    if not uses:
        raise SceneError(f"{path}: collides with no mesh, only with exact shapes; there is nothing to decompose")
    return list(dict.fromkeys(uses))


def _meshes_of_urdf(path: AnyPath, method: Decomposition) -> list[MeshUse]:
    """Return the meshes of a URDF's collision geometry."""
    shapes = [geometry.shape for link in load_skeleton(path).links for geometry in link.collisions]
    return [MeshUse(shape.path, shape.scale, method) for shape in shapes if isinstance(shape, MeshShape)]


def decompose_file(
    path: AnyPath, *, threshold: float | None = None, seed: int = 0, progress: Progress | None = None
) -> tuple[DecomposedMesh, ...]:
    """Decompose the meshes of a file into convex pieces, as a replay does; results are cached.

    Parameters
    ----------
    path
        A mesh, a scene file (.toml) or a URDF.
    threshold
        Concavity a piece may keep, of half the longest side; a replay takes the default, 2 %, but 1 to 5 mm.
    seed
        Of CoACD's search.
    progress
        Called with what is being done and the share of it that is done.

    Raises
    ------
    SceneError, ModelError, MeshError
        The file or a mesh is wrong, or a mesh cannot be decomposed.
    """
    with tracked_sources() as sources:
        uses = meshes_of_file(path)
        meshes = [DecompositionTask(load_mesh(use.path, np.array(use.scale)), use.method) for use in uses]
    read = tuple(sources.contents)
    cut = decompose_all(meshes, threshold=threshold, seed=seed, progress=progress)
    return tuple(
        DecomposedMesh(path=use.path, scale=use.scale, triangles=len(mesh.faces), pieces=pieces, source_files=read)
        for use, (mesh, _), pieces in zip(uses, meshes, cut, strict=True)
    )


def write_pieces(pieces: Decomposed, out: AnyPath, *, force: bool = False, inputs: Iterable[AnyPath] = ()) -> None:
    """Write convex pieces as a mesh file, each in its own colour, in metres; ``-``: a GLB on standard output.

    Raises OutputError for a suffix that is none of `FORMATS`, a file that exists without `force` or is one of `inputs`,
    a full disk.
    """
    import trimesh

    kind = "glb" if is_standard_output(out) else out.suffix.lower().removeprefix(".")
    if f".{kind}" not in FORMATS:
        raise OutputError(f"{out}: pieces are written as {', '.join(FORMATS)}; choose a name that ends so")
    scene = trimesh.Scene()
    for k, corners in enumerate(pieces.hulls):
        hull = trimesh.convex.convex_hull(corners)
        red, green, blue = colorsys.hsv_to_rgb((k * 0.6180339887498949) % 1.0, 0.55, 0.95)
        hull.visual.face_colors = [round(255 * red), round(255 * green), round(255 * blue), 255]
        scene.add_geometry(hull, node_name=f"piece_{k}", geom_name=f"piece_{k}")
    data = scene.export(file_type=kind)  # type: ignore[no-untyped-call]
    write_file(out, data.encode() if isinstance(data, str) else data, force=force, inputs=inputs)
