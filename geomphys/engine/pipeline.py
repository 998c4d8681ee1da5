"""The pipeline: runs frames through the compiled step in chunks, and yields their results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from geomphys.config import Config
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.engine.block_motion import BlockMotionMeter
from geomphys.engine.frame_buffer import Block
from geomphys.engine.frame_results import MotionMeasures, results_of
from geomphys.engine.grasps import GraspMeter
from geomphys.engine.log_messages import FrameReporter
from geomphys.engine.missed_motion import MissedMotion
from geomphys.engine.replay_memory import give_back, take_memory
from geomphys.engine.state import NEAR_PAIRS, Method, StepParameters
from geomphys.engine.step import Recording, run_block, run_block_as_published
from geomphys.errors import GeomphysError
from geomphys.jit.kernel import are_compiled
from geomphys.jit.stage_clock import start_clock
from geomphys.results import FLAG_CATCHING_UP, Frame, Grasp, ResultColumns
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import pose_tree
from geomphys.scene.world import World
from geomphys.storage.overlapped_call import OverlappedCall

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def compile_ahead(world: World, config: Config) -> None:
    """Let other processes begin to compile the step of a replay, unless that is done; the caller goes on."""
    if not are_compiled(config.method):
        with closing(Pipeline(world, config)) as pipeline:
            pipeline.compile_ahead()


@dataclass
class Chunk:
    """Some frames in a row and their results."""

    frames: list[Frame]
    block: Block
    decode_ns: int  # a frame
    motion: MotionMeasures
    flags: Ints  # (n,) beside those of the frames and of the step
    is_last: bool = False


@dataclass
class _Running:
    """Frames that are being computed."""

    frames: list[Frame]
    roots: Floats  # (n, T, 7)
    angles: Floats  # (n, Q)
    dts: Floats  # (n,)
    flags: Ints  # (n,)
    decode_ns: int
    block: Block
    count: OverlappedCall[int]  # frames that were stepped


class Pipeline:
    """A scene with its state: takes frames and yields results.

    Results come one chunk late, so that the last one is known as such. If it `overlaps`, frames are computed in a thread of their
    own, while the caller reads the next and uses those before; the first, for which kernels may be compiled, are not.
    """

    def __init__(self, world: World, config: Config, weights: Weights = WEIGHTS, *, overlaps: bool = False) -> None:
        start_clock()
        self.world = world
        memory = self._memory = take_memory(world, config, weights)
        self.data, self.blocks = memory.data, list(memory.blocks)
        self._run_block: Any = run_block
        method = Method(config.gap, None)
        if memory.packed_paper is not None:
            method, self._run_block = Method(None, memory.packed_paper), run_block_as_published
        self.params = StepParameters(config.gap, config.max_impacts, method)
        self._last_ns: int | None = None
        self._reporter = FrameReporter()
        self._motion = BlockMotionMeter(world.scene, self.blocks[0].moving)
        self._grasps = GraspMeter(world)
        self._missed = MissedMotion(world.scene)
        self._overlaps = overlaps
        self._has_run = False
        self._at_work: OverlappedCall[int] | None = None

    def close(self) -> None:
        """Leave its memory to the next replay of the scene; it takes no frames any more, and its chunks are void."""
        if self._at_work is not None:
            self._at_work.settle()
        give_back(self._memory)

    def run(self, roots: Floats, angles: Floats, dts: Floats, block: Block) -> int:
        """Step through frames (n, T, 7), (n, Q), (n,) into `block`; returns how many were stepped."""
        call = self._run_block.unlocked if self._has_run else self._run_block  # the first may compile
        count: int = call(*self._arguments(roots, angles, dts, block))
        self._has_run = True
        if count == 0 or self.data.workspace.near.counts["lost"]:
            raise GeomphysError(
                f"more than {NEAR_PAIRS} pairs of convex pieces are near each other at once, or have as many contact points; "
                "decompose the meshes into fewer"
            )
        return count

    def compile_ahead(self) -> None:
        """Let other processes begin to compile the step, while the caller goes on."""
        trees, dofs = len(self.scene.trees.role), len(self.scene.dofs.lower)
        self._run_block.compile_ahead(
            *self._arguments(np.zeros((0, trees, 7)), np.zeros((0, dofs)), np.zeros(0), self.blocks[0])
        )

    def _arguments(self, roots: Floats, angles: Floats, dts: Floats, block: Block) -> tuple[Any, ...]:
        """What the compiled step takes."""
        memory = self._memory
        recording = Recording(roots, angles, dts)
        return memory.scene, memory.packed_data, recording, self.params, memory.packed_blocks[id(block)]

    def chunks(self, batches: Iterator[tuple[list[Frame], int]]) -> Iterator[Chunk]:
        """Run batches of frames, each with what a frame of it took to decode [ns]; yields them with their results.

        Where it overlaps, a batch is computed while the next one is read and the one before is the caller's.
        """
        running: _Running | None = None
        try:
            for frames, decode_ns in batches:
                if not frames:
                    continue
                before, running = running, None
                while before is not None:
                    chunk, before = self._ended(before)
                    if before is None:
                        running = self._begin_batch(frames, decode_ns)
                    yield chunk
                running = running or self._begin_batch(frames, decode_ns)
            while running is not None:
                chunk, running = self._ended(running)
                chunk.is_last = running is None
                yield chunk
        finally:
            if self._at_work is not None:
                self._at_work.settle()

    def _begin_batch(self, frames: list[Frame], decode_ns: int) -> _Running:
        """Begin to compute frames."""
        first = frames[0].time_ns if self._last_ns is None else self._last_ns
        times = np.array([first, *(frame.time_ns for frame in frames)], dtype=np.int64)
        dts = np.diff(times).astype(np.float64) * 1e-9
        roots, angles = _stacked([f.roots for f in frames]), _stacked([f.angles for f in frames])
        flags = np.array(self._missed.correct(frames, roots, angles, dts), np.int64)
        return self._begin(frames, roots, angles, dts, flags, decode_ns)

    def _begin(
        self, frames: list[Frame], roots: Floats, angles: Floats, dts: Floats, flags: Ints, decode_ns: int
    ) -> _Running:
        """Begin to compute frames in the block that the frames before are not in."""
        self.blocks.reverse()
        block = self.blocks[0]
        count = self._at_work = OverlappedCall(
            lambda: self.run(roots, angles, dts, block), is_overlapped=self._overlaps and self._has_run
        )
        return _Running(frames, roots, angles, dts, flags, decode_ns, block, count)

    def _ended(self, running: _Running) -> tuple[Chunk, _Running | None]:
        """The frames that were computed, and those that their block could not take, which are begun again."""
        count = running.count.wait()
        frames, rest = running.frames[:count], running.frames[count:]
        motion = self._motion.add(frames, running.block)
        chunk = Chunk(frames, running.block, running.decode_ns, motion, running.flags[:count])
        self._last_ns = frames[-1].time_ns
        if not rest:
            return chunk, None
        roots, angles, dts = (column[count:] for column in (running.roots, running.angles, running.dts))
        return chunk, self._begin(rest, roots, angles, dts, running.flags[count:], running.decode_ns)

    @property
    def scene(self) -> Scene:
        """The scene."""
        return self.world.scene

    def grasps(self) -> tuple[Grasp, ...]:
        """Outcomes so far of the simulated bodies that driven ones touched."""
        return self._grasps.grasps()

    def _pose_as_recorded(self, frame: Frame, poses: Floats) -> None:
        """Set driven trees in `poses` (B, 7) to their recorded poses, which a frame that catches up has not reached."""
        for tree in np.flatnonzero(self.scene.trees.role == DRIVEN).tolist():
            pose_tree(self._memory.scene, self.data.workspace.origins, tree, frame.roots, frame.angles, poses)

    def results(self, chunk: Chunk) -> ResultColumns:
        """The results of a chunk; once, in order."""
        columns = results_of(chunk.block, chunk.frames, chunk.flags, chunk.motion, chunk.decode_ns)
        for row in np.flatnonzero(chunk.flags & FLAG_CATCHING_UP).tolist():
            self._pose_as_recorded(chunk.frames[row], columns.recorded[row])
        grasped, reported = self._grasps.messages(columns), self._reporter.messages(columns.metrics)
        rows = sorted(grasped.keys() | reported.keys())
        return replace(columns, messages={row: grasped.get(row, ()) + reported.get(row, ()) for row in rows})


def _stacked(rows: Sequence[Floats]) -> Floats:
    """Arrays (...) of one shape as one (n, ...); in half the time that `numpy.stack` takes."""
    return np.concatenate(rows).reshape(len(rows), *rows[0].shape)
