"""Workspaces of the driven loop for scenes without files."""

from __future__ import annotations

import pytest

from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Sphere
from tests.simulated.scenes import Thing, floor, make_scene


@pytest.fixture
def table() -> tuple[object, object, ReplayData]:
    """A packed scene of three driven balls and a floor, its packed workspace, and the replay data that they are of."""
    scene = make_scene([*(Thing(shape=Sphere(0.05), role=s.DRIVEN, at=(0.2 * k, 0, 0.06)) for k in range(3)), floor()])
    data = make_replay_data(scene)
    return pack(scene), pack(data.workspace), data
