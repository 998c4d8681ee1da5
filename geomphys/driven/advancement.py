"""Certifies that two pieces move from one pair of poses to another without passing through each other.

Both bodies move on straight lines with constant angular velocity. The path is certified by conservative advancement: pieces
that are a distance apart cannot touch before their relative motion has reached that distance; and where a direction, attached
to the piece that rotates most, separates them now and at a later time, it does so in between, up to the curvature of the
relative motion. An overlap on the path that is small relative to both pieces is tolerated: the ends of a path are free, or nearly
so, and a piece that passes through another reaches a depth of half the thickness of the thinner one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, approximate_separation, pair_separation, separation_bound
from geomphys.collision.extent import gap_along
from geomphys.collision.penetration import Scratch
from geomphys.collision.support import shapes_of
from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import vec_at
from geomphys.numerics.vec3 import (
    Vec,
    add,
    add_scaled,
    norm,
    quat_conjugate,
    quat_mul,
    quat_rotate,
    rot_from_quat,
    rot_mul,
    rotate,
    slerp,
    sub,
)
from geomphys.scene.arrays import Scene
from geomphys.scene.kinematics import frame_rotation, orientation_of, position_of, set_frame

Floats = NDArray[np.float64]

PATH_TOLERANCE = 0.08  # how deep two pieces may overlap between two poses: of their mean thickness
MAX_PATH_TOLERANCE = 1e-3  # m: the same, at most
MAX_ADVANCEMENTS = 48  # times at most that are tested
SLIGHT = 0.25  # of that overlap: if no deeper along the last direction, it is tried again before another is sought
SMALL_SINE = 0.03  # below it the first terms of the series of the arcsine are exact to rounding
HALVINGS = 5  # later times at most, each half as far, at which a direction that separates two pieces is tried


@kernel
def path_tolerance(scene: Scene, a: int, b: int) -> float:
    """How deep [m] two pieces may overlap on their path."""
    thickness = scene.pieces.thickness
    return min(PATH_TOLERANCE * 0.5 * (thickness[a] + thickness[b]), MAX_PATH_TOLERANCE)


@kernel
def _centre(scene: Scene, poses: Floats, piece: int) -> Vec:
    """Centre of a piece in the world."""
    body = scene.pieces.body[piece]
    inside = vec_at(scene.pieces.body_centre, piece)
    return add(position_of(poses, body), quat_rotate(orientation_of(poses, body), inside))


@kernel
def _arcsine(x: float) -> float:
    """The angle [rad] whose sine is x >= 0; more than 1 counts as 1. Its series takes less time than the library's function."""
    if x > SMALL_SINE:
        return math.asin(min(1.0, x))
    xx = x * x
    return x + x * xx * (1.0 / 6.0 + xx * (3.0 / 40.0 + xx * (5.0 / 112.0 + xx * (35.0 / 1152.0))))


@kernel
def rotation_between(before: Floats, after: Floats, body: int) -> float:
    """Angle [rad] by which a body rotates from one row of poses (B, 7) to another."""
    square = 0.0
    for k in range(3, 7):
        square += (after[body, k] - before[body, k]) ** 2
    if square == 0.0:
        return 0.0
    if square > 2.0:
        square = max(4.0 - square, 0.0)
    return 4.0 * _arcsine(0.5 * math.sqrt(square))


@kernel
def centre_motion(scene: Scene, before: Floats, after: Floats, piece: int) -> Vec:
    """How far the centre of a piece moves from one row of poses (B, 7) to another [m]."""
    return sub(_centre(scene, after, piece), _centre(scene, before, piece))


@kernel
def pair_motion(scene: Scene, before: Floats, after: Floats, a: int, b: int) -> tuple[float, float]:
    """Bound on the relative motion of two pieces [m], and its part by rotation."""
    angle_a = rotation_between(before, after, scene.pieces.body[a])
    return _motion_of_pair(scene, before, after, a, b, angle_a, rotation_between(before, after, scene.pieces.body[b]))


@kernel
def _motion_of_pair(
    scene: Scene, before: Floats, after: Floats, a: int, b: int, angle_a: float, angle_b: float
) -> tuple[float, float]:
    """`pair_motion` of pieces whose bodies rotate by these angles [rad]."""
    path = norm(sub(centre_motion(scene, before, after, a), centre_motion(scene, before, after, b)))
    swing = angle_a * scene.pieces.reach[a] + angle_b * scene.pieces.reach[b]
    return path + swing, swing


@kernel
def _pose_between(scene: Scene, before: Floats, after: Floats, piece: int, t: float, frames: Floats) -> None:
    """Row of `frames` of a piece at the fraction `t` of its body's path: its own centre moves on a straight line."""
    body, local = scene.pieces.body[piece], scene.pieces.local
    q = slerp(orientation_of(before, body), orientation_of(after, body), t)
    c0, c1 = _centre(scene, before, piece), _centre(scene, after, piece)
    world_rotation = rot_mul(rot_from_quat(q), frame_rotation(local, piece))
    c = vec_at(scene.pieces.centre, piece)
    at = sub(add_scaled(c0, sub(c1, c0), t), rotate(world_rotation, c))
    set_frame(frames, piece, world_rotation, at)


