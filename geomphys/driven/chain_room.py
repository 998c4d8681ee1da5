"""Scratch of the search for a posture, and which trees have one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PAST = 4  # spots of a pair that are remembered: a face that lies on another has as many corners


class ChainRoom(NamedTuple):
    """Scratch of the search for a posture; T trees, Q joints, n pairs."""

    goal: Floats  # (Q,) offsets the coupling asks for
    current: Floats  # (Q,) offsets at the start
    trial: Floats  # (Q,) offsets being tried
    angles: Floats  # (Q,) recorded + trial
    spare: Floats  # (Q,)
    swing: Floats  # (Q,) by how much the offset of a joint may change in the step without being a jump
    low: Floats  # (Q,) bounds of the offsets in a search
    high: Floats  # (Q,)
    root_low: Floats  # (T, 3) m, and of those of the roots
    root_high: Floats  # (T, 3) m
    poses: Floats  # (B, 7) forward kinematics of `angles`, roots as recorded
    yields: Ints  # (Q,) 1 for joints that are unknowns where a pair depends on them
    lever: Floats  # (Q,) m per rad, their scale
    column: Ints  # (Q,) unknown of each joint, -1: none
    root_column: Ints  # (T,) first of the root's three unknowns, -1: none
    joint_of: Ints  # (unknowns,) joint of an unknown, or -1 - (3 tree + axis)
    filled: Ints  # (1,) pairs met so far
    a: Ints  # (n,) their pieces
    b: Ints  # (n,)
    hold: Floats  # (n,) m of clearance per m of scaled motion of chains; only of links of one tree
    separation: Floats  # (n,) m, of the pairs as measured last
    normal: Floats  # (n, 3)
    point_a: Floats  # (n, 3) m
    point_b: Floats  # (n, 3) m
    measured: Ints  # (n,) 1: `separation` and what follows it are of where the pieces are now
    spots: Ints  # (n,) different ones where a pair was nearest in this search
    newest: Ints  # (n,) which of them is the last
    past_normal: Floats  # (4 n, 3) of the last four spots
    past_a: Floats  # (4 n, 3) m, as points of the links: in their frames; of other bodies: in the world
    past_b: Floats  # (4 n, 3)


def make_chain_room(scene: Scene, unknowns: int, pairs: int) -> ChainRoom:
    """Room for a scene."""
    dofs, trees, bodies = len(scene.dofs.lower), len(scene.trees.role), len(scene.bodies.role)
    goal, current, trial, angles, spare, swing, low, high = (np.zeros(dofs) for _ in range(8))
    root_low, root_high = np.zeros((trees, 3)), np.zeros((trees, 3))
    normal, point_a, point_b = (np.zeros((pairs, 3)) for _ in range(3))
    past_normal, past_a, past_b = (np.zeros((PAST * pairs, 3)) for _ in range(3))
    return ChainRoom(
        goal, current, trial, angles, spare, swing, low, high, root_low, root_high, np.zeros((bodies, 7)),
        np.zeros(dofs, np.int64), np.zeros(dofs), np.full(dofs, -1), np.full(trees, -1), np.zeros(unknowns, np.int64),
        np.zeros(1, np.int64), np.zeros(pairs, np.int64), np.zeros(pairs, np.int64), np.zeros(pairs), np.zeros(pairs), normal,
        point_a, point_b, np.zeros(pairs, np.int64), np.zeros(pairs, np.int64), np.zeros(pairs, np.int64), past_normal, past_a,
        past_b,
    )  # fmt: skip


@kernel
def is_chained(scene: Scene, tree: int) -> bool:
    """Whether the tree is an avatar in chains mode."""
    return scene.trees.role[tree] == DRIVEN and scene.trees.chains[tree] == 1
