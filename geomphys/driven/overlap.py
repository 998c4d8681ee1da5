"""Overlap elimination by translation: the nearest free place to where the coupling pulls.

A rigid body that only translates sees every pair of convex pieces as one convex obstacle, and the plane that separates
the pair now, or the plane of its penetration depth if it overlaps, bounds a half-space that is free of the obstacle
from end to end. The nearest point to the goal within such half-spaces (`least_distance`) is therefore free of all
obstacles that were asked for a plane, and the straight way there leads through nothing. Planes are added one at a
time, for the obstacle that is met first, until nothing stands in the way; then the planes are found anew at the new
place. With one normal this is the translation by the penetration depth (1); with several it is the smallest
translation that satisfies all of them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, bound_pair, find_near, measure_pair, pair_clearance
from geomphys.collision.penetration import Scratch
from geomphys.collision.sweep import Boxes, update_boxes
from geomphys.driven.detour import DETOUR, goes_through
from geomphys.driven.escape import ALONG, Rescue, ask_to_hold, concerns, escape
from geomphys.driven.least_distance import SOLVED, LeastDistance, solve_least_distance
from geomphys.driven.places import Places, distance, limit_of, place_at, relative_way, row_of
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, dot, norm
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REACH = 2.3  # times the way to the goal: what a tree may go in a round and the rounds after (√5 at most, begun free)
CLEAR = 10.0  # gaps: pairs known to be this far apart are measured only if they turn out to be in the way
STEP_DONE = 1e-7  # m: a round that moves nothing farther ends the loop
ROW_TOLERANCE = 1e-10  # m: how far a plane may stay violated
SHALLOW = 0.25  # of the mean thickness of two pieces: an overlap that may wait for the next step of a frame
FAR = 10.0  # times the depth: a solution farther away is none (nearly opposite normals)

# methods, in the order of results.METHODS
GLOBAL = 0
LEAST_DISTANCE = 1
INTERPOLATED = 2


@kernel
def _add_plane(p: Places, near: Near, k: int, problem: LeastDistance, unknowns: int, row: int, gap: float) -> None:
    """Row: after the move the pair k stays `gap` apart along its present normal."""
    for j in range(unknowns):
        problem.rows[row, j] = 0.0
    ca, cb = p.column[near.tree_a[k]], p.column[near.tree_b[k]]
    both = ca >= 0 and cb >= 0
    scale = math.sqrt(0.5) if both else 1.0
    bound = gap - near.separation[k]
    for i in range(3):
        n = near.normal[k, i]
        if ca >= 0:
            problem.rows[row, ca + i] += scale * n
            bound += n * p.current[near.tree_a[k], i]
        if cb >= 0:
            problem.rows[row, cb + i] -= scale * n
            bound -= n * p.current[near.tree_b[k], i]
    problem.bounds[row] = scale * bound
    p.chosen[k] = 1


@kernel
def _way_is_free(
    scene: Scene, p: Places, near: Near, k: int, step: Vec, gap: float, axes: Axes, scratch: Scratch
) -> bool:
    """Conservative advancement of the pair k along `step`: no move is longer than the clearance before it."""
    length = norm(step)
    a, b = near.a[k], near.b[k]
    keep = (p.moved[a, 9], p.moved[a, 10], p.moved[a, 11])
    keep_b = (p.moved[b, 9], p.moved[b, 10], p.moved[b, 11])
    for i in range(3):
        p.moved[b, 9 + i] = p.frames[b, 9 + i]
    share, clear, free = 0.0, near.separation[k], False
    for _ in range(64):
        if clear < 0.25 * gap:
            break
        share += max(clear, gap) / length
        if share >= 1.0:
            free = True
            break
        for i in range(3):
            p.moved[a, 9 + i] = p.frames[a, 9 + i] + share * step[i]
        clear, _ = pair_clearance(scene.pieces, p.moved, a, b, length, axes, scratch)
    p.moved[a, 9], p.moved[a, 10], p.moved[a, 11] = keep
    p.moved[b, 9], p.moved[b, 10], p.moved[b, 11] = keep_b
    return free


@kernel
def _first_obstacle(scene: Scene, p: Places, near: Near, group: int, gap: float, axes: Axes, scratch: Scratch) -> int:
    """Of the pairs without a plane that stand between `current` and `trial`, the one that is met first; -1: none."""
    first, deepest, found = math.inf, 0.0, -1
    tree_a, tree_b, step = -1, -1, (0.0, 0.0, 0.0)
    for k in range(near.filled[0]):
        if p.chosen[k] == 1 or p.group[near.tree_a[k]] != group:
            continue
        if near.tree_a[k] != tree_a or near.tree_b[k] != tree_b:  # pairs of the same trees stand together
            tree_a, tree_b = near.tree_a[k], near.tree_b[k]
            step = relative_way(p.current, p.trial, tree_a, tree_b)
        n = row_of(near.normal, k)
        s, along = near.separation[k], dot(n, step)
        if s + along >= 0.5 * gap:
            continue
        if near.exact[k] == 0:
            measure_pair(scene.pieces, p.frames, near, k, limit_of(p, near, k, gap), axes, scratch)
            n = row_of(near.normal, k)
            s, along = near.separation[k], dot(n, step)
            if s + along >= 0.5 * gap:
                continue
        moment = max(s - gap, 0.0) / max(-along, 1e-300)
        depth = gap - s - along
        if moment > first + 1e-12 or (moment >= first - 1e-12 and depth <= deepest):
            continue
        enough = max(norm(step) - s, 0.5 * gap)
        there, m = pair_clearance(scene.pieces, p.moved, near.a[k], near.b[k], enough, axes, scratch)
        if there >= 0.5 * gap:
            if s + there > norm(step) or there - dot(m, step) >= 0.0:
                continue
            if _way_is_free(scene, p, near, k, step, gap, axes, scratch):
                continue
        first, deepest, found = moment, depth, k
    return found


@kernel
def _find_groups(scene: Scene, p: Places, near: Near) -> None:
    """Label driven trees that may meet, directly or by others in between, with the first of them; others do not interact."""
    for tree in range(len(p.group)):
        p.group[tree] = tree if scene.trees.role[tree] == DRIVEN else -1
    changed = True
    while changed:
        changed = False
        for k in range(near.filled[0]):
            a, b = p.group[near.tree_a[k]], p.group[near.tree_b[k]]
            if a >= 0 and b >= 0 and a != b:
                p.group[near.tree_a[k]] = p.group[near.tree_b[k]] = min(a, b)
                changed = True


@kernel
def _number_unknowns(scene: Scene, p: Places, near: Near, group: int) -> int:
    """Give each driven tree of a group with a near pair its three unknowns; the others go to their goals."""
    for tree in range(len(p.column)):
        p.column[tree] = -1
    unknowns = 0
    for k in range(near.filled[0]):
        if p.group[near.tree_a[k]] != group:
            continue
        for tree in (near.tree_a[k], near.tree_b[k]):
            if scene.trees.role[tree] == DRIVEN and p.column[tree] < 0:
                p.column[tree] = unknowns
                unknowns += 3
    return unknowns


@kernel
def _set_trial(scene: Scene, p: Places, problem: LeastDistance, group: int) -> float:
    """Read a group's solution into `trial` and place the pieces there; returns the longest move."""
    longest = 0.0
    for tree in range(len(p.column)):
        if p.group[tree] != group:
            continue
        for i in range(3):
            p.trial[tree, i] = problem.x[p.column[tree] + i] if p.column[tree] >= 0 else p.goal[tree, i]
        place_at(scene, p.base, p.trial, tree, p.moved)
        longest = max(longest, distance(p.trial, p.current, tree))
    return longest


