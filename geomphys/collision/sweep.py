"""Culling by axis-aligned boxes: trees first, then bodies, then convex pieces.

Trees that stand still are sorted once along x; a query walks only those whose interval can reach it. Wide ones (a
floor, a wall), which would make every interval long, are listed separately and tested every time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.support import core_of, radius_of, shapes_of, support
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import pack
from geomphys.numerics.quantiles import median
from geomphys.numerics.row_vectors import set_vec_at, vec_at
from geomphys.numerics.vec3 import Rot, Vec, add, neg, sub
from geomphys.scene.arrays import CAPSULE, CYLINDER, SPHERE, Pieces, Scene
from geomphys.scene.kinematics import frame_position, frame_rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

EMPTY_LOW, EMPTY_HIGH = (math.inf, math.inf, math.inf), (-math.inf, -math.inf, -math.inf)  # an empty box
WIDE = 4.0  # a tree wider than this many median widths is listed separately


class Boxes(NamedTuple):
    """World boxes of all pieces, bodies and trees, and the order of the still trees."""

    local_centre: Floats  # (P, 3) of the piece's box in its own frame
    local_half: Floats  # (P, 3)
    piece_low: Floats  # (P, 3)
    piece_high: Floats  # (P, 3)
    body_low: Floats  # (B, 3)
    body_high: Floats  # (B, 3)
    tree_low: Floats  # (T, 3)
    tree_high: Floats  # (T, 3)
    sorted_still: Ints  # (n,) still trees that are not wide, by low x
    sorted_low: Floats  # (n,) their low x
    widest: float  # m, the largest of their widths along x
    others: Ints  # (m,) trees that move, and wide ones


def local_boxes(pieces: Pieces) -> tuple[Floats, Floats]:
    """Centre and half extents (P, 3) of every piece's box in its own frame [m]."""
    count = len(pieces.kind)
    centre, half = np.zeros((count, 3)), np.zeros((count, 3))
    _measure_boxes(pack(pieces), np.zeros((count, 12)), centre, half)
    return centre, half


@kernel
def _measure_boxes(pieces: Pieces, frames: Floats, centre: Floats, half: Floats) -> None:
    shapes = shapes_of(pieces, frames)
    for i in range(len(pieces.kind)):
        core, radius = core_of(shapes, i), radius_of(shapes, i)
        for k in range(3):
            d = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)
            low, high = support(core, neg(d))[k] - radius, support(core, d)[k] + radius
            centre[i, k], half[i, k] = 0.5 * (low + high), 0.5 * (high - low)


def make_boxes(scene: Scene, frames: Floats) -> Boxes:
    """Boxes of all pieces placed by `frames` (P, 12), and the order of the trees that stand still."""
    pieces, bodies, trees = len(scene.pieces.kind), len(scene.bodies.role), len(scene.trees.role)
    centre, half = local_boxes(scene.pieces)
    piece_low, piece_high = np.zeros((pieces, 3)), np.zeros((pieces, 3))
    body_low, body_high = np.zeros((bodies, 3)), np.zeros((bodies, 3))
    tree_low, tree_high = np.zeros((trees, 3)), np.zeros((trees, 3))
    none = np.zeros(0, np.int64)
    boxes = Boxes(
        centre, half, piece_low, piece_high, body_low, body_high, tree_low, tree_high, none, np.zeros(0), 0.0, none,
    )  # fmt: skip
    packed = pack(scene), pack(boxes)
    for tree in range(trees):
        update_boxes(packed[0], frames, packed[1], tree)
    still = np.flatnonzero(scene.trees.moving == 0)
    width = boxes.tree_high[still, 0] - boxes.tree_low[still, 0]
    narrow = width <= WIDE * median(width) if len(still) else np.zeros(0, bool)
    ordered = still[narrow][np.argsort(boxes.tree_low[still[narrow], 0], kind="stable")]
    return boxes._replace(
        sorted_still=ordered,
        sorted_low=np.ascontiguousarray(boxes.tree_low[ordered, 0]),
        widest=float(width[narrow].max(initial=0.0)),
        others=np.setdiff1d(np.arange(trees), ordered, assume_unique=True),
    )


@kernel
def _half_extents(kind: int, r: Rot, half: Vec) -> Vec:
    """Half extents [m] along the axes of the world of a piece with half extents `half` in its own frame, rotated by `r`."""
    if kind == SPHERE:
        return half[0], half[0], half[0]
    if kind == CAPSULE:
        across, along = half[0], half[2] - half[0]
        return across + abs(r[2]) * along, across + abs(r[5]) * along, across + abs(r[8]) * along
    if kind == CYLINDER:
        return (
            half[0] * math.sqrt(max(0.0, 1.0 - r[2] * r[2])) + abs(r[2]) * half[2],
            half[0] * math.sqrt(max(0.0, 1.0 - r[5] * r[5])) + abs(r[5]) * half[2],
            half[0] * math.sqrt(max(0.0, 1.0 - r[8] * r[8])) + abs(r[8]) * half[2],
        )
    return (
        abs(r[0]) * half[0] + abs(r[1]) * half[1] + abs(r[2]) * half[2],
        abs(r[3]) * half[0] + abs(r[4]) * half[1] + abs(r[5]) * half[2],
        abs(r[6]) * half[0] + abs(r[7]) * half[1] + abs(r[8]) * half[2],
    )


