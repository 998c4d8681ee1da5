"""Overlap elimination as published: chains, then translations by PD_g, iterated; then interpolation.

Of a pair of objects A and B, A is translated by

    PD_g = (Σ_i pd_i² n_i) / (Σ_i pd_i)                                                    (1)

over their overlapping pairs of pieces i, and the poses are checked again. Two driven objects take half each, any other
object stays where it is. Where the normals cancel, or overlap remains after the passes, the object is interpolated between its
last stored free state and its pose by the coupling; where there is no free state, the pass with the least overlap counts.
"""

from __future__ import annotations

from typing import NamedTuple

from geomphys.driven.paper.chains import detect, draw_order, move_chains, update_tree
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.postures import Posture, copy_tree
from geomphys.driven.reach_cones import cone_angle
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import add_vec, set_vec, vec_at, vec_of
from geomphys.numerics.vec3 import Vec, add_scaled, norm, scale, slerp, sub, unit
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, position_of, set_pose

CANCELLED = 0.1  # PD_g shorter than this fraction of the deepest overlap: the normals cancel
PROGRESS = 0.98  # of the overlap before: a larger rest is no progress
PATIENCE = 4  # passes without progress
HALVINGS = 14  # steps of bisection between the last free state and the current one


class Elimination(NamedTuple):
    """Result of the elimination."""

    passes: int
    interpolations: int  # trees that were interpolated
    overlap: float  # m, sum of the remaining depths


@kernel
def _propose(w: PaperWorkspace, tree: int, pd: Vec, fraction: float, largest: float) -> None:
    """Set the translation of a tree to `fraction` of PD_g plus the clearance, if this is the deepest of its pairs so far."""
    if largest > w.deepest[tree]:
        w.deepest[tree] = largest
        d = add_scaled(scale(pd, fraction), unit(pd), w.gap)
        for i in range(3):
            w.translation[tree, i] = d[i]


@kernel
def _object_of(scene: Scene, tree: int, body: int) -> int:
    """The object of a body, as a body: a driven tree is one object, every other body one of its own."""
    return scene.trees.body_start[tree] if scene.trees.role[tree] == DRIVEN else body


@noinline
def sum_depths(scene: Scene, w: PaperWorkspace, first: int) -> int:
    """Sums of (1) over the overlaps of the pair of trees that begins at row `first` of the near pairs, for each object of the
    second tree, into `sums`; returns the row after them.
    """
    near = w.near
    a, b, k = near.tree_a[first], near.tree_b[first], first
    for body in range(scene.trees.body_start[b], scene.trees.body_start[b + 1]):
        s = w.sums[body]
        set_vec(s.weighted, (0.0, 0.0, 0.0))
        s.depths = s.deepest = 0.0
    while k < near.counts.filled and near.tree_a[k] == a and near.tree_b[k] == b:
        depth = -near.separation[k]
        if depth > 0.0:
            s = w.sums[_object_of(scene, b, scene.pieces.body[near.b[k]])]
            add_vec(s.weighted, vec_at(near.normal, k), depth * depth)
            s.depths, s.deepest = s.depths + depth, max(s.deepest, depth)
        k += 1
    return k


@noinline
def propose_translations(scene: Scene, w: PaperWorkspace) -> None:
    """Equation (1) for every pair of objects that overlap: `translation` of each tree by its deepest pair."""
    for tree in range(len(w.deepest)):
        w.deepest[tree] = 0.0
        for i in range(3):
            w.translation[tree, i] = 0.0
    k = 0
    while k < w.near.counts.filled:  # pairs of pieces are sorted by pairs of trees
        a, b = w.near.tree_a[k], w.near.tree_b[k]
        k = sum_depths(scene, w, k)
        if a == b:
            continue
        both = scene.trees.role[b] == DRIVEN
        for body in range(scene.trees.body_start[b], scene.trees.body_start[b + 1]):
            s = w.sums[body]
            if s.depths == 0.0:
                continue
            pd = scale(vec_of(s.weighted), 1.0 / s.depths)
            if norm(pd) < CANCELLED * s.deepest:
                w.cancelled[a] = 1
                if both:
                    w.cancelled[b] = 1
                continue
            _propose(w, a, pd, 0.5 if both else 1.0, s.deepest)
            if both:
                _propose(w, b, scale(pd, -1.0), 0.5, s.deepest)


