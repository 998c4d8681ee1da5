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
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.stage_clock import STAGES
from geomphys.numerics.row_vectors import set_vec, vec_at
from geomphys.numerics.vec3 import add, scale
from geomphys.scene.arrays import SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FRAMES = 128  # a block
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

CONTACT = np.dtype(
    [
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("point", np.float64, 3),  # m
        ("normal", np.float64, 3),
        ("depth", np.float64),  # m
        ("normal_impulse", np.float64),  # N s
        ("tangential_impulse", np.float64),  # N s
    ]
)
"""A contact point; see `geomphys.results.Contacts`."""

PENETRATION = np.dtype(
    [
        ("body_a", np.int64),
        ("body_b", np.int64),
        ("pd", np.float64, 3),  # m
        ("convex_pairs", np.int64),
        ("largest", np.float64),  # m
        ("method", np.int64),
    ]
)
"""The recorded overlap of a pair of bodies; see `geomphys.results.Penetrations`."""


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
    contact_end: Ints  # (N + 1,) rows of `contacts` after each frame; [0] is 0
    contacts: NDArray[np.void]  # (c,) CONTACT
    depth_end: Ints  # (N + 1,)
    depths: NDArray[np.void]  # (d,) PENETRATION


def make_block(moving: Ints, rest: Floats, dofs: int, frames: int = FRAMES) -> Block:
    """A buffer for `frames` frames."""
    stages = len(STAGES) + 1
    return Block(
        moving=moving,
        rest=rest,
        recorded=np.zeros((frames, len(moving), 7)),
        corrected=np.zeros((frames, len(moving), 7)),
        angles=np.zeros((frames, dofs)),
        figures=np.zeros(frames, FIGURES),
        cycles=np.zeros((frames, stages), np.int64),
        counts=np.zeros((frames, stages), np.int64),
        contact_end=np.zeros(frames + 1, np.int64),
        contacts=np.empty(CONTACTS, CONTACT),
        depth_end=np.zeros(frames + 1, np.int64),
        depths=np.empty(CONTACTS, PENETRATION),
    )


@kernel
def has_capacity(block: Block, frame: int) -> bool:
    """Whether a frame's contacts and depths surely fit."""
    return (
        frame < len(block.angles)
        and len(block.contacts) - block.contact_end[frame] >= RESERVE
        and len(block.depths) - block.depth_end[frame] >= RESERVE
    )


@kernel
def is_full(block: Block, frame: int) -> bool:
    """Whether the contacts or depths of a frame filled their table to the last row, so that some may be missing."""
    return bool(block.contact_end[frame + 1] == len(block.contacts) or block.depth_end[frame + 1] == len(block.depths))


@kernel
def write_depths(scene: Scene, block: Block, frame: int, depths: GlobalDepths, count: int, method: Ints) -> None:
    """Append the global depths of a frame: those of `count` pairs of bodies; `method` (T,) is that which freed each tree."""
    row = block.depth_end[frame]
    for k in range(min(count, len(block.depths) - row)):
        d = block.depths[row]
        d.body_a, d.body_b = depths.body_a[k], depths.body_b[k]
        d.convex_pairs, d.largest = depths.pairs[k], depths.largest[k]
        d.method = max(method[scene.bodies.tree[d.body_a]], method[scene.bodies.tree[d.body_b]])
        set_vec(d.pd, vec_at(depths.pd, k))
        row += 1
    block.depth_end[frame + 1] = row


@noinline
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
        n, pa, pb = vec_at(near.normal, k), vec_at(near.point_a, k), vec_at(near.point_b, k)
        parted = 0.0
        for i in range(3):
            parted += n[i] * (offsets[near.tree_a[k], i] - offsets[near.tree_b[k], i])
        count = manifold(
            Shapes(scene.pieces, frames), near.a[k], near.b[k], (s, n, pa, pb), points_a, points_b, scratch
        )
        for j in range(count):
            if row == len(block.contacts):
                break
            c = block.contacts[row]
            c.body_a, c.body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
            set_vec(c.point, scale(add(vec_at(points_a, j), vec_at(points_b, j)), 0.5))
            set_vec(c.normal, n)
            c.depth = max(parted, 0.0)
            c.normal_impulse = c.tangential_impulse = 0.0
            row += 1
    block.contact_end[frame + 1] = row
    return deepest
