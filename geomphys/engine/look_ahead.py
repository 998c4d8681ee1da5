"""Foresight: a hand that is about to be wedged steps aside in time.

A hand that moves rigidly cannot stay where the recorded fingers close on a rod from both sides: its own shape leaves
no place there, and the nearest free one may be centimetres away. Taken in the frame in which it happens, that is a
jump. But the frames before it are known: this module runs them again, from when the touch began, with the hand drifting
to one side by no more in a frame than its own motion excuses, and takes the least drift with which nothing is wedged.
Frames in which nothing had been touched are never changed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from geomphys.engine.frame_buffer import CORRECTION, FALLBACKS, FLAGS, RECORDED, Block
from geomphys.engine.state import Machine, State, restore
from geomphys.jit.stage_clock import cycles
from geomphys.results import FLAG_WEDGED
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BACK = (2, 4, 8, 16, 32, 48)  # frames before the wedge from which a drift is tried
PACES = (1.0, 0.6, 0.35)  # shares of the fastest drift that are tried: the first along all directions,
REFINED = 6  # the others along this many of them, the best ones (along all if none of them came by)
AFTER = 6  # frames after it that must be free too
MOTION_SHARE = 2.0  # a change of the offset is no jump up to this many times the recorded motion of the frame ...
SLACK = 1e-3  # ... and this, m, beyond what the coupling relaxes


@dataclass(frozen=True)
class Track:
    """N frames as arrays, with the drift asked for and the results."""

    roots: Floats  # (N, T, 7)
    angles: Floats  # (N, Q)
    dts: Floats  # (N,) s before each frame
    drifts: Floats  # (N, T, 3) direction in which a tree steps aside, its length the pace; 0: none
    block: Block
    before: State  # of the machine ahead of the first frame
    foresight: (
        Ints  # (N, 2) what searching drifts for a frame in which a tree was wedged took: processor cycles, trials
    )

    def cut(self, count: int) -> Track:
        """The first `count` frames."""
        return Track(
            self.roots[:count],
            self.angles[:count],
            self.dts[:count],
            self.drifts[:count],
            self.block,
            self.before,
            self.foresight[:count],
        )

    def __len__(self) -> int:
        return len(self.dts)


class Runner(Protocol):
    """What steps through a track: `pipeline.Pipeline`."""

    machine: Machine

    @property
    def scene(self) -> Scene:
        """The scene."""

    def run(self, track: Track, first: int, last: int, block: Block, hasty: bool = False) -> int:
        """Step through rows `first` to `last` of a track into `block`; returns how many were done."""


class Wedge(NamedTuple):
    """Where a tree was wedged: the row of its frame, the tree, and how its offset jumped [m]."""

    row: int
    tree: int
    jump: Floats  # (3,)


def directions() -> Floats:
    """(26, 3) unit directions to drift along: to the faces, edges and corners of a cube."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    grid = grid[np.any(grid != 0.0, axis=1)]
    unit: Floats = grid / np.linalg.norm(grid, axis=1, keepdims=True)
    return unit


def root_rows(scene: Scene, block: Block) -> dict[int, int]:
    """Row among the moving bodies of the root of every driven tree."""
    place = {int(body): k for k, body in enumerate(block.moving)}
    return {
        tree: place[int(scene.trees.body_start[tree])]
        for tree in range(len(scene.trees.role))
        if scene.trees.role[tree] == DRIVEN
    }


def excess(scene: Scene, recorded: Floats, corrected: Floats, dts: Floats, root: int, body: int) -> Floats:
    """By how much [m] a tree's offset changes more from frame to frame than its motion excuses: (n - 1,), >= 0.

    `recorded` and `corrected` are (n, M, 7) poses of the moving bodies, `dts` (n,) s before each frame; the tree's root is
    `body`, row `root` of the moving ones.
    """
    offset = corrected[:, root, :3] - recorded[:, root, :3]
    motion = np.linalg.norm(np.diff(recorded[:, :, :3], axis=0), axis=2).max(axis=1, initial=0.0)
    change, size = np.diff(offset, axis=0), np.linalg.norm(offset[:-1], axis=1)
    safe = np.where(size > 0.0, size, 1.0)
    tree = int(scene.bodies.tree[body])
    rate = math.sqrt(scene.trees.stiffness[tree] / scene.trees.mass[tree])
    inward = np.clip(-np.sum(change * offset[:-1], axis=1) / safe, 0.0, (1.0 - np.exp(-rate * dts[1:])) * size)
    rest = np.linalg.norm(change + (inward / safe)[:, None] * offset[:-1], axis=1)
    return np.maximum(rest - MOTION_SHARE * motion - SLACK, 0.0)


def first_wedge(scene: Scene, block: Block, count: int, start: int, before: Floats | None) -> Wedge | None:
    """The first frame from row `start` on in which a search for a way out moved a tree by a jump.

    `before` are the offsets (T, 3) ahead of row 0.
    """
    offsets = offsets_of(scene, block, count)
    for row in range(start, count):
        if block.numbers[row, FALLBACKS] == 0 or block.numbers[row, FLAGS] & FLAG_WEDGED:
            continue
        last = offsets[row - 1] if row else before
        if last is None:
            continue
        jump = offsets[row] - last
        tree = int(np.argmax(np.linalg.norm(jump, axis=1)))
        if np.linalg.norm(jump[tree]) > SLACK:
            return Wedge(row, tree, jump[tree])
    return None


def offsets_of(scene: Scene, block: Block, count: int) -> Floats:
    """(count, T, 3) m: offsets of the driven trees in the first rows of a block."""
    offsets = np.zeros((count, len(scene.trees.role), 3))
    for tree, row in root_rows(scene, block).items():
        offsets[:, tree] = block.corrected[:count, row, :3] - block.recorded[:count, row, :3]
    return offsets