@kernel
def _least(a: Vec, b: Vec) -> Vec:
    """The smaller of each of the coordinates."""
    return (min(a[0], b[0]), min(a[1], b[1]), min(a[2], b[2]))


@kernel
def _most(a: Vec, b: Vec) -> Vec:
    """The larger of each of the coordinates."""
    return (max(a[0], b[0]), max(a[1], b[1]), max(a[2], b[2]))


@noinline
def update_boxes(scene: Scene, frames: Floats, boxes: Boxes, tree: int) -> None:
    """Recompute the boxes of the pieces and bodies of `tree` and of itself; empty ones become (inf, -inf)."""
    tree_low, tree_high = EMPTY_LOW, EMPTY_HIGH
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        body_low, body_high = EMPTY_LOW, EMPTY_HIGH
        for i in range(scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]):
            r, p, c = frame_rotation(frames, i), frame_position(frames, i), vec_at(boxes.local_centre, i)
            middle = (
                p[0] + r[0] * c[0] + r[1] * c[1] + r[2] * c[2],
                p[1] + r[3] * c[0] + r[4] * c[1] + r[5] * c[2],
                p[2] + r[6] * c[0] + r[7] * c[1] + r[8] * c[2],
            )
            reach = _half_extents(scene.pieces.kind[i], r, vec_at(boxes.local_half, i))
            low, high = sub(middle, reach), add(middle, reach)
            set_vec_at(boxes.piece_low, i, low)
            set_vec_at(boxes.piece_high, i, high)
            body_low, body_high = _least(body_low, low), _most(body_high, high)
        set_vec_at(boxes.body_low, body, body_low)
        set_vec_at(boxes.body_high, body, body_high)
        tree_low, tree_high = _least(tree_low, body_low), _most(tree_high, body_high)
    set_vec_at(boxes.tree_low, tree, tree_low)
    set_vec_at(boxes.tree_high, tree, tree_high)


@kernel
def apart(low_a: Floats, high_a: Floats, low_b: Floats, high_b: Floats, i: int, j: int, margin: float) -> bool:
    """Whether box i of the first set and box j of the second are farther apart than `margin` along some axis."""
    return (
        low_a[i, 0] > high_b[j, 0] + margin
        or low_b[j, 0] > high_a[i, 0] + margin
        or low_a[i, 1] > high_b[j, 1] + margin
        or low_b[j, 1] > high_a[i, 1] + margin
        or low_a[i, 2] > high_b[j, 2] + margin
        or low_b[j, 2] > high_a[i, 2] + margin
    )


@kernel
def squared_piece_gap(boxes: Boxes, a: int, b: int) -> float:
    """Square of the distance of the boxes of two pieces [m²]; 0 where they overlap."""
    square = 0.0
    for k in range(3):
        far = max(boxes.piece_low[a, k] - boxes.piece_high[b, k], boxes.piece_low[b, k] - boxes.piece_high[a, k], 0.0)
        square += far * far
    return square


@kernel
def bodies_apart(boxes: Boxes, a: int, b: int, margin: float) -> bool:
    """Whether the boxes of two bodies are farther apart than `margin` [m] along some axis."""
    return apart(boxes.body_low, boxes.body_high, boxes.body_low, boxes.body_high, a, b, margin)


@kernel
def body_apart_from_tree(boxes: Boxes, body: int, tree: int, margin: float) -> bool:
    """Whether the boxes of a body and of a tree are farther apart than `margin` [m] along some axis."""
    return apart(boxes.body_low, boxes.body_high, boxes.tree_low, boxes.tree_high, body, tree, margin)


@kernel
def _add_near(boxes: Boxes, tree: int, other: int, margin: float, found: Ints, count: int) -> int:
    """Write another tree to `found`, which has `count`, if its box comes within `margin` [m]; returns their number."""
    if other == tree or apart(boxes.tree_low, boxes.tree_high, boxes.tree_low, boxes.tree_high, tree, other, margin):
        return count
    found[count] = other
    return count + 1


@kernel
def near_trees(boxes: Boxes, tree: int, margin: float, found: Ints) -> int:
    """Trees whose boxes come within `margin` [m] of that of `tree`, itself left out; returns their number.

    They are written to `found`: the sorted still ones by low x, then the others.
    """
    count = 0
    low, high = boxes.tree_low[tree, 0] - margin, boxes.tree_high[tree, 0] + margin
    start = np.searchsorted(boxes.sorted_low, low - boxes.widest)
    for k in range(start, len(boxes.sorted_still)):
        if boxes.sorted_low[k] > high:
            break
        count = _add_near(boxes, tree, boxes.sorted_still[k], margin, found, count)
    for k in range(len(boxes.others)):
        count = _add_near(boxes, tree, boxes.others[k], margin, found, count)
    return count
