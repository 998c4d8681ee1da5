"""Evaluates reach cones: signed angle of the limb of a compound joint in its cone, and its gradient by joint.

A cone is a polygon of great-circle arcs on the unit sphere, its inside on the left of its sides (corners
counter-clockwise seen from outside); it need not be convex, nor smaller than a half sphere. The *signed angle* g of a
direction is its angular distance from the polygon's sides, positive inside. The side on which a direction lies is decided
at the nearest point of the polygon alone, as the arc to it crosses no other side: no winding number, and no special case
for the opposite direction.

A recorded limb may point out of its cone. Free motion leaves it so, but no solver rotates it further out: the limit of g
is min(0, g recorded).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import Vec, add, add_scaled, cross, dot, norm, perpendicular, rotate, scale, sub, unit
from geomphys.scene.arrays import JOINT_FIXED, Scene
from geomphys.scene.kinematics import frame_rotation, joint_value

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOUCHING = 1e-8  # of a direction to the polygon, below which the side's own normal is the inward direction


@kernel
def _side_of(directions: Floats, first: int, last: int, k: int) -> Vec:
    """Unit normal of the plane of the side from corner k to the next, towards the inside."""
    return unit(cross(vec_at(directions, k), vec_at(directions, k + 1 if k + 1 < last else first)))


@kernel
def _nearest(directions: Floats, first: int, last: int, d: Vec) -> tuple[Vec, Vec]:
    """Point of the polygon nearest to d, and a normal n there: d is inside if n·d >= 0.

    Where the nearest point is a corner, that is the sum of the normals of its two sides.
    """
    shortest, corner, point, normal = math.inf, first, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(first, last):
        a = vec_at(directions, k)
        away = norm(sub(d, a))
        if away < shortest:
            shortest, corner, point = away, k, a
        b = vec_at(directions, k + 1 if k + 1 < last else first)
        n = unit(cross(a, b))
        if dot(cross(n, a), d) > 0.0 and dot(cross(b, n), d) > 0.0:
            foot = unit(add_scaled(d, n, -dot(n, d)))
            away = norm(sub(d, foot))
            if away < shortest:
                shortest, corner, point, normal = away, -1, foot, n
    if corner >= 0:
        before = corner - 1 if corner > first else last - 1
        normal = add(_side_of(directions, first, last, before), _side_of(directions, first, last, corner))
    return point, normal


@noinline
def signed_angle(directions: Floats, first: int, last: int, d: Vec) -> tuple[float, Vec, Vec]:
    """Signed angular distance of a direction from the boundary of a cone.

    Parameters
    ----------
    directions, first, last
        The polygon's corners are rows `first` to `last` (not included) of `directions` (D, 3), unit.
    d
        Unit, in the same frame.

    Returns
    -------
    tuple
        (angle [rad], positive inside; nearest boundary direction, unit; unit tangent at d along which the angle grows
        fastest).
    """
    nearest, normal = _nearest(directions, first, last, d)
    angle = math.atan2(norm(cross(d, nearest)), dot(d, nearest))
    inside = dot(normal, d) >= 0.0
    path = sub(nearest, d)
    if norm(path) < TOUCHING:
        inward = unit(add_scaled(normal, d, -dot(normal, d)))
    else:
        inward = unit(add_scaled(path, d, -dot(path, d)))
        if inward == (0.0, 0.0, 0.0):
            inward = perpendicular(d)
        if inside:
            inward = scale(inward, -1.0)
    return angle if inside else -angle, nearest, inward


@kernel
def _rotated(axis: Vec, angle: float, v: Vec) -> Vec:
    """V rotated by `angle` about a unit axis (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    return add_scaled(add_scaled(scale(v, c), cross(axis, v), s), axis, dot(axis, v) * (1.0 - c))


@kernel
def _in_first(scene: Scene, v: Vec, body: int, first: int, angles: Floats) -> Vec:
    """A vector of link `body` in the frame that the joint above link `first` sits in."""
    while True:
        if scene.bodies.joint[body] != JOINT_FIXED:
            axis = vec_at(scene.bodies.axis, body)
            v = _rotated(axis, joint_value(scene, body, angles), v)
        if body == first:
            return v
        v = rotate(frame_rotation(scene.bodies.origin, body), v)
        body = scene.bodies.parent[body]


@noinline
def limb_direction(scene: Scene, cone: int, angles: Floats) -> Vec:
    """Unit direction of the limb at `angles` (Q,), in the frame of the cone's first joint, before its rotation."""
    cones = scene.cones
    limb = vec_at(cones.limb, cone)
    joints, first, last = cones.joints, cones.joint_start[cone], cones.joint_start[cone + 1]
    return unit(_in_first(scene, limb, joints[last - 1], joints[first], angles))


@kernel
def cone_angle(scene: Scene, cone: int, angles: Floats) -> float:
    """Signed angle g [rad] of the limb in its cone, positive inside."""
    start = scene.cones.direction_start
    return signed_angle(scene.cones.directions, start[cone], start[cone + 1], limb_direction(scene, cone, angles))[0]


@kernel
def cone_limit(scene: Scene, cone: int, recorded: Floats) -> float:
    """The least g [rad] a solver may leave the limb at: 0, or what was recorded beyond."""
    return min(cone_angle(scene, cone, recorded), 0.0)


@kernel
def cone_jacobian(scene: Scene, cone: int, angles: Floats, index: int, d: Vec, inward: Vec) -> float:
    """∂g/∂q of the joint in row `index` of `cones.joints`: inward · (axis × d)."""
    body = scene.cones.joints[index]
    axis = vec_at(scene.bodies.axis, body)
    axis = _in_first(scene, axis, body, scene.cones.joints[scene.cones.joint_start[cone]], angles)
    return float(scene.bodies.multiplier[body] * dot(inward, cross(axis, d)))


@kernel
def cone_row(scene: Scene, lever: Floats, cone: int, angles: Floats, column: Ints, row: Floats) -> float:
    """Add ∂g/∂q of those joints of a cone that are unknowns to `row`, scaled as `add_effects` does.

    `column` (Q,) numbers the unknowns, -1: none. Returns g [rad]; the limb stays in its cone to first order if
    row · Δx >= cone_limit - g.
    """
    start = scene.cones.direction_start
    d = limb_direction(scene, cone, angles)
    g, _, inward = signed_angle(scene.cones.directions, start[cone], start[cone + 1], d)
    for index in range(scene.cones.joint_start[cone], scene.cones.joint_start[cone + 1]):
        q = scene.bodies.dof[scene.cones.joints[index]]
        if column[q] >= 0:
            row[column[q]] += cone_jacobian(scene, cone, angles, index, d, inward) / lever[q]
    return g
