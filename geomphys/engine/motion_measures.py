"""Measures of motion quality of a frame: amplification of the correction, contacts and grasps kept, fingertip error.

Contacts of fingertips are taken from the near pairs that the frame has measured anyway, as recorded and as corrected;
others are searched, by boxes and a margin of 2 mm.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near, measure_near, near_bodies
from geomphys.collision.sweep import bodies_apart, body_apart_from_tree, near_trees, update_boxes
from geomphys.driven.contacts_kept import RECORDED_ON
from geomphys.engine.fingertips import TipContacts
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.numerics.row_vectors import set_vec_at, vec_at
from geomphys.numerics.vec3 import Vec, add, cross, dot, neg, norm, rotate, rotate_back, scale, sub
from geomphys.scene.arrays import DRIVEN, FIXED, Scene
from geomphys.scene.kinematics import frame_position, frame_rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

IN_CONTACT = RECORDED_ON  # m: a fingertip recorded no farther from a body is in contact
RETAINED = 1e-3  # m: a contact is kept if the gap is no larger than this, or than as recorded
ROUNDING = 1e-6  # m, by which a gap may be larger than the recorded one
DEEP = 5e-4  # m: amplification is measured in frames recorded deeper than this
SURELY = 1.0 - 1e-9  # of a square: smaller by more than rounding


@kernel
def _take_nearer(contacts: TipContacts, i: int, gap: float, piece: int, point: Vec, n: Vec) -> None:
    """Store the contact of fingertip i if it is nearer than the one stored before."""
    if gap <= IN_CONTACT and gap < contacts.gap[i]:
        contacts.gap[i], contacts.piece[i] = gap, piece
        set_vec_at(contacts.point, i, point)
        set_vec_at(contacts.normal, i, n)


@noinline
def take_contacts(scene: Scene, data: ReplayData, near: Near, contacts: TipContacts, only_fixed: bool) -> None:
    """Contacts of fingertips with other trees, or with fixed ones alone, from the near pairs that are measured."""
    tip_of, pieces = data.fingertips.of_body, scene.pieces
    _clear_contacts(contacts)
    for k in range(near.counts.filled):
        a, b = near.a[k], near.b[k]
        fixed = scene.bodies.role[pieces.body[b]] == FIXED
        if near.exact[k] == 0 or near.tree_a[k] == near.tree_b[k] or (only_fixed and not fixed):
            continue
        s, n = near.separation[k], vec_at(near.normal, k)
        if tip_of[pieces.body[a]] >= 0:
            _take_nearer(contacts, tip_of[pieces.body[a]], s, b, vec_at(near.point_b, k), n)
        if tip_of[pieces.body[b]] >= 0:
            _take_nearer(contacts, tip_of[pieces.body[b]], s, a, vec_at(near.point_a, k), neg(n))


@kernel
def _clear_contacts(contacts: TipContacts) -> None:
    """No fingertip is in contact."""
    for i in range(len(contacts.gap)):
        contacts.gap[i] = math.inf


@noinline
def _search_contacts(
    scene: Scene, data: ReplayData, frames: Floats, contacts: TipContacts, of_recorded: bool, but_fixed: bool
) -> None:
    """Search contacts of fingertips, with pieces at `frames` (P, 12), whose boxes are up to date.

    `of_recorded`: only of fingertips that were recorded in contact and have none yet; `but_fixed`: not with fixed trees.
    """
    near, tips, found = data.workspace.near, data.fingertips, data.detection.found
    last_tree, others = -1, 0
    for i in range(len(tips.link)):
        if of_recorded and (tips.recorded.gap[i] == math.inf or contacts.gap[i] < math.inf):
            continue
        tree = scene.bodies.tree[tips.link[i]]
        if tree != last_tree:
            others, last_tree = near_trees(data.detection.boxes, tree, IN_CONTACT, found), tree
        near.counts.filled = 0
        for k in range(others):
            if but_fixed and scene.trees.role[found[k]] == FIXED:
                continue
            for j in range(tips.body_start[i], tips.body_start[i + 1]):
                body, other = tips.bodies[j], found[k]
                if body_apart_from_tree(data.detection.boxes, body, other, IN_CONTACT):
                    continue
                for b in range(scene.trees.body_start[other], scene.trees.body_start[other + 1]):
                    if not bodies_apart(data.detection.boxes, body, b, IN_CONTACT):
                        near_bodies(scene, frames, body, b, IN_CONTACT, -math.inf, near, data.tip_detection)
        for k in range(near.counts.filled):
            limit = min(contacts.gap[i], IN_CONTACT)
            if near.separation[k] > limit:
                continue
            s = measure_near(scene.pieces, frames, k, limit, near, data.tip_detection.axes, data.detection.scratch)
            _take_nearer(contacts, i, s, near.b[k], vec_at(near.point_b, k), vec_at(near.normal, k))


@kernel
def _others_move(scene: Scene) -> bool:
    """Whether there is a tree that is not fixed beside a driven one."""
    driven, movable = 0, 0
    for tree in range(len(scene.trees.role)):
        driven += int(scene.trees.role[tree] == DRIVEN)
        movable += int(scene.trees.role[tree] != FIXED)
    return driven > 0 and movable > 1


@kernel
def _count_contacts(contacts: TipContacts) -> int:
    """Number of fingertips in contact."""
    count = 0
    for i in range(len(contacts.gap)):
        count += int(contacts.gap[i] < math.inf)
    return count


@kernel
def _update_driven_boxes(scene: Scene, data: ReplayData, frames: Floats) -> None:
    """Boxes of driven trees with their pieces at `frames` (P, 12)."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, frames, data.detection.boxes, tree)


