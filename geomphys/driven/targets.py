"""Targets of links: recorded poses plus the offsets of the last frame, relaxed by the coupling (6); with inertia where pressed.

A tree that was only translated has one offset, that of its root. One that rotated or changed its joints has one
for each link, of its centre and of its rotation, in the world: so they do not depend on the choice among equivalent angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.coupling import relax_by, relaxation_of
from geomphys.driven.objective import is_rigid, link_centre
from geomphys.driven.postures import is_recorded
from geomphys.driven.state import PRESCRIBED, DrivenState, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import copy_pose, set_vec, set_vec_at, vec_at, vec_of
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    dot,
    norm,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_unit,
    rotation_vector,
    scale,
    sub,
)
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import orientation_of, set_pose

Floats = NDArray[np.float64]

NO_TRANSLATION = 1e-6  # m: smaller translations of links count as zero
NO_ROTATION = 1e-6  # rad: smaller rotation offsets of links count as zero
DEVIATION_PER_MOTION = 1.9  # how far a link's offset may leave its path by the coupling in a frame: times its motion
MIN_DEVIATION = 1.4e-3  # m: the same, at least
COMING_TO_REST = 0.25  # of its speed in the last step: a slower recorded link comes to rest
LEAST_DEPTH = 5e-4  # m: a smaller recorded depth counts as this where offsets are compared with it
SMALL_OFFSET = 1e-3  # m: an offset from which on the motion of the base along it has inertia
FULL_DEPTH = 3e-3  # m: recorded depth from which on inertia applies in full
MAX_GROWTH = 100.0  # of the weight of a link that is far off
MOVED = 1e-7  # m or rad: a posture that differs by less from its goal has not touched anything


@kernel
def _has_offset(scene: Scene, state: DrivenState, tree: int) -> bool:
    """Whether some link of a tree with offsets of its links has one that is not zero."""
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        for i in range(3):
            offset = state.link_offsets[body]
            if abs(offset.translation[i]) > NO_TRANSLATION or abs(offset.rotation[i]) > NO_ROTATION:
                return True
    return False


@kernel
def clear_link_offset(state: DrivenState, body: int) -> None:
    """Set a link's offset and its rates to zero."""
    offset = state.link_offsets[body]
    for i in range(3):
        offset.translation[i] = offset.rotation[i] = offset.velocity[i] = offset.angular_velocity[i] = 0.0
        offset.last_translation[i] = offset.last_rotation[i] = 0.0
        offset.contact_velocity[i] = offset.contact_angular_velocity[i] = offset.recorded_velocity[i] = 0.0
        offset.last_velocity[i] = offset.last_angular_velocity[i] = offset.recorded_angular_velocity[i] = 0.0


@kernel
def clear_offsets(scene: Scene, state: DrivenState, tree: int) -> None:
    """Set a tree's offsets and their rates to zero."""
    state.general_motion[tree] = 0
    for i in range(3):
        state.offset[tree, i] = state.offset_velocity[tree, i] = state.last_offset_velocity[tree, i] = 0.0
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        clear_link_offset(state, body)


@noinline
def find_recorded_motion(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, recorded: Floats) -> None:
    """Motion of the links of a tree from the last recorded poses to `recorded` (B, 7), into `SearchWorkspace.recorded`."""
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        motion, centre = ws.work.recorded[body], link_centre(ws, recorded, body)
        set_vec(motion.centre, centre)
        set_vec(motion.path, sub(centre, link_centre(ws, state.recorded.poses, body)))
        set_vec(motion.rotation, _rotation_vector_between(state.recorded.poses, recorded, body))


@kernel
def _set_link_target(ws: DrivenWorkspace, recorded: Floats, body: int, translation: Vec, rotation: Vec) -> None:
    """Target of a link: its recorded pose plus an offset."""
    q = orientation_of(recorded, body)
    if rotation != (0.0, 0.0, 0.0):
        q = quat_unit(quat_mul(quat_from_rotation_vector(rotation), q))
    set_pose(ws.work.target, body, add(vec_of(ws.work.recorded[body].centre), translation), q)


@kernel
def _retained_rate(state: DrivenState, ws: DrivenWorkspace, body: int, dt: float) -> float:
    """Share, 0 to 1, of the rate set by contacts with which an offset goes on: less where the recorded motion comes to an end."""
    before = dt * norm(vec_of(state.link_offsets[body].recorded_velocity))
    moved = norm(vec_of(ws.work.recorded[body].path))
    return 1.0 if moved >= COMING_TO_REST * before else moved / (COMING_TO_REST * before)


