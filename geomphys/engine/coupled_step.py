"""The coupled step of driven and simulated bodies: groups that may touch, then the driven loop, then the rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_overlaps_with_simulated
from geomphys.collision.sweep import bodies_apart, update_boxes
from geomphys.driven.coupling import relax
from geomphys.driven.postures import copy_tree, is_recorded
from geomphys.driven.state import PRESCRIBED, WAS_PRESCRIBED
from geomphys.engine.coupled_groups import activate_group, label_groups
from geomphys.engine.coupled_motion import advance_together
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import end_unknown, first_unknown, load_unknowns, pose_driven
from geomphys.engine.methods import separate_by_method
from geomphys.engine.state import ReplayData, StepParameters
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, set_vec, vec_at, vec_of
from geomphys.numerics.vec3 import add, add_scaled, norm, scale, slerp, sub
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, pose_tree, position_of, set_pose
from geomphys.simulated.driven_paths import extrapolated, follow_paths, is_even
from geomphys.simulated.islands import mark_activation
from geomphys.simulated.overlap_clearing import clear_overlaps
from geomphys.simulated.position_projection import LEFT
from geomphys.simulated.state import COUPLED
from geomphys.simulated.update import MAX_SUBSTEPS, STEP_TOLERANCE, begin_frame, end_frame

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SUBSTEP = 1.0 / 240.0  # s: longest substep where driven and simulated bodies may touch
NEAR = 6e-3  # m: bodies that come no nearer do not touch
MIN_OVERLAP = 5e-8  # m: a driven body is moved out of a simulated one that is deeper in it


@noinline
def write_corrected_poses(scene: Scene, data: ReplayData) -> None:
    """Corrected poses: of driven trees those of the final posture, of others the recorded ones."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(7):
                data.corrected[body, k] = data.recorded[body, k]
                if scene.trees.role[tree] == DRIVEN:
                    data.corrected[body, k] = data.driven.last.poses[body, k]


@noinline
def write_simulated_poses(scene: Scene, data: ReplayData) -> None:
    """Pass the poses of simulated bodies before and after the step to the driven loop."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == SIMULATED:
            body = scene.trees.body_start[tree]
            copy_pose(data.corrected, body, data.driven.last.poses, body)


@noinline
def recording_between(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, w: float) -> None:
    """The recording interpolated between that of the last step (`w` = 0) and `roots` (T, 7) and `angles` (Q,).

    Into `data.roots`, `data.angles` and, by forward kinematics, `data.recorded`.
    """
    last = data.driven.recorded
    for i in range(len(angles)):
        data.angles[i] = last.angles[i] + w * (angles[i] - last.angles[i])
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        q = slerp(orientation_of(last.roots, tree), orientation_of(roots, tree), w)
        p0, p1 = position_of(last.roots, tree), position_of(roots, tree)
        set_pose(data.roots, tree, add_scaled(p0, sub(p1, p0), w), q)
        pose_tree(scene, data.workspace.origins, tree, data.roots, data.angles, data.recorded)


@noinline
def fit_recorded_paths(scene: Scene, data: ReplayData, roots: Floats, dt: float, first: bool) -> None:
    """Accelerations of the recorded `roots` (T, 7) of driven trees in this frame, as `fit_paths` of kinematic ones."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        c = data.recorded_path[tree]
        position, change = position_of(roots, tree), (0.0, 0.0, 0.0)
        velocity = (0.0, 0.0, 0.0)
        if not first and dt > 0.0:
            velocity = scale(sub(position, vec_of(c.position)), 1.0 / dt)
            if is_even(dt, c.duration):
                change = scale(sub(velocity, vec_of(c.velocity)), 2.0 / (dt + c.duration))
        set_vec(c.acceleration, extrapolated(change, vec_of(c.change)))
        set_vec(c.position, position)
        set_vec(c.velocity, velocity)
        set_vec(c.change, change)
        c.duration = 0.0 if first else dt


@noinline
def curve_path(scene: Scene, data: ReplayData, dt: float, part: int, parts: int) -> None:
    """Move driven trees, at the end of a substep, onto the parabolas of `fit_recorded_paths`, from straight lines.

    Of a parabola p + v u + a u (u - dt) / 2, divided evenly, that is by a dt² (parts - part - 1) / (2 parts²).
    """
    factor = -0.5 * dt * dt * (parts - part - 1) / (parts * parts)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        for i in range(3):
            deviation = factor * data.recorded_path[tree].acceleration[i]
            if deviation != 0.0:
                data.roots[tree, i] += deviation
                for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                    data.recorded[body, i] += deviation


@noinline
def pose_kinematic(scene: Scene, data: ReplayData, t: float) -> None:
    """Recorded poses and roots of kinematic trees at time `t` [s] of the frame: on the paths that the simulated bodies see."""
    follow_paths(data.simulated, t, data.recorded)
    for tree in range(len(scene.trees.role)):
        if is_recorded(scene, tree) and scene.trees.role[tree] != DRIVEN:
            copy_pose(data.recorded, scene.trees.body_start[tree], data.roots, tree)


@kernel
def pose_simulated(scene: Scene, data: ReplayData, tree: int, poses: Floats) -> None:
    """Pieces and boxes of a simulated tree at its row of `poses` (B, 7)."""
    p = data.workspace.piece_frames
    for frames in (p.base, p.frames, p.moved):
        pose_pieces_of_tree(scene, tree, poses, frames)
    update_boxes(scene, p.base, data.detection.boxes, tree)


@kernel
def recorded_motion(scene: Scene, data: ReplayData, tree: int) -> float:
    """Largest motion of the bodies of a driven tree by the recording in this frame [m]."""
    most = 0.0
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        path = sub(position_of(data.recorded, body), position_of(data.start, body))
        off = vec_at(data.driven.offset, tree)
        most = max(most, norm(add(path, off)))
    return most


