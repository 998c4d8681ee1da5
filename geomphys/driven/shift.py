"""A link that lies along a surface is moved out by pure translation, not by tilting it into an unnatural pose.

The parent joint moves the link's base out, and the link's own joint turns back by as much as the link was turned with it,
so that its orientation stays. With two planar joints of parallel axes that is one turn and its opposite; compound joints
(several axes with a common centre) count as one joint. The turns are found by Newton's method on

    rotation of the link = 0,   n · (displacement of its base) = shift

of which each step is the shortest: Δq = Jᵀ (J Jᵀ)⁻¹ r, slightly damped for what the joints cannot move at all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.ccd import CcdRoom, helps, pose_way, set_bend
from geomphys.driven.posture import Joints, world_axis
from geomphys.driven.reach_cones import cone_angle, cone_bound
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import (
    Quat,
    Vec,
    cross,
    dot,
    norm,
    quat_conjugate,
    quat_mul,
    quat_rotate,
    rotation_vector,
    scale,
    sub,
)
from geomphys.scene.arrays import JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import orientation_of, position_of

Floats = NDArray[np.float64]

SLANT = 0.2  # sine of the angle between a link and a surface beneath which it lies along it
SPREAD = 0.25  # of the link's length that its contacts must cover at least
SAME_CENTRE = 1e-3  # m: joints nearer than this are one compound joint
STEPS = 10  # of Newton's method
TURNED = 5e-4  # rad: the link may turn by this much
MISSED = 0.02  # of the shift that may be missed
DAMPING = 1e-9


@kernel
def lies_along(ccd: CcdRoom, poses: Floats, link: int, n: Vec, spread: float) -> bool:
    """Whether `link` lies along a surface of normal n (unit): its contacts reach over `spread` [m] of its length."""
    along = (ccd.along[link, 0], ccd.along[link, 1], ccd.along[link, 2])
    length = norm(along)
    if length == 0.0 or spread < SPREAD * length:
        return False
    return abs(dot(n, quat_rotate(orientation_of(poses, link), along))) < SLANT * length


@kernel
def _parent_joint(scene: Scene, joints: Joints, ccd: CcdRoom, link: int, still: int, poses: Floats) -> tuple[int, int]:
    """The link's own joint and the innermost body of its parent joint, that may be a compound one; (-1, -1): none."""
    own, parent, body = -1, -1, link
    while body >= 0:
        if helps(scene, joints, ccd, body, link, still, True):
            if ccd.shared[scene.bodies.dof[body]] > 1:
                break
            here = position_of(poses, body)
            if own < 0:
                own = body
            elif parent < 0:
                if norm(sub(here, position_of(poses, own))) > SAME_CENTRE:
                    parent = body
            elif norm(sub(here, position_of(poses, parent))) <= SAME_CENTRE:
                parent = body
            else:
                break
        body = scene.bodies.parent[body]
    return (own, parent) if parent >= 0 else (-1, -1)


@kernel
def _effect(scene: Scene, poses: Floats, joint: int, base: Vec, n: Vec, length: float) -> Quat:
    """Column of J: how the joint turns the link (three components, times its length) and moves its base along n."""
    axis = scale(world_axis(scene, poses, joint), scene.bodies.multiplier[joint])
    if scene.bodies.joint[joint] == JOINT_PRISMATIC:
        return (0.0, 0.0, 0.0, dot(n, axis))
    push = dot(n, cross(axis, sub(base, position_of(poses, joint))))
    return (axis[0] * length, axis[1] * length, axis[2] * length, push)


@kernel
def _solve(m: Floats) -> Quat:
    """Solution of the four symmetric, positive definite equations in the rows of m (4, 5), by elimination."""
    for i in range(4):
        for j in range(i + 1, 4):
            factor = m[j, i] / m[i, i]
            for k in range(i, 5):
                m[j, k] -= factor * m[i, k]
    w = m[3, 4] / m[3, 3]
    z = (m[2, 4] - m[2, 3] * w) / m[2, 2]
    y = (m[1, 4] - m[1, 2] * z - m[1, 3] * w) / m[1, 1]
    x = (m[0, 4] - m[0, 1] * y - m[0, 2] * z - m[0, 3] * w) / m[0, 0]
    return (x, y, z, w)