@kernel
def _drop_rates(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, dt: float) -> None:
    """Rates that contacts have set end where the recorded motion ends: what is held still in contact stays at rest."""
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        lost = 1.0 - _retained_rate(state, ws, body, dt)
        if lost == 0.0:
            continue
        o = state.link_offsets[body]
        for i in range(3):
            o.velocity[i] -= lost * o.contact_velocity[i]
            o.angular_velocity[i] -= lost * o.contact_angular_velocity[i]
            if body == ws.links.pivot[tree]:
                state.offset_velocity[tree, i] -= lost * o.contact_velocity[i]
                state.last_offset_velocity[tree, i] -= lost * o.contact_velocity[i]


@kernel
def _rotation_vector_between(before: Floats, after: Floats, body: int) -> Vec:
    """Rotation vector of a body from its orientation in poses `before` to that in poses `after` (B, 7)."""
    return rotation_vector(quat_mul(orientation_of(after, body), quat_conjugate(orientation_of(before, body))))


@kernel
def _recorded_jolt(state: DrivenState, ws: DrivenWorkspace, body: int, dt: float) -> tuple[Vec, Vec]:
    """How far a link's recorded translation [m] and rotation [rad] are from those with its velocities of the last step."""
    o, recorded = state.link_offsets[body], ws.work.recorded[body]
    return (
        sub(vec_of(recorded.path), scale(vec_of(o.recorded_velocity), dt)),
        sub(vec_of(recorded.rotation), scale(vec_of(o.recorded_angular_velocity), dt)),
    )


@kernel
def _continue_motion(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, dt: float) -> None:
    """Move relaxed offsets of a pressed tree towards those with which its links would go on as in the last step.

    Offsets go on at their last rates. What is new in the recorded motion is followed in part: of the base of chains what
    is across its offset in full, as the recording is; of all else, what stops or trembles, less. The share grows with the
    recorded depth and with the grip: no offset starts, or is kept from its end, by inertia.
    """
    weights, base = ws.weights, ws.links.pivot[tree]
    pressed = min(ws.work.depth[tree] / FULL_DEPTH, 1.0)
    share = pressed * (weights.rigid_inertia if is_rigid(scene, tree) else weights.inertia)
    share = max(share, weights.grip_inertia * ws.work.grip[tree])
    if share == 0.0 or dt == 0.0:
        return
    jolt, _ = _recorded_jolt(state, ws, base, dt)
    offset = vec_of(state.link_offsets[base].last_translation)
    along = dot(offset, jolt) / (dot(offset, offset) + SMALL_OFFSET * SMALL_OFFSET)
    followed = add_scaled(jolt, offset, -along)
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        o, (jolt, rotation) = state.link_offsets[body], _recorded_jolt(state, ws, body, dt)
        for i in range(3):
            there = o.last_translation[i] + dt * o.last_velocity[i] - (jolt[i] - followed[i])
            o.translation[i] += share * (there - o.translation[i])
            there = o.last_rotation[i] + dt * o.last_angular_velocity[i] - rotation[i]
            o.rotation[i] += share * (there - o.rotation[i])


@noinline
def _relax_tree(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, recorded: Floats, dt: float) -> None:
    """Relax the offsets of a tree, and set the targets of its links.

    Stores the rates, so that their change by impulses until the next step can be found.
    """
    trees, first, relaxation = scene.trees, scene.trees.body_start[tree], relaxation_of(scene.trees, tree, dt)
    if dt > 0.0:
        _drop_rates(scene, state, ws, tree, dt)
    velocity_change = sub(vec_at(state.offset_velocity, tree), vec_at(state.last_offset_velocity, tree))
    for body in range(first, trees.body_start[tree + 1]):
        o = state.link_offsets[body]
        set_vec(o.last_translation, vec_of(o.translation))
        set_vec(o.last_rotation, vec_of(o.rotation))
        set_vec_at(ws.work.anchor, body, add(vec_of(ws.work.recorded[body].centre), vec_of(o.translation)))
    if state.general_motion[tree] == 0:
        for i in range(3):
            state.offset[tree, i], state.offset_velocity[tree, i] = relax_by(
                relaxation, state.offset[tree, i], state.offset_velocity[tree, i]
            )
        offset = vec_at(state.offset, tree)
        for body in range(first, trees.body_start[tree + 1]):
            set_vec(state.link_offsets[body].translation, offset)
            set_vec(state.link_offsets[body].velocity, vec_at(state.offset_velocity, tree))
            _set_link_target(ws, recorded, body, offset, (0.0, 0.0, 0.0))
        for i in range(3):
            state.last_offset_velocity[tree, i] = state.offset_velocity[tree, i]
        return
    for body in range(first, trees.body_start[tree + 1]):
        o = state.link_offsets[body]
        for i in range(3):
            o.translation[i], o.velocity[i] = relax_by(relaxation, o.translation[i], o.velocity[i] + velocity_change[i])
            o.rotation[i], o.angular_velocity[i] = relax_by(relaxation, o.rotation[i], o.angular_velocity[i])
    for i in range(3):
        state.last_offset_velocity[tree, i] = state.offset_velocity[tree, i]
    if not _has_offset(scene, state, tree):
        clear_offsets(scene, state, tree)
    else:
        _continue_motion(scene, state, ws, tree, dt)
    for body in range(first, trees.body_start[tree + 1]):
        o = state.link_offsets[body]
        _set_link_target(ws, recorded, body, vec_of(o.translation), vec_of(o.rotation))


