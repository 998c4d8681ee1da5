"""Assembles the `World` of a scene file: reads models and meshes, lays all bodies out in the kernels' flat arrays."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from geomphys.errors import SceneError
from geomphys.numerics.transforms import frame_from_matrix
from geomphys.scene.arrays import (
    DRIVEN,
    FIXED,
    JOINT_FIXED,
    JOINT_PRISMATIC,
    JOINT_REVOLUTE,
    Bodies,
    Chains,
    Dofs,
    ReachCones,
    Scene,
    Trees,
)
from geomphys.scene.body_geometry import GeometryLoader
from geomphys.scene.chains import link_index
from geomphys.scene.decomposition import Progress
from geomphys.scene.findings import Findings, NotShown
from geomphys.scene.frame_ids import make_frame_ids_unique
from geomphys.scene.joint_sources import joint_sources, keypoint_sources
from geomphys.scene.materials import MaterialTable, material_table
from geomphys.scene.pieces import PosedShape, build_pieces
from geomphys.scene.scene_facts import facts_of
from geomphys.scene.scene_file import AvatarTable, Coupling, ObjectTable, SceneFile
from geomphys.scene.topic_sources import RootSource
from geomphys.scene.trees import Tree, TreeBody, read_avatar, read_object
from geomphys.scene.unit_warnings import unit_warnings
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath

Floats = NDArray[np.float64]

MAX_BODIES = 5000
"""Limit on objects and links together."""
MAX_DRIVEN_DOFS = 3000
"""Limit on corrected degrees of freedom: 3 for each driven object or avatar, 1 for each joint of an avatar in chains mode."""
_JOINTS = {"fixed": JOINT_FIXED, "revolute": JOINT_REVOLUTE, "continuous": JOINT_REVOLUTE, "prismatic": JOINT_PRISMATIC}


def assemble(
    file: SceneFile,
    path: AnyPath,
    *,
    mode: str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    surfaces_only: bool = False,
) -> World:
    """Read everything a scene file names and build its `World`.

    With `surfaces_only` the convex pieces of meshes are their hulls: enough to show a world or to test its triangles.

    `Scene.excluded` holds links joined directly and `ignore_pairs`; pairs that overlap in the zero pose are added by
    `exclude_pairs`.

    Raises
    ------
    SceneError, ModelError, MeshError
        With the file, the key or element, and the value that is wrong.
    """
    loader = GeometryLoader(seed, progress, surfaces_only)
    prefix_frames = len(file.avatar) > 1
    trees = [read_avatar(a, path, loader, prefix_frames, mode or a.mode) for a in file.avatar]
    trees += [read_object(o, path, loader) for o in file.object]
    bodies = [body for tree in trees for body in tree.bodies]
    renamed = make_frame_ids_unique(trees)
    _check_size(trees, bodies, path)
    material_pairs = material_table(file.material_pair)
    material_pairs.require_known(path, ((t.material, t.name) for t in trees))
    table, default_pairs = material_pairs.with_defaults(path, _possible_contacts(trees))
    body_start = _start_offsets(len(t.bodies) for t in trees)
    dof_start = _start_offsets(0 if t.skeleton is None else len(t.skeleton.dof_names) for t in trees)
    avatar_bodies = int(body_start[len(file.avatar)])
    chains = _chains(trees, body_start)
    scene = Scene(
        gravity=np.array(file.scene.gravity, dtype=np.float64),
        pieces=build_pieces([PosedShape(s, local, k) for k, b in enumerate(bodies) for s, local in b.geometry.pieces]),
        bodies=_bodies(trees, bodies, table, body_start, dof_start),
        trees=_trees(trees, body_start, dof_start),
        dofs=_dofs(trees, chains, body_start, dof_start),
        chains=chains,
        cones=_cones(trees, body_start),
        materials=table.pairs,
        excluded=_excluded(trees, body_start, avatar_bodies, path),
        initial_velocity=_velocities(trees, body_start),
    )
    return World(
        facts=facts_of(file),
        parsed_file=file,
        path=path,
        scene=scene,
        tree_names=tuple(t.name for t in trees),
        body_names=tuple(b.name for b in bodies),
        frame_names=tuple(b.frame for b in bodies),
        dof_names=tuple(n for t in trees if t.skeleton is not None for n in t.skeleton.dof_names),
        avatar_count=len(file.avatar),
        roots=tuple(
            RootSource(tree=k, topic=t.topic, position=t.pose[0], orientation=t.pose[1], delay=t.delay)
            for k, t in enumerate(trees)
            if t.topic is not None
        ),
        joints=tuple(joint_sources(trees, dof_start, path)),
        keypoints=tuple(keypoint_sources(trees, path)),
        urdfs={t.name: t.skeleton.path for t in trees if t.skeleton is not None},
        zero_pose_overlaps=(),
        triangles=tuple(b.visual for b in bodies),
        collision_triangles=tuple(b.geometry.triangles for b in bodies),
        findings=Findings(
            not_shown=tuple(
                NotShown(str(t.skeleton.path), reason)
                for t in trees
                if t.skeleton is not None
                for reason in t.not_shown
            ),
            sizes=tuple(unit_warnings(trees)),
            without_collision=tuple(_without_collision(trees)),
            renamed_frames=renamed,
            default_pairs=default_pairs,
        ),
    )


def exclude_pairs(world: World, pairs: Sequence[tuple[int, int]]) -> World:
    """A copy of the world in which pairs (a, b) of avatar bodies that overlap in the zero pose are excluded from collision."""
    excluded = world.scene.excluded.copy()
    for a, b in pairs:
        excluded[a, b] = excluded[b, a] = 1
    return replace(
        world,
        scene=world.scene._replace(excluded=excluded),
        zero_pose_overlaps=tuple((world.body_names[a], world.body_names[b]) for a, b in pairs),
    )


def _check_size(trees: Sequence[Tree], bodies: Sequence[TreeBody], path: AnyPath) -> None:
    """Raise SceneError for too many bodies or driven dofs: memory grows with their square."""
    if len(bodies) > MAX_BODIES:
        raise SceneError(
            f"{path}: has {len(bodies)} bodies (objects and links), at most {MAX_BODIES} are replayed: "
            "leave out what nothing comes near"
        )
    driven = [t for t in trees if t.role == DRIVEN]
    free = 3 * len(driven) + sum(len(t.skeleton.dof_names) for t in driven if t.skeleton is not None and t.in_chains)
    if free > MAX_DRIVEN_DOFS:
        raise SceneError(
            f"{path}: what is driven has {free} degrees of freedom that may yield, at most {MAX_DRIVEN_DOFS} are replayed: "
            "use fewer driven objects, or avatars in rigid mode"
        )


def _possible_contacts(trees: Sequence[Tree]) -> Iterator[tuple[str, str, str, str]]:
    """(material, owner, material, owner) of trees that can come into contact.

    Two trees that are not both fixed, or one avatar in chains mode with self-collision.
    """
    kinds: dict[tuple[str, bool], list[str]] = {}
    for tree in trees:
        if any(b.geometry.pieces for b in tree.bodies):
            kinds.setdefault((tree.material, tree.role == FIXED), []).append(tree.name)
    rows = list(kinds.items())
    for i, ((first, first_fixed), owners) in enumerate(rows):
        if len(owners) > 1 and not first_fixed:
            yield first, owners[0], first, owners[1]
        for (second, second_fixed), others in rows[i + 1 :]:
            if not (first_fixed and second_fixed):
                yield first, owners[0], second, others[0]
    for tree in trees:
        if tree.in_chains and isinstance(tree.table, AvatarTable) and tree.table.self_collision:
            yield tree.material, tree.name, tree.material, tree.name


def _without_collision(trees: Sequence[Tree]) -> Iterator[str]:
    """Names of links that have visuals but no collision geometry."""
    for tree in trees:
        if tree.skeleton is not None:
            for link, body in zip(tree.skeleton.links, tree.bodies, strict=True):
                if link.visuals and not link.collisions:
                    yield body.name


def _bodies(
    trees: Sequence[Tree],
    bodies: Sequence[TreeBody],
    table: MaterialTable,
    body_start: NDArray[np.int64],
    dof_start: NDArray[np.int64],
) -> Bodies:
    count = len(bodies)
    parent, joint, dof = np.full(count, -1), np.full(count, JOINT_FIXED), np.full(count, -1)
    origin = np.tile(frame_from_matrix(np.eye(4)), (count, 1))
    axis = np.tile([1.0, 0.0, 0.0], (count, 1))
    multiplier, offset = np.ones(count), np.zeros(count)
    for t, tree in enumerate(trees):
        if tree.skeleton is None:
            continue
        for k, entry in enumerate(tree.skeleton.joints):
            row = int(body_start[t]) + k
            if entry is None:
                continue
            parent[row], joint[row] = body_start[t] + entry.parent, _JOINTS[entry.type]
            origin[row], axis[row] = frame_from_matrix(entry.parent_from_joint), entry.axis
            if entry.dof >= 0:
                dof[row] = dof_start[t] + entry.dof
                multiplier[row], offset[row] = entry.multiplier, entry.offset
    principal = [b.mass.principal() for b in bodies]
    return Bodies(
        role=np.array([t.role for t in trees for _ in t.bodies], dtype=np.int64),
        tree=np.repeat(np.arange(len(trees)), np.diff(body_start)),
        piece_start=_start_offsets(len(b.geometry.pieces) for b in bodies),
        material=np.array([table.index(t.material) for t in trees for _ in t.bodies], dtype=np.int64),
        mass=np.array([b.mass.mass for b in bodies], dtype=np.float64),
        com=np.array([b.mass.com for b in bodies], dtype=np.float64).reshape(-1, 3),
        inertia=np.array([p[0] for p in principal], dtype=np.float64).reshape(-1, 3),
        principal=np.array([p[1] for p in principal], dtype=np.float64).reshape(-1, 4),
        parent=parent,
        joint=joint,
        origin=origin,
        axis=axis,
        dof=dof,
        multiplier=multiplier,
        offset=offset,
    )


def _trees(trees: Sequence[Tree], body_start: NDArray[np.int64], dof_start: NDArray[np.int64]) -> Trees:
    rest, stiffness, damping, moving, self_collision = [], [], [], [], []
    for tree in trees:
        position, orientation = tree.pose
        rest.append((*position, *orientation) if tree.topic is None else (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
        coupling = tree.table.coupling or Coupling()
        stiffness.append(np.inf if isinstance(coupling, str) else coupling.stiffness)
        damping.append(np.inf if isinstance(coupling, str) else coupling.damping)
        moving.append(int(tree.role != FIXED or tree.topic is not None or tree.table.joints is not None))
        self_collision.append(int(isinstance(tree.table, AvatarTable) and tree.table.self_collision))
    return Trees(
        body_start=body_start,
        dof_start=dof_start,
        role=np.array([t.role for t in trees], dtype=np.int64),
        moving=np.array(moving, dtype=np.int64),
        rest=np.array(rest, dtype=np.float64).reshape(-1, 7),
        mass=np.array([t.mass for t in trees], dtype=np.float64),
        stiffness=np.array(stiffness, dtype=np.float64),
        damping=np.array(damping, dtype=np.float64),
        chains=np.array([t.in_chains for t in trees], dtype=np.int64),
        self_collision=np.array(self_collision, dtype=np.int64),
        effort=np.array([_or_inf(t.table.effort_n) for t in trees], dtype=np.float64),
        squeeze=np.array([t.table.squeeze for t in trees], dtype=np.float64),
    )


def _or_inf(value: float | None) -> float:
    return float(np.inf) if value is None else value


def _chains(trees: Sequence[Tree], body_start: NDArray[np.int64]) -> Chains:
    rows = [(t, links) for t, tree in enumerate(trees) for links in tree.chains]
    return Chains(
        tree=np.array([t for t, _ in rows], dtype=np.int64),
        body_start=_start_offsets(len(links) for _, links in rows),
        bodies=np.array([body_start[t] + k for t, links in rows for k in links], dtype=np.int64),
    )


def _dofs(trees: Sequence[Tree], chains: Chains, body_start: NDArray[np.int64], dof_start: NDArray[np.int64]) -> Dofs:
    lower, upper = np.full(dof_start[-1], -np.inf), np.full(dof_start[-1], np.inf)
    chain, effort = np.full(dof_start[-1], -1, dtype=np.int64), np.full(dof_start[-1], np.inf)
    chain_of_body = {
        int(b): c for c in range(len(chains.tree)) for b in chains.bodies[slice(*chains.body_start[c : c + 2])]
    }
    for t, tree in enumerate(trees):
        if tree.skeleton is None:
            continue
        columns = slice(dof_start[t], dof_start[t + 1])
        lower[columns], upper[columns] = tree.skeleton.lower, tree.skeleton.upper
        for k, joint in enumerate(tree.skeleton.joints):
            if joint is not None and joint.dof >= 0 and joint.mimics is None:
                effort[dof_start[t] + joint.dof] = joint.effort
                chain[dof_start[t] + joint.dof] = chain_of_body.get(int(body_start[t]) + k, -1)
    return Dofs(
        lower=lower, upper=upper, tree=np.repeat(np.arange(len(trees)), np.diff(dof_start)), chain=chain, effort=effort
    )


def _cones(trees: Sequence[Tree], body_start: NDArray[np.int64]) -> ReachCones:
    rows = [(t, cone) for t, tree in enumerate(trees) for cone in tree.cones]
    return ReachCones(
        joint_start=_start_offsets(len(cone.links) for _, cone in rows),
        joints=np.array([body_start[t] + k for t, cone in rows for k in cone.links], dtype=np.int64),
        limb=np.array([cone.limb for _, cone in rows], dtype=np.float64).reshape(-1, 3),
        direction_start=_start_offsets(len(cone.directions) for _, cone in rows),
        directions=np.concatenate([np.zeros((0, 3)), *(cone.directions for _, cone in rows)]),
    )


def _excluded(trees: Sequence[Tree], body_start: NDArray[np.int64], count: int, path: AnyPath) -> NDArray[np.int64]:
    excluded = np.eye(count, dtype=np.int64)
    for t, tree in enumerate(trees):
        if tree.skeleton is None or not isinstance(tree.table, AvatarTable):
            continue
        pairs = sorted(tree.skeleton.neighbours())
        for k, names in enumerate(tree.table.ignore_pairs):
            where = f"{path}: avatar {tree.name!r}: ignore_pairs[{k}]"
            first, second = (link_index(tree.skeleton, name, where) for name in names)
            pairs.append((first, second))
        for a, b in pairs:
            i, j = body_start[t] + a, body_start[t] + b
            excluded[i, j] = excluded[j, i] = 1
    return excluded


def _velocities(trees: Sequence[Tree], body_start: NDArray[np.int64]) -> Floats:
    rows = np.zeros((int(body_start[-1]), 6))
    for t, tree in enumerate(trees):
        if isinstance(tree.table, ObjectTable):
            rows[body_start[t], :3] = tree.table.velocity or 0.0
            rows[body_start[t], 3:] = tree.table.angular_velocity or 0.0
    return rows


def _start_offsets(counts: Iterator[int] | Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(np.fromiter(counts, dtype=np.int64))]).astype(np.int64)
