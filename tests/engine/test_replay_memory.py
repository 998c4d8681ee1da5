"""Memory of a replay that the next one gets: as new, for the same world and parameters alone, and never for two at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import geomphys
from geomphys.config import Config
from geomphys.driven.weights import WEIGHTS
from geomphys.engine import replay_memory
from geomphys.engine.replay_memory import TABLES, ReplayMemory, _state, give_back, take_memory
from geomphys.load import load_world
from geomphys.scene.world import World

ROOT = Path(__file__).resolve().parents[2]
METHODS = pytest.mark.parametrize("config", [Config(), Config(method="paper")], ids=["exact", "paper"])


@pytest.fixture(scope="module")
def world() -> World:
    return load_world(ROOT / "assets/scenes/gripper_cube.toml")


def arrays_of(memory: ReplayMemory) -> list[np.ndarray]:
    return [*_state((memory.data, memory.paper))]


def rows_of_tables(record: Any) -> Iterator[np.ndarray]:
    for value in record:
        if isinstance(value, tuple):
            yield from rows_of_tables(value)
        elif isinstance(record, TABLES) and value.ndim:
            yield value


@METHODS
def test_whatever_a_replay_left_in_it_it_is_as_new(world: World, config: Config) -> None:
    used, new = (ReplayMemory(world, config, WEIGHTS) for _ in range(2))
    for array, constant in zip(arrays_of(used), arrays_of(new), strict=True):
        if array.ctypes.data != constant.ctypes.data:
            array.reshape(-1).view(np.uint8)[:] = 0xA5
    give_back(used)
    taken = take_memory(world, config, WEIGHTS)
    assert taken is used
    for array, expected in zip(arrays_of(taken), arrays_of(new), strict=True):
        assert array.tobytes() == expected.tobytes()


def test_it_is_of_one_replay_and_of_one_world_and_config(world: World) -> None:
    memory = ReplayMemory(world, Config(), WEIGHTS)
    for other in (Config(gap=3e-6), Config(max_iterations=7)):
        give_back(memory)
        assert take_memory(world, other, WEIGHTS) is not memory
    give_back(memory)
    assert take_memory(replace(world), Config(), WEIGHTS) is not memory
    give_back(memory)
    assert take_memory(world, Config(), WEIGHTS) is memory
    assert take_memory(world, Config(), WEIGHTS) is not memory


@METHODS
def test_a_replay_gives_the_same_bytes_after_any_other(world: World, config: Config, tmp_path: Path) -> None:
    log, timeless = ROOT / "recordings/gripper_cube.mcap", geomphys.OutputOptions(timing=False)
    short = replace(config, start=1.0, end=2.0)

    def output(name: str, config: Config) -> bytes:
        geomphys.run(log, world, out=tmp_path / name, config=config, options=timeless)
        return (tmp_path / name).read_bytes()

    replay_memory._free.clear()
    alone = output("alone.mcap", short)
    frames = geomphys.replay(log, world, config=short)
    next(frames)  # a replay that is not at its end
    beside = output("beside.mcap", short)
    frames.close()
    assert alone == beside == output("after.mcap", short)


@METHODS
@pytest.mark.parametrize("name", ["gripper_cube", "two_hands"])
def test_rows_that_are_not_reset_are_not_read_before_they_are_written(
    name: str, config: Config, tmp_path: Path
) -> None:
    scene, out = load_world(ROOT / f"assets/scenes/{name}.toml"), tmp_path / "out.mcap"
    config = replace(config, start=1.0, end=2.5)
    replay_memory._free.clear()
    found = set()
    for left_over in (0x00, 0xA5, 0xFF):
        for memory in replay_memory._free:
            tables = [*rows_of_tables((memory.data, memory.paper))]
            assert sum(table.nbytes for table in tables) > 1e6
            for table in tables:
                table.reshape(-1).view(np.uint8)[:] = left_over
        options = geomphys.OutputOptions(timing=False)
        geomphys.run(ROOT / f"recordings/{name}.mcap", scene, out=out, config=config, options=options, force=True)
        found.add(out.read_bytes())
    assert len(found) == 1