@kernel
def _take_prescribed(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, recorded: Floats, dt: float
) -> None:
    """Offsets of a tree, and their rates, from its prescribed posture, which its links are targeted at."""
    first, prescribed = scene.trees.body_start[tree], state.prescribed_posture.poses
    for body in range(first, scene.trees.body_start[tree + 1]):
        o, c = state.link_offsets[body], vec_of(ws.work.recorded[body].centre)
        translation = sub(link_centre(ws, prescribed, body), c)
        rotation = _rotation_vector_between(recorded, prescribed, body)
        for i in range(3):
            ws.work.anchor[body, i] = c[i] + o.translation[i]
            o.velocity[i] = (translation[i] - o.translation[i]) / dt
            o.angular_velocity[i] = (rotation[i] - o.rotation[i]) / dt
        set_vec(o.translation, translation)
        set_vec(o.rotation, rotation)
        _set_link_target(ws, recorded, body, translation, rotation)
    for i in range(3):
        state.offset_velocity[tree, i] = state.last_offset_velocity[tree, i] = state.link_offsets[
            ws.links.pivot[tree]
        ].velocity[i]


@kernel
def _set_link_weights(scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int) -> None:
    """Weights of the links of a tree in the objective: in chains more where an offset is large against the recorded depth.

    In the metric of the links alone one finger is moved far where two overlap near their knuckles; so other links share in it.
    """
    depth = max(ws.work.depth[tree], LEAST_DEPTH)
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        ws.work.weight[body] = ws.links.weight[body]
        if not is_rigid(scene, tree):
            amplification = norm(vec_of(state.link_offsets[body].translation)) / depth
            excess = max(amplification - ws.weights.amplification, 0.0) / ws.weights.excess
            ws.work.weight[body] *= 1.0 + min(excess * excess, MAX_GROWTH)


@noinline
def set_link_targets(scene: Scene, state: DrivenState, ws: DrivenWorkspace, recorded: Floats, dt: float) -> None:
    """Relax all offsets by `dt` [s], set targets, weights, anchors and limits of links, whose recorded poses are (B, 7).

    The anchor of a link is where its centre would be if its offset stayed that of the last frame: the straight line from there
    to the target is the path by the coupling, from which it may depart no farther than a limit.
    """
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        find_recorded_motion(scene, state, ws, tree, recorded)
        if state.prescription[tree] == PRESCRIBED and dt > 0.0:
            _take_prescribed(scene, state, ws, tree, recorded, dt)
        else:
            _relax_tree(scene, state, ws, tree, recorded, dt)
        motion = 0.0
        _set_link_weights(scene, state, ws, tree)
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            motion = max(motion, norm(vec_of(ws.work.recorded[body].path)))
        ws.work.deviation_limit[tree] = max(MIN_DEVIATION, DEVIATION_PER_MOTION * motion)
        ws.work.translation_limit[tree] = ws.weights.translation_speed * dt
        ws.work.closing[tree] = ws.weights.closing_speed * dt + ws.weights.closing_share * motion


@kernel
def _set_rate_along(rate: Floats, by_contacts: Floats, change: Vec, moved: Vec, per_second: float) -> None:
    """Set the rate (3,) of an offset along its change by contacts to that of its motion in the step, `per_second` times it.

    `by_contacts` (3,) is what is so set.

    It does not go on against what it touched. Without it an offset that contacts change would stand still as soon as they end.
    """
    size = norm(change)
    set_vec(by_contacts, (0.0, 0.0, 0.0))
    if size <= MOVED:
        return
    along, present = per_second * dot(moved, change) / size, dot(vec_of(rate), change) / size
    if along < 0.0 or present < along:
        for i in range(3):
            rate[i] += (along - present) * change[i] / size
            by_contacts[i] = along * change[i] / size


