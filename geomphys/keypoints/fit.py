"""Fits joint values, and the root pose where no tracker gives it, to the points of a frame: damped Gauss-Newton.

Minimises, over joint values q within their limits and the root's pose,

    1/2 sum_i w_i |x_i(q, root) - p_i|² + 1/2 sum_j l_j² (r_j (q_j - rest_j)² + s (q_j - target_j)²) + 1/2 l_o² |a|²

with the points p_i that are seen, the lever l_j of each joint, s = `SMOOTHNESS_WEIGHT` and target the values of the last frame,
and, where the source has an orientation of the palm, the rotation vector a from that to the root's and its lever l_o.
The weight r_j of the rest posture is low where the points determine a joint and higher where they do not, as for the twist of a
straight finger, where they only give noise (`weigh_rest`): by the diagonal of the Gauss-Newton Hessian of the points.
It starts from the result of the last frame, so of equivalent solutions the near one is found.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel
from geomphys.keypoints.cholesky import factorise, substitute_back, substitute_forward
from geomphys.keypoints.fit_model import REST_WEIGHT, SHOWN, SMOOTHNESS_WEIGHT, UNSHOWN_WEIGHT, FitModel, FitState
from geomphys.numerics.row_vectors import copy_pose, vec_at
from geomphys.numerics.vec3 import (
    Vec,
    add,
    cross,
    dot,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rotation_vector,
    sub,
)
from geomphys.scene.arrays import JOINT_FIXED, JOINT_PRISMATIC
from geomphys.scene.kinematics import orientation_of, pose_child, position_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP_TOLERANCE = 3e-3
"""rad (and m · 10); a smaller step ends the search: with points that are 1 mm off the next one is about a tenth of it."""
NO_GAIN = 1e-6
"""Share of the objective; so does a step that gains no more."""
MAX_INCREMENT = 0.5
"""rad or m; a larger increment of the last frame is not extrapolated."""
MAX_STEP = 0.5
"""rad; longest step of a joint value."""
ROOT_RIDGE = 1e-9
"""Added to the Hessian of the root, so that undetermined directions have a solution: no motion."""


@kernel
def pose_links(model: FitModel, root: Floats, angles: Floats, poses: Floats) -> None:
    """Forward kinematics: world poses (B, 7) of the links from the root's pose (7,) and the joint values (Q,)."""
    for k in range(7):
        poses[0, k] = root[k]
    for body in range(1, len(model.parent)):
        value = model.offset[body]
        if model.column[body] >= 0:
            value += model.multiplier[body] * angles[model.column[body]]
        pose_child(poses, body, model.parent[body], model.origin, model.axis, (model.kind[body], value))


@kernel
def orientation_error(state: FitState, poses: Floats) -> Vec:
    """Rotation vector from the orientation of the source to that of the root."""
    recorded = (state.orientation[0], state.orientation[1], state.orientation[2], state.orientation[3])
    return rotation_vector(quat_mul(orientation_of(poses, 0), quat_conjugate(recorded)))


@kernel
def objective(model: FitModel, state: FitState, points: Floats, seen: Ints, angles: Floats, poses: Floats) -> float:
    """Value of the objective for posed links."""
    total = 0.0
    for i in range(len(model.body)):
        if seen[i]:
            body = model.body[i]
            x, y, z = poses[body, 0] - points[i, 0], poses[body, 1] - points[i, 1], poses[body, 2] - points[i, 2]
            total += model.weight[i] * (x * x + y * y + z * z)
    smoothness = state.weights.smoothness
    for j in range(len(angles)):
        rest, near = angles[j] - model.rest[j], angles[j] - state.target[j]
        total += model.lever[j] ** 2 * (state.rest_weight[j] * rest * rest + smoothness * near * near)
    if state.weights.orientation > 0.0:
        error = orientation_error(state, poses)
        total += state.weights.orientation * dot(error, error)
    return 0.5 * total


