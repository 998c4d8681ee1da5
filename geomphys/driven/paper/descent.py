"""Cyclic coordinate descent: moves a point of a link to a goal by the joints of its chain, one after the other.

From the link's own joint inwards to the chain's root, the point ee and the goal are projected on the plane of the
joint's axis a (unit) through its origin o,

    p' = p - (a·(p - o)) a,                                                               (4)

and the joint rotates by the angle between them as seen from o,

    Δθ = acos( unit(ee' - o) · unit(goal' - o) ),                                         (5)

signed by the axis and clamped to the joint's limits. A limb that leaves its reach cone is projected back into it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.postures import point_of, world_axis
from geomphys.driven.reach_cones import cone_angle, cone_jacobian, limb_direction, signed_angle
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.vec3 import Vec, add_scaled, cross, dot, norm, sub
from geomphys.scene.arrays import JOINT_FIXED, JOINT_PRISMATIC, Scene
from geomphys.scene.kinematics import pose_body, position_of

Floats = NDArray[np.float64]

SWEEPS = 12  # sweeps over the joints of a chain
STILL = 1e-9  # rad or m: a sweep in which no joint moves farther ends the descent
ON_AXIS = 1e-9  # m: a point nearer than this to a joint's axis is not moved by it
LONGEST = 0.5  # rad or m: of a step of a degree of freedom with several joints
CONE_STEPS = 24  # steps of the projection into a reach cone
CONE_MARGIN = 1e-9  # rad: how far inside the cone a projected limb ends


@kernel
def joint_rotation(axis: Vec, origin: Vec, ee: Vec, goal: Vec) -> float:
    """Δθ [rad] of (5) after (4), positive about the axis; 0 where either point lies on the axis."""
    e, g = sub(ee, origin), sub(goal, origin)
    e, g = add_scaled(e, axis, -dot(axis, e)), add_scaled(g, axis, -dot(axis, g))
    if norm(e) < ON_AXIS or norm(g) < ON_AXIS:
        return 0.0
    return math.atan2(dot(axis, cross(e, g)), dot(e, g))


@kernel
def set_angle(w: PaperWorkspace, q: int, value: float) -> float:
    """Set a degree of freedom of the iterate, clamped to its limits; returns by how much it changed."""
    before = w.iterate.angles[q]
    w.iterate.angles[q] = min(max(value, w.lower[q]), w.upper[q])
    return float(w.iterate.angles[q] - before)


@kernel
def moves(scene: Scene, q: int, body: int) -> bool:
    """Whether degree of freedom q has a joint at or above `body`."""
    while body >= 0:
        if scene.bodies.dof[body] == q and scene.bodies.joint[body] != JOINT_FIXED:
            return True
        body = scene.bodies.parent[body]
    return False


@kernel
def is_usable(scene: Scene, w: PaperWorkspace, joint: int, link: int, anchor: int) -> bool:
    """Whether the joint above body `joint` is one of the link's chain that leaves body `anchor` (-1: none) where it is."""
    q = scene.bodies.dof[joint]
    if q < 0 or scene.bodies.joint[joint] == JOINT_FIXED or scene.dofs.chain[q] != w.limbs.chain[link]:
        return False
    return not moves(scene, q, anchor)


@noinline
def pose_chain(scene: Scene, w: PaperWorkspace, link: int) -> None:
    """Forward kinematics of the iterate from the root of the link's chain to the link."""
    first = scene.chains.bodies[scene.chains.body_start[w.limbs.chain[link]]]
    for body in range(first, link + 1):
        pose_body(scene, w.origins, body, w.iterate.angles, w.iterate.poses)


@noinline
def fit_cone(scene: Scene, w: PaperWorkspace, cone: int) -> bool:
    """Project the limb of a compound joint into its reach cone by the least change of its joints; whether it is inside."""
    start, cones = scene.cones.direction_start, scene.cones
    for _ in range(CONE_STEPS):
        d = limb_direction(scene, cone, w.iterate.angles)
        g, _, inward = signed_angle(cones.directions, start[cone], start[cone + 1], d)
        if g >= w.cone_limit[cone]:
            return True
        square = 0.0
        for row in range(cones.joint_start[cone], cones.joint_start[cone + 1]):
            square += cone_jacobian(scene, cone, w.iterate.angles, row, d, inward) ** 2
        if square < 1e-12:
            return False
        step = (w.cone_limit[cone] + CONE_MARGIN - g) / square
        for row in range(cones.joint_start[cone], cones.joint_start[cone + 1]):
            q = scene.bodies.dof[cones.joints[row]]
            effect = cone_jacobian(scene, cone, w.iterate.angles, row, d, inward)
            w.step[q] = step * effect
        for row in range(cones.joint_start[cone], cones.joint_start[cone + 1]):
            q = scene.bodies.dof[cones.joints[row]]
            set_angle(w, q, w.iterate.angles[q] + w.step[q])
    return bool(cone_angle(scene, cone, w.iterate.angles) >= w.cone_limit[cone])