@outlined
def _nearest_free_of(
    scene: Scene, p: Places, near: Near, ignored: Ints, problem: LeastDistance, group: int, gap: float, axes: Axes,
    scratch: Scratch,
) -> tuple[int, float, int]:  # fmt: skip
    """Planes until the way of a group of trees is free: (SOLVED or not, longest move, planes that hold)."""
    unknowns = _number_unknowns(scene, p, near, group)
    rows, deepest = 0, 0.0
    for k in range(near.filled[0]):
        if p.group[near.tree_a[k]] != group:
            continue
        p.chosen[k] = 0 if concerns(scene, near, ignored, k) else 1
        if p.chosen[k] == 0 and near.separation[k] < 0.0 and rows < len(problem.bounds):
            _add_plane(p, near, k, problem, unknowns, rows, gap)
            rows += 1
            deepest = max(deepest, -near.separation[k])
    pull = 0.0
    for tree in range(len(p.column)):
        if p.group[tree] == group:
            pull = max(pull, distance(p.goal, p.current, tree))
    while True:
        for tree in range(len(p.column)):
            if p.column[tree] >= 0:
                for i in range(3):
                    problem.x[p.column[tree] + i] = p.goal[tree, i]
        status, active = solve_least_distance(problem, unknowns, rows, ROW_TOLERANCE)
        longest = _set_trial(scene, p, problem, group)
        if status != SOLVED or longest > 2.0 * pull + FAR * deepest + 10.0 * gap:
            return 1, 0.0, active
        k = _first_obstacle(scene, p, near, group, gap, axes, scratch)
        if k < 0:
            return SOLVED, longest, active
        if rows == len(problem.bounds):
            return 1, 0.0, active
        _add_plane(p, near, k, problem, unknowns, rows, gap)
        rows += 1