@kernel
def rotate_axes(model: FitModel, state: FitState) -> None:
    """Joint axes in the world frame, for `state.poses`."""
    for body in range(1, len(model.parent)):
        if model.column[body] >= 0:
            axis = vec_at(model.axis, body)
            axis = quat_rotate(orientation_of(state.poses, body), axis)
            state.axes[body, 0], state.axes[body, 1], state.axes[body, 2] = axis


@kernel
def point_jacobian(model: FitModel, state: FitState, body: int, centre: Vec) -> int:
    """Derivative (3, N) of a link's origin with respect to the unknowns.

    Fills `state.jacobian` at the columns that it lists in `state.columns`; returns their number. The root rotates about `centre`.
    """
    columns, jacobian, poses = state.columns, state.jacobian, state.poses
    x, count, link = position_of(poses, body), 0, body
    unknowns = len(model.rest)
    while link > 0:
        column = model.column[link]
        if column >= 0 and model.kind[link] != JOINT_FIXED:
            axis = vec_at(state.axes, link)
            if model.kind[link] != JOINT_PRISMATIC:
                axis = cross(axis, sub(x, position_of(poses, link)))
            known = False
            for k in range(count):
                known = known or columns[k] == column
            for k in range(3):
                value = model.multiplier[link] * axis[k]
                jacobian[k, column] = value + (jacobian[k, column] if known else 0.0)
            if not known:
                columns[count] = column
                count += 1
        link = model.parent[link]
    if model.fits_root:
        r = sub(x, centre)
        for k in range(3):
            for m in range(6):
                jacobian[k, unknowns + m] = 0.0
            jacobian[k, unknowns + k] = 1.0
            columns[count] = unknowns + k
            columns[count + 3] = unknowns + 3 + k
            count += 1
        count += 3
        jacobian[0, unknowns + 4], jacobian[0, unknowns + 5] = r[2], -r[1]
        jacobian[1, unknowns + 3], jacobian[1, unknowns + 5] = -r[2], r[0]
        jacobian[2, unknowns + 3], jacobian[2, unknowns + 4] = r[1], -r[0]
    return count


@kernel
def add_points(model: FitModel, state: FitState, points: Floats, seen: Ints, centre: Vec) -> None:
    """Gradient and Gauss-Newton Hessian (lower triangle) of the terms of the points, at `state.poses`."""
    hessian, gradient, jacobian, columns = state.hessian, state.gradient, state.jacobian, state.columns
    for a in range(len(gradient)):
        gradient[a] = 0.0
        for b in range(a + 1):
            hessian[a, b] = 0.0
    rotate_axes(model, state)
    for i in range(len(model.body)):
        if not seen[i]:
            continue
        body, w = model.body[i], model.weight[i]
        count = point_jacobian(model, state, body, centre)
        x = w * (state.poses[body, 0] - points[i, 0])
        y = w * (state.poses[body, 1] - points[i, 1])
        z = w * (state.poses[body, 2] - points[i, 2])
        for m in range(count):
            a = columns[m]
            u, v, t = jacobian[0, a], jacobian[1, a], jacobian[2, a]
            gradient[a] += u * x + v * y + t * z
            for n in range(m + 1):
                b = columns[n]
                value = w * (u * jacobian[0, b] + v * jacobian[1, b] + t * jacobian[2, b])
                hessian[max(a, b), min(a, b)] += value


@kernel
def weigh_rest(model: FitModel, state: FitState) -> None:
    """Set the rest weight of each joint by how far the seen points are from its axis: by the Hessian of `add_points`."""
    for j in range(len(model.rest)):
        shown = state.hessian[j, j] / (SHOWN * model.lever[j] ** 2)
        state.rest_weight[j] = REST_WEIGHT + (UNSHOWN_WEIGHT - REST_WEIGHT) / (1.0 + shown * shown)


