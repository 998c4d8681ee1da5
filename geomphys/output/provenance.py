"""Provenance of an output: hashes of the inputs, the seed and all parameters, stored as its metadata record.

The record ``geomphys`` holds strings: ``version``, ``input_sha256``, ``scene_sha256``, ``world_sha256``, ``seed``,
every field of `Config` under its own name (numbers, true/false and null as in JSON), ``intersection_volume_m3`` and
``complete``; where joint values were fitted to points, ``keypoint_scale``: avatar -> finger or ``palm`` -> factor of its
lengths, as JSON. It holds no wall clock, path or host name, so the same run gives the same bytes.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, cast

import numpy as np

from geomphys.config import Config
from geomphys.errors import LogError, SceneError
from geomphys.scene.arrays import Scene
from geomphys.scene.world import World
from geomphys.storage.remote_files import AnyPath, open_sequential, relative_path
from geomphys.version import __version__

METADATA_RECORD = "geomphys"
MEASURES = ("intersection_volume_m3",)
"""Keys of the record that are results."""
NON_PARAMETER_KEYS = ("version", "input_sha256", "scene_sha256", "world_sha256", *MEASURES, "complete")
"""Keys of the record that are not parameters."""


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of an output. Hashes are SHA-256 in hexadecimal."""

    version: str = __version__
    input_sha256: str
    scene_sha256: str
    """Of the scene file alone."""
    world_sha256: str
    """Of the loaded world: convex pieces, skeletons, masses, materials. Changes with a mesh or a URDF."""
    parameters: dict[str, str] = field(default_factory=dict)
    """Every parameter by name, `seed` among them."""
    files: tuple[AnyPath, ...] = ()
    """Every file that was read, which no output may replace; not in the record."""

    def record(self, *, complete: bool, intersection_volume_m3: float | None = None) -> dict[str, str]:
        """The metadata record.

        `complete` is false if the run ended early. The volume is that common to the two bodies of the deepest recorded overlap;
        None if it is not known.
        """
        volume = (
            {}
            if intersection_volume_m3 is None
            else {"intersection_volume_m3": _parameter_text(intersection_volume_m3)}
        )
        return {
            "version": self.version,
            "input_sha256": self.input_sha256,
            "scene_sha256": self.scene_sha256,
            "world_sha256": self.world_sha256,
            **self.parameters,
            **volume,
            "complete": "true" if complete else "false",
        }


def provenance_of(log: AnyPath, world: World, config: Config) -> Provenance:
    """Provenance of a replay of `log` in `world`; reads the log once to hash it.

    Raises LogError or SceneError if a file cannot be read.
    """
    try:
        input_sha256 = sha256_of_log(log)
    except OSError as problem:
        raise LogError(f"{log}: cannot be read ({problem.strerror})") from problem
    try:
        scene_sha256 = sha256_of_file(world.path)
    except OSError as problem:
        raise SceneError(f"{world.path}: cannot be read ({problem.strerror})") from problem
    parameters = {name: _parameter_text(value) for name, value in config.as_dict().items()}
    if world.keypoint_scale:
        parameters["keypoint_scale"] = json.dumps(world.keypoint_scale, sort_keys=True)
    return Provenance(
        input_sha256=input_sha256,
        scene_sha256=scene_sha256,
        world_sha256=sha256_of_world(world),
        parameters=parameters,
        files=(*files_of_log(log), *world.source_files),
    )


def files_of_log(path: AnyPath) -> tuple[AnyPath, ...]:
    """The files of a log, sorted: itself, or all in and below a bag directory. Raises OSError."""
    return tuple(sorted(p for p in path.rglob("*") if p.is_file())) if path.is_dir() else (path,)


def recorded_provenance(record: dict[str, str]) -> Provenance:
    """The provenance in the metadata record of an output; "" for missing values."""
    return Provenance(
        version=record.get("version", ""),
        input_sha256=record.get("input_sha256", ""),
        scene_sha256=record.get("scene_sha256", ""),
        world_sha256=record.get("world_sha256", ""),
        parameters={k: v for k, v in record.items() if k not in NON_PARAMETER_KEYS},
    )


def sha256_of_file(path: AnyPath) -> str:
    """SHA-256 of a file's bytes; OSError if it cannot be read."""
    with open_sequential(path) as stream:
        return hashlib.file_digest(cast(Any, stream), "sha256").hexdigest()


def sha256_of_log(path: AnyPath) -> str:
    """SHA-256 of a log: of the file's bytes, or of a bag directory as one line ``name NUL sha256`` a file, sorted."""
    if not path.is_dir():
        return sha256_of_file(path)
    digest = hashlib.sha256()
    for file in files_of_log(path):
        digest.update(f"{relative_path(file, path).as_posix()}\0{sha256_of_file(file)}\n".encode())
    return digest.hexdigest()


@lru_cache(maxsize=4)
def sha256_of_world(world: World) -> str:
    """SHA-256 of a world's arrays and names: everything besides log and parameters that the result of a replay depends on."""
    digest = hashlib.sha256()
    for names in (world.tree_names, world.body_names, world.frame_names, world.dof_names):
        digest.update(json.dumps(names).encode())
    _update_digest(digest, world.scene)
    return digest.hexdigest()


def _update_digest(digest: hashlib._Hash, file: Scene | tuple[object, ...] | np.ndarray) -> None:
    if isinstance(file, np.ndarray):
        if file.dtype.kind == "i":
            file = file.astype(np.int64)  # independent of the width of stored integers
        digest.update(f"{file.dtype.str}{file.shape}".encode())
        digest.update(np.ascontiguousarray(file).tobytes())
        return
    for inner in file:
        if isinstance(inner, (tuple, np.ndarray)):
            _update_digest(digest, inner)


def _parameter_text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
