"""Finds the pairs of convex pieces that are near each other, their separations and normals."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.extent import extent, local_extent
from geomphys.collision.penetration import Scratch, Separation, separate, separation
from geomphys.collision.support import shapes_of
from geomphys.collision.sweep import Boxes, apart, bodies_apart, body_apart_from_tree, near_trees, squared_piece_gap
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import set_vec, set_vec_at, vec_of
from geomphys.numerics.vec3 import Vec, dot, neg, rotate, rotate_back
from geomphys.scene.arrays import DRIVEN, SIMULATED, Pieces, Scene
from geomphys.scene.kinematics import frame_position, frame_rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Records = NDArray[Any]

NOWHERE = (0.0, 0.0, 0.0)  # witness points of a pair that is not measured
UNKNOWN = -math.inf  # an extent
APPROXIMATE = 0.9  # of the separation: where only a bound is needed
BOXES_SUFFICE = 2e-3  # m: pairs whose boxes are farther apart are listed with that bound, without a direction


PAIR_COUNTS = np.dtype(
    [
        ("filled", np.int64),
        ("lost", np.int64),  # pairs that found the table full since it was last set to 0
    ]
)
"""Counts of a table of near pairs."""


MOTION_BOUND = np.dtype(
    [
        ("world", np.float64),  # m, in the world
        ("joints", np.float64),  # m, by joints alone: of its pieces among each other
    ]
)
"""How far the pieces of a tree may move."""


class Near(NamedTuple):
    """Pairs of pieces that are near each other, in a fixed order. `counts.filled` of them are filled."""

    counts: Record  # PAIR_COUNTS
    a: Ints  # (n,) pieces
    b: Ints  # (n,)
    tree_a: Ints  # (n,)
    tree_b: Ints  # (n,)
    separation: Floats  # (n,) m, > 0: distance; < 0: penetration depth
    normal: Floats  # (n, 3) unit, out of b into a; zeros: unknown, the bound is that of boxes
    point_a: Floats  # (n, 3) witness points, world
    point_b: Floats  # (n, 3)
    exact: Ints  # (n,) 0: `separation` is a lower bound, and the points are undefined


CACHED_AXIS = np.dtype(
    [
        ("pair", np.int64),  # its number, -1: none
        ("direction", np.float64, 3),  # in the frame of its second piece, as is
        ("extent", np.float64),  # m, that piece's along it; UNKNOWN until it is asked for
    ]
)
"""The separating direction of a pair of pieces, as last found: it turns along with the second piece."""


class Axes(NamedTuple):
    """Cached separating directions of pairs, from which the next search starts. Losing one costs time only."""

    rows: Records  # (n,) CACHED_AXIS


class Detection(NamedTuple):
    """Workspace of collision detection: derived and disposable."""

    boxes: Boxes
    axes: Axes
    scratch: Scratch
    found: Ints  # (T,) scratch


def make_near(size: int) -> Near:
    """A table for `size` pairs."""
    a, b, tree_a, tree_b = (np.zeros(size, np.int64) for _ in range(4))
    normal, point_a, point_b = (np.zeros((size, 3)) for _ in range(3))
    counts, exact = np.zeros((), PAIR_COUNTS), np.ones(size, np.int64)
    return Near(counts, a, b, tree_a, tree_b, np.zeros(size), normal, point_a, point_b, exact)


def make_axes(size: int = 1 << 14) -> Axes:
    """A table for `size` (a power of two) cached directions."""
    axes = Axes(np.zeros(size, CACHED_AXIS))
    axes.rows["pair"] = -1
    return axes


@kernel
def _slot_of(pieces: Pieces, a: int, b: int, axes: Axes) -> tuple[int, int]:
    """(number of a pair, the row where its direction is if that holds the number): pairs of one piece have adjacent rows."""
    key = a * len(pieces.kind) + b
    return key, key & (len(axes.rows) - 1)


@kernel
def _recall(axes: Axes, key: int, slot: int, frames: Floats, b: int) -> Vec:
    """The direction cached for a pair, whose second piece is b; zeros without one."""
    row = axes.rows[slot]
    return rotate(frame_rotation(frames, b), vec_of(row.direction)) if row.pair == key else (0.0, 0.0, 0.0)


@kernel
def _remember(axes: Axes, key: int, slot: int, frames: Floats, b: int, n: Vec) -> None:
    """Cache the direction of a pair, whose second piece is b, in place of another pair's in its slot."""
    row = axes.rows[slot]
    row.pair, row.extent = key, UNKNOWN
    set_vec(row.direction, rotate_back(frame_rotation(frames, b), n))


