"""Disk cache of loaded worlds: reading meshes and computing hulls can take longer than a replay.

The key is the path of the scene file, the load options and the state of the installation. An entry is valid
while every file it was made from has the same content.
"""

from __future__ import annotations

import dataclasses
import hashlib
import os
from contextlib import suppress

from geomphys.scene.arrays import Bodies, Chains, Dofs, Materials, Pieces, ReachCones, Scene, Trees
from geomphys.scene.findings import DefaultPair, Findings, NotShown, RenamedFrame
from geomphys.scene.primitives import PrimitiveShape
from geomphys.scene.scene_facts import ObjectFacts, RecordingFacts, SceneFacts
from geomphys.scene.source_files import Sources, track_sources
from geomphys.scene.topic_sources import JointSource, KeypointSource, RootSource
from geomphys.scene.world import World
from geomphys.storage.cache import Store, installed_state, user_cache_folder
from geomphys.storage.remote_files import AnyPath

MAX_WORLDS = 100
"""Cached worlds; the oldest are removed."""
LIBRARIES = ("coacd", "numpy", "scipy", "trimesh", "yourdfpy")
"""Packages whose version is part of the key."""
RECORDS = (
    World,
    Scene,
    Pieces,
    Bodies,
    Trees,
    Dofs,
    Chains,
    ReachCones,
    Materials,
    RootSource,
    JointSource,
    KeypointSource,
    Findings,
    NotShown,
    RenamedFrame,
    DefaultPair,
    Sources,
    SceneFacts,
    RecordingFacts,
    ObjectFacts,
    PrimitiveShape,
)
"""All records that a world is made of."""
SEARCH_PATH_VARIABLES = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
"""Environment variables with search paths; part of the key."""


def load_cached_world(path: AnyPath, mode: str | None, seed: int) -> World | None:
    """Return the cached world of a scene file; None if there is none or one of its files changed."""
    cached: tuple[World, Sources] | None = _store().load(_cache_key(path, mode, seed))
    if cached is None or not cached[1].are_unchanged():
        return None
    world, sources_of_world = cached
    track_sources(sources_of_world)
    return world


def cache_world(world: World, sources_of_world: Sources, mode: str | None, seed: int) -> None:
    """Cache a world, unless it consists of its scene file alone or visuals were skipped."""
    if len(sources_of_world.contents) < 2 or world.findings.not_shown:
        return
    store = _store()
    stored = dataclasses.replace(world, parsed_file=None)  # it is read again where it is asked for
    store.save(_cache_key(world.path, mode, seed), (stored, sources_of_world))
    with suppress(OSError):  # removed by another process, or read-only
        for oldest in sorted(store.folder.iterdir(), key=lambda file: file.stat().st_mtime)[:-MAX_WORLDS]:
            oldest.unlink(missing_ok=True)


def _store() -> Store:
    return Store(user_cache_folder("worlds"), RECORDS)


def _cache_key(path: AnyPath, mode: str | None, seed: int) -> str:
    search_paths = [os.environ.get(name) for name in SEARCH_PATH_VARIABLES]
    text = f"{installed_state(*LIBRARIES)} {path.absolute()} {path} {mode} {seed} {search_paths}"
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()
