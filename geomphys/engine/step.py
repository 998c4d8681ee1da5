"""One frame, compiled: every stage in order. The only module that knows them all."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near
from geomphys.collision.global_depth import global_depths
from geomphys.collision.sweep import update_boxes
from geomphys.driven.contacts_kept import find_touches
from geomphys.driven.groups import GLOBAL, Outcome, combine
from geomphys.driven.postures import is_recorded
from geomphys.driven.state import NOT_STARTED
from geomphys.engine.coupled_step import (
    curve_path,
    fit_recorded_paths,
    is_pressed,
    move_together,
    pose_kinematic,
    recording_between,
    separate_from_simulated,
    simulate_rest,
    substeps_of,
    write_corrected_poses,
    write_simulated_poses,
)
from geomphys.engine.frame_buffer import Block, has_capacity, is_full, write_contacts, write_depths
from geomphys.engine.methods import update_by_method
from geomphys.engine.motion_measures import measure_motion, take_contacts
from geomphys.engine.quarantine import contain_driven, keep_posture
from geomphys.engine.state import ReplayData, StepParameters
from geomphys.jit.kernel import kernel, noinline
from geomphys.jit.packed_records import Record
from geomphys.jit.stage_clock import cycles
from geomphys.numerics.row_vectors import copy_pose
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
from geomphys.simulated.driven_paths import fit_paths
from geomphys.simulated.frame_contacts import deepest_overlap, deepest_overlap_at_start, write_touches

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CONTACT_GAPS = 3.0  # surfaces nearer than this many gaps are in contact
FLAGGED_OVERLAP = 1e-5  # m: a residual overlap of driven bodies that is deeper is flagged
FLAGGED_OVERLAP_SIMULATED = 1e-4  # m: the same with simulated bodies
BLOCKED_FROM = 1e-4  # m: a body in contact this far from its recorded pose, that is free, is blocked

KINEMATICS, RECORDED_DEPTH, OVERLAP, IMPULSES, CONTACTS, WHOLE = range(6)


class Recording(NamedTuple):
    """N frames of what was recorded."""

    roots: Floats  # (N, T, 7) poses of the trees' roots
    angles: Floats  # (N, Q)
    dts: Floats  # (N,) s since the frame before


@noinline
def pose_recording(scene: Scene, data: ReplayData, roots: Floats, angles: Floats) -> None:
    """Forward kinematics of all trees the recording moves; their pieces and boxes as recorded."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        pose_tree(scene, data.workspace.origins, tree, roots, angles, data.recorded)
        pose_pieces_of_tree(scene, tree, data.recorded, data.workspace.piece_frames.base)
        update_boxes(scene, data.workspace.piece_frames.base, data.detection.boxes, tree)


@noinline
def measure_recorded(scene: Scene, data: ReplayData) -> tuple[float, int]:
    """Overlaps of the recorded poses: fills `near` and `depths`; returns the deepest [m] of driven bodies with fixed and
    other driven ones, and the number of pairs of bodies in `depths`.
    """
    near, depth = data.workspace.near, data.workspace.work.depth
    for tree in range(len(scene.trees.role)):
        depth[tree] = 0.0
    find_near(scene, data.workspace.piece_frames.base, data.touching, 0.0, 0.0, near, data.detection)
    overlapping = global_depths(scene.pieces, near, data.depths)
    find_touches(scene, data.workspace, near)
    take_contacts(scene, data, near, data.fingertips.recorded, True)
    deepest = 0.0
    for k in range(near.counts.filled):
        deep = -near.separation[k]
        depth[near.tree_a[k]] = max(depth[near.tree_a[k]], deep)
        depth[near.tree_b[k]] = max(depth[near.tree_b[k]], deep)
        if scene.trees.role[near.tree_b[k]] != SIMULATED:
            deepest = max(deepest, deep)
    return deepest, overlapping


