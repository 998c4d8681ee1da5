"""Swept boxes: bounds of everything a body, and each of its pieces, can reach in a frame."""

from __future__ import annotations

import math

from geomphys.jit.kernel import kernel, noinline
from geomphys.numerics.row_vectors import quat_from, rot_of, set_vec, vec_from, vec_of
from geomphys.numerics.vec3 import (
    Rot,
    Vec,
    add,
    norm,
    quat_rotate,
    rot_from_quat,
    rot_mul,
    rotate,
    sub,
)
from geomphys.simulated.driven_paths import set_path
from geomphys.simulated.motion import angular_speed_bound, orientation_at, point_at
from geomphys.simulated.state import Aabb, Simulation

MARGIN = 2e-3  # m: how much farther than expected a body may move before pairs are searched again


@kernel
def box_piece(sim: Simulation, piece: int, p: Vec, r: Rot, grow: float, join: bool) -> None:
    """Box of a piece with its body at position p, rotation r, grown by so much, and joined with the box it had."""
    box, own, local = sim.boxes[piece], sim.local_boxes[piece], sim.pieces.local[piece]
    m = rot_mul(r, rot_of(local))
    c = add(p, add(rotate(r, vec_from(local, 9)), rotate(m, vec_of(own.centre))))
    h = vec_of(own.half)
    for i in range(3):
        reach = abs(m[3 * i]) * h[0] + abs(m[3 * i + 1]) * h[1] + abs(m[3 * i + 2]) * h[2]
        reach = min(reach, own.radius) + grow
        low, high = c[i] - reach, c[i] + reach
        if join:
            low, high = min(low, box.low[i]), max(high, box.high[i])
        box.low[i], box.high[i] = low, high


@kernel
def box_body(sim: Simulation, body: int) -> None:
    """Box of a body, from those of its pieces; (inf, -inf) for a body without pieces."""
    box, kind = sim.body_boxes[body], sim.bodies[body]
    for i in range(3):
        low, high = math.inf, -math.inf
        for piece in range(kind.first_piece, kind.end_piece):
            low, high = min(low, sim.boxes[piece].low[i]), max(high, sim.boxes[piece].high[i])
        box.low[i], box.high[i] = low, high


@kernel
def apart(a: Aabb, b: Aabb) -> bool:
    """Whether two boxes are disjoint."""
    for i in range(3):  # noqa: SIM110
        if a.low[i] > b.high[i] or b.low[i] > a.high[i]:
            return True
    return False


@kernel
def passes_by(sim: Simulation, body: int) -> bool:
    """Whether a body with prescribed motion is out of reach of all simulated bodies in the frame."""
    ball, start, end = sim.balls[body], sim.start[body], sim.end[body]
    a = add(vec_from(start, 0), quat_rotate(quat_from(start, 3), vec_of(ball.centre)))
    b = add(vec_from(end, 0), quat_rotate(quat_from(end, 3), vec_of(ball.centre)))
    # it leaves the straight line by less than the effects of acceleration and of the rotation about its centre
    m, dt = sim.motion[body], sim.frame.dt
    reach = ball.radius + 2.0 * norm(vec_of(ball.centre)) + 0.125 * dt * dt * norm(vec_of(m.acceleration))
    for i in range(3):
        if min(a[i], b[i]) - reach > sim.frame.extent_high[i]:
            return True
        if max(a[i], b[i]) + reach < sim.frame.extent_low[i]:
            return True
    return False


@kernel
def box_path(sim: Simulation, body: int) -> None:
    """Prescribed motion of a body through the frame, and its boxes in the span; empty ones if it is out of reach."""
    kind, box = sim.bodies[body], sim.body_boxes[body]
    if passes_by(sim, body):
        set_vec(box.low, (math.inf, math.inf, math.inf))
        set_vec(box.high, (-math.inf, -math.inf, -math.inf))
        return
    set_path(sim, body)
    m, t0, t1 = sim.motion[body], sim.frame.span_start, sim.frame.span_end
    h = t1 - t0
    angle, rotation_curvature = h * angular_speed_bound(m), 0.25 * h * h * norm(vec_of(m.half_angular_acceleration))
    path_curvature = 0.125 * h * h * norm(vec_of(m.acceleration))
    r0, r1 = rot_from_quat(orientation_at(m, t0)), rot_from_quat(orientation_at(m, t1))
    for piece in range(kind.first_piece, kind.end_piece):
        bulge = sim.arm[piece] * min(2.0, 0.125 * angle * angle + rotation_curvature) + path_curvature
        box_piece(sim, piece, point_at(m, t0), r0, bulge, False)
        box_piece(sim, piece, point_at(m, t1), r1, bulge, True)
    box_body(sim, body)


@kernel
def reach_ahead(sim: Simulation, body: int, left: float) -> float:
    """How far any point of a simulated body may move in `left` seconds with its present motion [m]."""
    m = sim.motion[body]
    acceleration = max(norm(vec_of(m.acceleration)), sim.frame.weight)
    chord = min(2.0, 2.0 * left * norm(vec_of(m.angular_velocity)))
    return left * norm(vec_of(m.velocity)) + 0.5 * left * left * acceleration + chord * m.reach


@kernel
def box_free(sim: Simulation, body: int) -> None:
    """Box of a simulated body, and of its pieces, in the span searched; stores the range it is valid for."""
    m, kind, t = sim.motion[body], sim.bodies[body], sim.frame.span_start
    reach = reach_ahead(sim, body, sim.frame.span_end - t) + MARGIN
    m.listed_range = reach
    m.listed_rotation = 0.0
    set_vec(m.listed_position, point_at(m, t))
    r = rot_from_quat(orientation_at(m, t))
    p = sub(point_at(m, t), rotate(r, vec_of(m.centre)))
    for piece in range(kind.first_piece, kind.end_piece):
        box_piece(sim, piece, p, r, reach, False)
    box_body(sim, body)


@kernel
def set_extent(sim: Simulation) -> bool:
    """Box of everything that simulated bodies can reach, from the boxes of the bodies; returns whether it has grown."""
    low, high = sim.frame.extent_low, sim.frame.extent_high
    low_before, high_before = vec_of(low), vec_of(high)
    set_vec(low, (math.inf, math.inf, math.inf))
    set_vec(high, (-math.inf, -math.inf, -math.inf))
    for s in range(len(sim.free)):
        box = sim.body_boxes[sim.free[s]]
        for i in range(3):
            low[i], high[i] = min(low[i], box.low[i]), max(high[i], box.high[i])
    for i in range(3):  # noqa: SIM110 - a kernel cannot take a generator
        if low[i] < low_before[i] or high[i] > high_before[i]:
            return True
    return False


@noinline
def box_all(sim: Simulation) -> None:
    """Boxes of all bodies that move, in the span searched."""
    for s in range(len(sim.free)):
        box_free(sim, sim.free[s])
    set_extent(sim)
    for k in range(len(sim.paths)):
        box_path(sim, sim.paths[k])


@noinline
def box_changed(sim: Simulation) -> None:
    """Boxes of the changed bodies in the span searched, and of bodies with prescribed motion that were out of reach."""
    for s in range(sim.counts.changed):
        box_free(sim, sim.changed[s])
    if not set_extent(sim):
        return
    for k in range(len(sim.paths)):
        if sim.body_boxes[sim.paths[k]].low[0] == math.inf:
            box_path(sim, sim.paths[k])