@noinline
def store_tree_offsets(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, tree: int, recorded: Floats, general_motion: bool
) -> None:
    """Store the offsets that a tree has in its final posture, and their rates; `find_recorded_motion` was called for `recorded`.

    Where it reached its goal the offsets are those of `set_link_targets`. The rates are too, changed by impulses, but along the
    change of an offset by contacts: there they are a share of those at which it changed, and 0 after a coupled contact solve.
    """
    poses, root, shrinking, growing = state.last.poses, scene.trees.body_start[tree], 0.0, 0.0
    if state.progress.dt > 0.0 and state.prescription[tree] == 0:
        shrinking = ws.weights.offset_rate / state.progress.dt
        growing = shrinking if is_rigid(scene, tree) else ws.weights.growth_rate / state.progress.dt
    for body in range(root, scene.trees.body_start[tree + 1]):
        for i in range(3):
            state.link_offsets[body].velocity[i] += state.offset_velocity[tree, i] - state.last_offset_velocity[tree, i]
    for i in range(3):
        state.offset[tree, i] = state.last.roots[tree, i] - recorded[root, i]
    offset = vec_at(state.offset, tree)
    for body in range(root, scene.trees.body_start[tree + 1]):
        rotation = (0.0, 0.0, 0.0)
        translation = offset
        if general_motion:
            q = quat_mul(orientation_of(poses, body), quat_conjugate(orientation_of(recorded, body)))
            rotation = rotation_vector(q)
            if orientation_of(poses, body) == orientation_of(recorded, body):
                rotation = (0.0, 0.0, 0.0)
            translation = sub(link_centre(ws, poses, body), vec_of(ws.work.recorded[body].centre))
        o = state.link_offsets[body]
        change, moved = sub(translation, vec_of(o.translation)), sub(translation, vec_of(o.last_translation))
        _set_rate_along(
            o.velocity, o.contact_velocity, change, moved, growing if dot(moved, change) > 0.0 else shrinking
        )
        change, moved = sub(rotation, vec_of(o.rotation)), sub(rotation, vec_of(o.last_rotation))
        _set_rate_along(
            o.angular_velocity,
            o.contact_angular_velocity,
            change,
            moved,
            growing if dot(moved, change) > 0.0 else shrinking,
        )
        set_vec(o.translation, translation)
        set_vec(o.rotation, rotation)
        if state.progress.dt > 0.0:
            per_second, motion = 1.0 / state.progress.dt, ws.work.recorded[body]
            set_vec(o.recorded_velocity, scale(vec_of(motion.path), per_second))
            set_vec(o.recorded_angular_velocity, scale(vec_of(motion.rotation), per_second))
            set_vec(o.last_velocity, scale(sub(translation, vec_of(o.last_translation)), per_second))
            set_vec(o.last_angular_velocity, scale(sub(rotation, vec_of(o.last_rotation)), per_second))
    state.general_motion[tree] = 1 if general_motion else 0
    if not general_motion:
        for body in range(root, scene.trees.body_start[tree + 1]):
            o = state.link_offsets[body]
            set_vec(o.translation, offset)
            set_vec(o.rotation, (0.0, 0.0, 0.0))
            set_vec(o.angular_velocity, (0.0, 0.0, 0.0))
    for i in range(3):
        pivot = ws.links.pivot[tree]
        state.offset_velocity[tree, i] = state.last_offset_velocity[tree, i] = state.link_offsets[pivot].velocity[i]


@noinline
def store_offsets(
    scene: Scene, state: DrivenState, ws: DrivenWorkspace, roots: Floats, angles: Floats, recorded: Floats
) -> None:
    """Compute the offsets from the final posture `state.last`, and store the recording."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        if scene.trees.role[tree] == DRIVEN:
            store_tree_offsets(scene, state, ws, tree, recorded, has_general_motion(scene, state, tree, roots, angles))
        copy_pose(roots, tree, state.recorded.roots, tree)
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            state.recorded.angles[q] = angles[q]
            if scene.trees.role[tree] == DRIVEN:
                state.used_low[q] = min(state.used_low[q], angles[q])
                state.used_high[q] = max(state.used_high[q], angles[q])
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            copy_pose(recorded, body, state.recorded.poses, body)


@kernel
def has_general_motion(scene: Scene, state: DrivenState, tree: int, roots: Floats, angles: Floats) -> bool:
    """Whether a tree differs from its recording by more than a translation."""
    if orientation_of(state.last.roots, tree) != orientation_of(roots, tree):
        return True
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):  # noqa: SIM110 - no generators in kernels
        if state.last.angles[q] != angles[q]:
            return True
    return False
