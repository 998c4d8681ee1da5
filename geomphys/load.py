"""From a scene file to the world of a replay."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geomphys.collision.penetration import make_scratch, separation
from geomphys.errors import ConfigError
from geomphys.jit.packed_records import pack
from geomphys.numerics.transforms import compose, frame_from_matrix, matrix_from_frame
from geomphys.scene.arrays import Floats, World
from geomphys.scene.assembly import assemble, exclude
from geomphys.scene.decomposition import Progress
from geomphys.scene.scene_cache import find_world, keep_world
from geomphys.scene.scene_file import load_scene_file
from geomphys.scene.source_files import noted_sources
from geomphys.storage.remote_files import as_path, is_remote

CLOSE = 5e-6
"""m; bodies nearer than this in the zero pose count as overlapping there: no clearance could be kept between them."""


def load_world(path: Path | str, *, mode: str | None = None, seed: int = 0, progress: Progress | None = None) -> World:
    """Read a scene file and everything it names.

    Parameters
    ----------
    path
        The scene file; the paths in it are relative to it.
    mode
        ``rigid`` or ``chains`` for all avatars; None leaves it to the file. An avatar in chains mode without chains in
        the file gets those of `geomphys.scene.chains.suggested_chains`.
    seed
        Of the convex decomposition.
    progress
        Called with what is being done and the share of it that is done, where something takes long.

    Raises
    ------
    SceneError, ModelError, MeshError
        The scene file, a URDF or a mesh is wrong: which, where in it, what is expected.
    ConfigError
        An unknown mode.
    """
    if mode not in (None, "rigid", "chains"):
        raise ConfigError(f"mode = {mode!r}: expected rigid or chains")
    path = as_path(path)
    is_local = not is_remote(path)
    kept = find_world(path, mode, seed) if is_local else None
    if kept is not None:
        return kept
    with noted_sources() as sources:
        world = _load(path, mode, seed, progress)
    if is_local:
        keep_world(world, sources, mode, seed)
    return world


def _load(path: Path, mode: str | None, seed: int, progress: Progress | None) -> World:
    world = assemble(load_scene_file(path), path, mode=mode, seed=seed, progress=progress)
    return exclude(world, zero_pose_overlaps(world))


def zero_pose_overlaps(world: World) -> list[tuple[int, int]]:
    """Pairs a < b of bodies of one avatar nearer than `CLOSE` with all angles zero, without those excluded."""
    pieces = world.scene.pieces
    poses = _zero_poses(world)
    frames = np.ascontiguousarray(frame_from_matrix(compose(poses[pieces.body], matrix_from_frame(pieces.local))))
    packed, scratch, no_axis = pack(pieces), pack(make_scratch()), (0.0, 0.0, 0.0)
    found: dict[tuple[int, int], bool] = {}
    for i, j in _candidates(world, frames):
        pair = (int(pieces.body[i]), int(pieces.body[j]))
        if not found.get(pair, False):
            found[pair] = separation(packed, frames, i, j, CLOSE, no_axis, scratch)[0] < CLOSE
    return sorted(pair for pair, close in found.items() if close)


def _candidates(world: World, frames: Floats) -> Iterator[tuple[int, int]]:
    """Pairs i < j of pieces of one avatar whose bounding balls touch, of bodies that are not excluded."""
    scene = world.scene
    pieces, excluded = scene.pieces, scene.excluded
    centres = np.einsum("pij,pj->pi", frames[:, :9].reshape(-1, 3, 3), pieces.centre) + frames[:, 9:]
    for tree in range(world.avatar_count):
        first, last = scene.bodies.piece_start[scene.trees.body_start[tree : tree + 2]]
        for i in range(first, last):
            other = slice(i + 1, last)
            away = np.linalg.norm(centres[other] - centres[i], axis=1)
            near = away <= pieces.reach[other] + pieces.reach[i] + CLOSE
            near &= excluded[pieces.body[i], pieces.body[other]] == 0
            for j in np.flatnonzero(near):
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
