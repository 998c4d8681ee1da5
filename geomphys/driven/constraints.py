"""Constraints of the quadratic program: pairs that may come near, reach cones, and bounds of unknowns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.penetration import Separation
from geomphys.driven.objective import pivot_of
from geomphys.driven.postures import Posture, joint_jacobian, point_of
from geomphys.driven.qp import has_row
from geomphys.driven.reach_cones import cone_angle, cone_row
from geomphys.driven.state import GENERAL_MOTION, HAS_ROW, LOCKED, NO_ROW, REQUESTED, DrivenWorkspace
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import set_vec, vec_at, vec_of
from geomphys.numerics.vec3 import Vec, cross, dot, norm, quat_conjugate, quat_rotate, sub
from geomphys.scene.arrays import DRIVEN, JOINT_FIXED, Scene
from geomphys.scene.kinematics import orientation_of, position_of

Floats = NDArray[np.float64]

ROOT_ARM = 0.15  # m: a root may rotate by the trust radius over this
CONTACT_DISTANCE = 1e-5  # m: pairs no farther apart count as touching
CACHED_DISTANCE = 2e-3  # m: nearest points of pairs no farther apart are cached
SAME_SPOT = 1e-3  # m
CONE_MARGIN = 1e-7  # rad
OVERLAP_WEIGHT = 1e3  # mean weights: penalty of an overlap that cannot be removed in one step
NEAR_ENOUGH = 2.5  # pairs farther apart than this times the trust radius and `NEAR_SLACK` together need no row
NEAR_SLACK = 1e-3  # m


@kernel
def number_unknowns(scene: Scene, ws: DrivenWorkspace) -> int:
    """Number the columns of every tree that may move, and clear the problem; returns their number."""
    work, n = ws.work, 0
    for q in range(len(work.column)):
        work.column[q] = -1
    for tree in range(len(work.mobility)):
        if scene.trees.role[tree] != DRIVEN or work.mobility[tree] == LOCKED:
            continue
        work.first[tree] = n
        n += 3 if work.mobility[tree] != GENERAL_MOTION else 6
        if work.mobility[tree] == GENERAL_MOTION:
            for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                if ws.links.is_unknown[q] == 1:
                    work.column[q] = n
                    n += 1
    for i in range(n):
        ws.problem.gradient[i] = 0.0
        for j in range(i + 1):
            ws.problem.hessian[i, j] = 0.0
    return n


@kernel
def row_limit(trust_radius: float) -> float:
    """Distance [m] up to which a pair gets a row where no point moves much farther than `trust_radius` [m]."""
    return NEAR_ENOUGH * trust_radius + NEAR_SLACK


@kernel
def _add_point_jacobian(
    scene: Scene, ws: DrivenWorkspace, poses: Floats, body: int, point: Vec, n: Vec, sign: float, row: Floats
) -> None:
    """Add to a row how a point of a body moves along n with each unknown."""
    tree = scene.bodies.tree[body]
    if scene.trees.role[tree] != DRIVEN or ws.work.mobility[tree] == LOCKED:
        return
    first = ws.work.first[tree]
    for k in range(3):
        row[first + k] += sign * n[k]
    if ws.work.mobility[tree] != GENERAL_MOTION:
        return
    moment = cross(sub(point, pivot_of(ws, poses, tree)), n)
    for k in range(3):
        row[first + 3 + k] += sign * moment[k]
    joint = body
    while joint >= 0:
        q = scene.bodies.dof[joint]
        if scene.bodies.joint[joint] != JOINT_FIXED and q >= 0 and ws.work.column[q] >= 0:
            row[ws.work.column[q]] += sign * joint_jacobian(scene, poses, joint, point, n)
        joint = scene.bodies.parent[joint]


@kernel
def _add_row(
    scene: Scene, ws: DrivenWorkspace, poses: Floats, a: int, b: int, found: Separation, m: int, unknowns: int
) -> None:
    """Row m: change of the separation of the pieces a and b along the normal in `found`."""
    _, n, pa, pb = found
    row = ws.problem.least.rows[m]
    for j in range(unknowns):
        row[j] = 0.0
    _add_point_jacobian(scene, ws, poses, scene.pieces.body[a], pa, n, 1.0, row)
    _add_point_jacobian(scene, ws, poses, scene.pieces.body[b], pb, n, -1.0, row)


@kernel
def least_change(gap: float, s: float) -> float:
    """Least change of the separation `s` of a pair: none is required where it is free."""
    return min(gap - s, 0.0) if s >= 0.0 else gap - s


@kernel
def is_unlocked(ws: DrivenWorkspace, tree: int) -> bool:
    """Whether a tree may move."""
    return bool(ws.work.mobility[tree] != LOCKED)


@kernel
def is_unlocked_pair(ws: DrivenWorkspace, k: int) -> bool:
    """Whether one of the trees of near pair k may move."""
    return is_unlocked(ws, ws.near.tree_a[k]) or is_unlocked(ws, ws.near.tree_b[k])


@kernel
def clear_spots(ws: DrivenWorkspace) -> None:
    """Clear the cached contact spots."""
    for i in range(len(ws.work.spots)):
        if ws.work.spots[i].a < 0:  # they are filled from the first on
            break
        ws.work.spots[i].a = -1
    ws.work.counts.next_spot = 0


@kernel
def _inside(poses: Floats, body: int, point: Vec) -> Vec:
    """A point of the world in a body's frame."""
    return quat_rotate(quat_conjugate(orientation_of(poses, body)), sub(point, position_of(poses, body)))


