"""Driven and simulated bodies in a frame: driven ones first, then what they push, then who gives way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near, near_pairs_of_trees
from geomphys.collision.sweep import apart, update_boxes
from geomphys.driven.coupling import relax_offset
from geomphys.driven.postures import is_recorded
from geomphys.engine.methods import give_way_by_method
from geomphys.engine.state import Knobs, Machine
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import (
    add,
    add_scaled,
    dot,
    norm,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rotation_vector,
    scale,
    slerp,
    sub,
)
from geomphys.scene.arrays import DRIVEN, SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, place_tree, pose_tree, position_of, set_pose
from geomphys.simulated.driven_paths import carried_on, is_even
from geomphys.simulated.update import simulate

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TURN = 1.0 / 240.0  # s: where they may meet, driven and simulated bodies take turns at least so often
SPARE = 0.01  # share of a turn by which one may be longer: times of messages are rounded
MOST_TURNS = 16  # in a frame
NEAR = 1e-3  # m: bodies that come no nearer do not meet
LEAST_MOTION = 1e-9  # m: of both in a frame together; slower, one turn a frame will do


@outlined
def shift_driven(scene: Scene, m: Machine) -> None:
    """Corrected poses: of driven trees those of the final posture, of others the recorded ones."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(7):
                m.corrected[body, k] = m.recorded[body, k]
                if scene.trees.role[tree] == DRIVEN:
                    m.corrected[body, k] = m.driven.last.poses[body, k]


@outlined
def note_simulated(scene: Scene, m: Machine) -> None:
    """Tell the driven loop where simulated bodies are before its step, and where they are to be after it."""
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == SIMULATED:
            body = scene.trees.body_start[tree]
            for k in range(7):
                m.driven.last.poses[body, k] = m.corrected[body, k]


@outlined
def recording_between(
    scene: Scene, origins: Floats, roots0: Floats, angles0: Floats, roots1: Floats, angles1: Floats, w: float,
    roots: Floats, angles: Floats, poses: Floats,
) -> None:  # fmt: skip
    """The recording a share `w` of the way from one moment to another: into `roots` (T, 7), `angles` (Q,) and, by forward
    kinematics, `poses` (B, 7).
    """
    for i in range(len(angles)):
        angles[i] = angles0[i] + w * (angles1[i] - angles0[i])
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        q = slerp(orientation_of(roots0, tree), orientation_of(roots1, tree), w)
        p0, p1 = position_of(roots0, tree), position_of(roots1, tree)
        set_pose(roots, tree, add_scaled(p0, sub(p1, p0), w), q)
        pose_tree(scene, origins, tree, roots, angles, poses)


@outlined
def note_courses(scene: Scene, m: Machine, roots: Floats, dt: float, first: bool) -> None:
    """Accelerations that recorded roots (T, 7) have in this frame, judged from the frames before as those of tracked things.

    A row of `course`: root position [m], its mean velocity [m/s], how that changed [m/s²], the frame's time [s], and the
    acceleration [m/s²].
    """
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        c = m.course[tree]
        position, change = position_of(roots, tree), (0.0, 0.0, 0.0)
        velocity = (0.0, 0.0, 0.0)
        if not first and dt > 0.0:
            velocity = scale(sub(position, (c[0], c[1], c[2])), 1.0 / dt)
            if is_even(dt, c[9]):
                change = scale(sub(velocity, (c[3], c[4], c[5])), 2.0 / (dt + c[9]))
        pull = carried_on(change, (c[6], c[7], c[8]))
        for i in range(3):
            c[i], c[3 + i], c[6 + i], c[10 + i] = position[i], velocity[i], change[i], pull[i]
        c[9] = 0.0 if first else dt


@outlined
def bend_way(scene: Scene, m: Machine, dt: float, part: int, parts: int) -> None:
    """Let the end of a part of a frame lie on the parabolas of `note_courses`, not on the way straight from the part before.

    Of a parabola p + v u + a u (u - dt) / 2, parted evenly, that is a dt² (parts - part - 1) / (2 parts²) beside it.
    """
    share = -0.5 * dt * dt * (parts - part - 1) / (parts * parts)
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for i in range(3):
            aside = share * m.course[tree, 10 + i]
            if aside != 0.0:
                m.roots[tree, i] += aside
                for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                    m.recorded[body, i] += aside