@noinline
def find_contacts(
    scene: Scene, data: ReplayData, gap: float, first: bool, block: Block, frame: int
) -> tuple[float, float]:
    """Contacts of the final poses, written to `block`; returns the deepest residual overlaps [m]: of all bodies, of
    driven ones.
    """
    piece_frames, near = data.workspace.piece_frames, data.workspace.near
    margin = CONTACT_GAPS * gap
    find_near(scene, piece_frames.frames, data.still, margin, math.inf, near, data.detection)
    of_driven = write_contacts(
        scene, piece_frames.frames, near, data.driven.offset, block, frame, data.detection.scratch
    )
    take_contacts(scene, data, near, data.fingertips.corrected, False)
    deepest = of_driven
    if len(data.simulated.free) > 0:
        left = (
            deepest_overlap_at_start(data.simulated, piece_frames.frames)
            if first
            else deepest_overlap(data.simulated, piece_frames.frames)
        )
        deepest = max(deepest, left)
        block.contact_end[frame + 1] = write_touches(
            data.simulated, data.corrected, block.contacts, block.contact_end[frame + 1]
        )
    return deepest, of_driven


@kernel
def measure_correction(scene: Scene, data: ReplayData, figures: Record) -> None:
    """Largest distance and angle of a driven body from where it was recorded, into `figures` (FIGURES)."""
    far, rotation = 0.0, 0.0
    for body in range(len(scene.bodies.role)):
        if scene.bodies.role[body] != DRIVEN:
            continue
        square, same, opposite = 0.0, 0.0, 0.0
        for k in range(3):
            square += (data.corrected[body, k] - data.recorded[body, k]) ** 2
        for k in range(3, 7):  # q and -q are one rotation
            same += (data.corrected[body, k] - data.recorded[body, k]) ** 2
            opposite += (data.corrected[body, k] + data.recorded[body, k]) ** 2
        far = max(far, np.sqrt(square))
        rotation = max(rotation, 4.0 * np.arcsin(min(1.0, 0.5 * np.sqrt(min(same, opposite)))))
    figures.correction, figures.rotation = far, rotation


@kernel
def save_poses(scene: Scene, data: ReplayData) -> None:
    """Save the poses of moving bodies at the start of a frame or substep."""
    for body in range(len(data.start)):
        if scene.trees.moving[scene.bodies.tree[body]] == 1:
            copy_pose(data.corrected, body, data.start, body)
    keep_posture(data)


@noinline
def update_driven_bodies(
    scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float, together: bool, params: StepParameters
) -> Outcome:
    """The driven loop: moves driven bodies to the roots (T, 7) and angles (Q,) recorded `dt` [s] later.

    `together`: they were moved together with the simulated ones, which they need not avoid then.
    """
    write_simulated_poses(scene, data)
    ignored = data.workspace.work.ignored
    for tree in range(len(ignored)):
        ignored[tree] = 1 if together and scene.trees.role[tree] == SIMULATED else 0
    done = update_by_method(scene, data, params.method, roots, angles, dt)
    for tree in range(len(ignored)):
        ignored[tree] = 0
    write_corrected_poses(scene, data)
    return done


