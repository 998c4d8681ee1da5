"""A small world, made by hand, and frames of it: a hand of two links beside a fixed table, a ball and a tracked cup."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.config import Config
from geomphys.output.provenance import Provenance, provenance_of
from geomphys.scene.world import World
from tests.output.made_world import make_world


@pytest.fixture
def world(tmp_path: Path) -> World:
    return make_world(tmp_path / "scene", avatars=("hand",))


@pytest.fixture
def two_hands(tmp_path: Path) -> World:
    return make_world(tmp_path / "two", avatars=("left", "right"))


@pytest.fixture
def provenance(world: World, tmp_path: Path) -> Provenance:
    log = tmp_path / "log.mcap"
    log.write_bytes(b"stands for a log")
    return provenance_of(log, world, Config())
