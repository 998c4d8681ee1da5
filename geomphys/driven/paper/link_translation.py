"""Translates a link that lies along a surface out of it, instead of tilting it into an unnatural pose.

The parent joint moves the link's base out and the link's own joint rotates back by the same angle, so that the link's
orientation stays. With the parent's axis b (unit) through its origin and r from there to the link's base, a rotation by φ
moves the base along the surface's normal n by

    A cos φ + B sin φ - A,     A = n·(r - (b·r) b),     B = n·(b × r),

which is set to the distance to go and solved for φ.
"""

from __future__ import annotations

import math

from geomphys.driven.paper.descent import is_usable, pose_chain, set_angle
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.postures import world_axis
from geomphys.driven.reach_cones import cone_angle
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import Vec, add_scaled, cross, dot, norm, quat_rotate, sub
from geomphys.scene.arrays import JOINT_FIXED, JOINT_REVOLUTE, Scene
from geomphys.scene.kinematics import orientation_of, position_of

SLANT = 0.2  # sine of the angle between a link and a surface below which the link lies along it
COVERED = 0.25  # of the link's length that its contacts extend over at least
SAME_CENTRE = 1e-3  # m: joints nearer to each other are one compound joint
PARALLEL = 0.999  # cosine of the angle of two axes from which one joint undoes what the other rotates
ACHIEVED = 1e-9  # rad: a rotation that limits shorten by more is rejected


@kernel
def lies_along(w: PaperWorkspace, link: int, n: Vec, extent: float) -> bool:
    """Whether a link lies along a surface of unit normal n; `extent` [m] of its length is in contact."""
    along = vec_at(w.limbs.along, link)
    length = norm(along)
    if length == 0.0 or extent < COVERED * length:
        return False
    return abs(dot(n, quat_rotate(orientation_of(w.iterate.poses, link), along))) < SLANT * length


@kernel
def _own_joint(scene: Scene, link: int) -> int:
    """The joint of a link: that above it, or above what it is fixed to."""
    while scene.bodies.parent[link] >= 0 and scene.bodies.joint[link] == JOINT_FIXED:
        link = scene.bodies.parent[link]
    return link


@kernel
def _is_single(scene: Scene, w: PaperWorkspace, joint: int) -> bool:
    """Whether a joint is revolute and the only one of its degree of freedom."""
    return scene.bodies.joint[joint] == JOINT_REVOLUTE and w.limbs.joints[scene.bodies.dof[joint]] == 1


@kernel
def _parent_joint(scene: Scene, w: PaperWorkspace, own: int, link: int, anchor: int) -> int:
    """The joint before joint `own` with an axis parallel to its; of a compound joint the one that is; -1: none."""
    centre, found = position_of(w.iterate.poses, own), False
    axis = world_axis(scene, w.iterate.poses, own)
    joint = scene.bodies.parent[own]
    while joint >= 0:
        if is_usable(scene, w, joint, link, anchor):
            at = position_of(w.iterate.poses, joint)
            if norm(sub(at, centre)) > SAME_CENTRE:
                if found:
                    return -1
                found, centre = True, at
            parallel = abs(dot(axis, world_axis(scene, w.iterate.poses, joint))) > PARALLEL
            if found and parallel and _is_single(scene, w, joint):
                return joint
        joint = scene.bodies.parent[joint]
    return -1


@kernel
def _wrapped(angle: float) -> float:
    """An angle [rad] within half a revolution of zero."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def rotation_for(a: float, b: float, distance: float) -> tuple[bool, float]:
    """The smaller φ [rad] with A cos φ + B sin φ = A + `distance`; whether there is one."""
    amplitude = math.hypot(a, b)
    if amplitude == 0.0 or abs(a + distance) > amplitude:
        return False, 0.0
    middle, half = math.atan2(b, a), math.acos((a + distance) / amplitude)
    one, other = _wrapped(middle - half), _wrapped(middle + half)
    return True, one if abs(one) < abs(other) else other


@kernel
def _is_in_cone(scene: Scene, w: PaperWorkspace, q: int) -> bool:
    """Whether the limb that joint q moves, if it has a reach cone, is in it."""
    cone = w.limbs.cone[q]
    return cone < 0 or cone_angle(scene, cone, w.iterate.angles) >= w.cone_limit[cone]


@noinline
def translate_link(scene: Scene, w: PaperWorkspace, link: int, anchor: int, n: Vec, distance: float) -> bool:
    """Move a link's base by `distance` [m] along n (unit, world) and keep the link's orientation.

    Parameters are those of `descend`. Returns whether its parent joint and its own, of parallel axes, can do so within
    limits and reach cones; else nothing changes.
    """
    own = _own_joint(scene, link)
    if not is_usable(scene, w, own, link, anchor) or not _is_single(scene, w, own):
        return False
    parent = _parent_joint(scene, w, own, link, anchor)
    if parent < 0:
        return False
    axis = world_axis(scene, w.iterate.poses, parent)
    r = sub(position_of(w.iterate.poses, own), position_of(w.iterate.poses, parent))
    exists, angle = rotation_for(dot(n, add_scaled(r, axis, -dot(axis, r))), dot(n, cross(axis, r)), distance)
    if not exists:
        return False
    same = 1.0 if dot(axis, world_axis(scene, w.iterate.poses, own)) > 0.0 else -1.0
    p, q = scene.bodies.dof[parent], scene.bodies.dof[own]
    before_p, before_q = w.iterate.angles[p], w.iterate.angles[q]
    step_p, step_q = angle / scene.bodies.multiplier[parent], -same * angle / scene.bodies.multiplier[own]
    short = abs(set_angle(w, p, before_p + step_p) - step_p) + abs(set_angle(w, q, before_q + step_q) - step_q)
    fits = short <= ACHIEVED and _is_in_cone(scene, w, p) and _is_in_cone(scene, w, q)
    if not fits:
        w.iterate.angles[p], w.iterate.angles[q] = before_p, before_q
    pose_chain(scene, w, link)
    return fits
