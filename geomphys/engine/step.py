"""One frame, compiled: every stage in order. The only module that knows them all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near
from geomphys.collision.global_depth import global_depths
from geomphys.collision.sweep import update_boxes
from geomphys.driven.contacts_kept import RECORDED_ON, find_touches
from geomphys.driven.groups import GLOBAL, Outcome, combine
from geomphys.driven.postures import is_recorded
from geomphys.driven.state import NOT_STARTED
from geomphys.engine.coupled_step import (
    curve_path,
    fit_recorded_paths,
    is_pressed,
    move_together,
    note_simulated,
    recording_between,
    separate_from_simulated,
    shift_driven,
    simulate_rest,
    substeps_of,
)
from geomphys.engine.frame_buffer import Block, has_capacity, is_full, write_contacts, write_depths
from geomphys.engine.methods import update_by_method
from geomphys.engine.motion_measures import measure_motion
from geomphys.engine.quarantine import contain_driven, keep_posture
from geomphys.engine.state import Machine, StepParameters
from geomphys.jit.kernel import kernel, outlined
from geomphys.jit.packed_records import Record
from geomphys.jit.stage_clock import cycles
from geomphys.results import (
    FLAG_BLOCKED,
    FLAG_NOT_CONVERGED,
    FLAG_SHAPE_CHANGED,
    FLAG_STARTED_INSIDE,
    FLAG_SWEEP_BOUND,
    FLAG_TABLE_FULL,
)
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.kinematics import pose_pieces_of_tree, pose_tree
from geomphys.simulated.frame_contacts import deepest_overlap, deepest_overlap_at_start, write_touches

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CONTACT_GAPS = 3.0  # surfaces nearer than this many gaps are in contact
LEFT = 1e-5  # m: a residual overlap of driven bodies that is deeper is flagged
SUNK = 1e-4  # m: the same with simulated bodies
BLOCKED_FROM = 1e-4  # m: a body in contact this far from its recorded pose, that is free, is blocked

KINEMATICS, RECORDED_DEPTH, OVERLAP, IMPULSES, CONTACTS, WHOLE = range(6)


class Recording(NamedTuple):
    """N frames of what was recorded."""

    roots: Floats  # (N, T, 7) poses of the trees' roots
    angles: Floats  # (N, Q)
    dts: Floats  # (N,) s since the frame before


@outlined
def pose_recording(scene: Scene, m: Machine, roots: Floats, angles: Floats) -> None:
    """Forward kinematics of all trees the recording moves; their pieces and boxes as recorded."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        pose_tree(scene, m.workspace.origins, tree, roots, angles, m.recorded)
        pose_pieces_of_tree(scene, tree, m.recorded, m.workspace.piece_frames.base)
        update_boxes(scene, m.workspace.piece_frames.base, m.detection.boxes, tree)


@outlined
def measure_recorded(scene: Scene, m: Machine) -> tuple[float, int]:
    """Overlaps of the recorded poses: fills `near` and `depths`; returns the deepest [m] of driven bodies with fixed and
    other driven ones, and the number of pairs of bodies in `depths`.
    """
    near, depth, touching = m.workspace.near, m.workspace.work.depth, 0.0
    for tree in range(len(scene.trees.role)):
        depth[tree] = 0.0
        if scene.trees.role[tree] == DRIVEN and scene.trees.dof_start[tree + 1] > scene.trees.dof_start[tree]:
            touching = RECORDED_ON
    find_near(scene, m.workspace.piece_frames.base, m.still, touching, math.inf, near, m.detection)
    overlapping = global_depths(scene.pieces, near, m.depths)
    if touching > 0.0:
        find_touches(scene, m.workspace, near)
    deepest = 0.0
    for k in range(near.counts.filled):
        deep = -near.separation[k]
        depth[near.tree_a[k]] = max(depth[near.tree_a[k]], deep)
        depth[near.tree_b[k]] = max(depth[near.tree_b[k]], deep)
        if scene.trees.role[near.tree_b[k]] != SIMULATED:
            deepest = max(deepest, deep)
    return deepest, overlapping


