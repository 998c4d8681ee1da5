"""Keeps recorded contacts: a fingertip recorded in contact ends in contact.

A penalty term moves the gap of a link at the end of a chain to the recorded one, or to zero where it was recorded inside, by
the joints of its own chain alone, so that it does not move the palm. Only contacts with fixed or tracked bodies count: between
two hands the term makes motion worse. How fast fingers close is bounded by how fast the hand was recorded to move
(`Weights.closing_share`, `Weights.closing_speed`): otherwise they would jump to an object once they are recorded near it.
"""

from __future__ import annotations

import math

from geomphys.collision.detect import NOWHERE, Near, append_bound, measure_near
from geomphys.collision.sweep import squared_piece_gap, update_boxes
from geomphys.driven.constraints import add_term
from geomphys.driven.objective import is_rigid
from geomphys.driven.postures import Posture, joint_jacobian
from geomphys.driven.state import GENERAL_MOTION, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.record_copy import copy_record
from geomphys.numerics.row_vectors import set_vec, vec_at
from geomphys.numerics.vec3 import Vec
from geomphys.scene.arrays import FIXED, JOINT_FIXED, Scene

RECORDED_ON = 2e-3  # m: a link recorded no farther away is in contact


@kernel
def store_touch(ws: DrivenWorkspace, tip: int, body: int, gap: float, n: Vec) -> None:
    """Store a recorded contact, with its smallest gap and the normal there, which points out of the body."""
    work, i = ws.work, 0
    while i < work.counts.touches and (work.touches[i].tip != tip or work.touches[i].body != body):
        i += 1
    touch = work.touches[i]
    if i < work.counts.touches and touch.gap <= gap:
        return
    touch.tip, touch.body, touch.gap = tip, body, gap
    set_vec(touch.normal, n)
    work.counts.touches = max(work.counts.touches, i + 1)


@kernel
def _known_gap(scene: Scene, ws: DrivenWorkspace, near: Near, k: int, tip: int) -> float:
    """The smallest gap [m] of a tip and the body in near pair k that was found so far or is measured; inf: none."""
    body_of, gap = scene.pieces.body, math.inf
    body_a, body_b = body_of[near.a[k]], body_of[near.b[k]]
    for i in range(ws.work.counts.touches):
        if ws.work.touches[i].tip == tip and ws.work.touches[i].body == body_b:
            gap = ws.work.touches[i].gap
    for j in range(k + 1, near.counts.filled):  # pairs of two bodies are adjacent
        if body_of[near.a[j]] != body_a or body_of[near.b[j]] != body_b:
            break
        if near.exact[j] == 1:
            gap = min(gap, near.separation[j])
    return gap


@noinline
def find_touches(scene: Scene, ws: DrivenWorkspace, near: Near) -> None:
    """Recorded contacts of tips of chains, from the near pairs of the recorded poses, which are measured as needed.

    Those of a tip and a body are measured only as far as the nearest of them so far.
    """
    ws.work.counts.touches = 0
    for k in range(near.counts.filled):
        body_a, body_b = scene.pieces.body[near.a[k]], scene.pieces.body[near.b[k]]
        if near.separation[k] > RECORDED_ON or scene.bodies.role[body_b] != FIXED:
            continue
        tip = ws.links.weld_body[body_a]
        if ws.links.tip[tip] == 0:
            continue
        limit = min(RECORDED_ON, _known_gap(scene, ws, near, k, tip))
        if near.separation[k] > limit:
            continue
        s = measure_near(scene.pieces, ws.piece_frames.base, k, limit, near, ws.detection.axes, ws.detection.scratch)
        if s <= limit:
            store_touch(ws, tip, body_b, s, vec_at(near.normal, k))


@kernel
def drop_touches(scene: Scene, ws: DrivenWorkspace, tree: int) -> None:
    """Drop the recorded contacts of a tree: the coupled contact solve has placed it."""
    work, count = ws.work, 0
    for i in range(work.counts.touches):
        if scene.bodies.tree[work.touches[i].tip] != tree:
            copy_record(work.touches[count], work.touches[i])
            count += 1
    work.counts.touches = count


@kernel
def _is_listed(ws: DrivenWorkspace, a: int, b: int) -> bool:
    """Whether the pairs of tips include pieces a and b."""
    for i in range(ws.work.counts.touch_pairs):
        k = ws.work.touch_pairs[i]
        if ws.near.a[k] == a and ws.near.b[k] == b:
            return True
    return False


@kernel
def _add_pair(ws: DrivenWorkspace, k: int) -> None:
    """Add near pair k to those of tips."""
    ws.work.touch_pairs[ws.work.counts.touch_pairs] = k
    ws.work.counts.touch_pairs += 1