@kernel
def pair_separation(
    pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axes: Axes, scratch: Scratch
) -> tuple[float, Vec, Vec, Vec]:
    """`separation` of pieces a and b, unless the direction cached for the pair separates them by more than `limit` [m]."""
    bound, n = separation_bound(pieces, frames, a, b, axes)
    if bound > limit:
        return bound, n, NOWHERE, NOWHERE
    key, slot = _slot_of(pieces, a, b, axes)
    s, n, pa, pb = separation(pieces, frames, a, b, limit, NOWHERE, scratch)
    _remember(axes, key, slot, frames, b, n)
    return s, n, pa, pb


@kernel
def approximate_separation(
    pieces: Pieces, frames: Floats, a: int, b: int, limit: float, axes: Axes, scratch: Scratch
) -> tuple[float, Vec]:
    """A lower bound of the separation of pieces a and b [m] and its direction: at least the share `APPROXIMATE` of a distance.

    Below 0 where they overlap, by how much is unknown.
    """
    key, slot = _slot_of(pieces, a, b, axes)
    direction = _recall(axes, key, slot, frames, b)
    scratch.simplex.count = 0
    s, n, _, _ = separate(shapes_of(pieces, frames), a, b, limit, direction, APPROXIMATE, scratch.simplex, scratch)
    _remember(axes, key, slot, frames, b, n)
    return s, n


@kernel
def measure_near(
    pieces: Pieces, frames: Floats, k: int, limit: float, near: Near, axes: Axes, scratch: Scratch
) -> float:
    """Measure the near pair k within `limit` [m], if it is not; returns its separation, or a bound above `limit`."""
    if near.exact[k] == 1:
        return float(near.separation[k])
    s, n, pa, pb = pair_separation(pieces, frames, near.a[k], near.b[k], limit, axes, scratch)
    near.separation[k], near.exact[k] = s, 1 if s <= limit else 0
    for i in range(3):
        near.normal[k, i], near.point_a[k, i], near.point_b[k, i] = n[i], pa[i], pb[i]
    return s


@kernel
def copy_measured(source: Near, target: Near, k: int) -> float:
    """Copy what was measured of the pair k, the same one in both tables; returns its separation."""
    target.separation[k], target.exact[k] = source.separation[k], 1
    for i in range(3):
        target.normal[k, i] = source.normal[k, i]
        target.point_a[k, i], target.point_b[k, i] = source.point_a[k, i], source.point_b[k, i]
    return float(source.separation[k])


@noinline
def separation_bound(pieces: Pieces, frames: Floats, a: int, b: int, axes: Axes) -> tuple[float, Vec]:
    """A lower bound of the separation of pieces a and b [m], their gap along the cached direction, and that direction.

    -inf and zeros without one.
    """
    key, slot = _slot_of(pieces, a, b, axes)
    row, shapes = axes.rows[slot], shapes_of(pieces, frames)
    n = _recall(axes, key, slot, frames, b)
    if n == NOWHERE:
        return -math.inf, n
    if row.extent == UNKNOWN:
        row.extent = local_extent(shapes, b, vec_of(row.direction))
    return -extent(shapes, a, neg(n)) - dot(n, frame_position(frames, b)) - row.extent, n


@kernel
def append_bound(near: Near, a: int, b: int, tree_a: int, tree_b: int, bound: float, n: Vec) -> None:
    """Add a pair to `near` that is not measured, with a bound on its separation; counts it as lost where the table is full.

    `n` is the direction along which they are that far apart; zeros: unknown.
    """
    k = near.counts.filled
    if k == len(near.a):
        near.counts.lost += 1
        return
    near.counts.filled = k + 1
    near.a[k], near.b[k], near.tree_a[k], near.tree_b[k] = a, b, tree_a, tree_b
    near.separation[k], near.exact[k] = bound, 0
    set_vec_at(near.normal, k, n)


@kernel
def append_pair(near: Near, a: int, b: int, tree_a: int, tree_b: int, found: Separation) -> None:
    """Add a measured pair to `near`; counts it as lost where the table is full."""
    s, n, pa, pb = found
    k = near.counts.filled
    append_bound(near, a, b, tree_a, tree_b, s, n)
    if k < len(near.a):
        near.exact[k] = 1
        set_vec_at(near.point_a, k, pa)
        set_vec_at(near.point_b, k, pb)


@noinline
def near_bodies(
    scene: Scene,
    frames: Floats,
    body_a: int,
    body_b: int,
    limit: float,
    enough: float,
    near: Near,
    detection: Detection,
) -> None:
    """Append the pairs of pieces of two bodies within `limit` [m], unless boxes or a cached direction separate them farther."""
    boxes, axes = detection.boxes, detection.axes
    tree_a, tree_b = scene.bodies.tree[body_a], scene.bodies.tree[body_b]
    for a in range(scene.bodies.piece_start[body_a], scene.bodies.piece_start[body_a + 1]):
        if apart(boxes.piece_low, boxes.piece_high, boxes.body_low, boxes.body_high, a, body_b, limit):
            continue
        for b in range(scene.bodies.piece_start[body_b], scene.bodies.piece_start[body_b + 1]):
            square = squared_piece_gap(boxes, a, b)
            if square > limit * limit:
                continue
            bound = math.sqrt(square)
            if bound > max(enough, BOXES_SUFFICE) or enough == -math.inf:
                append_bound(near, a, b, tree_a, tree_b, bound, NOWHERE)
                continue
            bound, along = separation_bound(scene.pieces, frames, a, b, axes)
            if bound > limit:
                continue
            if bound >= enough:
                append_bound(near, a, b, tree_a, tree_b, bound, along)
                continue
            key, slot = _slot_of(scene.pieces, a, b, axes)
            found = separation(scene.pieces, frames, a, b, limit, NOWHERE, detection.scratch)
            _remember(axes, key, slot, frames, b, found[1])
            if found[0] <= limit:
                append_pair(near, a, b, tree_a, tree_b, found)