@noinline
def translate_trees(scene: Scene, w: PaperWorkspace) -> bool:
    """Translate every driven tree by the deepest of its PD_g; whether one was moved."""
    propose_translations(scene, w)
    some = False
    for tree in range(len(w.deepest)):
        if w.deepest[tree] == 0.0 or w.cancelled[tree] == 1:
            continue
        some = True
        for i in range(3):
            w.iterate.roots[tree, i] += w.translation[tree, i]
        update_tree(scene, w, tree)
    return some


@kernel
def overlaps_others(w: PaperWorkspace, tree: int) -> bool:
    """Whether a driven tree overlaps another object in the poses last checked."""
    for k in range(w.near.counts.filled):
        a, b = w.near.tree_a[k], w.near.tree_b[k]
        if a != b and tree in (a, b) and w.near.separation[k] < 0.0:
            return True
    return False


@kernel
def _is_free(scene: Scene, w: PaperWorkspace, tree: int) -> bool:
    """Whether a tree overlaps no other object at the iterate, and no limb of it is out of its reach cone."""
    update_tree(scene, w, tree)
    detect(scene, w)
    if overlaps_others(w, tree):
        return False
    for cone in range(len(w.cone_limit)):
        body = scene.cones.joints[scene.cones.joint_start[cone]]
        if scene.bodies.tree[body] == tree and cone_angle(scene, cone, w.iterate.angles) < w.cone_limit[cone]:
            return False
    return True


@kernel
def _interpolate(scene: Scene, w: PaperWorkspace, tree: int, fraction: float) -> None:
    """Interpolate the iterate of a tree between its last free state (fraction 0) and its posture by the coupling (fraction 1)."""
    p, target = position_of(w.free.roots, tree), position_of(w.target.roots, tree)
    q = slerp(orientation_of(w.free.roots, tree), orientation_of(w.target.roots, tree), fraction)
    set_pose(w.iterate.roots, tree, add_scaled(p, sub(target, p), fraction), q)
    for j in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        value = w.free.angles[j] + fraction * (w.target.angles[j] - w.free.angles[j])
        w.iterate.angles[j] = min(max(value, w.lower[j]), w.upper[j])


@noinline
def interpolate_tree(scene: Scene, w: PaperWorkspace, tree: int) -> bool:
    """Move a tree to the free state nearest to the current one between that and its last free one; whether there is one."""
    if w.has_free[tree] == 0:
        return False
    _interpolate(scene, w, tree, 0.0)
    if not _is_free(scene, w, tree):
        return False
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        _interpolate(scene, w, tree, middle)
        if _is_free(scene, w, tree):
            low = middle
        else:
            high = middle
    _interpolate(scene, w, tree, low)
    update_tree(scene, w, tree)
    return True


@kernel
def copy_driven(scene: Scene, source: Posture, target: Posture) -> None:
    """Copy the driven trees of a posture."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            copy_tree(scene, source, tree, target)


@noinline
def eliminate(scene: Scene, w: PaperWorkspace, number: int) -> Elimination:
    """Eliminate the overlaps of driven trees at the iterate; `number` is that of the frame, for the order of chains."""
    chained, patience, passes, interpolations = False, PATIENCE, 0, 0
    for tree in range(len(w.cancelled)):
        w.cancelled[tree] = w.interpolated[tree] = 0
        chained = chained or scene.trees.chains[tree] == 1
    copy_driven(scene, w.iterate, w.target)
    copy_driven(scene, w.iterate, w.best)
    overlap = detect(scene, w)
    if overlap == 0.0:
        return Elimination(0, 0, 0.0)
    draw_order(w, number)
    least = overlap
    for count in range(w.passes):
        passes = count + 1
        if chained:
            move_chains(scene, w, count)
        moved = translate_trees(scene, w)
        overlap = detect(scene, w)
        patience = PATIENCE if overlap < PROGRESS * least else patience - 1
        if overlap < least:
            least = overlap
            copy_driven(scene, w.iterate, w.best)
        if overlap == 0.0 or patience == 0 or not (moved or chained):
            break
    for tree in range(len(w.cancelled)):
        if scene.trees.role[tree] == DRIVEN and overlaps_others(w, tree):
            interpolations += 1
            w.interpolated[tree] = 1
            if not interpolate_tree(scene, w, tree):
                copy_tree(scene, w.best, tree, w.iterate)
                update_tree(scene, w, tree)
            overlap = detect(scene, w)
    return Elimination(passes, interpolations, overlap)