@noinline
def _cache_spot(scene: Scene, ws: DrivenWorkspace, poses: Floats, k: int) -> None:
    """Cache the nearest points of near pair k, in place of a spot that is the same."""
    near, work = ws.near, ws.work
    a, b = near.a[k], near.b[k]
    la = _inside(poses, scene.pieces.body[a], vec_at(near.point_a, k))
    lb = _inside(poses, scene.pieces.body[b], vec_at(near.point_b, k))
    slot = -1
    for i in range(len(work.spots)):
        spot = work.spots[i]
        if spot.a < 0:
            break
        if spot.a == a and spot.b == b:
            far = norm(sub(vec_of(spot.point_a), la)) + norm(sub(vec_of(spot.point_b), lb))
            if far < SAME_SPOT:
                slot = i
                break
    if slot < 0:
        slot = work.counts.next_spot
        work.counts.next_spot = (slot + 1) % len(work.spots)
    spot = work.spots[slot]
    spot.a, spot.b = a, b
    set_vec(spot.normal, vec_at(near.normal, k))
    set_vec(spot.point_a, la)
    set_vec(spot.point_b, lb)


@noinline
def _add_spots(scene: Scene, ws: DrivenWorkspace, poses: Floats, k: int, gap: float, m: int, unknowns: int) -> int:
    """Rows for spots where near pair k touched before: the nearest points of two faces jump from corner to corner."""
    near, work = ws.near, ws.work
    a, b = near.a[k], near.b[k]
    for i in range(len(work.spots)):
        spot = work.spots[i]
        if spot.a < 0:
            break
        if spot.a != a or spot.b != b:
            continue
        n = vec_of(spot.normal)
        pa = point_of(poses, scene.pieces.body[a], vec_of(spot.point_a))
        pb = point_of(poses, scene.pieces.body[b], vec_of(spot.point_b))
        s = dot(n, sub(pa, pb))
        if s < near.separation[k] - 1e-7 or s > 0.01:  # else the surface is curved, and the normal has changed
            continue
        if norm(sub(pa, vec_at(near.point_a, k))) + norm(sub(pb, vec_at(near.point_b, k))) < SAME_SPOT:
            continue
        if not has_row(ws.problem, m):
            break
        _add_row(scene, ws, poses, a, b, (s, n, pa, pb), m, unknowns)
        ws.problem.least.rhs[m] = least_change(gap, s)
        m += 1
    return m


@noinline
def add_term(ws: DrivenWorkspace, row: Floats, unknowns: int, weight: float, r: float) -> None:
    """Add ½ weight (row x + r)² to the objective."""
    h, g = ws.problem.hessian, ws.problem.gradient
    for i in range(unknowns):
        if row[i] != 0.0:
            g[i] += weight * r * row[i]
            for j in range(i + 1):
                h[i, j] += weight * row[i] * row[j]


@kernel
def request_pairs_in_contact(ws: DrivenWorkspace) -> None:
    """Only pairs that touch get a row at first; others once an iterate overlaps them."""
    near = ws.near
    for k in range(near.counts.filled):
        ws.row_state[k] = (
            REQUESTED
            if near.exact[k] == 1 and near.separation[k] < CONTACT_DISTANCE and is_unlocked_pair(ws, k)
            else NO_ROW
        )