@outlined
def pull_freely(scene: Scene, m: Machine, dt: float) -> None:
    """Note the couplings of driven trees as they are, and the speeds that (6) gives them in `dt` if nothing is met."""
    trees = scene.trees
    for tree in range(len(trees.role)):
        if trees.role[tree] != DRIVEN:
            continue
        for i in range(3):
            x, v = m.driven.offset[tree, i], m.driven.speed[tree, i]
            m.coupling[tree, i] = x
            m.coupling[tree, 3 + i] = relax_offset(trees, tree, x, v, dt)[1]


@kernel
def want_velocities(scene: Scene, m: Machine, dt: float) -> None:
    """Velocities of driven bodies at which they want to move, whatever holds them back: as recorded, and as (6) pulls."""
    bodies = scene.bodies
    for body in range(len(bodies.role)):
        if bodies.role[body] != DRIVEN:
            continue
        tree = bodies.tree[body]
        com = (bodies.com[body, 0], bodies.com[body, 1], bodies.com[body, 2])
        q0, q1 = orientation_of(m.start, body), orientation_of(m.corrected, body)
        c0 = add(position_of(m.start, body), quat_rotate(q0, com))
        c1 = add(position_of(m.corrected, body), quat_rotate(q1, com))
        turn = rotation_vector(quat_mul(q1, quat_conjugate(q0)))
        for i in range(3):
            pulled = m.driven.offset[tree, i] - m.coupling[tree, i]
            m.velocity[body, i] = (c1[i] - c0[i] - pulled) / dt + m.coupling[tree, 3 + i]
            m.velocity[body, 3 + i] = turn[i] / dt


@kernel
def place_simulated(scene: Scene, m: Machine, tree: int, poses: Floats) -> None:
    """Pieces and boxes of a simulated tree at its row of `poses` (B, 7)."""
    p = m.room.places
    for frames in (p.base, p.frames, p.moved):
        place_tree(scene, tree, poses, frames)
    update_boxes(scene, p.base, m.boxes, tree)


@kernel
def _meets_driven(scene: Scene, m: Machine, tree: int) -> bool:
    """Whether a simulated tree overlaps a driven one as that ended the last frame."""
    near = m.room.near
    near.filled[0] = 0
    for other in range(len(scene.trees.role)):
        if scene.trees.role[other] == DRIVEN:
            update_boxes(scene, m.room.places.frames, m.boxes, other)
            near_pairs_of_trees(
                scene, m.room.places.frames, m.boxes, other, tree, 0.0, math.inf, near, m.axes, m.scratch
            )
    for k in range(near.filled[0]):  # noqa: SIM110 - a kernel cannot take a generator
        if near.separation[k] < 0.0:
            return True
    return False


@outlined
def predict_simulated(scene: Scene, m: Machine, dt: float) -> None:
    """Put simulated bodies where they go by their velocity within the frame: what driven bodies have to keep clear of.

    Kept clear of where it is now, a ball that rolls ahead of a hand would never be reached by it. One that comes at a
    hand stays where it is: it is to hit it.
    """
    bodies = scene.bodies
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != SIMULATED:
            continue
        body = scene.trees.body_start[tree]
        for k in range(7):
            m.recorded[body, k] = m.corrected[body, k]
        speed = (m.velocity[body, 0], m.velocity[body, 1], m.velocity[body, 2])
        spin = (m.velocity[body, 3], m.velocity[body, 4], m.velocity[body, 5])
        if dot(speed, speed) + dot(spin, spin) == 0.0:
            continue
        com = (bodies.com[body, 0], bodies.com[body, 1], bodies.com[body, 2])
        q = orientation_of(m.corrected, body)
        centre = add_scaled(add(position_of(m.corrected, body), quat_rotate(q, com)), speed, dt)
        q = quat_unit(quat_mul(quat_from_rotation_vector(scale(spin, dt)), q))
        set_pose(m.predicted, body, sub(centre, quat_rotate(q, com)), q)
        place_simulated(scene, m, tree, m.predicted)
        if _meets_driven(scene, m, tree):
            place_simulated(scene, m, tree, m.corrected)
        else:
            for k in range(7):
                m.recorded[body, k] = m.predicted[body, k]