@kernel
def _offset(before: Floats, after: Floats, piece: int, point: Vec) -> Vec:
    """World displacement of a point of a piece (in its frame) from frames `before` to `after` (P, 12)."""
    moved = sub(rotate(frame_rotation(after, piece), point), rotate(frame_rotation(before, piece), point))
    return add(moved, sub(frame_position(after, piece), frame_position(before, piece)))


@kernel
def largest_offset(scene: Scene, data: ReplayData) -> float:
    """Largest distance [m] of a driven link from where it was recorded.

    Measured at the six middles of the sides of the box (in its own frame) of each of its pieces.
    """
    base, frames, largest = data.workspace.piece_frames.base, data.workspace.piece_frames.frames, 0.0
    for i in range(len(scene.pieces.kind)):
        if scene.bodies.role[scene.pieces.body[i]] != DRIVEN:
            continue
        centre, half = vec_at(data.detection.boxes.local_centre, i), vec_at(data.detection.boxes.local_half, i)
        change = 0.0
        for k in range(9):
            change += (frames[i, k] - base[i, k]) ** 2
        most = norm(_offset(base, frames, i, centre)) + math.sqrt(change) * max(half[0], half[1], half[2])
        if most * most < SURELY * largest:
            continue  # none of its points can be farther
        for side in ((half[0], 0.0, 0.0), (0.0, half[1], 0.0), (0.0, 0.0, half[2])):
            one, other = _offset(base, frames, i, add(centre, side)), _offset(base, frames, i, sub(centre, side))
            largest = max(largest, dot(one, one), dot(other, other))
    return math.sqrt(largest)


@kernel
def _fingertip_error(scene: Scene, data: ReplayData, in_contact: bool) -> float:
    """Mean distance [m] of the middles of fingertips from where they were recorded; of all, or of those in contact."""
    tips, total, count = data.fingertips, 0.0, 0
    for i in range(len(tips.link)):
        if in_contact and tips.recorded.gap[i] > IN_CONTACT:
            continue
        moved, pieces = (0.0, 0.0, 0.0), 0
        for j in range(tips.body_start[i], tips.body_start[i + 1]):
            for piece in range(scene.bodies.piece_start[tips.bodies[j]], scene.bodies.piece_start[tips.bodies[j] + 1]):
                centre = vec_at(scene.pieces.centre, piece)
                moved = add(
                    moved, _offset(data.workspace.piece_frames.base, data.workspace.piece_frames.frames, piece, centre)
                )
                pieces += 1
        total += norm(scale(moved, 1.0 / pieces))
        count += 1
    return total / count if count > 0 else 0.0


