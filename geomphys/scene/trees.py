"""Reads the avatars and objects of a scene file as trees of bodies, with their URDFs and meshes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geomphys.errors import MeshError, SceneError
from geomphys.scene.arrays import DRIVEN, FIXED, SIMULATED
from geomphys.scene.body_geometry import BodyGeometry, GeometryLoader, ShapeInBody
from geomphys.scene.chains import named_chains, suggested_chains
from geomphys.scene.mass import ZERO_MASS, MassProperties
from geomphys.scene.reach_cone import ReachCone, reach_cone
from geomphys.scene.scene_file import AvatarTable, ObjectTable
from geomphys.scene.scene_values import Decomposition
from geomphys.scene.skeleton import Link, Skeleton, load_skeleton, require_solid
from geomphys.scene.tessellation import Triangles, merge_surfaces
from geomphys.scene.urdf_file import MeshShape
from geomphys.storage.remote_files import AnyPath

DEFAULT_DENSITY = 1000.0
"""kg/m³, where a scene file gives neither density nor mass"""
DRIVEN_MASS = 0.4
"""kg; default mass of a driven object, about that of a hand"""
_ROLES = {"fixed": FIXED, "simulated": SIMULATED, "driven": DRIVEN}


@dataclass(eq=False)
class TreeBody:
    """A body with its names, collision geometry, mass and display mesh."""

    name: str  # name in /contacts
    frame: str  # child frame id of the output
    geometry: BodyGeometry
    mass: MassProperties
    visual: Triangles


@dataclass(eq=False)
class Tree:
    """An avatar or object: its bodies in the order of the links of its skeleton, or one body without a skeleton."""

    name: str
    table: AvatarTable | ObjectTable
    role: int
    material: str
    mass: float  # kg, of the coupling
    bodies: list[TreeBody]
    skeleton: Skeleton | None = None
    chains: list[tuple[int, ...]] = field(default_factory=list)  # links
    cones: list[ReachCone] = field(default_factory=list)
    in_chains: bool = False
    not_shown: list[str] = field(default_factory=list)  # link name and problem of each skipped visual

    @property
    def topic(self) -> str | None:
        """Topic of the root's pose; None for a static root."""
        return self.table.root.topic if isinstance(self.table, AvatarTable) else self.table.topic

    @property
    def delay(self) -> float:
        """s, added to the times of its topic."""
        return self.table.root.delay if isinstance(self.table, AvatarTable) else self.table.delay

    @property
    def pose(self) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
        """Position and orientation: of the root in the world, or in the tracker's frame."""
        source = self.table.root if isinstance(self.table, AvatarTable) else self.table
        return source.position, source.rotation


def read_avatar(table: AvatarTable, path: AnyPath, loader: GeometryLoader, prefix_frames: bool, mode: str) -> Tree:
    """Read an avatar; `prefix_frames`: whether its frame ids start with the avatar's name.

    Mode ``auto`` is ``chains`` where joints move links that collide, else ``rigid``.

    Raises SceneError, ModelError, MeshError.
    """
    where = f"{path}: avatar {table.name!r}"
    skeleton = _skeleton(table.urdf, path, where)
    prefix = f"{table.name}/" if prefix_frames else ""
    bodies, not_shown = _link_bodies(skeleton, table.name, prefix, table.decomposition, loader)
    for body in bodies:
        body.mass = body.geometry.mass.scaled(table.density)
    in_chains = mode == "chains" or (mode == "auto" and skeleton.moves_collisions())
    tree = Tree(
        table.name, table, DRIVEN, table.material, table.mass, bodies, skeleton, in_chains=in_chains,
        not_shown=not_shown,
    )  # fmt: skip
    tree.chains = named_chains(table, skeleton, path) or suggested_chains(skeleton)
    tree.cones = [
        reach_cone(cone, skeleton, f"reach_cone[{k}] of avatar {table.name!r}", path)
        for k, cone in enumerate(table.reach_cone)
    ]
    return tree


def read_object(table: ObjectTable, path: AnyPath, loader: GeometryLoader) -> Tree:
    """Read an object.

    Raises SceneError, ModelError, MeshError.
    """
    where = f"{path}: object {table.name!r}"
    role = _ROLES[table.class_]
    density = DEFAULT_DENSITY if table.density is None else table.density
    if table.urdf is not None:
        skeleton = _skeleton(table.urdf, path, where)
        bodies, not_shown = _link_bodies(skeleton, table.name, f"{table.name}/", table.decomposition, loader)
        for body in bodies:
            body.mass = body.geometry.mass.scaled(density)
        return Tree(table.name, table, role, table.material, 0.0, bodies, skeleton, not_shown=not_shown)
    shape = table.primitive or MeshShape(path.parent / str(table.mesh), (table.scale,) * 3)
    shapes: list[ShapeInBody] = [(shape, np.eye(4))]
    geometry = loader.body_geometry(shapes, table.decomposition, where)
    if geometry.mass.mass == 0.0:
        raise MeshError(f"{where}: {table.mesh} encloses no volume: check its triangles")
    mass = table.mass
    if mass is None and role == DRIVEN and table.density is None:
        mass = DRIVEN_MASS
    solid = geometry.mass.scaled(density) if mass is None else geometry.mass.with_mass(mass)
    body = TreeBody(table.name, table.name, geometry, solid, loader.visual_triangles(shapes, where))
    return Tree(table.name, table, role, table.material, solid.mass, [body])


def _skeleton(urdf: str, path: AnyPath, where: str) -> Skeleton:
    target = path.parent / urdf
    if not target.is_file():
        raise SceneError(f"{where}: urdf = {urdf!r}: no such file ({target}); paths are relative to the scene file")
    skeleton = load_skeleton(target)
    require_solid(skeleton)
    return skeleton


def _link_bodies(
    skeleton: Skeleton, owner: str, prefix: str, method: Decomposition, loader: GeometryLoader
) -> tuple[list[TreeBody], list[str]]:
    """The bodies of a model, and the problems of its skipped visuals."""
    loader.require_closed(
        [(g.shape, link.name) for link in skeleton.links for g in link.collisions], method, skeleton.path
    )
    bodies, not_shown = [], [line.removeprefix(f"{skeleton.path}: ") for line in skeleton.not_shown]
    meshes = [
        (g.shape, method, f"{skeleton.path}: link {link.name!r}")
        for link in skeleton.links
        for g in link.collisions
        if isinstance(g.shape, MeshShape)
    ]
    loader.decompose_meshes(meshes)
    for link in skeleton.links:
        where = f"{skeleton.path}: link {link.name!r}"
        solids = [(g.shape, g.link_from_shape) for g in link.collisions]
        geometry = loader.body_geometry(solids, method, where)
        visual = _visual_triangles(link, where, loader, not_shown)
        bodies.append(TreeBody(f"{owner}/{link.name}", f"{prefix}{link.name}", geometry, ZERO_MASS, visual))
    return bodies, not_shown


def _visual_triangles(link: Link, where: str, loader: GeometryLoader, not_shown: list[str]) -> Triangles:
    """Display mesh of a link: its readable visuals, or its collision geometry if there are none."""
    surfaces = []
    for visual in link.visuals:
        try:
            surfaces.append(loader.visual_triangles([(visual.shape, visual.link_from_shape)], where))
        except MeshError as fault:
            not_shown.append(f"link {link.name!r}: {str(fault).removeprefix(f'{where}: ')}")
    if surfaces:
        return merge_surfaces(surfaces)
    return loader.visual_triangles([(g.shape, g.link_from_shape) for g in link.collisions], where)