@outlined
def find_contacts(scene: Scene, m: Machine, gap: float, first: bool, block: Block, frame: int) -> tuple[float, float]:
    """Contacts of the final poses, written to `block`; returns the deepest residual overlaps [m]: of all bodies, of
    driven ones.
    """
    piece_frames, near = m.workspace.piece_frames, m.workspace.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, piece_frames.frames, m.detection.boxes, tree)
    margin = CONTACT_GAPS * gap
    find_near(scene, piece_frames.frames, m.still, margin, math.inf, near, m.detection)
    of_driven = write_contacts(scene, piece_frames.frames, near, m.driven.offset, block, frame, m.detection.scratch)
    deepest = of_driven
    if len(m.simulated.free) > 0:
        left = (
            deepest_overlap_at_start(m.simulated, piece_frames.frames)
            if first
            else deepest_overlap(m.simulated, piece_frames.frames)
        )
        deepest = max(deepest, left)
        block.contact_end[frame + 1] = write_touches(
            m.simulated, m.corrected, block.contacts, block.contact_end[frame + 1]
        )
    return deepest, of_driven


@kernel
def measure_correction(scene: Scene, m: Machine, figures: Record) -> None:
    """Largest distance and angle of a driven body from where it was recorded, into `figures` (FIGURES)."""
    far, rotation = 0.0, 0.0
    for body in range(len(scene.bodies.role)):
        if scene.bodies.role[body] != DRIVEN:
            continue
        square, same, opposite = 0.0, 0.0, 0.0
        for k in range(3):
            square += (m.corrected[body, k] - m.recorded[body, k]) ** 2
        for k in range(3, 7):  # q and -q are one rotation
            same += (m.corrected[body, k] - m.recorded[body, k]) ** 2
            opposite += (m.corrected[body, k] + m.recorded[body, k]) ** 2
        far = max(far, np.sqrt(square))
        rotation = max(rotation, 4.0 * np.arcsin(min(1.0, 0.5 * np.sqrt(min(same, opposite)))))
    figures.correction, figures.rotation = far, rotation


@kernel
def keep_poses(scene: Scene, m: Machine) -> None:
    """Save the poses of moving bodies at the start of a frame or substep."""
    for body in range(len(m.start)):
        if scene.trees.moving[scene.bodies.tree[body]] == 1:
            for k in range(7):
                m.start[body, k] = m.corrected[body, k]
    keep_posture(m)


@outlined
def drive(
    scene: Scene, m: Machine, roots: Floats, angles: Floats, dt: float, together: bool, params: StepParameters
) -> Outcome:
    """The driven loop: moves driven bodies to the roots (T, 7) and angles (Q,) recorded `dt` [s] later.

    `together`: they were moved together with the simulated ones, which they need not avoid then.
    """
    note_simulated(scene, m)
    ignored = m.workspace.work.ignored
    for tree in range(len(ignored)):
        ignored[tree] = 1 if together and scene.trees.role[tree] == SIMULATED else 0
    done = update_by_method(scene, m, params.method, roots, angles, dt)
    for tree in range(len(ignored)):
        ignored[tree] = 0
    shift_driven(scene, m)
    return done


