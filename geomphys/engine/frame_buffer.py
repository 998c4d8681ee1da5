"""Buffer of the results of a block of frames, as flat arrays, written by the compiled step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.collision.global_depth import GlobalDepths
from geomphys.collision.manifold import manifold
from geomphys.collision.penetration import Scratch
from geomphys.collision.support import Shapes
from geomphys.jit.kernel import kernel, outlined
from geomphys.jit.stage_clock import STAGES
from geomphys.scene.arrays import SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FRAMES = 64  # a block
CONTACTS = 1 << 15  # rows for a block
RESERVE = 1 << 14  # rows a frame may need; a block ends early when fewer are left

FIGURES = np.dtype(
    [
        ("recorded", np.float64),  # m, deepest overlap as recorded
        ("residual", np.float64),  # m, residual
        ("correction", np.float64),  # m
        ("rotation", np.float64),  # rad, of the correction
        ("amplification", np.float64),
        ("fingertip_error", np.float64),  # m
        ("contact_precision", np.float64),  # m
        ("contact_alignment", np.float64),  # rad
        ("iterations", np.int64),
        ("impacts", np.int64),
        ("fallbacks", np.int64),
        ("flags", np.int64),
        ("contacts_recorded", np.int64),
        ("contacts_kept", np.int64),
        ("grasps_recorded", np.int64),
        ("grasps_kept", np.int64),
    ]
)
"""Of a frame; see `geomphys.results.Metrics`."""


class Block(NamedTuple):
    """Up to N frames. M bodies move: `moving` names them; the others stay as in `rest`."""

    moving: Ints  # (M,) bodies
    rest: Floats  # (B, 7) poses of the bodies that stand still
    recorded: Floats  # (N, M, 7)
    corrected: Floats  # (N, M, 7)
    angles: Floats  # (N, Q)
    figures: NDArray[np.void]  # (N,) FIGURES
    cycles: Ints  # (N, S + 1) of each stage and of the whole step
    counts: Ints  # (N, S + 1)
    contact_end: Ints  # (N + 1,) rows of the contact arrays after each frame; [0] is 0
    contact_bodies: Ints  # (c, 2)
    contact_values: Floats  # (c, 9) point, normal, depth, normal and tangential impulse
    depth_end: Ints  # (N + 1,)
    depth_bodies: Ints  # (d, 2)
    depth_numbers: Ints  # (d, 2) convex pairs, method
    depth_values: Floats  # (d, 4) PD_g, largest


def make_block(moving: Ints, rest: Floats, dofs: int, frames: int = FRAMES) -> Block:
    """A buffer for `frames` frames."""
    stages = len(STAGES) + 1
    ints, floats = np.int64, np.float64
    return Block(
        moving, rest, np.zeros((frames, len(moving), 7)), np.zeros((frames, len(moving), 7)), np.zeros((frames, dofs)),
        np.zeros(frames, FIGURES), np.zeros((frames, stages), ints), np.zeros((frames, stages), ints),
        np.zeros(frames + 1, ints), np.zeros((CONTACTS, 2), ints), np.zeros((CONTACTS, 9), floats),
        np.zeros(frames + 1, ints), np.zeros((CONTACTS, 2), ints), np.zeros((CONTACTS, 2), ints), np.zeros((CONTACTS, 4)),
    )  # fmt: skip


@kernel
def has_capacity(block: Block, frame: int) -> bool:
    """Whether a frame's contacts and depths surely fit."""
    return (
        frame < len(block.angles)
        and len(block.contact_bodies) - block.contact_end[frame] >= RESERVE
        and len(block.depth_bodies) - block.depth_end[frame] >= RESERVE
    )


@kernel
def is_full(block: Block, frame: int) -> bool:
    """Whether the contacts or depths of a frame filled their table to the last row, so that some may be missing."""
    return bool(
        block.contact_end[frame + 1] == len(block.contact_bodies)
        or block.depth_end[frame + 1] == len(block.depth_bodies)
    )


@kernel
def write_depths(scene: Scene, block: Block, frame: int, depths: GlobalDepths, count: int, method: Ints) -> None:
    """Append the global depths of a frame: those of `count` pairs of bodies; `method` (T,) is that which freed each tree."""
    row = block.depth_end[frame]
    for k in range(min(count, len(block.depth_bodies) - row)):
        block.depth_bodies[row, 0], block.depth_bodies[row, 1] = depths.body_a[k], depths.body_b[k]
        tree_a, tree_b = scene.bodies.tree[depths.body_a[k]], scene.bodies.tree[depths.body_b[k]]
        block.depth_numbers[row, 0] = depths.pairs[k]
        block.depth_numbers[row, 1] = max(method[tree_a], method[tree_b])
        for i in range(3):
            block.depth_values[row, i] = depths.pd[k, i]
        block.depth_values[row, 3] = depths.largest[k]
        row += 1
    block.depth_end[frame + 1] = row


@outlined
def write_contacts(
    scene: Scene, frames: Floats, near: Near, offsets: Floats, block: Block, frame: int, scratch: Scratch
) -> float:
    """Append the contact manifolds of the near pairs of a frame.

    Parameters
    ----------
    scene, frames
        The scene and its pieces' final world frames (P, 12).
    near
        The pairs in contact; those with simulated bodies are left to the simulated loop.
    offsets
        (T, 3) m; how far each tree was moved out. A contact's depth is how far it parted the two surfaces.
    block, frame
        Where they go.
    scratch
        For the narrow phase.

    Returns
    -------
    float
        The deepest remaining overlap, m.
    """
    row, deepest, points_a, points_b = block.contact_end[frame], 0.0, scratch.on_a, scratch.on_b
    for k in range(near.counts.filled):
        s = near.separation[k]
        deepest = max(deepest, -s)
        if scene.trees.role[near.tree_a[k]] == SIMULATED or scene.trees.role[near.tree_b[k]] == SIMULATED:
            continue
        n = (near.normal[k, 0], near.normal[k, 1], near.normal[k, 2])
        pa = (near.point_a[k, 0], near.point_a[k, 1], near.point_a[k, 2])
        pb = (near.point_b[k, 0], near.point_b[k, 1], near.point_b[k, 2])
        parted = 0.0
        for i in range(3):
            parted += n[i] * (offsets[near.tree_a[k], i] - offsets[near.tree_b[k], i])
        count = manifold(
            Shapes(scene.pieces, frames), near.a[k], near.b[k], (s, n, pa, pb), points_a, points_b, scratch
        )
        for j in range(count):
            if row == len(block.contact_bodies):
                break
            block.contact_bodies[row, 0] = scene.pieces.body[near.a[k]]
            block.contact_bodies[row, 1] = scene.pieces.body[near.b[k]]
            for i in range(3):
                block.contact_values[row, i] = 0.5 * (points_a[j, i] + points_b[j, i])
                block.contact_values[row, 3 + i] = n[i]
            block.contact_values[row, 6] = max(parted, 0.0)
            block.contact_values[row, 7] = block.contact_values[row, 8] = 0.0
            row += 1
    block.contact_end[frame + 1] = row
    return deepest