@noinline
def add_pairs(
    scene: Scene, ws: DrivenWorkspace, iterate: Posture, gap: float, m: int, unknowns: int, soft: bool
) -> int:
    """Rows, from row m on, of the near pairs with a requested row, as measured at `iterate`; returns the number of rows.

    `soft`: pairs that overlap get a term of high weight in the objective instead.
    """
    near = ws.near
    for k in range(near.counts.filled):
        if ws.row_state[k] != REQUESTED or not has_row(ws.problem, m):
            continue
        s, n = near.separation[k], vec_at(near.normal, k)
        pa, pb = vec_at(near.point_a, k), vec_at(near.point_b, k)
        ws.row_state[k] = HAS_ROW
        _add_row(scene, ws, iterate.poses, near.a[k], near.b[k], (s, n, pa, pb), m, unknowns)
        if soft and s < 0.0:
            add_term(ws, ws.problem.least.rows[m], unknowns, OVERLAP_WEIGHT, s - gap)
            continue
        ws.problem.least.rhs[m] = least_change(gap, s)
        m += 1
        if s < CACHED_DISTANCE:
            m = _add_spots(scene, ws, iterate.poses, k, gap, m, unknowns)
            _cache_spot(scene, ws, iterate.poses, k)
    return m


@noinline
def set_cone_limits(scene: Scene, ws: DrivenWorkspace, recorded: Floats) -> None:
    """Set how far out of their reach cones limbs of the trees being solved may point: as at recorded angles (Q,)."""
    for cone in range(len(scene.cones.limb)):
        tree = scene.bodies.tree[scene.cones.joints[scene.cones.joint_start[cone]]]
        if ws.work.mobility[tree] == GENERAL_MOTION:
            ws.work.cone_angle[cone] = cone_angle(scene, cone, recorded)
            for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
                ws.work.cone_reference[q] = recorded[q]


@kernel
def _least_cone_angle(scene: Scene, ws: DrivenWorkspace, angles: Floats, cone: int) -> float:
    """A lower bound of a limb's angle [rad] in its cone after the step: no joint changes it by more than it rotates.

    `angles` (Q,) rad: those before the step.
    """
    least, cones, work = ws.work.cone_angle[cone], scene.cones, ws.work
    for index in range(cones.joint_start[cone], cones.joint_start[cone + 1]):
        body = cones.joints[index]
        q = scene.bodies.dof[body]
        i, change = work.column[q], abs(angles[q] - work.cone_reference[q])
        if i >= 0:
            change += max(ws.problem.high[i], -ws.problem.low[i])
        least -= abs(scene.bodies.multiplier[body]) * change
    return least


@noinline
def add_cones(scene: Scene, ws: DrivenWorkspace, iterate: Posture, m: int, unknowns: int) -> int:
    """Rows that keep limbs of compound joints in their reach cones, see `set_cone_limits`; returns the number of rows.

    Limbs that cannot leave theirs within the bounds of the unknowns get none.
    """
    for cone in range(len(scene.cones.limb)):
        tree = scene.bodies.tree[scene.cones.joints[scene.cones.joint_start[cone]]]
        if ws.work.mobility[tree] != GENERAL_MOTION or _least_cone_angle(scene, ws, iterate.angles, cone) > CONE_MARGIN:
            continue
        if not has_row(ws.problem, m):
            continue
        row = ws.problem.least.rows[m]
        for j in range(unknowns):
            row[j] = 0.0
        g = cone_row(scene, ws.work.unit, cone, iterate.angles, ws.work.column, row)
        lacks = min(ws.work.cone_angle[cone], 0.0) + CONE_MARGIN - g
        ws.problem.least.rhs[m] = lacks if lacks > 2.0 * CONE_MARGIN else min(lacks, 0.0)
        m += 1
    return m


@noinline
def bound_unknowns(scene: Scene, ws: DrivenWorkspace, iterate: Posture, trust_radius: float, firm: bool) -> None:
    """Bounds of the unknowns: the trust region and limits of joints; `firm`: joints beyond their limits have to return."""
    low, high, work = ws.problem.low, ws.problem.high, ws.work
    for tree in range(len(work.mobility)):
        if work.mobility[tree] == LOCKED:
            continue
        first = work.first[tree]
        for k in range(3):
            low[first + k], high[first + k] = -trust_radius, trust_radius
        if work.mobility[tree] != GENERAL_MOTION:
            continue
        for k in range(3, 6):
            low[first + k], high[first + k] = -trust_radius / ROOT_ARM, trust_radius / ROOT_ARM
        for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
            i = work.column[q]
            if i >= 0:
                lever = ws.links.lever[q]
                most, back, forth = (
                    trust_radius / lever,
                    work.low[q] - iterate.angles[q],
                    work.high[q] - iterate.angles[q],
                )
                low[i] = max(-most, min(back, most if firm else 0.0))
                high[i] = min(most, max(forth, -most if firm else 0.0))
