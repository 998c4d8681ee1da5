"""The hashes change with what they stand for, and with nothing else."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from geomphys.config import Config
from geomphys.errors import LogError, SceneError
from geomphys.output.provenance import provenance_of, sha256_of_log, sha256_of_world
from geomphys.scene.world import World
from tests.output.made_world import make_world


@pytest.fixture
def world(tmp_path: Path) -> World:
    return make_world(tmp_path / "a", avatars=("hand",))


def test_hashes_are_those_of_the_files(world: World, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    log.write_bytes(b"log")
    found = provenance_of(log, world, Config(seed=5, rate=60.0))
    assert found.input_sha256 == hashlib.sha256(b"log").hexdigest()
    assert found.scene_sha256 == hashlib.sha256(world.path.read_bytes()).hexdigest()
    record = found.record(complete=False)
    assert (record["seed"], record["rate"], record["mode"], record["time"]) == ("5", "60.0", "null", "header")
    assert (record["complete"], found.record(complete=True)["complete"]) == ("false", "true")
    assert not any(str(tmp_path) in value for value in record.values())


def test_a_bag_is_hashed_by_names_and_contents(tmp_path: Path) -> None:
    hashes = set()
    for number, files in enumerate(({"a": b"1", "b": b"2"}, {"a": b"2", "b": b"1"}, {"a": b"12"}, {"a": b"1"})):
        for twice in ("x", "y"):
            bag = tmp_path / f"{number}{twice}"
            bag.mkdir()
            for name, data in files.items():
                (bag / name).write_bytes(data)
        one, other = (sha256_of_log(tmp_path / f"{number}{twice}") for twice in ("x", "y"))
        assert one == other
        hashes.add(one)
    assert len(hashes) == 4


def test_the_world_hash_is_of_the_world_not_of_its_place(world: World, tmp_path: Path) -> None:
    assert sha256_of_world(world) == sha256_of_world(make_world(tmp_path / "b", avatars=("hand",)))
    bodies = world.scene.bodies
    heavier = replace(world, scene=world.scene._replace(bodies=bodies._replace(mass=bodies.mass * (1 + 1e-15))))
    renamed = replace(world, body_names=("hand/thumb", *world.body_names[1:]))
    assert len({sha256_of_world(w) for w in (world, heavier, renamed)}) == 3
    assert not np.array_equal(bodies.mass, heavier.scene.bodies.mass)


def test_files_that_are_missing_are_named(world: World, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"gone.mcap: cannot be read"):
        provenance_of(tmp_path / "gone.mcap", world, Config())
    (tmp_path / "log").write_bytes(b"")
    with pytest.raises(SceneError, match=r"gone.toml: cannot be read"):
        provenance_of(tmp_path / "log", replace(world, path=tmp_path / "gone.toml"), Config())
