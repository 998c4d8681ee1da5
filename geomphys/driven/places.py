"""Where driven trees are while overlaps are eliminated: goals, places, what may be met, and who is held."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, norm, sub
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Places(NamedTuple):
    """Where driven trees are during the loop; offsets are from the recorded pose, in m."""

    goal: Floats  # (T, 3) where the coupling pulls
    current: Floats  # (T, 3) where the tree is
    trial: Floats  # (T, 3) where it would go next
    reach: Floats  # (T, 2) how far its pieces may move in this round: in the world, and by bending only
    stir: Floats  # (T, 2) how far its pieces have just been moved by turning and bending, likewise; 0 after the first round
    column: Ints  # (T,) its first unknown, -1 if it is not in the problem
    group: Ints  # (T,) the first of the driven trees that it may meet in this round, -1: not driven
    base: Floats  # (P, 12) world_from_piece as recorded
    frames: Floats  # (P, 12) at `current`
    moved: Floats  # (P, 12) at `trial`
    start: Floats  # (T, 3) where trees were when the loop began
    origin: Floats  # (T, 3) where trees were when pairs within their reach were looked for,
    seen: Floats  # (T, 3) and when they were last brought up to date
    chosen: Ints  # (n,) 1 for pairs of `Near` whose plane is in the problem
    found: Ints  # (T,) scratch
    hasty: Ints  # (1,) 1: a trial, that ends where a way out would have to be searched for
    begun: Ints  # (1,) 1: there is a last free place, and no way out may lead through anything
    asked: Ints  # (1,) 1: wedged trees may be held; ASKED: some are to be, and the step is to be done again
    passing: (
        Ints  # (1,) 1: a step before the frame's last, after which what is round a carried tree may leave it more room
    )
    wedged: Ints  # (1,) the group that has no free place
    escapes: Ints  # (1,) ways out that were taken in this frame
    behind: Ints  # (T,) 1: has been held in the last frame and is not back yet
    held: Ints  # (T,) LOOSE, HELD, ALONG or CARRIED (`escape.py`)


def make_places(scene: Scene, size: int) -> Places:
    """Places for a scene, with room for `size` near pairs."""
    trees, pieces = len(scene.trees.role), len(scene.pieces.kind)
    goal, current, trial = (np.zeros((trees, 3)) for _ in range(3))
    base, frames, moved = (np.zeros((pieces, 12)) for _ in range(3))
    hasty, begun, asked, passing, wedged, escapes = (np.zeros(1, np.int64) for _ in range(6))
    return Places(
        goal, current, trial, np.zeros((trees, 2)), np.zeros((trees, 2)), np.full(trees, -1), np.full(trees, -1), base, frames,
        moved,
        np.zeros((trees, 3)), np.zeros((trees, 3)), np.zeros((trees, 3)), np.zeros(size, np.int64),
        np.zeros(trees, np.int64), hasty, begun, asked, passing, wedged, escapes,
        np.zeros(trees, np.int64), np.zeros(trees, np.int64),
    )  # fmt: skip


@kernel
def place_at(scene: Scene, base: Floats, offsets: Floats, tree: int, frames: Floats) -> None:
    """Frames of the pieces of `tree`, translated by its row of `offsets` from `base`."""
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
    for i in range(first, last):
        for k in range(9):
            frames[i, k] = base[i, k]
        for k in range(3):
            frames[i, 9 + k] = base[i, 9 + k] + offsets[tree, k]


@kernel
def row_of(offsets: Floats, tree: int) -> Vec:
    """A row of an (n, 3) array."""
    return (offsets[tree, 0], offsets[tree, 1], offsets[tree, 2])


@kernel
def distance(a: Floats, b: Floats, tree: int) -> float:
    """Between a row of one (n, 3) array and the same row of another."""
    return norm((a[tree, 0] - b[tree, 0], a[tree, 1] - b[tree, 1], a[tree, 2] - b[tree, 2]))


@kernel
def relative_way(start: Floats, end: Floats, tree_a: int, tree_b: int) -> Vec:
    """How far tree a goes against tree b from one (T, 3) array of places to another. [m]"""
    return sub(
        sub(row_of(end, tree_a), row_of(start, tree_a)),
        sub(row_of(end, tree_b), row_of(start, tree_b)),
    )


@kernel
def limit_of(p: Places, near: Near, k: int, gap: float) -> float:
    """How near [m] the pair k had to be to be among those of `find_reachable`."""
    a, b = near.tree_a[k], near.tree_b[k]
    column = 1 if a == b else 0
    return p.reach[a, column] + p.reach[b, column] + 2.0 * gap
