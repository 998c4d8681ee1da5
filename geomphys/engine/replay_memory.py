"""State, workspace and frame buffers of a replay: kept from one replay to the next of the same scene, as a batch has them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.collision.global_depth import GlobalDepths
from geomphys.collision.scratch import Scratch
from geomphys.config import Config
from geomphys.driven.links import links_of
from geomphys.driven.paper.state import PaperWorkspace, make_paper_workspace
from geomphys.driven.weights import Weights
from geomphys.engine.fingertips import thumbs_of
from geomphys.engine.frame_buffer import Block, make_block
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.packed_records import pack
from geomphys.scene.world import World

Bytes = NDArray[np.uint8]

TABLES = (GlobalDepths, Near, Scratch)
"""Records whose rows are read only once they are written; more than half of the memory."""


class ReplayMemory:
    """What a replay writes to, and as kernels take it. Made by `take_memory`.

    Attributes
    ----------
    data : ReplayData
    paper : PaperWorkspace or None
        Of the published method, if that is the config's.
    blocks : tuple of Block
        Two; a replay does not read of them what it has not written.
    scene, packed_data, packed_paper, packed_blocks
        Packs, see `geomphys.jit.packed_records`.
    """

    def __init__(self, world: World, config: Config, weights: Weights) -> None:
        self.key = (world, config, weights)
        self.data, self.paper = self._make()
        scene = world.scene
        moving = np.flatnonzero(scene.trees.moving[scene.bodies.tree]).astype(np.int64)
        rest = self.data.recorded.copy()
        self.blocks: tuple[Block, ...] = tuple(make_block(moving, rest, len(scene.dofs.lower)) for _ in range(2))
        self.scene, self.packed_data = pack(scene), pack(self.data)
        self.packed_paper: Any = None if self.paper is None else pack(self.paper)
        self.packed_blocks = {id(block): pack(block) for block in self.blocks}

    def _make(self) -> tuple[ReplayData, PaperWorkspace | None]:
        """Everything but the blocks, as at the beginning of a replay."""
        world, config, weights = self.key
        data = make_replay_data(world.scene, config.max_iterations, thumbs_of(world), weights, links_of(world, weights))
        if config.method != "paper":
            return data, None
        return data, make_paper_workspace(world.scene, data.workspace, config)

    @cached_property
    def _at_beginning(self) -> list[tuple[Bytes, Bytes | int]]:
        """The memory of each array, and what it holds at the beginning, 0 if only zeros; not of those that are the scene's."""
        arrays, initial = _state((self.data, self.paper)), _state(self._make())
        found = {
            (array.ctypes.data, array.nbytes): (_bytes_of(array), content if (content := _bytes_of(value)).any() else 0)
            for array, value in zip(arrays, initial, strict=True)
            if array.ctypes.data != value.ctypes.data
        }
        return list(found.values())

    def reset(self) -> None:
        """Set every number to what it is at the beginning of a replay, but in the rows of `TABLES`."""
        for memory, initial in self._at_beginning:
            memory[:] = initial


_free: list[ReplayMemory] = []  # at most one, which no replay uses


def take_memory(world: World, config: Config, weights: Weights) -> ReplayMemory:
    """Memory for a replay, as new: that of the last one, if it was of the same world and parameters."""
    try:
        memory = _free.pop()
    except IndexError:
        return ReplayMemory(world, config, weights)
    if memory.key != (world, config, weights):
        return ReplayMemory(world, config, weights)
    memory.reset()
    return memory


def give_back(memory: ReplayMemory) -> None:
    """Leave memory to the next replay; the caller uses it no more."""
    _free[:] = [memory]


def _state(record: tuple[Any, ...]) -> Iterator[NDArray[Any]]:
    """The arrays that hold something from frame to frame: all but the rows of `TABLES`, in order."""
    for value in record:
        if isinstance(value, np.ndarray):
            if not (isinstance(record, TABLES) and value.ndim):
                yield value
        elif isinstance(value, tuple):
            yield from _state(value)


def _bytes_of(array: NDArray[Any]) -> Bytes:
    """The memory of a contiguous array."""
    return array.reshape(-1).view(np.uint8)
