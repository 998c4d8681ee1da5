"""Loads the world of a replay from a scene file, and excludes body pairs that overlap in the zero pose."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from geomphys.config import Config
from geomphys.errors import ConfigError
from geomphys.numerics.transforms import compose, frame_from_matrix, matrix_from_frame
from geomphys.scene.arrays import Floats
from geomphys.scene.scene_cache import cache_world, load_cached_world
from geomphys.scene.source_files import tracked_sources
from geomphys.scene.world import World
from geomphys.storage.cache import user_cache_folder
from geomphys.storage.output_file import write_file
from geomphys.storage.remote_files import AnyPath, as_path, is_remote

if TYPE_CHECKING:
    from geomphys.scene.decomposition import Progress

ZERO_POSE_CLEARANCE = 5e-6
"""m; bodies closer than this in the zero pose count as overlapping there."""


def load_world(
    path: AnyPath | str,
    *,
    mode: str | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    assembled: Callable[[World], None] | None = None,
) -> World:
    """Read a scene file and everything it names.

    Parameters
    ----------
    path
        The scene file; the paths in it are relative to it.
    mode
        ``rigid``, ``chains`` or ``auto`` (chains where joints move links that collide) for all avatars; None leaves it
        to the file. An avatar without chains in the file gets those of `geomphys.scene.chains.suggested_chains`.
    seed
        Of the convex decomposition.
    progress
        Called with a description and the fraction done while meshes are decomposed.
    assembled
        Called with the world before the pairs that overlap in the zero pose are excluded, if it is not in the cache:
        the first kernels are needed for that.

    Raises
    ------
    SceneError, ModelError, MeshError
        The scene file, a URDF or a mesh is wrong: which, where in it, what is expected.
    ConfigError
        An unknown mode.
    """
    if mode not in (None, "auto", "rigid", "chains"):
        raise ConfigError(f"mode = {mode!r}: expected auto, rigid or chains")
    path = as_path(path)
    is_local = not is_remote(path)
    cached = load_cached_world(path, mode, seed) if is_local else None
    if cached is not None:
        return cached
    with tracked_sources() as sources:
        world = _load(path, mode, seed, progress, assembled)
    world = replace(world, source_files=tuple(sources.contents))
    if is_local:
        cache_world(world, sources, mode, seed)
    return world


def _load(
    path: AnyPath,
    mode: str | None,
    seed: int,
    progress: Progress | None,
    assembled: Callable[[World], None] | None,
) -> World:
    from geomphys.scene.assembly import assemble, exclude_pairs  # a world from the cache needs none of it
    from geomphys.scene.scene_file import load_scene_file

    world = assemble(load_scene_file(path), path, mode=mode, seed=seed, progress=progress)
    if assembled is not None:
        assembled(world)
    return exclude_pairs(world, zero_pose_overlaps(world))


def scaled_to_log(log: AnyPath, world: World, config: Config, *, progress: Progress | None = None) -> World:
    """A world whose avatars that are fitted to points have the bone lengths of a log, and what the palm's orientation says.

    The same world if there are none, or if it is one already.

    Their scaled URDFs are written to a cache folder, under names made of their content.

    Raises LogError, ModelError, MeshError.
    """
    if not world.keypoints or world.keypoint_scale or world.palm_orientations:
        return world
    from geomphys.recording.point_measures import measure_points

    measures = measure_points(log, world, config)
    orientations = {name: m.orientation for name, m in measures.items() if m.orientation is not None}
    if orientations:
        world = replace(world, palm_orientations=orientations)
    scales = {name: m for name, m in measures.items() if m.links}
    if not scales:
        return world
    from geomphys.scene.assembly import assemble, exclude_pairs
    from geomphys.scene.scaled_urdf import scaled_urdf

    folder, file, tables = user_cache_folder("urdfs"), world.file, []
    for table in file.avatar:
        if table.name in scales:
            text = scaled_urdf(world.urdfs[table.name], scales[table.name].links)
            path = folder / f"{hashlib.sha256(text).hexdigest()}.urdf"
            if not path.is_file():
                write_file(path, text, force=True)
            table = table.model_copy(update={"urdf": str(path)})
        tables.append(table)
    file = file.model_copy(update={"avatar": tuple(tables)})
    scaled = assemble(file, world.path, mode=config.mode, seed=config.seed, progress=progress)
    factors = {name: scale.branches for name, scale in scales.items()}
    scaled = replace(
        scaled,
        keypoint_scale=factors,
        palm_orientations=orientations,
        findings=world.findings,  # they name the user's files
        source_files=world.source_files,
    )
    return exclude_pairs(scaled, zero_pose_overlaps(scaled))


def zero_pose_overlaps(world: World) -> list[tuple[int, int]]:
    """Pairs a < b of one avatar's bodies, not yet excluded, closer than `ZERO_POSE_CLEARANCE` at zero joint angles."""
    from geomphys.collision.penetration import make_scratch, separation
    from geomphys.jit.packed_records import pack

    pieces = world.scene.pieces
    poses = _zero_poses(world)
    frames = np.ascontiguousarray(frame_from_matrix(compose(poses[pieces.body], matrix_from_frame(pieces.local))))
    packed, scratch, no_axis = pack(pieces), pack(make_scratch()), (0.0, 0.0, 0.0)
    found: dict[tuple[int, int], bool] = {}
    for i, j in _candidates(world, frames):
        pair = (int(pieces.body[i]), int(pieces.body[j]))
        if not found.get(pair, False):
            found[pair] = (
                separation(packed, frames, i, j, ZERO_POSE_CLEARANCE, no_axis, scratch)[0] < ZERO_POSE_CLEARANCE
            )
    return sorted(pair for pair, close in found.items() if close)


def _candidates(world: World, frames: Floats) -> Iterator[tuple[int, int]]:
    """Pairs i < j of pieces of one avatar whose bounding spheres touch, without excluded body pairs."""
    scene = world.scene
    pieces, excluded = scene.pieces, scene.excluded
    centres = np.einsum("pij,pj->pi", frames[:, :9].reshape(-1, 3, 3), pieces.centre) + frames[:, 9:]
    for tree in range(world.avatar_count):
        first, last = scene.bodies.piece_start[scene.trees.body_start[tree : tree + 2]]
        for i in range(first, last):
            other = slice(i + 1, last)
            distance = np.linalg.norm(centres[other] - centres[i], axis=1)
            close = distance <= pieces.reach[other] + pieces.reach[i] + ZERO_POSE_CLEARANCE
            close &= excluded[pieces.body[i], pieces.body[other]] == 0
            for j in np.flatnonzero(close):
                yield i, int(i + 1 + j)


def _zero_poses(world: World) -> Floats:
    """root_from_body (B, 4, 4) of every body with all angles zero."""
    bodies = world.scene.bodies
    poses = np.tile(np.eye(4), (len(bodies.parent), 1, 1))
    origins = matrix_from_frame(bodies.origin)
    for body, parent in enumerate(bodies.parent):
        if parent >= 0:
            poses[body] = poses[parent] @ origins[body]
    return poses