@kernel
def _attached_direction(before: Floats, after: Floats, body: int, fraction: float, n: Vec) -> Vec:
    """A direction attached to a body, after a `fraction` of the body's rotation."""
    rotation = quat_mul(orientation_of(after, body), quat_conjugate(orientation_of(before, body)))
    return quat_rotate(slerp((0.0, 0.0, 0.0, 1.0), rotation, fraction), n)


@kernel
def _curvature(
    scene: Scene, before: Floats, a: int, b: int, motion: float, swing: float, angle_a: float, angle_b: float
) -> float:
    """Bound on the second derivative, over the fraction of the path, of a gap along a direction attached to the piece that
    rotates most [m].

    `motion`, `swing` [m]: see `pair_motion`; `angle_a`, `angle_b` [rad]: see `rotation_between`.
    """
    larger, apart = max(angle_a, angle_b), norm(sub(_centre(scene, before, a), _centre(scene, before, b)))
    return (angle_a + angle_b) * swing + larger * (larger * apart + 2.0 * (motion - swing))


@noinline
def is_separated_on_path(
    scene: Scene, before: Floats, after: Floats, a: int, b: int, bound: tuple[float, Vec], motion: float, frames: Floats
) -> bool:
    """Whether a direction that separates two pieces at `after`, as in `bound`, separates them on their whole path from `before`.

    It does, up to the tolerated overlap, where it separates them at `before` too, with little rotation in between; where they
    rotate more, attached to the piece that rotates most. `bound`: gap at `after` [m] and direction; `motion` [m] bounds their
    relative motion; `frames` (P, 12) are those of the pieces at `before`.
    """
    gap, n = bound
    body_a, body_b = scene.pieces.body[a], scene.pieces.body[b]
    angle_a, angle_b = rotation_between(before, after, body_a), rotation_between(before, after, body_b)
    deep, bulge = path_tolerance(scene, a, b), 0.0
    if (angle_a + angle_b) * motion > deep:
        most, swing = _motion_of_pair(scene, before, after, a, b, angle_a, angle_b)
        bulge = _curvature(scene, before, a, b, most, swing, angle_a, angle_b) / 8.0
        if bulge > 0.5 * deep + max(gap, 0.0):
            return False
        reference = body_a if angle_a > angle_b else body_b
        rotation = quat_mul(orientation_of(before, reference), quat_conjugate(orientation_of(after, reference)))
        n = quat_rotate(rotation, n)
    gap_before = gap_along(shapes_of(scene.pieces, frames), a, b, n)
    return gap_before > -deep and bulge <= 0.5 * deep + max(min(gap, gap_before), 0.0)


@noinline
def path_is_free(
    scene: Scene, before: Floats, after: Floats, a: int, b: int, frames: Floats, axes: Axes, scratch: Scratch
) -> bool:
    """Whether the pieces `a` and `b` move from the poses `before` (B, 7) to `after` without passing through each other.

    `frames` (P, 12) is scratch; rows `a` and `b` are written. Whether they overlap at either end is not checked.
    """
    body_a, body_b = scene.pieces.body[a], scene.pieces.body[b]
    angle_a, angle_b = rotation_between(before, after, body_a), rotation_between(before, after, body_b)
    motion, swing = _motion_of_pair(scene, before, after, a, b, angle_a, angle_b)
    if motion == 0.0:
        return True
    deep = path_tolerance(scene, a, b)
    reference = body_a if angle_a > angle_b else body_b
    curvature = _curvature(scene, before, a, b, motion, swing, angle_a, angle_b)
    t, leads_farther = 0.0, True
    for _ in range(MAX_ADVANCEMENTS):
        _pose_between(scene, before, after, a, t, frames)
        _pose_between(scene, before, after, b, t, frames)
        left = motion * (1.0 - t)
        s, n = separation_bound(scene.pieces, frames, a, b, axes)
        if s < -SLIGHT * deep or not leads_farther:
            s, n = approximate_separation(scene.pieces, frames, a, b, left + deep, axes, scratch)
            if s < 0.0:
                s, n, _, _ = pair_separation(scene.pieces, frames, a, b, left + deep, axes, scratch)
        if s > left:
            return True
        if s < -1.5 * deep:
            return t == 0.0  # a pair that overlaps already cannot be entered
        moved_by, leads_farther = (max(s, 0.0) + deep) / motion, False
        far, most = 1.0 - t, 0.5 * deep + max(s, 0.0)
        if curvature * far * far > 8.0 * most:
            far = math.sqrt(8.0 * most / curvature)
        for _ in range(HALVINGS):
            if far <= moved_by or s < -deep:
                break
            _pose_between(scene, before, after, a, t + far, frames)
            _pose_between(scene, before, after, b, t + far, frames)
            ahead = _attached_direction(before, after, reference, far, n)
            gap = gap_along(shapes_of(scene.pieces, frames), a, b, ahead)
            if gap > -deep and curvature * far * far / 8.0 <= 0.5 * deep + max(min(s, gap), 0.0):
                moved_by, leads_farther = far, True
            far *= 0.5
        t += moved_by
        if t >= 1.0:
            return True
    return False