@kernel
def add_priors(model: FitModel, state: FitState) -> None:
    """Add the other terms of the objective, at `state.angles` and `state.poses`."""
    hessian, gradient, smoothness = state.hessian, state.gradient, state.weights.smoothness
    for j in range(len(model.rest)):
        scale = model.lever[j] ** 2
        hessian[j, j] += scale * (state.rest_weight[j] + smoothness)
        gradient[j] += scale * (
            state.rest_weight[j] * (state.angles[j] - model.rest[j]) + smoothness * (state.angles[j] - state.target[j])
        )
    first = len(model.rest)
    for j in range(first, len(gradient)):
        hessian[j, j] += ROOT_RIDGE
    if state.weights.orientation > 0.0:
        error = orientation_error(state, state.poses)
        for k in range(3):
            gradient[first + 3 + k] += state.weights.orientation * error[k]
            hessian[first + 3 + k, first + 3 + k] += state.weights.orientation


@kernel
def choose_free(model: FitModel, state: FitState, shown: Ints) -> None:
    """Mark the unknowns of a step: joints that a seen point determines, or none ever does, but for those pressed on a limit."""
    for j in range(len(model.rest)):
        at_lower = state.angles[j] <= model.lower[j] and state.gradient[j] > 0.0
        at_upper = state.angles[j] >= model.upper[j] and state.gradient[j] < 0.0
        state.free[j] = int(shown[j] != 0 and not at_lower and not at_upper)
    for j in range(len(model.rest), len(state.free)):
        state.free[j] = 1 if model.fits_root else 0


@kernel
def try_step(model: FitModel, state: FitState, centre: Vec) -> float:
    """Take `state.step` from the current posture to the trial posture; returns the largest change (rad, or m · 10)."""
    n, largest, trial_root = len(model.rest), 0.0, state.trial_root
    for j in range(n):
        state.trial_angles[j] = state.angles[j]
        if state.free[j]:
            change = min(max(state.step[j], -MAX_STEP), MAX_STEP)
            value = min(max(state.angles[j] + change, model.lower[j]), model.upper[j])
            state.trial_angles[j] = value
            largest = max(largest, abs(value - state.angles[j]))
    for k in range(7):
        trial_root[k] = state.root[k]
    if model.fits_root:
        shift = (state.step[n], state.step[n + 1], state.step[n + 2])
        rotation_step = (state.step[n + 3], state.step[n + 4], state.step[n + 5])
        rotation = quat_from_rotation_vector(rotation_step)
        p = sub((state.root[0], state.root[1], state.root[2]), centre)
        p = add(add(quat_rotate(rotation, p), centre), shift)
        q = quat_unit(quat_mul(rotation, (state.root[3], state.root[4], state.root[5], state.root[6])))
        trial_root[0], trial_root[1], trial_root[2] = p
        trial_root[3], trial_root[4], trial_root[5], trial_root[6] = q
        for k in range(3):
            largest = max(largest, abs(rotation_step[k]), 10.0 * abs(shift[k]))
    pose_links(model, trial_root, state.trial_angles, state.trial_poses)
    return largest


@kernel
def accept_trial(state: FitState) -> None:
    """Make the trial posture the current one."""
    for j in range(len(state.angles)):
        state.angles[j] = state.trial_angles[j]
    for k in range(7):
        state.root[k] = state.trial_root[k]
    for body in range(len(state.poses)):
        copy_pose(state.trial_poses, body, state.poses, body)


@kernel
def seen_centre(points: Floats, seen: Ints) -> Vec:
    """Mean of the seen points; the origin if there are none."""
    x, y, z, count = 0.0, 0.0, 0.0, 0
    for i in range(len(seen)):
        if seen[i]:
            x, y, z, count = x + points[i, 0], y + points[i, 1], z + points[i, 2], count + 1
    count = max(count, 1)
    return (x / count, y / count, z / count)