@kernel
def recorded_motion(scene: Scene, m: Machine, tree: int) -> float:
    """How far the recording moves a driven tree in this frame, at most over its bodies [m]."""
    most = 0.0
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        way = sub(position_of(m.recorded, body), position_of(m.start, body))
        off = (m.driven.offset[tree, 0], m.driven.offset[tree, 1], m.driven.offset[tree, 2])
        most = max(most, norm(add(way, off)))
    return most


@outlined
def turns_of(scene: Scene, m: Machine, dt: float) -> int:
    """In how many parts of a frame driven and simulated bodies take turns.

    A driven body stands still for the rest of its part once a simulated one is in its way, however fast that is pushed
    off. Where they may meet, parts are no longer than `TURN`, so that what comes of it does not hang on the frame rate.
    """
    most = math.ceil(dt / TURN - SPARE)
    if most <= 1:
        return 1
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] != DRIVEN:
            continue
        moved = recorded_motion(scene, m, tree)
        off = (m.driven.offset[tree, 0], m.driven.offset[tree, 1], m.driven.offset[tree, 2])
        for other in range(len(scene.trees.role)):
            if scene.trees.role[other] != SIMULATED:
                continue
            body = scene.trees.body_start[other]
            speed = norm((m.velocity[body, 0], m.velocity[body, 1], m.velocity[body, 2]))
            if moved + dt * speed < LEAST_MOTION:
                continue
            reach = moved + dt * speed + norm(off) + NEAR
            for link in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
                if not apart(
                    m.boxes.body_low, m.boxes.body_high, m.boxes.body_low, m.boxes.body_high, link, body, reach
                ):
                    return min(most, MOST_TURNS)
    return 1


@kernel
def push_back(scene: Scene, m: Machine, tree: int) -> None:
    """Let the impulse that a driven tree got change the speed of its offset (6).

    The driven loop has already taken from it what went against the bodies it met; that is not taken twice.
    """
    impulse = (m.impulse[tree, 0], m.impulse[tree, 1], m.impulse[tree, 2])
    size = norm(impulse)
    if size == 0.0:
        return
    speed = (m.driven.speed[tree, 0], m.driven.speed[tree, 1], m.driven.speed[tree, 2])
    free = (m.coupling[tree, 3], m.coupling[tree, 4], m.coupling[tree, 5])
    taken = max(0.0, -dot(sub(free, speed), impulse) / size)
    back = 1.0 / scene.trees.mass[tree] - taken / size
    for i in range(3):
        m.driven.speed[tree, i] += back * impulse[i]


@outlined
def simulate_bodies(scene: Scene, m: Machine, dt: float, knobs: Knobs, done: int, goes_on: bool) -> tuple[int, int]:
    """Move the simulated bodies through the frame, or a part of it; what hits a driven tree changes its offset's speed.

    `done` are the impacts of the frame's parts so far, if it `goes_on`. Returns the impacts and the flags of `simulate`.
    """
    if len(m.simulated.free) == 0 or dt <= 0.0:
        return 0, 0
    want_velocities(scene, m, dt)
    for tree in range(len(m.impulse)):
        for i in range(3):
            m.impulse[tree, i] = 0.0
    impacts, flags = simulate(m.simulated, dt, knobs.max_impacts - done, knobs.gap, goes_on)
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            push_back(scene, m, tree)
        elif scene.trees.role[tree] == SIMULATED:
            body = scene.trees.body_start[tree]
            for k in range(7):
                m.recorded[body, k] = m.corrected[body, k]
            place_simulated(scene, m, tree, m.corrected)
    return impacts, flags


@outlined
def yield_to_simulated(scene: Scene, m: Machine, knobs: Knobs) -> int:
    """Where a simulated body ended inside a driven one, the driven one gives way. Returns the rounds this took."""
    p, near = m.room.places, m.room.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, p.frames, m.boxes, tree)
    find_near(scene, p.frames, m.boxes, m.still, 0.0, math.inf, near, p.found, m.axes, m.scratch)
    for k in range(near.filled[0]):
        if near.separation[k] < 0.0 and scene.trees.role[near.tree_b[k]] == SIMULATED:
            note_simulated(scene, m)
            rounds = give_way_by_method(scene, m, knobs.method)
            shift_driven(scene, m)
            return rounds
    return 0
