"""How bodies that follow a path move within a frame.

Only where it is at every frame is known. A tracked thing of the scene goes from one to the next on the parabola that
the frames before call for: its acceleration is the change of the mean velocity from frame to frame, carried on to the
middle of the frame as it changed last, and none where it turned round. What moves smoothly then strikes and carries
with the velocity it has at that moment, at any frame rate; what starts, stops or trembles goes straight. Driven
bodies go straight in their turns, whose ends lie on such parabolas.
"""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec, add_scaled, dot, quat_conjugate, quat_mul, rotation_vector, scale, sub
from geomphys.scene.arrays import FIXED
from geomphys.simulated.cells import quat_at, set_quat, set_vec, vec_at
from geomphys.simulated.state import (
    AT_DT,
    AT_PATH_COUNT,
    AT_PATHS,
    AT_VELOCITY,
    BASE,
    BEND,
    COURSE,
    COURSE_CHANGE,
    COURSE_TIME,
    LENGTH,
    POINT,
    PULL,
    RATE,
    ROLE,
    SPEED,
    TURN,
    end_of,
    entry,
    kind_of,
    knob,
    motion_of,
    start_of,
    velocity_of,
)

UNEVEN = 3.0  # a frame longer or shorter than the one before by this factor says nothing of the acceleration


@kernel
def mean_velocities(sim: int, body: int) -> tuple[Vec, Vec]:
    """Mean velocity of the origin [m/s] and mean rate of turning [rad/s] of a body through the frame."""
    start, end, rate = start_of(sim, body), end_of(sim, body), 1.0 / knob(sim, AT_DT)
    turn = rotation_vector(quat_mul(quat_at(end, 3), quat_conjugate(quat_at(start, 3))))
    return scale(sub(vec_at(end, 0), vec_at(start, 0)), rate), scale(turn, rate)


@kernel
def is_even(dt: float, last: float) -> bool:
    """Whether a frame of `dt` [s] after one of `last` [s] tells of an acceleration."""
    return last < UNEVEN * dt and dt < UNEVEN * last


@kernel
def carried_on(a: Vec, before: Vec) -> Vec:
    """What an acceleration that was `before` and then `a`, a frame later, is half a frame after that.

    On the straight line through both; no more than twice the smaller, and 0 where their directions differ.
    """
    b = add_scaled(scale(a, 1.5), before, -0.5)
    if dot(a, before) <= 0.0 or dot(a, b) <= 0.0:
        return (0.0, 0.0, 0.0)
    most = 4.0 * min(dot(a, a), dot(before, before))
    square = dot(b, b)
    return b if square <= most else scale(b, math.sqrt(most / square))


@kernel
def lay_courses(sim: int) -> None:
    """Accelerations of the tracked things of the scene for this frame, from those before."""
    dt = knob(sim, AT_DT)
    for k in range(entry(sim, AT_PATH_COUNT)):
        body = int_at(entry(sim, AT_PATHS), k)
        if int_at(kind_of(sim, body), ROLE) != FIXED:
            continue
        m = motion_of(sim, body)
        v, w = mean_velocities(sim, body)
        last = float_at(m, COURSE_TIME)
        a, b = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if is_even(dt, last):
            rate = 2.0 / (dt + last)
            a, b = scale(sub(v, vec_at(m, COURSE)), rate), scale(sub(w, vec_at(m, COURSE + 3)), rate)
        set_vec(m, PULL, carried_on(a, vec_at(m, COURSE_CHANGE)))
        set_vec(m, BEND, scale(carried_on(b, vec_at(m, COURSE_CHANGE + 3)), 0.5))
        set_float(m, LENGTH, dt)
        set_vec(m, COURSE, v)
        set_vec(m, COURSE + 3, w)
        set_vec(m, COURSE_CHANGE, a)
        set_vec(m, COURSE_CHANGE + 3, b)
        set_float(m, COURSE_TIME, dt)


@kernel
def set_path(sim: int, body: int) -> None:
    """Motion of a body that follows its path through the frame, from its pose at the start to the end's."""
    m, start = motion_of(sim, body), start_of(sim, body)
    v, w = mean_velocities(sim, body)
    set_float(m, BASE, 0.0)
    set_vec(m, POINT, vec_at(start, 0))
    set_quat(m, TURN, quat_at(start, 3))
    set_vec(m, SPEED, add_scaled(v, vec_at(m, PULL), -0.5 * knob(sim, AT_DT)))
    set_vec(m, RATE, w)
    load_path(sim, body, 0.0)


@kernel
def load_path(sim: int, body: int, t: float) -> None:
    """Write the velocities that a body that follows its path has at time `t` of the frame to `velocity` of the state."""
    m, v = motion_of(sim, body), velocity_of(entry(sim, AT_VELOCITY), body)
    set_vec(v, 0, add_scaled(vec_at(m, SPEED), vec_at(m, PULL), t))
    set_vec(v, 3, add_scaled(vec_at(m, RATE), vec_at(m, BEND), 2.0 * t - float_at(m, LENGTH)))


@kernel
def load_paths(sim: int, t: float) -> None:
    """`load_path` for all tracked things of the scene."""
    for k in range(entry(sim, AT_PATH_COUNT)):
        body = int_at(entry(sim, AT_PATHS), k)
        if int_at(kind_of(sim, body), ROLE) == FIXED:
            load_path(sim, body, t)