@kernel
def step(
    scene: Scene, m: Machine, roots: Floats, angles: Floats, dt: float, params: StepParameters, block: Block, frame: int
) -> None:
    """One frame: from the recorded roots (T, 7) and angles (Q,) to its row of `block`.

    `dt` [s] is the time since the frame before it; the first frame's does not matter.
    """
    figures, clock = block.figures[frame], block.cycles[frame]
    first = m.driven.progress.start == NOT_STARTED
    t0 = cycles()
    keep_poses(scene, m)
    pose_recording(scene, m, roots, angles)
    t1 = cycles()
    figures.recorded, overlapping = measure_recorded(scene, m)
    t2 = cycles()
    if len(m.simulated.free) > 0:
        fit_recorded_paths(scene, m, roots, dt, first)
    parts = 1 if first or params.method.paper is not None else substeps_of(scene, m, dt)
    impacts, flags, simulating, pressed = 0, 0, 0, False
    m.workspace.problem.counts.lost = 0
    done = Outcome(0, 0, True, False)
    for tree in range(len(m.driven.method)):
        m.driven.method[tree] = GLOBAL
    for part in range(parts):
        last = part == parts - 1
        if part > 0:
            keep_poses(scene, m)
        if last and parts > 1:
            pose_recording(scene, m, roots, angles)
        if not last:
            recording_between(scene, m, roots, angles, 1.0 / (parts - part))
            curve_path(scene, m, dt, part, parts)
        now_at, joint_values = (roots, angles) if last else (m.roots, m.angles)
        t3 = cycles()
        moves = not first and len(m.simulated.free) > 0 and dt > 0.0
        if moves:
            impacts += move_together(scene, m, now_at, joint_values, dt / parts, params.gap, part > 0)
            pressed = pressed or is_pressed(scene, m)
            if m.coupled.solve.unsettled > 0:
                flags |= FLAG_SWEEP_BOUND
            if m.coupled.solve.lost > 0:
                flags |= FLAG_TABLE_FULL
        simulating += cycles() - t3
        done = combine(done, drive(scene, m, now_at, joint_values, dt / parts, moves, params))
        flags |= contain_driven(scene, m, now_at, joint_values, first)
        t3 = cycles()
        if moves:
            now, flagged = simulate_rest(scene, m, params.max_impacts - impacts)
            impacts, flags = impacts + now, flags | flagged
            if separate_from_simulated(scene, m, params) > 0:
                flags |= contain_driven(scene, m, now_at, joint_values, first)
        simulating += cycles() - t3
    if m.workspace.problem.counts.lost > 0:
        flags |= FLAG_TABLE_FULL
    t4 = cycles()
    write_depths(scene, block, frame, m.depths, overlapping, m.driven.method)
    figures.residual, left = find_contacts(scene, m, params.gap, first, block, frame)
    if is_full(block, frame):
        m.workspace.near.counts.lost += 1
    measure_correction(scene, m, figures)
    measure_motion(scene, m, figures)
    t5 = cycles()
    for k in range(len(block.moving)):
        for i in range(7):
            block.recorded[frame, k, i] = m.recorded[block.moving[k], i]
            block.corrected[frame, k, i] = m.corrected[block.moving[k], i]
    for k in range(len(angles)):
        driven = scene.trees.role[scene.dofs.tree[k]] == DRIVEN
        block.angles[frame, k] = m.driven.last.angles[k] if driven else angles[k]
    figures.iterations, figures.impacts, figures.fallbacks, figures.flags = (
        done.passes,
        impacts,
        done.fallbacks,
        flags,
    )
    if not done.converged or left > LEFT or (not first and figures.residual > SUNK):
        figures.flags |= FLAG_NOT_CONVERGED
    if done.shape_changed:
        figures.flags |= FLAG_SHAPE_CHANGED
    touches = block.contact_end[frame + 1] > block.contact_end[frame]
    if figures.recorded == 0.0 and touches and not pressed and figures.correction > BLOCKED_FROM:
        figures.flags |= FLAG_BLOCKED
    if first and (figures.recorded > 0.0 or figures.residual > LEFT):
        figures.flags |= FLAG_STARTED_INSIDE
    clock[KINEMATICS], clock[RECORDED_DEPTH], clock[OVERLAP] = t1 - t0, t2 - t1, t4 - t2 - simulating
    clock[IMPULSES], clock[CONTACTS], clock[WHOLE] = simulating, t5 - t4, t5 - t0
    counts = block.counts[frame]
    counts[KINEMATICS], counts[RECORDED_DEPTH], counts[OVERLAP] = len(block.moving), overlapping, done.passes
    counts[IMPULSES], counts[WHOLE] = impacts, 1
    counts[CONTACTS] = block.contact_end[frame + 1] - block.contact_end[frame]


@kernel
def run_block(
    scene: Scene,
    m: Machine,
    recording: Recording,
    params: StepParameters,
    block: Block,
) -> int:
    """Step through frames.

    Parameters
    ----------
    scene, m, params
        The scene, the machine (state, updated), and the configuration.
    recording
        N frames.
    block
        Takes the results.

    Returns
    -------
    int
        How many frames were done before `block` was full: at least one.
    """
    block.contact_end[0] = block.depth_end[0] = 0
    for frame in range(len(recording.dts)):
        if not has_capacity(block, frame):
            return frame
        step(scene, m, recording.roots[frame], recording.angles[frame], recording.dts[frame], params, block, frame)
        if m.workspace.near.counts.lost > 0:  # a table is full: the caller aborts the replay
            return frame
    return len(recording.dts)


@kernel
def run_block_as_published(scene: Scene, m: Machine, recording: Recording, params: StepParameters, block: Block) -> int:
    """`run_block` with a `Method` of the paper: an entry of its own, so that its machine code is found by its name."""
    return run_block(scene, m, recording, params, block)