@kernel
def _nearest_free(
    scene: Scene, p: Places, near: Near, ignored: Ints, problem: LeastDistance, gap: float, axes: Axes, scratch: Scratch
) -> tuple[int, float, int]:
    """One round, group by group: (SOLVED or not, longest move, most planes that hold in a group)."""
    _find_groups(scene, p, near)
    longest, most = 0.0, 0
    for tree in range(len(p.group)):
        if p.group[tree] == tree:
            status, moved, active = _nearest_free_of(scene, p, near, ignored, problem, tree, gap, axes, scratch)
            longest, most = max(longest, moved), max(most, active)
            if status != SOLVED:
                p.wedged[0] = tree
                return status, 0.0, most
    return SOLVED, longest, most


@kernel
def _accept(scene: Scene, p: Places) -> None:
    """`trial` becomes `current`."""
    for tree in range(len(p.column)):
        if scene.trees.role[tree] == DRIVEN:
            for i in range(3):
                p.current[tree, i] = p.trial[tree, i]
            place_at(scene, p.base, p.current, tree, p.frames)


@kernel
def _may_wait(scene: Scene, p: Places, near: Near, ignored: Ints) -> bool:
    """Whether all that overlaps in the group that is wedged is carried, not deep, and this is not the frame's last step."""
    if p.passing[0] == 0:
        return False
    waits = True
    for k in range(near.filled[0]):
        a, b = near.tree_a[k], near.tree_b[k]
        if p.group[a] == p.wedged[0] and near.separation[k] < 0.0 and concerns(scene, near, ignored, k):
            mean = 0.5 * (scene.pieces.thickness[near.a[k]] + scene.pieces.thickness[near.b[k]])
            carried = p.held[a] >= ALONG or (scene.trees.role[b] == DRIVEN and p.held[b] >= ALONG)
            waits = waits and carried and -near.separation[k] < SHALLOW * mean
    return waits


@kernel
def _note_start(scene: Scene, p: Places) -> None:
    """Where trees are that are about to go somewhere."""
    for tree in range(len(p.start)):
        if scene.trees.role[tree] == DRIVEN:
            for i in range(3):
                p.start[tree, i] = p.current[tree, i]


@outlined
def find_reachable(
    scene: Scene, p: Places, boxes: Boxes, near: Near, stirred: bool, gap: float, axes: Axes, scratch: Scratch
) -> None:
    """All pairs that trees may meet on their way from `current` to `goal`, or that `p.stir` has moved through, if `stirred`."""
    for tree in range(len(p.reach)):
        for i in range(2):
            p.reach[tree, i] = p.stir[tree, i] if stirred else 0.0
        for i in range(3):
            p.origin[tree, i] = p.seen[tree, i] = p.current[tree, i]
        if scene.trees.role[tree] == DRIVEN:
            p.reach[tree, 0] += REACH * distance(p.goal, p.current, tree)
            update_boxes(scene, p.frames, boxes, tree)
    find_near(scene, p.frames, boxes, p.reach, 2.0 * gap, CLEAR * gap, near, p.found, axes, scratch)


