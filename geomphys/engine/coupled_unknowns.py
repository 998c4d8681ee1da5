"""Offsets of driven trees as unknowns of the contact solve: values, masses, and the resulting poses.

The coupling (6), m A = -K x - R v, is taken implicitly over a step of h seconds: without contact the rate becomes

    u = (m v - h K x) / M,   M = m + h R + h² K,

and a contact impulse p along an unknown adds p / M to it. Where |K x| is above the limit of effort F the spring is a constant
force: F stands for K x with its sign, and M = m + h R. Of a joint behind a contact, m, K and R are times its `impedance_scale`
(`coupled_motion.fit_stiffness`). Without contact on a tree (6) is solved in closed form, as it always is for the rotation of a
root, which is no unknown.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.coupling import relax, relax_by, relaxation_of
from geomphys.driven.postures import Posture, copy_tree
from geomphys.driven.starts import JUMP, wrapped
from geomphys.engine.coupled_state import Coupled
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import quat_of, set_quat, set_vec, vec_of
from geomphys.numerics.vec3 import (
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_unit,
    rotation_vector,
    slerp,
)
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, pose_tree, set_pose

Floats = NDArray[np.float64]


@kernel
def unknown_of_joint(scene: Scene, q: int) -> int:
    """Index of the unknown of a degree of freedom."""
    return 3 * len(scene.trees.role) + q


@kernel
def first_unknown(scene: Scene, tree: int) -> int:
    """First unknown of the joints of a tree."""
    return unknown_of_joint(scene, scene.trees.dof_start[tree])


@kernel
def end_unknown(scene: Scene, tree: int) -> int:
    """One past the last unknown of the joints of a tree."""
    return unknown_of_joint(scene, scene.trees.dof_start[tree + 1])


@kernel
def solves(scene: Scene, c: Coupled, tree: int) -> bool:
    """Whether a tree is driven and takes part."""
    return bool(scene.trees.role[tree] == DRIVEN and c.trees[tree].solved == 1)


@noinline
def load_unknowns(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, dt: float) -> None:
    """Offsets, rates and recorded rates of all driven trees for the substep that ends at `roots` and `angles`.

    A tree that was pressed keeps its velocity in the world: the change of the recording's rate is subtracted from that
    of its offset.
    """
    c, state = data.coupled, data.driven
    solve = c.solve
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        t = c.trees[tree]
        for i in range(3):
            x = c.unknowns[3 * tree + i]
            x.offset = state.last.roots[tree, i] - state.recorded.roots[tree, i]
            if t.touched == 0:
                x.rate = state.offset_velocity[tree, i]
            x.recorded_before = x.recorded_rate
            x.recorded_rate = (roots[tree, i] - state.recorded.roots[tree, i]) / dt
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            x = c.unknowns[unknown_of_joint(scene, q)]
            x.offset = wrapped(data.workspace, q, state.last.angles[q] - state.recorded.angles[q])
            if t.touched == 0:
                change = wrapped(data.workspace, q, x.offset - x.loaded_offset)
                x.rate = change / solve.substep_duration if solve.started == 1 else 0.0
            x.loaded_offset = x.offset
            change = angles[q] - state.recorded.angles[q]
            x.recorded_before = x.recorded_rate
            x.recorded_rate = change / dt if abs(change) < JUMP else 0.0
        corrected, recorded = orientation_of(state.last.roots, tree), orientation_of(state.recorded.roots, tree)
        set_quat(t.rotation_offset, (0.0, 0.0, 0.0, 1.0))
        if corrected != recorded:
            set_quat(t.rotation_offset, quat_mul(corrected, quat_conjugate(recorded)))
        if t.touched == 0:
            set_vec(t.rotation_offset_rate, vec_of(state.link_offsets[scene.trees.body_start[tree]].angular_velocity))
        if t.pressed == 1:
            keep_world_velocity(scene, c, tree)
        forget_bad_rates(c, 3 * tree, 3 * tree + 3)
        forget_bad_rates(c, first_unknown(scene, tree), end_unknown(scene, tree))
        t.touched = t.solved = 0
        copy_tree(scene, state.recorded, tree, c.begin)
    solve.started, solve.substep_duration = 1, dt
    solve.unconverged = solve.lost = 0


@kernel
def forget_bad_rates(c: Coupled, first: int, last: int) -> None:
    """Set rates of unknowns `first` to `last` that are not finite to zero."""
    for k in range(first, last):
        if not math.isfinite(c.unknowns[k].rate):
            c.unknowns[k].rate = 0.0


@kernel
def keep_world_velocity(scene: Scene, c: Coupled, tree: int) -> None:
    """Subtract the change of the recording's rates from those of a tree's offsets."""
    for i in range(3):
        x = c.unknowns[3 * tree + i]
        x.rate -= x.recorded_rate - x.recorded_before
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        x = c.unknowns[unknown_of_joint(scene, q)]
        x.rate -= x.recorded_rate - x.recorded_before


@kernel
def relax_rotation(scene: Scene, c: Coupled, tree: int, dt: float) -> bool:
    """Relax the rotation offset of the root, which is no unknown, by (6) in closed form over `dt` [s]; whether there is one."""
    t = c.trees[tree]
    if t.rotation_offset[0] == 0.0 and t.rotation_offset[1] == 0.0 and t.rotation_offset[2] == 0.0:
        return False
    x, v, r = rotation_vector(quat_of(t.rotation_offset)), t.rotation_offset_rate, relaxation_of(scene.trees, tree, dt)
    x0, v[0] = relax_by(r, x[0], v[0])
    x1, v[1] = relax_by(r, x[1], v[1])
    x2, v[2] = relax_by(r, x[2], v[2])
    set_quat(t.rotation_offset, quat_from_rotation_vector((x0, x1, x2)))
    return True


@noinline
def pose_driven(
    scene: Scene, data: ReplayData, tree: int, roots: Floats, angles: Floats, at: float, into: Posture
) -> None:
    """Pose a driven tree, in a posture, at its offsets from the recording `at` this fraction of the substep."""
    c = data.coupled
    rotation = slerp(orientation_of(c.begin.roots, tree), orientation_of(roots, tree), at)
    rotation_offset = quat_of(c.trees[tree].rotation_offset)
    if rotation_offset[0] != 0.0 or rotation_offset[1] != 0.0 or rotation_offset[2] != 0.0:
        rotation = quat_unit(quat_mul(rotation_offset, rotation))
    set_pose(into.roots, tree, (0.0, 0.0, 0.0), rotation)
    for i in range(3):
        a, b = c.begin.roots[tree, i], roots[tree, i]
        into.roots[tree, i] = a + at * (b - a) + c.unknowns[3 * tree + i].offset
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        a, b = c.begin.angles[q], angles[q]
        if abs(b - a) >= JUMP:
            a = b
        into.angles[q] = a + at * (b - a) + c.unknowns[unknown_of_joint(scene, q)].offset
    pose_tree(scene, data.workspace.origins, tree, into.roots, into.angles, into.poses)


@kernel
def begin_step(c: Coupled, first: int, last: int, h: float) -> None:
    """Free rates and masses of unknowns `first` to `last` for a step of `h` seconds by the implicit coupling.

    The spring presses with no more than `effort`.
    """
    for k in range(first, last):
        x = c.unknowns[k]
        x.new_rate = x.inverse_mass = 0.0
        if x.mass == 0.0:
            continue
        mass, stiffness, damping = (
            x.impedance_scale * x.mass,
            x.impedance_scale * x.stiffness,
            x.impedance_scale * x.damping,
        )
        impulse = h * stiffness * x.offset
        whole = mass + h * damping + h * h * stiffness
        if abs(stiffness * x.offset) > x.effort:
            impulse = h * x.effort if x.offset > 0.0 else -h * x.effort
            whole = mass + h * damping
        x.inverse_mass = 1.0 / whole
        x.new_rate = (mass * x.rate - impulse) / whole


@kernel
def begin_impact(c: Coupled, first: int, last: int) -> None:
    """Rates and real masses of unknowns `first` to `last`, for impulses, which act instantaneously."""
    for k in range(first, last):
        x = c.unknowns[k]
        x.new_rate = x.rate
        x.inverse_mass = 1.0 / x.mass if x.mass > 0.0 else 0.0


@kernel
def end_impact(c: Coupled, first: int, last: int) -> None:
    """Set the rates of unknowns `first` to `last` to the solved ones."""
    for k in range(first, last):
        c.unknowns[k].rate = c.unknowns[k].new_rate


@kernel
def end_step(c: Coupled, first: int, last: int, h: float, pressed: bool) -> None:
    """Offsets of unknowns `first` to `last` after a step: as solved where they are `pressed`, else by (6) in closed form."""
    for k in range(first, last):
        x = c.unknowns[k]
        if x.mass == 0.0:
            continue
        if pressed:
            x.rate = x.new_rate
            x.offset += h * x.rate
        elif x.offset != 0.0 or x.rate != 0.0:
            x.offset, x.rate = relax(x.offset, x.rate, x.mass, x.stiffness, x.damping, h)