@kernel
def _compare_contacts(data: ReplayData, figures: Record) -> int:
    """Find which recorded contacts are kept, how far they moved on the object and its normal rotated; returns their number.

    Points and normals are compared in the frame of the object, which may have been corrected too.
    """
    tips, count, distance, rotation = data.fingertips, 0, 0.0, 0.0
    base, frames = data.workspace.piece_frames.base, data.workspace.piece_frames.frames
    for i in range(len(tips.link)):
        before, after = tips.recorded.gap[i], tips.corrected.gap[i]
        tips.is_retained[i] = int(before <= IN_CONTACT and after <= max(RETAINED, before + ROUNDING))
        if tips.is_retained[i] == 1:
            count += 1
            piece = tips.recorded.piece[i]
            r0, r1 = frame_rotation(base, piece), frame_rotation(frames, piece)
            at = rotate_back(r0, sub(vec_at(tips.recorded.point, i), frame_position(base, piece)))
            distance += norm(sub(vec_at(tips.corrected.point, i), add(frame_position(frames, piece), rotate(r1, at))))
            n0 = rotate(r1, rotate_back(r0, vec_at(tips.recorded.normal, i)))
            n1 = vec_at(tips.corrected.normal, i)
            rotation += math.atan2(norm(cross(n0, n1)), dot(n0, n1))
    if count > 0:
        figures.contact_precision, figures.contact_alignment = distance / count, rotation / count
    return count


@kernel
def _count_grasps(scene: Scene, data: ReplayData, is_retained: bool) -> int:
    """Hands whose thumb and another finger are in contact: as recorded, or both with contacts that are kept."""
    tips, count, i = data.fingertips, 0, 0
    while i < len(tips.link):
        tree, thumb, finger = scene.bodies.tree[tips.link[i]], False, False
        while i < len(tips.link) and scene.bodies.tree[tips.link[i]] == tree:
            touches = tips.is_retained[i] == 1 if is_retained else tips.recorded.gap[i] <= IN_CONTACT
            if touches and tips.is_thumb[i] == 1:
                thumb = True
            elif touches:
                finger = True
            i += 1
        count += int(thumb and finger)
    return count


@noinline
def measure_motion(scene: Scene, data: ReplayData, figures: Record, are_taken: bool) -> None:
    """Measures of motion quality of a frame, once its final poses, their boxes and its correction are known.

    Written to `figures` (FIGURES), the frame's record in the block. `are_taken`: `take_contacts` was called for the contacts
    with fixed trees as recorded, and for all as corrected; else all are searched.
    """
    base, frames, tips = data.workspace.piece_frames.base, data.workspace.piece_frames.frames, data.fingertips
    search_recorded = not are_taken or _others_move(scene)
    if not are_taken:
        _clear_contacts(tips.recorded)
        _clear_contacts(tips.corrected)
    figures.amplification = figures.fingertip_error = figures.contact_precision = figures.contact_alignment = 0.0
    if figures.correction == 0.0 and figures.rotation == 0.0:
        if search_recorded:
            _search_contacts(scene, data, frames, tips.recorded, False, are_taken)
        count = _count_contacts(tips.recorded)
        figures.contacts_recorded = figures.contacts_kept = count
        figures.grasps_recorded = figures.grasps_kept = _count_grasps(scene, data, False) if count > 1 else 0
        return
    if figures.recorded > DEEP:
        figures.amplification = largest_offset(scene, data) / figures.recorded
    if len(tips.link) == 0:
        figures.contacts_recorded = figures.contacts_kept = figures.grasps_recorded = figures.grasps_kept = 0
        return
    if search_recorded:
        _update_driven_boxes(scene, data, base)
        _search_contacts(scene, data, base, tips.recorded, False, are_taken)
        _update_driven_boxes(scene, data, frames)
    count = _count_contacts(tips.recorded)
    figures.contacts_recorded, figures.contacts_kept = count, 0
    figures.grasps_recorded = figures.grasps_kept = 0
    if count > 0:
        _search_contacts(scene, data, frames, tips.corrected, True, False)
        figures.contacts_kept = _compare_contacts(data, figures)
        figures.grasps_recorded, figures.grasps_kept = (
            _count_grasps(scene, data, False),
            _count_grasps(scene, data, True),
        )
    figures.fingertip_error = _fingertip_error(scene, data, count > 0)