@kernel
def _measure_again(scene: Scene, p: Places, near: Near, gap: float, axes: Axes, scratch: Scratch) -> bool:
    """Bring the pairs of `find_reachable` up to date; False if a tree may get out of what was looked at there."""
    for tree in range(len(p.reach)):
        if scene.trees.role[tree] == DRIVEN:
            left = p.reach[tree, 0] - distance(p.current, p.origin, tree)
            if 2.0 * distance(p.goal, p.current, tree) > left:
                return False
    tree_a, tree_b, step = -1, -1, (0.0, 0.0, 0.0)
    for k in range(near.filled[0]):
        if near.tree_a[k] != tree_a or near.tree_b[k] != tree_b:
            tree_a, tree_b = near.tree_a[k], near.tree_b[k]
            step = relative_way(p.seen, p.current, tree_a, tree_b)
        if near.separation[k] > 0.0:  # what a direction shows to be apart it shows again, by so much more or less
            bound = near.separation[k] + dot(row_of(near.normal, k), step)
            if bound >= CLEAR * gap:
                near.separation[k], near.exact[k] = bound, 0
                continue
        if bound_pair(scene.pieces, p.frames, near, k, CLEAR * gap, axes):
            continue
        limit = 2.0 * gap
        for tree in (near.tree_a[k], near.tree_b[k]):
            if scene.trees.role[tree] == DRIVEN:
                limit += 2.0 * distance(p.goal, p.current, tree)
        measure_pair(scene.pieces, p.frames, near, k, limit, axes, scratch)
    for tree in range(len(p.seen)):
        for i in range(3):
            p.seen[tree, i] = p.current[tree, i]
    return True


@outlined
def eliminate_overlap(
    scene: Scene, p: Places, boxes: Boxes, near: Near, known: bool, ignored: Ints, problem: LeastDistance, gap: float,
    rounds: int, rescue: Rescue, axes: Axes, scratch: Scratch,
) -> tuple[int, int, int, bool]:  # fmt: skip
    """Move all driven trees from `current` as near to `goal` as they come without overlap and without passing through.

    Parameters
    ----------
    scene, p, boxes
        The scene, where its trees are (`frames` placed at `current`), and their boxes.
    near, problem, rescue, axes, scratch
        Room for the near pairs, the least-distance problem, the search for a way out and the narrow phase.
    known
        Whether `find_reachable` has filled `near` already.
    ignored
        (B,) 1 for bodies that may overlap for now (chains see to them).
    gap
        m; clearance kept.
    rounds
        Bound on the rounds.

    Returns
    -------
    tuple
        (rounds taken, method as in `results.METHODS`, searches for a way out, whether nothing is left to be done).
    """
    method, rescues, again, far, status, longest = GLOBAL, 0, False, 0.0, 1, 0.0
    _note_start(scene, p)
    for count in range(rounds):
        if not known and not (again and _measure_again(scene, p, near, gap, axes, scratch)):
            find_reachable(scene, p, boxes, near, count == 0, gap, axes, scratch)
        known, again = False, True
        status, longest, active = _nearest_free(scene, p, near, ignored, problem, gap, axes, scratch)
        method = max(method, LEAST_DISTANCE if active > 1 else GLOBAL)
        detour = status == SOLVED and p.begun[0] == 1 and min(far, longest) > DETOUR
        detour = detour and goes_through(scene, p, near, ignored, axes, scratch)
        if status == SOLVED and not detour:
            far += longest
            _accept(scene, p)
            if longest <= STEP_DONE or active == 0:
                return count + 1, method, rescues, True
            continue
        overlapped = False
        for k in range(near.filled[0]):
            overlapped = overlapped or (near.separation[k] < 0.0 and concerns(scene, near, ignored, k))
        if not overlapped:
            return count + 1, method if detour else INTERPOLATED, rescues, True
        method = INTERPOLATED
        rescues += 1
        if p.hasty[0] == 1:
            return count + 1, method, rescues, False
        if ask_to_hold(scene, near, ignored, p.group, p.wedged[0], p.behind, False, p.asked, p.held):
            return count + 1, method, rescues, True
        if _may_wait(scene, p, near, ignored):
            return count + 1, method, rescues, True
        if not escape(
            scene, p.base, p.current, p.frames, boxes, near, ignored, gap, p.begun[0] == 1, rescue, p.found, axes, scratch
        ):  # fmt: skip
            if ask_to_hold(scene, near, ignored, p.group, p.wedged[0], p.behind, True, p.asked, p.held):
                return count + 1, method, rescues, True
            if p.asked[0] != 0:  # there is no free place that it could get to
                return count + 1, method, rescues, p.passing[0] == 1
            escape(scene, p.base, p.current, p.frames, boxes, near, ignored, gap, False, rescue, p.found, axes, scratch)
        p.escapes[0] += 1
        again, far = False, 0.0
        _note_start(scene, p)
    return rounds, method, rescues, status == SOLVED and longest <= gap