@noinline
def substeps_of(scene: Scene, data: ReplayData, dt: float) -> int:
    """Number of substeps of a frame for driven and simulated bodies.

    A driven body stops for the rest of its substep once a simulated one obstructs it, however fast that is moved away. Where
    they may touch, substeps are no longer than `SUBSTEP`, so that the result does not depend on the frame rate.
    """
    most = math.ceil(dt / SUBSTEP - STEP_TOLERANCE)
    if most <= 1:
        return 1
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        moved = recorded_motion(scene, data, tree)
        off = vec_at(data.driven.offset, tree)
        for other in range(len(scene.trees.role)):
            if scene.trees.role[other] != SIMULATED:
                continue
            body = scene.trees.body_start[other]
            speed = norm(vec_at(data.velocity, body))
            reach = moved + dt * speed + norm(off) + NEAR
            for link in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                if not bodies_apart(data.detection.boxes, link, body, reach):
                    return min(most, MAX_SUBSTEPS)
    return 1


@kernel
def is_pressed(scene: Scene, data: ReplayData) -> bool:
    """Whether some driven tree was pressed or hit by a simulated body in the last substep."""
    for tree in range(len(scene.trees.role)):  # noqa: SIM110 - a kernel cannot take a generator
        if data.coupled.trees[tree].touched == 1:
            return True
    return False


@kernel
def relax_temporarily(c: Coupled, first: int, last: int, dt: float) -> None:
    """Relax the offsets of unknowns `first` to `last` by (6), temporarily: until `restore_offsets`."""
    for k in range(first, last):
        x = c.unknowns[k]
        x.new_rate = x.offset
        if x.mass > 0.0:
            x.offset = relax(x.offset, x.rate, x.mass, x.stiffness, x.damping, dt)[0]


@kernel
def restore_offsets(c: Coupled, first: int, last: int) -> None:
    """Restore the offsets of unknowns `first` to `last` from before `relax_temporarily`."""
    for k in range(first, last):
        c.unknowns[k].offset = c.unknowns[k].new_rate


@kernel
def predict_end_poses(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float) -> None:
    """Poses at the end of a substep of all bodies that are not simulated; driven trees by (6) alone."""
    c = data.coupled
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        if scene.trees.role[tree] == DRIVEN:
            relax_temporarily(c, 3 * tree, 3 * tree + 3, dt)
            relax_temporarily(c, first_unknown(scene, tree), end_unknown(scene, tree), dt)
            pose_driven(scene, data, tree, roots, angles, 1.0, c.after)
            restore_offsets(c, 3 * tree, 3 * tree + 3)
            restore_offsets(c, first_unknown(scene, tree), end_unknown(scene, tree))
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(7):
                driven = scene.trees.role[tree] == DRIVEN
                data.corrected[body, k] = c.after.poses[body, k] if driven else data.recorded[body, k]


@noinline
def move_together(
    scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float, gap: float, goes_on: bool
) -> int:
    """Solve groups of driven and simulated bodies that may touch through a substep; returns the number of impacts.

    Simulated bodies of groups are then at its end. Driven trees that were touched get the resulting posture as their goal,
    `DrivenState.prescribed_posture`, which other obstacles may still correct. Begins the frame of the simulated loop.
    """
    c, state = data.coupled, data.driven
    load_unknowns(scene, data, roots, angles, dt)
    predict_end_poses(scene, data, roots, angles, dt)
    data.coupled.solve.any_awake = 1 if begin_frame(data.simulated, dt, gap, goes_on) else 0
    impacts = 0
    if label_groups(scene, data):
        for group in range(len(c.trees)):
            if c.trees[group].group == group:
                activate_group(scene, data, group)
                impacts += advance_together(scene, data, roots, angles, dt)
                mark_activation(data.simulated, COUPLED)
                clear_overlaps(data.simulated, dt, LEFT * gap)
        activate_group(scene, data, -1)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            if c.trees[tree].solved == 0:
                c.trees[tree].pressed = 0
            if c.trees[tree].touched == 1:
                state.prescription[tree] = PRESCRIBED
                copy_tree(scene, c.after, tree, state.prescribed_posture)
    return impacts


@noinline
def simulate_rest(scene: Scene, data: ReplayData, most_impacts: int) -> tuple[int, int]:
    """Move the simulated bodies in no group; ends the frame of the simulated loop. Returns impacts and flags."""
    impacts, flags = end_frame(data.simulated, most_impacts, data.coupled.solve.any_awake == 1)
    for tree in range(len(scene.trees.role)):
        if data.driven.prescription[tree] == PRESCRIBED:
            data.driven.prescription[tree] = WAS_PRESCRIBED
        if scene.trees.role[tree] == SIMULATED:
            body = scene.trees.body_start[tree]
            copy_pose(data.corrected, body, data.recorded, body)
            pose_simulated(scene, data, tree, data.corrected)
    return impacts, flags


@noinline
def separate_from_simulated(scene: Scene, data: ReplayData, params: StepParameters) -> int:
    """Move driven bodies out of simulated ones that ended inside them. Returns the number of iterations."""
    p, near = data.workspace.piece_frames, data.workspace.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, p.frames, data.detection.boxes, tree)
    find_overlaps_with_simulated(scene, p.frames, near, data.detection)
    for k in range(near.counts.filled):
        if near.separation[k] < -MIN_OVERLAP:
            write_simulated_poses(scene, data)
            rounds = separate_by_method(scene, data, params.method)
            write_corrected_poses(scene, data)
            return rounds
    return 0
