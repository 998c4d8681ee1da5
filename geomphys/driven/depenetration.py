"""Depenetration search: a free translation, near by, of a tree that starts inside something, along many directions.

Only the first frame, or bodies that have closed on a tree, need it. In the first frame any free position is valid; later
one that can be reached has priority. Distances grow by the factor `FARTHER`, so a free gap between
two of them may be missed. A direction in which nothing can be reached, however fast, is given up.
"""

from __future__ import annotations

import math

from geomphys.collision.detect import approximate_separation, measure_near
from geomphys.driven.advancement import path_is_free
from geomphys.driven.constraints import is_unlocked_pair
from geomphys.driven.postures import copy_tree
from geomphys.driven.reachability import find_obstruction, measure_swept_pairs
from geomphys.driven.state import LOCKED, DrivenWorkspace
from geomphys.driven.stepping import measure_near_pairs, pose_with_pieces
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.vec3 import Vec, scale, unit
from geomphys.scene.arrays import Scene

NEAREST = 1e-3  # m
FARTHER = 1.3  # factor from one tried distance to the next
DISTANCES = 30
BISECTIONS = 12

CLEAR, BLOCKED, OBSTRUCTED = 0, 1, 2  # verdicts on a translation


@kernel
def _direction(number: int) -> Vec:
    """One of the 26 directions to the faces, edges and corners of a cube."""
    number += 1 if number >= 13 else 0
    return unit((float(number % 3 - 1), float(number // 3 % 3 - 1), float(number // 9 - 1)))


@kernel
def _overlap(scene: Scene, ws: DrivenWorkspace, a: int, b: int, gap: float) -> bool:
    """Whether two pieces overlap; by how much is not measured."""
    p, d = ws.piece_frames, ws.detection
    return approximate_separation(scene.pieces, p.frames, a, b, gap, d.axes, d.scratch)[0] < 0.0


@noinline
def _is_clear(scene: Scene, ws: DrivenWorkspace, gap: float) -> bool:
    """Whether the posed tree being solved is clear of others by the gap; its links do not move against each other."""
    p, d, near, counts = ws.piece_frames, ws.detection, ws.near, ws.work.counts
    measure_near_pairs(scene, ws, gap, -math.inf)
    for k in range(near.counts.filled):
        if near.tree_a[k] == near.tree_b[k] or not is_unlocked_pair(ws, k):
            continue
        if (
            _overlap(scene, ws, near.a[k], near.b[k], gap)
            or measure_near(scene.pieces, p.frames, k, gap, near, d.axes, d.scratch) < gap
        ):
            counts.blocking_a, counts.blocking_b = near.a[k], near.b[k]
            return False
    return True


@kernel
def _is_obstructed_before(scene: Scene, ws: DrivenWorkspace, tree: int, k: int) -> bool:
    """Whether near pair k obstructs the path of a tree to `start` also where the other body stays as at the step's start.

    It then obstructs any farther path in this direction, however fast it is.
    """
    work, a, b, d = ws.work, ws.near.a[k], ws.near.b[k], ws.detection
    other = ws.near.tree_b[k] if ws.near.tree_a[k] == tree else ws.near.tree_a[k]
    copy_tree(scene, work.start, tree, work.trial)
    copy_tree(scene, work.before, other, work.trial)
    obstructs = not path_is_free(
        scene, work.before.poses, work.trial.poses, a, b, ws.piece_frames.moved, d.axes, d.scratch
    )
    copy_tree(scene, work.iterate, other, work.trial)
    return obstructs


@noinline
def _judge_translation(scene: Scene, ws: DrivenWorkspace, tree: int, path: Vec, gap: float, certified: bool) -> int:
    """Whether a tree, translated from `iterate`, is clear by the gap and, if `certified`, reachable from the step's start.

    CLEAR, BLOCKED, or OBSTRUCTED: nor is any position reachable that is farther in this direction. The pieces that were last
    found not to be clear are tried first.
    """
    work, counts = ws.work, ws.work.counts
    for k in range(7):
        work.start.roots[tree, k] = work.iterate.roots[tree, k] + (path[k] if k < 3 else 0.0)
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        work.start.angles[q] = work.iterate.angles[q]
    pose_with_pieces(scene, ws, work.start, tree)
    if counts.blocking_a >= 0 and _overlap(scene, ws, counts.blocking_a, counts.blocking_b, gap):
        return BLOCKED
    if not _is_clear(scene, ws, gap):
        return BLOCKED
    if not certified:
        return CLEAR
    if measure_swept_pairs(scene, ws, work.start) < 0.0:
        return BLOCKED
    k = find_obstruction(scene, ws, work.start)
    if k < 0:
        return CLEAR
    return OBSTRUCTED if _is_obstructed_before(scene, ws, tree, k) else BLOCKED


@noinline
def _free_tree(scene: Scene, ws: DrivenWorkspace, tree: int, gap: float, certified: bool) -> bool:
    """Find the shortest free translation of a tree among those tried, into `iterate`."""
    distance, nearest, towards, closed = NEAREST, math.inf, (0.0, 0.0, 0.0), 0
    for _ in range(DISTANCES):
        for number in range(26):
            if closed >> number & 1 == 1:
                continue
            d = _direction(number)
            high = min(distance, nearest - NEAREST * 1e-3)  # farther ones do not matter any more
            found = _judge_translation(scene, ws, tree, scale(d, high), gap, certified)
            closed |= int(found == OBSTRUCTED) << number
            if found != CLEAR:
                continue
            low = distance / FARTHER if distance > NEAREST else 0.0
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                if _judge_translation(scene, ws, tree, scale(d, middle), gap, certified) == CLEAR:
                    high = middle
                else:
                    low = middle
            nearest, towards = high, d
        if nearest < math.inf:
            break
        distance *= FARTHER
    if nearest < math.inf:
        for i in range(3):
            ws.work.iterate.roots[tree, i] += nearest * towards[i]
    pose_with_pieces(scene, ws, ws.work.iterate, tree)
    return nearest < math.inf


@noinline
def find_depenetration(scene: Scene, ws: DrivenWorkspace, gap: float, certified: bool) -> bool:
    """Translate the trees being solved, one by one, from `SearchWorkspace.iterate` to free positions near it; into `best`.

    Returns whether all are free then. With `certified` they must also be reachable from the start of the step.
    """
    work, free = ws.work, True
    for tree in range(len(work.mobility)):
        work.cached_mobility[tree] = work.mobility[tree]  # restored after each tree
    for tree in range(len(work.mobility)):
        if work.cached_mobility[tree] == LOCKED:
            continue
        for other in range(len(work.mobility)):
            work.mobility[other] = work.cached_mobility[other] if other == tree else LOCKED
        work.counts.blocking_a = -1
        if not _is_clear(scene, ws, gap):
            free = _free_tree(scene, ws, tree, gap, certified) and free
    for tree in range(len(work.mobility)):
        work.mobility[tree] = work.cached_mobility[tree]
        if work.mobility[tree] != LOCKED:
            copy_tree(scene, work.iterate, tree, work.best)
    return free
