"""Boxes that hold everything a body, and each of its pieces, can reach in a frame."""

from __future__ import annotations

import math

from geomphys.jit.addresses import float_at, int_at, set_float
from geomphys.jit.kernel import kernel
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
from geomphys.simulated.cells import quat_at, rot_at, set_vec, vec_at
from geomphys.simulated.driven_paths import set_path
from geomphys.simulated.motion import fastest_turn, point_at, turn_at
from geomphys.simulated.state import (
    ARM,
    AT_ARM,
    AT_BALLS,
    AT_BODY_BOXES,
    AT_BOXES,
    AT_COUNT,
    AT_DT,
    AT_EXTENT,
    AT_FROM,
    AT_LOCAL,
    AT_LOCAL_BOXES,
    AT_PATH_COUNT,
    AT_PATHS,
    AT_UNTIL,
    AT_WEIGHT,
    BEND,
    FIRST,
    HOME,
    LAST,
    OFFSET,
    PULL,
    RANGE,
    SPEED,
    SPIN,
    TURNED,
    end_of,
    entry,
    free_body,
    kind_of,
    knob,
    motion_of,
    start_of,
)

ROOM = 2e-3  # m: how much farther than expected a body may go before pairs are looked for again


@kernel
def piece_box(sim: int, piece: int) -> int:
    """Row of `boxes`."""
    return entry(sim, AT_BOXES) + 48 * piece


@kernel
def body_box(sim: int, body: int) -> int:
    """Row of `body_boxes`."""
    return entry(sim, AT_BODY_BOXES) + 48 * body


@kernel
def box_piece(sim: int, piece: int, p: Vec, r: Rot, grow: float, join: bool) -> None:
    """Box of a piece with its body at position p, rotation r, grown by so much, and joined with the box it had."""
    box, own, local = piece_box(sim, piece), entry(sim, AT_LOCAL_BOXES) + 56 * piece, entry(sim, AT_LOCAL) + 96 * piece
    m = rot_mul(r, rot_at(local, 0))
    c = add(p, add(rotate(r, vec_at(local, 9)), rotate(m, vec_at(own, 0))))
    h, radius = vec_at(own, 3), float_at(own, 6)
    for i in range(3):
        reach = abs(m[3 * i]) * h[0] + abs(m[3 * i + 1]) * h[1] + abs(m[3 * i + 2]) * h[2]
        reach = min(reach, radius) + grow
        low, high = c[i] - reach, c[i] + reach
        if join:
            low, high = min(low, float_at(box, i)), max(high, float_at(box, 3 + i))
        set_float(box, i, low)
        set_float(box, 3 + i, high)


@kernel
def box_body(sim: int, body: int) -> None:
    """Box of a body, from those of its pieces; an empty body's lies nowhere."""
    box, kind = body_box(sim, body), kind_of(sim, body)
    for i in range(3):
        low, high = math.inf, -math.inf
        for piece in range(int_at(kind, FIRST), int_at(kind, LAST)):
            low = min(low, float_at(piece_box(sim, piece), i))
            high = max(high, float_at(piece_box(sim, piece), 3 + i))
        set_float(box, i, low)
        set_float(box, 3 + i, high)


@kernel
def apart(a: int, b: int) -> bool:
    """Whether two boxes have nothing in common."""
    for i in range(3):  # noqa: SIM110
        if float_at(a, i) > float_at(b, 3 + i) or float_at(b, i) > float_at(a, 3 + i):
            return True
    return False


@kernel
def passes_by(sim: int, body: int) -> bool:
    """Whether a body that follows its path is nowhere near what simulated bodies can reach in the frame."""
    ball, start, end = entry(sim, AT_BALLS) + 32 * body, start_of(sim, body), end_of(sim, body)
    a = add(vec_at(start, 0), quat_rotate(quat_at(start, 3), vec_at(ball, 0)))
    b = add(vec_at(end, 0), quat_rotate(quat_at(end, 3), vec_at(ball, 0)))
    # on the way it leaves the straight line by less than its acceleration and the turning of its middle move it
    m, dt = motion_of(sim, body), knob(sim, AT_DT)
    reach = float_at(ball, 3) + 2.0 * norm(vec_at(ball, 0)) + 0.125 * dt * dt * norm(vec_at(m, PULL))
    for i in range(3):
        if min(a[i], b[i]) - reach > float_at(sim, AT_EXTENT + 3 + i):
            return True
        if max(a[i], b[i]) + reach < float_at(sim, AT_EXTENT + i):
            return True
    return False