@kernel
def _add_square(m: Floats, c: Quat) -> None:
    """Add c cᵀ to the square part of m."""
    for i in range(4):
        for j in range(4):
            m[i, j] += c[i] * c[j]


@kernel
def _newton(
    scene: Scene, joints: Joints, ccd: CcdRoom, link: int, still: int, own: int, last: int, recorded: Floats, bend: Floats,
    angles: Floats, poses: Floats, n: Vec, length: float, turn: Vec, short: float,
) -> None:  # fmt: skip
    """One step of all joints from the link to body `last`; `turn` and `short` is what is left to do."""
    base, m = position_of(poses, own), ccd.system
    for i in range(4):
        for j in range(5):
            m[i, j] = 0.0
    for i in range(3):
        m[i, 4] = turn[i] * length
    m[3, 4] = short
    for solving in range(2):
        y = (0.0, 0.0, 0.0, 0.0)
        if solving == 1:
            damping = DAMPING * (m[0, 0] + m[1, 1] + m[2, 2] + m[3, 3])
            for i in range(4):
                m[i, i] += damping
            y = _solve(m)
        body, done = link, False
        while not done:
            if helps(scene, joints, ccd, body, link, still, True):
                c = _effect(scene, poses, body, base, n, length)
                if solving == 0:
                    _add_square(m, c)
                else:
                    q = scene.bodies.dof[body]
                    step = c[0] * y[0] + c[1] * y[1] + c[2] * y[2] + c[3] * y[3]
                    set_bend(scene, recorded, bend, angles, q, bend[q] + step)
            done = body == last
            body = scene.bodies.parent[body]


@outlined
def shift_link(
    scene: Scene, origins: Floats, joints: Joints, ccd: CcdRoom, link: int, still: int, recorded: Floats, bend: Floats,
    angles: Floats, poses: Floats, n: Vec, shift: float,
) -> bool:  # fmt: skip
    """Move `link` by `shift` [m] along n without turning it, by its parent joint and its own.

    Parameters
    ----------
    scene, origins, joints, ccd, link, still, recorded, bend, angles, poses
        As for `descend`.
    n, shift
        Unit normal, in the world of `poses`, and how far the link's base is to move along it [m]; it moves aside as the
        parent joint makes it.

    Returns
    -------
    bool
        Whether the joints can do it within limits and cones, the link turned by less than `TURNED`; else nothing changes.
    """
    own, last = _parent_joint(scene, joints, ccd, link, still, poses)
    if own < 0:
        return False
    length = norm((ccd.along[link, 0], ccd.along[link, 1], ccd.along[link, 2]))
    for q in range(len(bend)):
        ccd.saved[q] = bend[q]
    base, orientation = position_of(poses, own), orientation_of(poses, link)
    turned, missed = 0.0, shift
    for _ in range(STEPS):
        turn = rotation_vector(quat_mul(orientation, quat_conjugate(orientation_of(poses, link))))
        short = shift - dot(n, sub(position_of(poses, own), base))
        turned, missed = norm(turn), abs(short)
        if turned < 1e-9 and missed < 1e-4 * shift:
            break
        _newton(
            scene, joints, ccd, link, still, own, last, recorded, bend, angles, poses, n, length, turn, short
        )  # fmt: skip
        pose_way(scene, origins, link, angles, poses)
    fine = turned < TURNED and missed < MISSED * shift
    body = link
    while fine and body >= 0:
        q = scene.bodies.dof[body]
        if q >= 0 and ccd.cone[q] >= 0 and bend[q] != ccd.saved[q]:
            fine = cone_angle(scene, ccd.cone[q], angles) >= cone_bound(scene, ccd.cone[q], recorded)
        body = scene.bodies.parent[body]
    if not fine:
        for q in range(len(bend)):
            if joints.yields[q] == 1:
                set_bend(scene, recorded, bend, angles, q, ccd.saved[q])
        pose_way(scene, origins, link, angles, poses)
    return fine