@kernel
def step(
    scene: Scene,
    data: ReplayData,
    roots: Floats,
    angles: Floats,
    dt: float,
    params: StepParameters,
    block: Block,
    frame: int,
) -> None:
    """One frame: from the recorded roots (T, 7) and angles (Q,) to its row of `block`.

    `dt` [s] is the time since the frame before it; the first frame's does not matter.
    """
    figures, clock = block.figures[frame], block.cycles[frame]
    first = data.driven.progress.start == NOT_STARTED
    t0 = cycles()
    save_poses(scene, data)
    pose_recording(scene, data, roots, angles)
    t1 = cycles()
    figures.recorded, overlapping = measure_recorded(scene, data)
    t2 = cycles()
    if len(data.simulated.free) > 0:
        fit_recorded_paths(scene, data, roots, dt, first)
    substeps = 1 if first or params.method.paper is not None else substeps_of(scene, data, dt)
    impacts, flags, simulating, pressed = 0, 0, 0, False
    data.workspace.problem.counts.lost = 0
    done = Outcome(0, 0, True, False)
    for tree in range(len(data.driven.method)):
        data.driven.method[tree] = GLOBAL
    moves = not first and len(data.simulated.free) > 0 and dt > 0.0
    if moves:
        fit_paths(data.simulated, data.recorded, dt)
    for substep in range(substeps):
        last = substep == substeps - 1
        if substep > 0:
            save_poses(scene, data)
        if last and substeps > 1:
            pose_recording(scene, data, roots, angles)
        if not last:
            recording_between(scene, data, roots, angles, 1.0 / (substeps - substep))
            curve_path(scene, data, dt, substep, substeps)
            pose_kinematic(scene, data, dt * (substep + 1) / substeps)
        now_at, joint_values = (roots, angles) if last else (data.roots, data.angles)
        t3 = cycles()
        if moves:
            impacts += move_together(scene, data, now_at, joint_values, dt / substeps, params.gap, substep > 0)
            pressed = pressed or is_pressed(scene, data)
            if data.coupled.solve.unconverged > 0:
                flags |= FLAG_SWEEP_BOUND
            if data.coupled.solve.lost > 0:
                flags |= FLAG_TABLE_FULL
        simulating += cycles() - t3
        done = combine(done, update_driven_bodies(scene, data, now_at, joint_values, dt / substeps, moves, params))
        flags |= contain_driven(scene, data, now_at, joint_values, first)
        t3 = cycles()
        if moves:
            now, flagged = simulate_rest(scene, data, params.max_impacts)
            impacts, flags = impacts + now, flags | flagged
            if separate_from_simulated(scene, data, params) > 0:
                flags |= contain_driven(scene, data, now_at, joint_values, first)
        simulating += cycles() - t3
    if data.workspace.problem.counts.lost > 0:
        flags |= FLAG_TABLE_FULL
    t4 = cycles()
    write_depths(scene, block, frame, data.depths, overlapping, data.driven.method)
    figures.residual, left = find_contacts(scene, data, params.gap, first, block, frame)
    if is_full(block, frame):
        data.workspace.near.counts.lost += 1
    measure_correction(scene, data, figures)
    measure_motion(scene, data, figures, True)
    t5 = cycles()
    for k in range(len(block.moving)):
        for i in range(7):
            block.recorded[frame, k, i] = data.recorded[block.moving[k], i]
            block.corrected[frame, k, i] = data.corrected[block.moving[k], i]
    for k in range(len(angles)):
        driven = scene.trees.role[scene.dofs.tree[k]] == DRIVEN
        block.angles[frame, k] = data.driven.last.angles[k] if driven else angles[k]
    figures.iterations, figures.impacts, figures.fallbacks, figures.flags = (
        done.iterations,
        impacts,
        done.fallbacks,
        flags,
    )
    if not done.converged or left > FLAGGED_OVERLAP or (not first and figures.residual > FLAGGED_OVERLAP_SIMULATED):
        figures.flags |= FLAG_NOT_CONVERGED
    if done.shape_changed:
        figures.flags |= FLAG_SHAPE_CHANGED
    touches = block.contact_end[frame + 1] > block.contact_end[frame]
    if figures.recorded == 0.0 and touches and not pressed and figures.correction > BLOCKED_FROM:
        figures.flags |= FLAG_BLOCKED
    if first and (figures.recorded > 0.0 or figures.residual > FLAGGED_OVERLAP):
        figures.flags |= FLAG_STARTED_INSIDE
    clock[KINEMATICS], clock[RECORDED_DEPTH], clock[OVERLAP] = t1 - t0, t2 - t1, t4 - t2 - simulating
    clock[IMPULSES], clock[CONTACTS], clock[WHOLE] = simulating, t5 - t4, t5 - t0
    counts = block.counts[frame]
    counts[KINEMATICS], counts[RECORDED_DEPTH], counts[OVERLAP] = len(block.moving), overlapping, done.iterations
    counts[IMPULSES], counts[WHOLE] = impacts, 1
    counts[CONTACTS] = block.contact_end[frame + 1] - block.contact_end[frame]


@kernel
def run_block(
    scene: Scene,
    data: ReplayData,
    recording: Recording,
    params: StepParameters,
    block: Block,
) -> int:
    """Step through frames.

    Parameters
    ----------
    scene, m, params
        The scene, the data of the replay (updated), and the configuration.
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
        step(scene, data, recording.roots[frame], recording.angles[frame], recording.dts[frame], params, block, frame)
        if data.workspace.near.counts.lost > 0:  # a table is full: the caller aborts the replay
            return frame
    return len(recording.dts)


@kernel
def run_block_as_published(
    scene: Scene, data: ReplayData, recording: Recording, params: StepParameters, block: Block
) -> int:
    """`run_block` with a `Method` of the paper: an entry of its own, so that its machine code is found by its name."""
    return run_block(scene, data, recording, params, block)