@kernel
def _is_first(scene: Scene, link: int, joint: int) -> bool:
    """Whether no joint between `link` and `joint` belongs to the same degree of freedom."""
    body = link
    while body != joint:
        if scene.bodies.dof[body] == scene.bodies.dof[joint] and scene.bodies.joint[body] != JOINT_FIXED:
            return False
        body = scene.bodies.parent[body]
    return True


@kernel
def _shared_step(scene: Scene, w: PaperWorkspace, link: int, q: int, ee: Vec, goal: Vec) -> float:
    """Least-squares step towards the goal of a degree of freedom that several joints share (mimic joints)."""
    effect, body = (0.0, 0.0, 0.0), link
    while body >= 0:
        if scene.bodies.dof[body] == q and scene.bodies.joint[body] != JOINT_FIXED:
            axis = world_axis(scene, w.iterate.poses, body)
            if scene.bodies.joint[body] != JOINT_PRISMATIC:
                axis = cross(axis, sub(ee, position_of(w.iterate.poses, body)))
            effect = add_scaled(effect, axis, scene.bodies.multiplier[body])
        body = scene.bodies.parent[body]
    square = dot(effect, effect)
    if square < ON_AXIS * ON_AXIS:
        return 0.0
    return min(max(dot(effect, sub(goal, ee)) / square, -LONGEST), LONGEST)


@noinline
def _move_in_cone(scene: Scene, w: PaperWorkspace, cone: int, q: int, step: float) -> float:
    """Move a joint of a compound one and project the limb into its reach cone; undone if that fails.

    Returns the change of the joint.
    """
    first, last = scene.cones.joint_start[cone], scene.cones.joint_start[cone + 1]
    for row in range(first, last):
        k = scene.bodies.dof[scene.cones.joints[row]]
        w.saved[k] = w.iterate.angles[k]
    set_angle(w, q, w.iterate.angles[q] + step)
    if fit_cone(scene, w, cone):
        return float(w.iterate.angles[q] - w.saved[q])
    for row in range(first, last):
        k = scene.bodies.dof[scene.cones.joints[row]]
        w.iterate.angles[k] = w.saved[k]
    return 0.0


@kernel
def _move_joint(scene: Scene, w: PaperWorkspace, joint: int, link: int, local: Vec, goal: Vec) -> float:
    """Move one joint so that a point of the link is nearest to the goal; returns the change."""
    q, ratio = scene.bodies.dof[joint], scene.bodies.multiplier[joint]
    ee = point_of(w.iterate.poses, link, local)
    if w.limbs.joints[q] > 1:
        if not _is_first(scene, link, joint):
            return 0.0
        step = _shared_step(scene, w, link, q, ee, goal)
    elif scene.bodies.joint[joint] == JOINT_PRISMATIC:
        step = dot(world_axis(scene, w.iterate.poses, joint), sub(goal, ee)) / ratio
    else:
        axis, origin = world_axis(scene, w.iterate.poses, joint), position_of(w.iterate.poses, joint)
        step = joint_rotation(axis, origin, ee, goal) / ratio
    if step == 0.0:
        return 0.0
    cone = w.limbs.cone[q]
    change = set_angle(w, q, w.iterate.angles[q] + step) if cone < 0 else _move_in_cone(scene, w, cone, q, step)
    if change != 0.0:
        pose_chain(scene, w, link)
    return change


@noinline
def descend(scene: Scene, w: PaperWorkspace, link: int, anchor: int, local: Vec, goal: Vec, tolerance: float) -> float:
    """Move a point of a link to a goal by the joints of its chain.

    Parameters
    ----------
    scene, w
        The scene and the workspace, whose `iterate` is brought up to date from the chain's root to the link. No joint
        leaves its limits, nor a limb its reach cone; values recorded beyond do not grow.
    link
        Body whose joint is the first of a sweep.
    anchor
        Body of the same tree whose joints are not used, -1: none.
    local, goal
        m; the point ee in the link's frame, and where it is to go in the world.
    tolerance
        m; a point nearer than this is at the goal.

    Returns
    -------
    float
        Distance [m] of the point from the goal.
    """
    missed = norm(sub(goal, point_of(w.iterate.poses, link, local)))
    for _ in range(SWEEPS):
        if missed <= tolerance:
            break
        farthest, joint = 0.0, link
        while joint >= 0:
            if is_usable(scene, w, joint, link, anchor):
                farthest = max(farthest, abs(_move_joint(scene, w, joint, link, local, goal)))
            joint = scene.bodies.parent[joint]
        missed = norm(sub(goal, point_of(w.iterate.poses, link, local)))
        if farthest < STILL:
            break
    return missed