@noinline
def list_touches(scene: Scene, ws: DrivenWorkspace, limit: float) -> None:
    """List the near pairs of each tip with the body it touched in the recording, and append those within `limit` [m]."""
    work, near, boxes, first, posed = ws.work, ws.near, ws.detection.boxes, scene.bodies.piece_start, -1
    work.counts.touch_pairs = 0
    for k in range(near.counts.filled):
        is_touch = False
        if near.tree_a[k] != near.tree_b[k]:
            for i in range(work.counts.touches):
                is_touch = is_touch or _is_touch(scene, ws, k, work.touches[i].tip, work.touches[i].body)
        if is_touch:
            _add_pair(ws, k)
    for i in range(work.counts.touches):
        tip, other = work.touches[i].tip, work.touches[i].body
        tree = scene.bodies.tree[tip]
        if work.mobility[tree] != GENERAL_MOTION:
            continue
        if tree != posed:
            update_boxes(scene, ws.piece_frames.frames, boxes, tree)
            posed = tree
        for body in range(tip, scene.trees.body_start[tree + 1]):
            if ws.links.weld_body[body] != tip:
                continue
            for a in range(first[body], first[body + 1]):
                for b in range(first[other], first[other + 1]):
                    gap = math.sqrt(squared_piece_gap(boxes, a, b))
                    if gap > limit or _is_listed(ws, a, b):
                        continue
                    append_bound(near, a, b, tree, scene.bodies.tree[other], gap, NOWHERE)
                    if near.counts.lost == 0:
                        _add_pair(ws, near.counts.filled - 1)


@noinline
def measure_touches(scene: Scene, ws: DrivenWorkspace, limit: float) -> None:
    """Measure, within `limit` [m], the nearest of the near pairs of each tip with the body that it touched in the recording.

    Those with the least bounds first, until one that is measured is nearer than the bounds of the others; none farther than
    the nearest so far.
    """
    work, near = ws.work, ws.near
    for i in range(work.counts.touches):
        tip, other = work.touches[i].tip, work.touches[i].body
        if work.mobility[scene.bodies.tree[tip]] != GENERAL_MOTION:
            continue
        while True:
            first, least, nearest = -1, limit, limit
            for j in range(work.counts.touch_pairs):
                k = work.touch_pairs[j]
                if near.separation[k] < nearest and _is_touch(scene, ws, k, tip, other):
                    if near.exact[k] == 1:
                        nearest = near.separation[k]
                    if near.separation[k] < least:
                        first, least = k, near.separation[k]
            if first < 0 or near.exact[first] == 1:
                break
            measure_near(
                scene.pieces, ws.piece_frames.frames, first, nearest, near, ws.detection.axes, ws.detection.scratch
            )


@kernel
def _is_touch(scene: Scene, ws: DrivenWorkspace, k: int, tip: int, other: int) -> bool:
    """Whether near pair k is of a tip, or a body fixed to it, and the body `other`."""
    a, b, weld_body = scene.pieces.body[ws.near.a[k]], scene.pieces.body[ws.near.b[k]], ws.links.weld_body
    return bool((weld_body[a] == tip and b == other) or (weld_body[b] == tip and a == other))


@kernel
def _nearest(scene: Scene, ws: DrivenWorkspace, i: int) -> int:
    """The near pair, of those measured, in which the tip of a recorded contact is nearest to the body it touched; -1: none."""
    nearest, found = math.inf, -1
    for j in range(ws.work.counts.touch_pairs):
        k = ws.work.touch_pairs[j]
        nearer = ws.near.exact[k] == 1 and ws.near.separation[k] < nearest
        if nearer and _is_touch(scene, ws, k, ws.work.touches[i].tip, ws.work.touches[i].body):
            nearest, found = ws.near.separation[k], k
    return found


@noinline
def set_touch_goals(scene: Scene, ws: DrivenWorkspace) -> None:
    """At the start of a search: set how far apart recorded contacts may be at its end, from the present gaps."""
    work = ws.work
    for i in range(work.counts.touches):
        k = _nearest(scene, ws, i)
        touch = work.touches[i]
        closing = work.closing[scene.bodies.tree[touch.tip]]
        touch.goal = math.inf if k < 0 else max(ws.near.separation[k] - closing, touch.gap, 0.0)


@noinline
def add_touches(scene: Scene, ws: DrivenWorkspace, iterate: Posture, unknowns: int) -> float:
    """Add the penalty terms of the recorded contacts of trees with general motion; returns their cost."""
    work, near, cost = ws.work, ws.near, 0.0
    row = ws.problem.least.rows[len(ws.problem.least.rhs) - 1]
    for i in range(work.counts.touches):
        tip = work.touches[i].tip
        if work.mobility[scene.bodies.tree[tip]] != GENERAL_MOTION:
            continue
        found = _nearest(scene, ws, i)
        if found < 0:
            continue
        nearest = near.separation[found]
        off = nearest - max(work.touches[i].gap, 0.0)
        if off > 0.0:
            off = max(nearest - work.touches[i].goal, 0.0)
        for j in range(unknowns):
            row[j] = 0.0
        n, sign, point = vec_at(near.normal, found), 1.0, vec_at(near.point_a, found)
        if ws.links.weld_body[scene.pieces.body[near.a[found]]] != tip:
            sign, point = -1.0, vec_at(near.point_b, found)
        joint = tip
        while joint >= 0:
            q = scene.bodies.dof[joint]
            if q >= 0 and scene.dofs.chain[q] < 0 and scene.bodies.joint[joint] != JOINT_FIXED:
                break
            if q >= 0 and scene.bodies.joint[joint] != JOINT_FIXED and work.column[q] >= 0:
                row[work.column[q]] += sign * joint_jacobian(scene, iterate.poses, joint, point, n)
            joint = scene.bodies.parent[joint]
        rigid = is_rigid(scene, scene.bodies.tree[tip])
        weight = ws.weights.rigid_contact if rigid else ws.weights.contact
        add_term(ws, row, unknowns, weight, off)
        cost += 0.5 * weight * off * off
    return cost