@kernel
def near_pairs_of_trees(
    scene: Scene,
    frames: Floats,
    tree_a: int,
    tree_b: int,
    limit: float,
    enough: float,
    near: Near,
    detection: Detection,
) -> None:
    """Append the pairs of pieces of two trees that are within `limit` [m]."""
    boxes = detection.boxes
    for body_a in range(scene.trees.body_start[tree_a], scene.trees.body_start[tree_a + 1]):
        if body_apart_from_tree(boxes, body_a, tree_b, limit):
            continue
        for body_b in range(scene.trees.body_start[tree_b], scene.trees.body_start[tree_b + 1]):
            if not bodies_apart(boxes, body_a, body_b, limit):
                near_bodies(scene, frames, body_a, body_b, limit, enough, near, detection)


@kernel
def near_pairs_within_tree(
    scene: Scene, frames: Floats, tree: int, limit: float, enough: float, near: Near, detection: Detection
) -> None:
    """Append the pairs of pieces of links of one avatar that may collide and are within `limit` [m]."""
    boxes = detection.boxes
    last = scene.trees.body_start[tree + 1]
    for body_a in range(scene.trees.body_start[tree], last):
        for body_b in range(body_a + 1, last):
            if scene.excluded[body_a, body_b] == 0 and not bodies_apart(boxes, body_a, body_b, limit):
                near_bodies(scene, frames, body_a, body_b, limit, enough, near, detection)


@kernel
def set_motion_bound(bounds: Records, tree: int, far: float) -> None:
    """Let the pieces of a tree move by `far` [m], in the world and among each other."""
    bounds[tree].world = bounds[tree].joints = far


@noinline
def find_overlaps_with_simulated(scene: Scene, frames: Floats, near: Near, detection: Detection) -> None:
    """Pairs of pieces of a driven and a simulated tree that touch or overlap, in place of those in `near`.

    As of `find_near`, whose arguments have the same names.
    """
    near.counts.filled = 0
    low, high = detection.boxes.tree_low, detection.boxes.tree_high
    for tree in range(len(scene.trees.role)):
        for other in range(len(scene.trees.role)):
            together = scene.trees.role[tree] == DRIVEN and scene.trees.role[other] == SIMULATED
            if together and not apart(low, high, low, high, tree, other, 0.0):
                near_pairs_of_trees(scene, frames, tree, other, 0.0, math.inf, near, detection)


@noinline
def find_near(
    scene: Scene, frames: Floats, bounds: Records, margin: float, enough: float, near: Near, detection: Detection
) -> None:
    """All pairs of pieces, one of them driven, that may come into contact.

    Parameters
    ----------
    scene, frames
        The scene and its pieces' world frames (P, 12).
    bounds
        (T,) MOTION_BOUND: how far the pieces of each tree may move before the answer is used.
    margin
        m; pairs farther apart than the bounds of both and `margin` are left out.
    enough
        m; pairs that their boxes or a cached direction separate this far are not measured: `separation` and `normal` are that
        bound and direction, `exact` is 0. inf: all are measured; -inf: the bounds of boxes suffice.
    near
        The pairs replace the earlier ones; `counts.lost` counts those beyond its capacity.
    detection
        Its boxes are those of the pieces at `frames`.
    """
    boxes, found = detection.boxes, detection.found
    near.counts.filled = 0
    widest = 0.0
    for tree in range(len(scene.trees.role)):
        widest = max(widest, bounds[tree].world)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        count = near_trees(boxes, tree, bounds[tree].world + widest + margin, found)
        for k in range(count):
            other = found[k]
            if scene.trees.role[other] == DRIVEN and other < tree:
                continue
            limit = bounds[tree].world + bounds[other].world + margin
            if not apart(boxes.tree_low, boxes.tree_high, boxes.tree_low, boxes.tree_high, tree, other, limit):
                near_pairs_of_trees(scene, frames, tree, other, limit, enough, near, detection)
        if scene.trees.chains[tree] == 1 and scene.trees.self_collision[tree] == 1:
            limit = 2.0 * bounds[tree].joints + margin
            near_pairs_within_tree(scene, frames, tree, limit, enough, near, detection)