def touched(block: Block, count: int) -> NDArray[np.bool_]:
    """(count,) whether anything touched, overlapped or was corrected in each frame."""
    contacts = np.diff(block.contact_end[: count + 1]) > 0
    return contacts | (block.lengths[:count, RECORDED] > 0.0) | (block.lengths[:count, CORRECTION] > 0.0)


def step_aside(runner: Runner, before: Track | None, track: Track, spare: Block) -> None:
    """Where a tree was wedged in `track`, let it drift aside in the frames ahead, if that spares it a jump.

    `track`, and `before`, the one ahead of it, get new results where they changed; `spare` is room for trials.
    """
    scene = runner.scene
    row = 0
    while True:
        ahead = None if before is None else offsets_of(scene, before.block, len(before))[-1]
        wedge = first_wedge(scene, track.block, len(track), row, ahead)
        if wedge is None:
            return
        row = wedge.row + 1
        start = cycles()
        whole = track if before is None else joined(before, track)
        ahead_rows = len(whole) - len(track)
        end = runner.machine.state()
        plan, trials = find_drift(
            runner, whole, wedge._replace(row=wedge.row + ahead_rows), touched_in(before, track), spare
        )
        if plan is None:
            runner.machine.restore(end)
        else:
            whole.drifts[plan.first : plan.last, wedge.tree] = plan.direction
            runner.machine.restore(whole.before)
            if before is not None:
                before.drifts[...] = whole.drifts[:ahead_rows]
                runner.run(before, 0, ahead_rows, before.block)
                restore(track.before, runner.machine.state())
            track.drifts[...] = whole.drifts[ahead_rows:]
            runner.run(track, 0, len(track), track.block)
        track.foresight[wedge.row] += cycles() - start, trials


def joined(before: Track, track: Track) -> Track:
    """Two tracks in a row as one, without results."""
    return Track(
        np.concatenate([before.roots, track.roots]),
        np.concatenate([before.angles, track.angles]),
        np.concatenate([before.dts, track.dts]),
        np.concatenate([before.drifts, track.drifts]),
        track.block,
        before.before,
        np.concatenate([before.foresight, track.foresight]),
    )


def touched_in(before: Track | None, track: Track) -> NDArray[np.bool_]:
    """`touched` of two tracks in a row."""
    mine = touched(track.block, len(track))
    return mine if before is None else np.concatenate([touched(before.block, len(before)), mine])


class Plan(NamedTuple):
    """A drift along `direction` in rows `first` to `last`."""

    first: int
    last: int
    direction: Floats


def find_drift(
    runner: Runner, whole: Track, wedge: Wedge, touch: NDArray[np.bool_], spare: Block
) -> tuple[Plan | None, int]:
    """The drift of least jump, then least correction, with which the wedged tree comes by; None if all jump as much.

    The second value is how many were tried.
    """
    episode = wedge.row
    while episode > 0 and touch[episode - 1]:
        episode -= 1
    starts = sorted({max(wedge.row - back, episode) for back in BACK if episode < wedge.row}, reverse=True)
    ways = [*directions(), wedge.jump / np.linalg.norm(wedge.jump)]
    best: tuple[float, float] = (0.5 * float(np.linalg.norm(wedge.jump)), math.inf)
    plan: Plan | None = None
    trials = 0
    for start in starts:
        runner.machine.restore(whole.before)
        done = 0
        while done < start:
            done += runner.run(whole, done, start, spare)
        state = runner.machine.state()
        chosen = ways
        for pace in PACES:
            found = []
            for way in chosen:
                trials += 1
                cost = _try_drift(runner, whole, wedge, start, pace * way, spare, state)
                if cost is None:
                    continue
                found.append((cost, way))
                if cost < best:
                    best, plan = cost, Plan(start, wedge.row + 1, pace * way)
            if pace == PACES[0] and found:
                chosen = [way for _, way in sorted(found, key=lambda pair: pair[0])[:REFINED]]
        if best[0] == 0.0:
            break
    return plan, trials


def _try_drift(
    runner: Runner, whole: Track, wedge: Wedge, start: int, drift: Floats, spare: Block, state: State
) -> tuple[float, float] | None:
    """`cost_of` of a drift from row `start` to the wedge; None if the tree is wedged all the same.

    `state` is the machine's at row `start`.
    """
    last = min(wedge.row + 1 + AFTER, len(whole))
    runner.machine.restore(state)
    trial = Track(
        whole.roots[start:last], whole.angles[start:last], whole.dts[start:last], whole.drifts[start:last].copy(), spare,
        state, whole.foresight[start:last],
    )  # fmt: skip
    trial.drifts[: wedge.row + 1 - start, wedge.tree] = drift
    if runner.run(trial, 0, len(trial), spare, hasty=True) < len(trial):
        return None
    return cost_of(runner.scene, trial, wedge.tree, state)


def cost_of(scene: Scene, trial: Track, tree: int, before: State) -> tuple[float, float]:
    """(jump beyond what is excused, largest correction) of a trial, m."""
    block, count = trial.block, len(trial)
    root, moving = root_rows(scene, block)[tree], block.moving
    recorded = np.concatenate([before.recorded[moving][None], block.recorded[:count]])
    corrected = np.concatenate([before.corrected[moving][None], block.corrected[:count]])
    jump = excess(scene, recorded, corrected, np.concatenate([[0.0], trial.dts]), root, int(moving[root])).sum()
    return float(jump), float(block.lengths[:count, CORRECTION].max())