@kernel
def fit_frame(model: FitModel, state: FitState, points: Floats, seen: Ints, shown: Ints, limit: int) -> float:
    """Fit the points of a frame, from the posture in `state.angles` and `state.root`, which become those of the result.

    Parameters
    ----------
    model, state
        `state.target` and `state.weights` are set by the caller.
    points
        (K, 3) m, world frame.
    seen
        (K,) 1 for points that count.
    shown
        (Q,) 1 for joints that may move.
    limit
        Most iterations.

    Returns
    -------
    float
        Root mean square distance of the seen points from their links' origins [m].
    """
    pose_links(model, state.root, state.angles, state.poses)
    centre, damping, iterations = seen_centre(points, seen), 1e-9, 0
    add_points(model, state, points, seen, centre)
    weigh_rest(model, state)
    cost = objective(model, state, points, seen, state.angles, state.poses)
    searching = True
    while searching and iterations < limit:
        if iterations > 0:
            add_points(model, state, points, seen, centre)
        add_priors(model, state)
        choose_free(model, state, shown)
        is_better = False
        while not is_better and damping < 1e6:
            iterations += 1
            if factorise(state, damping):
                for j in range(len(state.step)):
                    state.step[j] = -state.gradient[j] if state.free[j] else 0.0
                substitute_forward(state, 0)
                substitute_back(state)
                largest = try_step(model, state, centre)
                trial_cost = objective(model, state, points, seen, state.trial_angles, state.trial_poses)
                if trial_cost <= cost:
                    is_better = True
                    searching = largest > STEP_TOLERANCE and cost - trial_cost > NO_GAIN * cost
                    cost = trial_cost
                    accept_trial(state)
                    damping = max(0.1 * damping, 1e-9)
                    continue
                if largest < STEP_TOLERANCE:
                    break
            damping = max(10.0 * damping, 1e-4)
        searching = searching and is_better
    total, count = 0.0, 0
    for i in range(len(seen)):
        if seen[i]:
            body = model.body[i]
            for k in range(3):
                total += (state.poses[body, k] - points[i, k]) ** 2
            count += 1
    return math.sqrt(total / max(count, 1))


@kernel
def fit_next(model: FitModel, state: FitState, points: Floats, seen: Ints, shown: Ints, limit: int) -> float:
    """Fit the points of a frame from the posture of the last one, with its extrapolation as target; see `fit_frame`."""
    for j in range(len(model.rest)):
        last, increment = state.angles[j], state.increment[j]
        predicted = last + (increment if abs(increment) < MAX_INCREMENT else 0.0)
        state.target[j] = min(max(predicted, model.lower[j]), model.upper[j])
        state.increment[j] = -last
    state.weights.smoothness = SMOOTHNESS_WEIGHT
    distance = fit_frame(model, state, points, seen, shown, limit)
    for j in range(len(model.rest)):
        state.increment[j] += state.angles[j]
    return distance


@kernel
def measure_uncertainty(model: FitModel, state: FitState, points: Floats, seen: Ints, variance_ratio: Floats) -> None:
    """How little the points of the last frame determine each joint, and the step that they ask for without limits.

    Sets `variance_ratio` (Q,) to the posterior variance over that by the rest term alone: 1 where the points are uninformative,
    near 0 where they determine the value; and `state.step` to the Gauss-Newton step without limits. The posture does not change.
    """
    smoothness = state.weights.smoothness
    state.weights.smoothness = 0.0
    for j in range(len(model.rest)):
        state.rest_weight[j] = REST_WEIGHT
    add_points(model, state, points, seen, seen_centre(points, seen))
    add_priors(model, state)
    state.weights.smoothness = smoothness
    joints = len(model.rest)
    for j in range(len(state.free)):
        state.free[j] = 1 if j < joints or model.fits_root else 0
    for j in range(joints):
        variance_ratio[j] = 1.0
    for j in range(len(state.step)):
        state.step[j] = 0.0
    if factorise(state, 0.0):
        for j in range(joints):
            for k in range(len(state.step)):
                state.step[k] = 0.0
            state.step[j] = 1.0
            substitute_forward(state, j)
            square = 0.0
            for k in range(j, len(state.step)):
                square += state.step[k] * state.step[k]
            variance_ratio[j] = square * REST_WEIGHT * model.lever[j] ** 2
        for j in range(len(state.step)):
            state.step[j] = -state.gradient[j] if state.free[j] else 0.0
        substitute_forward(state, 0)
        substitute_back(state)
