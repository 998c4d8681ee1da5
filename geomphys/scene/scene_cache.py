"""Worlds kept between runs: reading and checking meshes and their hulls takes longer than many a replay.

A world is found again by the name of its scene file and what it is read with. It is taken if every file it was made of
has the same bytes as then, and so has the package.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from geomphys.scene.arrays import World
from geomphys.scene.source_files import Sources
from geomphys.storage.cache import Store, sources, user_cache_folder

MAX_WORLDS = 100
"""Worlds; the oldest give way."""
LIBRARIES = ("coacd", "numpy", "scipy", "trimesh", "yourdfpy")
"""Those that bear on a world."""
SEARCH_PATH_VARIABLES = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH")
"""Variables that say where files are looked for."""


def load_cached_world(path: Path, mode: str | None, seed: int) -> World | None:
    """Return the world of a scene file as it was kept; None if there is none, or one of its files is not as it was."""
    cached: tuple[World, Sources] | None = _store().load(_cache_key(path, mode, seed))
    return cached[0] if cached is not None and cached[1].are_unchanged() else None


def cache_world(world: World, sources_of_world: Sources, mode: str | None, seed: int) -> None:
    """Keep a world for the next run, if it is made of more than its scene file and nothing of it was missing."""
    if len(sources_of_world.contents) < 2 or world.findings.not_shown:
        return
    store = _store()
    store.save(_cache_key(world.path, mode, seed), (world, sources_of_world))
    with suppress(OSError):  # another process was faster, or nothing can be written
        for oldest in sorted(store.folder.iterdir(), key=lambda file: file.stat().st_mtime)[:-MAX_WORLDS]:
            oldest.unlink(missing_ok=True)


def _store() -> Store:
    return Store(user_cache_folder("worlds"))


def _cache_key(path: Path, mode: str | None, seed: int) -> str:
    search_paths = [os.environ.get(name) for name in SEARCH_PATH_VARIABLES]
    text = f"{_version()} {path.absolute()} {path} {mode} {seed} {search_paths}"
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


@lru_cache(maxsize=1)
def _version() -> str:
    """All that makes other worlds of the same files."""
    digest = hashlib.sha256(" ".join(version(name) for name in LIBRARIES).encode())
    for name, text in sources().items():
        digest.update(f"{name}\0{len(text)}\0".encode() + text)
    return digest.hexdigest()
