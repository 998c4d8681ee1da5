"""The way out for a tree whose overlaps cannot be undone by their normals: a search over directions.

Normals that cancel (a rod between thumb and finger, a hand in a box) leave equation (1) and the least-distance problem
without an answer. Then the shortest way out among many directions is taken: along each the tree is advanced by its
deepest penetration depth, which never leaps over a free place, until it is free or farther than the best so far.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, near_pairs_of_trees
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, apart, near_trees, update_boxes
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add_scaled, cross, dot, norm, perpendicular, unit
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FAN = 66  # directions spread over the sphere
FARTHEST = 50.0  # m
ROUNDS = 4  # of refinement about the best direction
PASSED = 0.5  # of the mean thickness of two pieces: one that is deeper in the other on its way goes through it
DEEPER = 1.1  # times the share at the start is through it in any case
PITCH = 2e-4  # m: how finely a way is checked for that at most
ASKED = 2  # value of `Places.asked`: trees are to be held, and the step is to be done again
# values of `Places.held`: a tree is free to turn; keeps the orientation and shape of its last free place; is carried by
# what carried it in the step before; by what wedges it now
LOOSE, HELD, ALONG, CARRIED = range(4)


class Rescue(NamedTuple):
    """Directions to try, and room for the pairs met on the way."""

    directions: Floats  # (n, 3); the first FAN of them are spread over the sphere
    near: Near


def make_rescue(near: Near) -> Rescue:
    """The fan of directions (a Fibonacci lattice on the sphere) and room for those the contacts suggest."""
    directions = np.zeros((FAN + 64, 3))
    k = np.arange(FAN) + 0.5
    z = 1.0 - 2.0 * k / FAN
    turn = math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z * z)
    directions[:FAN] = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    return Rescue(directions, near)


@kernel
def concerns(scene: Scene, near: Near, ignored: Ints, k: int) -> bool:
    """Whether translation is to part the pair k: not links of one tree, nor ignored bodies."""
    body_a, body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
    return near.tree_a[k] != near.tree_b[k] and ignored[body_a] == 0 and ignored[body_b] == 0


@kernel
def is_mover(scene: Scene, tree: int) -> bool:
    """Whether the recording moves the tree and nothing else does: it can carry others."""
    return scene.trees.moving[tree] == 1 and scene.trees.role[tree] != SIMULATED and scene.trees.role[tree] != DRIVEN


@outlined
def ask_to_hold(
    scene: Scene, near: Near, ignored: Ints, group: Ints, wedged: int, behind: Ints, jointed: bool, asked: Ints,
    held: Ints,
) -> bool:  # fmt: skip
    """Ask that trees keep the turn of their last free place: those of a wedged group that overlap something.

    If they all do already, ask that they are carried by what they overlap, if the recording moves some of that.

    Parameters
    ----------
    scene, near, ignored
        As for `escape`.
    group, wedged
        (T,) group of every tree; the group that is wedged.
    behind
        (T,) 1 for trees that have been held and are not back yet.
    jointed
        Whether trees with joints that keep their recorded shape, too, are to be held that are not `behind`.
    asked, held
        (1,) 0: none may be held; `ASKED` if there are some more to hold. (T,) `HELD` or `CARRIED` for those.

    Returns
    -------
    bool
        Whether there are.
    """
    if asked[0] == 0:
        return False
    moved = False
    for k in range(near.filled[0]):
        if near.separation[k] < 0.0 and group[near.tree_a[k]] == wedged and concerns(scene, near, ignored, k):
            moved = moved or is_mover(scene, near.tree_b[k])
    for level in range(LOOSE, CARRIED if moved else HELD):
        next_level = HELD if level == LOOSE else CARRIED
        for k in range(near.filled[0]):
            if near.separation[k] >= 0.0 or not concerns(scene, near, ignored, k):
                continue
            for tree in (near.tree_a[k], near.tree_b[k]):
                joints = scene.trees.dof_start[tree + 1] > scene.trees.dof_start[tree] and scene.trees.chains[tree] == 0
                if group[tree] == wedged and held[tree] == level and (jointed or behind[tree] == 1 or not joints):
                    held[tree] = next_level
                    asked[0] = ASKED
        if asked[0] == ASKED:
            return True
    return asked[0] == ASKED


@kernel
def _place(scene: Scene, base: Floats, offset: Vec, tree: int, frames: Floats) -> None:
    first = scene.bodies.piece_start[scene.trees.body_start[tree]]
    last = scene.bodies.piece_start[scene.trees.body_start[tree + 1]]
    for i in range(first, last):
        for k in range(3):
            frames[i, 9 + k] = base[i, 9 + k] + offset[k]


@kernel
def _deepest(
    scene: Scene, frames: Floats, boxes: Boxes, tree: int, ignored: Ints, room: Near, found: Ints, axes: Axes,
    scratch: Scratch,
) -> tuple[float, Vec, float]:  # fmt: skip
    """Deepest overlap [m] of `tree` with anything else, its normal, pointing out of the other, and the largest share of the
    mean thickness of two pieces that one is in the other.
    """
    update_boxes(scene, frames, boxes, tree)
    room.filled[0] = 0
    for k in range(near_trees(boxes, tree, 0.0, found)):
        if not apart(boxes.tree_low, boxes.tree_high, boxes.tree_low, boxes.tree_high, tree, found[k], 0.0):
            near_pairs_of_trees(scene, frames, boxes, tree, found[k], 0.0, math.inf, room, axes, scratch)
    depth, normal, share, thickness = 0.0, (0.0, 0.0, 0.0), 0.0, scene.pieces.thickness
    for k in range(room.filled[0]):
        if room.separation[k] >= 0.0 or not concerns(scene, room, ignored, k):
            continue
        mean = 0.5 * (thickness[room.a[k]] + thickness[room.b[k]])
        share = max(share, -room.separation[k] / max(mean, 1e-6))
        if -room.separation[k] > depth:
            depth = -room.separation[k]
            normal = (room.normal[k, 0], room.normal[k, 1], room.normal[k, 2])
    return depth, normal, share


@kernel
def _thinnest(scene: Scene, tree: int) -> float:
    """Smallest mean thickness [m] that a piece of the tree and one of another can have."""
    mine, other = math.inf, math.inf
    for body in range(len(scene.bodies.tree)):
        for i in range(scene.bodies.piece_start[body], scene.bodies.piece_start[body + 1]):
            if scene.bodies.tree[body] == tree:
                mine = min(mine, scene.pieces.thickness[i])
            else:
                other = min(other, scene.pieces.thickness[i])
    return 0.5 * (mine + other)


@kernel
def _leads_through(
    scene: Scene, base: Floats, start: Vec, u: Vec, way: float, tree: int, frames: Floats, boxes: Boxes, most: float,
    ignored: Ints, room: Near, found: Ints, axes: Axes, scratch: Scratch,
) -> bool:  # fmt: skip
    """Whether the tree is in something by more than a share `most` of the thickness between `start` and `way` along u.

    No depth grows faster than the tree goes, so from a place where the largest share is s no pair gets there within
    (most - s) of the smallest mean thickness.
    """
    at, share, mean = 0.0, most / DEEPER, _thinnest(scene, tree)
    while share <= most:
        at += max((most - share) * mean, PITCH)
        if at >= way:
            return False
        _place(scene, base, add_scaled(start, u, at), tree, frames)
        share = _deepest(scene, frames, boxes, tree, ignored, room, found, axes, scratch)[2]
    return True


@kernel
def _way_out(
    scene: Scene, base: Floats, start: Vec, u: Vec, tree: int, frames: Floats, boxes: Boxes, shortest: float, depth: float,
    most: float, gap: float, ignored: Ints, room: Near, found: Ints, axes: Axes, scratch: Scratch,
) -> float:  # fmt: skip
    """How far along u the tree must go to be free, if less than `shortest` and not through anything (else inf).

    `depth` is what it must go at least; through something is what is in it by more than a share `most` of the thickness.
    """
    way = depth
    while way < shortest:
        _place(scene, base, add_scaled(start, u, way), tree, frames)
        d, n, share = _deepest(scene, frames, boxes, tree, ignored, room, found, axes, scratch)
        if share > most:
            return math.inf
        if d <= 0.0:
            if most < math.inf and _leads_through(
                scene, base, start, u, way, tree, frames, boxes, most, ignored, room, found, axes, scratch
            ):  # fmt: skip
                return math.inf
            return way
        slope = dot(n, u)
        way += max(d, gap) if slope < 0.3 else max(min(d / slope, 3.0 * d), gap)
    return math.inf


@kernel
def _suggest(near: Near, tree: int, directions: Floats) -> int:
    """Append the normals of the overlaps of `tree`, and what is at right angles to two of them; returns the number."""
    count, limit = FAN, len(directions)
    last = FAN
    for k in range(near.filled[0]):
        if near.separation[k] >= 0.0 or count >= FAN + 12:
            continue
        sign = 1.0 if near.tree_a[k] == tree else -1.0
        if near.tree_a[k] == tree or near.tree_b[k] == tree:
            for i in range(3):
                directions[count, i] = sign * near.normal[k, i]
            count += 1
    last = count
    for i in range(FAN, last):
        for j in range(i + 1, last):
            a = (directions[i, 0], directions[i, 1], directions[i, 2])
            b = (directions[j, 0], directions[j, 1], directions[j, 2])
            c = cross(a, b)
            if count + 2 > limit or norm(c) < 1e-3:
                continue
            c = unit(c)
            for k in range(3):
                directions[count, k], directions[count + 1, k] = c[k], -c[k]
            count += 2
    return count


@kernel
def _escape_tree(
    scene: Scene, base: Floats, current: Floats, frames: Floats, boxes: Boxes, tree: int, near: Near, depth: float,
    most: float, gap: float, ignored: Ints, rescue: Rescue, found: Ints, axes: Axes, scratch: Scratch,
) -> bool:  # fmt: skip
    """Translate one tree out of everything by the shortest way found; True if it is free then."""
    start = (current[tree, 0], current[tree, 1], current[tree, 2])
    shortest, best = math.inf, (0.0, 0.0, 1.0)
    count = _suggest(near, tree, rescue.directions)
    for k in range(count - 1, -1, -1):
        u = (rescue.directions[k, 0], rescue.directions[k, 1], rescue.directions[k, 2])
        way = _way_out(
            scene, base, start, u, tree, frames, boxes, min(shortest, FARTHEST), depth, most, gap, ignored, rescue.near, found,
            axes, scratch,
        )  # fmt: skip
        if way < shortest:
            shortest, best = way, u
    if shortest == math.inf:
        _place(scene, base, start, tree, frames)
        update_boxes(scene, frames, boxes, tree)
        return False
    spread = 0.25
    for _ in range(ROUNDS):
        side = perpendicular(best)
        other = cross(best, side)
        centre = best
        for k in range(6):
            angle = math.pi * k / 3.0
            u = unit(add_scaled(add_scaled(centre, side, spread * math.cos(angle)), other, spread * math.sin(angle)))
            way = _way_out(
                scene, base, start, u, tree, frames, boxes, shortest, depth, most, gap, ignored, rescue.near, found, axes,
            scratch,
            )  # fmt: skip
            if way < shortest:
                shortest, best = way, u
        spread *= 0.5
    end = add_scaled(start, best, shortest + gap)
    for i in range(3):
        current[tree, i] = end[i]
    _place(scene, base, end, tree, frames)
    update_boxes(scene, frames, boxes, tree)
    return True


@outlined
def escape(
    scene: Scene, base: Floats, current: Floats, frames: Floats, boxes: Boxes, near: Near, ignored: Ints, gap: float,
    around: bool, rescue: Rescue, found: Ints, axes: Axes, scratch: Scratch,
) -> bool:  # fmt: skip
    """Translate every driven tree that overlaps something out of it, one after the other.

    Parameters
    ----------
    scene, base
        The scene and its pieces' frames (P, 12) as recorded.
    current, frames
        (T, 3) offsets and the frames there; both are updated.
    boxes, near
        Boxes of the scene; the pairs found at `current`, whose normals suggest directions.
    ignored
        (B,) 1 for bodies that may overlap.
    gap
        m; added to the way out.
    around
        No way may lead through anything.
    rescue, found, axes, scratch
        Directions and room.

    Returns
    -------
    bool
        Whether a way out was found for all of them.
    """
    all_free = True
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, frames, boxes, tree)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        depth, _, share = _deepest(scene, frames, boxes, tree, ignored, rescue.near, found, axes, scratch)
        most = max(PASSED, DEEPER * share) if around else math.inf
        if depth > 0.0 and not _escape_tree(
            scene, base, current, frames, boxes, tree, near, depth, most, gap, ignored, rescue, found, axes, scratch
        ):  # fmt: skip
            all_free = False
    return all_free