@kernel
def box_path(sim: int, body: int) -> None:
    """Motion of a body that follows its path through the frame, and its boxes in the span; none if it passes by."""
    kind, box = kind_of(sim, body), body_box(sim, body)
    if passes_by(sim, body):
        set_vec(box, 0, (math.inf, math.inf, math.inf))
        set_vec(box, 3, (-math.inf, -math.inf, -math.inf))
        return
    set_path(sim, body)
    m, t0, t1 = motion_of(sim, body), knob(sim, AT_FROM), knob(sim, AT_UNTIL)
    h = t1 - t0
    angle, bend = h * fastest_turn(m), 0.25 * h * h * norm(vec_at(m, BEND))
    aside = 0.125 * h * h * norm(vec_at(m, PULL))
    r0, r1 = rot_from_quat(turn_at(m, t0)), rot_from_quat(turn_at(m, t1))
    for piece in range(int_at(kind, FIRST), int_at(kind, LAST)):
        bulge = float_at(entry(sim, AT_ARM), piece) * min(2.0, 0.125 * angle * angle + bend) + aside
        box_piece(sim, piece, point_at(m, t0), r0, bulge, False)
        box_piece(sim, piece, point_at(m, t1), r1, bulge, True)
    box_body(sim, body)


@kernel
def reach_ahead(sim: int, body: int, left: float) -> float:
    """How far any point of a simulated body may get in `left` seconds as it moves now [m]."""
    m = motion_of(sim, body)
    pull = max(norm(vec_at(m, PULL)), knob(sim, AT_WEIGHT))
    turn = min(2.0, 2.0 * left * norm(vec_at(m, SPIN)))
    return left * norm(vec_at(m, SPEED)) + 0.5 * left * left * pull + turn * float_at(m, ARM)


@kernel
def box_free(sim: int, body: int) -> None:
    """Box of a simulated body, and of its pieces, in the span looked at; notes the range it is for."""
    m, kind, t = motion_of(sim, body), kind_of(sim, body), knob(sim, AT_FROM)
    reach = reach_ahead(sim, body, knob(sim, AT_UNTIL) - t) + ROOM
    set_float(m, RANGE, reach)
    set_float(m, TURNED, 0.0)
    set_vec(m, HOME, point_at(m, t))
    r = rot_from_quat(turn_at(m, t))
    p = sub(point_at(m, t), rotate(r, vec_at(m, OFFSET)))
    for piece in range(int_at(kind, FIRST), int_at(kind, LAST)):
        box_piece(sim, piece, p, r, reach, False)
    box_body(sim, body)


@kernel
def box_all(sim: int) -> None:
    """Boxes of all bodies that move, in the span from `AT_FROM` to `AT_UNTIL`."""
    for i in range(3):
        set_float(sim, AT_EXTENT + i, math.inf)
        set_float(sim, AT_EXTENT + 3 + i, -math.inf)
    for s in range(entry(sim, AT_COUNT)):
        body = free_body(sim, s)
        box_free(sim, body)
        box = body_box(sim, body)
        for i in range(3):
            set_float(sim, AT_EXTENT + i, min(float_at(sim, AT_EXTENT + i), float_at(box, i)))
            set_float(sim, AT_EXTENT + 3 + i, max(float_at(sim, AT_EXTENT + 3 + i), float_at(box, 3 + i)))
    for k in range(entry(sim, AT_PATH_COUNT)):
        box_path(sim, int_at(entry(sim, AT_PATHS), k))
