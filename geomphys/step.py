"""One frame, compiled: every stage in order. The only module that knows them all."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.block import (
    CORRECTION,
    FALLBACKS,
    FLAGS,
    IMPACTS,
    ITERATIONS,
    RECORDED,
    RESIDUAL,
    TURN,
    Block,
    has_room,
    write_contacts,
    write_depths,
)
from geomphys.collision.detect import Axes, find_near, make_axes, make_near, near_pairs_of_trees
from geomphys.collision.global_depth import GlobalDepths, global_depths, make_global_depths
from geomphys.collision.penetration import Scratch, make_scratch
from geomphys.collision.sweep import Boxes, make_boxes, update_boxes
from geomphys.driven.chains import make_chain_room
from geomphys.driven.escape import make_rescue
from geomphys.driven.least_distance import make_least_distance
from geomphys.driven.overlap import make_places, place_at
from geomphys.driven.posture import make_joints, pose_avatars
from geomphys.driven.steps import is_recorded
from geomphys.driven.update import DrivenRoom, DrivenState, give_way, make_driven_state, update_driven
from geomphys.kernel import kernel, outlined
from geomphys.packed import pack
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_STARTED_INSIDE
from geomphys.simulated.make import make_simulated_state
from geomphys.simulated.state import SimulatedState
from geomphys.simulated.touches import write_touches
from geomphys.simulated.update import simulate
from geomphys.timing import cycles
from geomphys.vec3 import (
    add,
    add_scaled,
    dot,
    quat_conjugate,
    quat_from_rotation_vector,
    quat_mul,
    quat_rotate,
    quat_unit,
    rotation_vector,
    scale,
    sub,
)
from geomphys.world.kinematics import joint_origins, orientation_of, place_tree, pose_tree, position_of, set_pose
from geomphys.world.scene import DRIVEN, SIMULATED, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR_PAIRS = 1 << 14  # most pairs of pieces that can be near at once
PLANES = 512  # most planes of a least-distance problem
MET = 2048  # most pairs that chains yield to at once
CONTACT_GAPS = 3.0  # surfaces nearer than this many gaps are in contact

KINEMATICS, RECORDED_DEPTH, OVERLAP, IMPULSES, CONTACTS, WHOLE = range(6)


class Knobs(NamedTuple):
    """What the step needs of the configuration."""

    gap: float
    rounds: int
    max_impacts: int


class State(NamedTuple):
    """What frames leave behind for the next ones."""

    driven: DrivenState
    simulated: SimulatedState
    recorded: Floats
    corrected: Floats
    velocity: Floats
    boxes: Boxes
    base: Floats
    frames: Floats
    moved: Floats
    axes: Axes


def copied(record: Any) -> Any:
    """A deep copy of a NamedTuple of arrays."""
    parts = (copied(p) if isinstance(p, tuple) else p.copy() if isinstance(p, np.ndarray) else p for p in record)
    return type(record)(*parts)


def restore(record: Any, copy: Any) -> None:
    """Give the arrays of a record the values of its copy."""
    for part, old in zip(record, copy, strict=True):
        if isinstance(part, tuple):
            restore(part, old)
        elif isinstance(part, np.ndarray):
            part[...] = old


class Machine(NamedTuple):
    """State and scratch of a replay: what changes from frame to frame. Made by `make_machine`."""

    recorded: Floats  # (B, 7) poses as recorded
    corrected: Floats  # (B, 7)
    driven: DrivenState
    room: DrivenRoom
    depths: GlobalDepths
    boxes: Boxes
    still: Floats  # (T,) zeros: no tree moves while its overlaps are measured
    still_offset: Floats  # (T, 3) zeros
    points_a: Floats  # (8, 3) of a contact manifold
    points_b: Floats  # (8, 3)
    simulated: SimulatedState
    start: Floats  # (B, 7) poses at the frame's start
    predicted: Floats  # (B, 7) poses of simulated bodies at the frame's end, by their velocity
    velocity: Floats  # (B, 6) m/s of the centre of mass and rad/s, world
    impulse: Floats  # (T, 3) N s that simulated bodies gave to driven trees
    axes: Axes
    scratch: Scratch

    def state(self) -> State:
        """A copy of what frames leave behind, for `restore`."""
        return copied(self._state())

    def restore(self, state: State) -> None:
        """Go back to where `state` was taken."""
        restore(self._state(), state)

    def _state(self) -> State:
        p = self.room.places
        return State(
            self.driven, self.simulated, self.recorded, self.corrected, self.velocity, self.boxes, p.base, p.frames, p.moved,
            self.axes,
        )  # fmt: skip


def make_machine(scene: Scene) -> Machine:
    """Everything a replay of `scene` needs, at rest."""
    trees, bodies, pieces = len(scene.trees.role), len(scene.bodies.role), len(scene.pieces.kind)
    dofs, origins = len(scene.dofs.lower), joint_origins(scene)
    near, places, packed = make_near(NEAR_PAIRS), make_places(scene, NEAR_PAIRS), pack(scene)
    poses = np.zeros((bodies, 7))
    for tree in range(trees):
        pose_tree(packed, origins, tree, scene.trees.rest, np.zeros(dofs), poses)
        for frames in (places.base, places.frames, places.moved):
            place_tree(packed, tree, poses, frames)
    unknowns = 3 * trees + dofs
    room = DrivenRoom(
        origins, make_joints(scene, poses), np.zeros(bodies, np.int64), places, make_chain_room(scene, unknowns, MET), near,
        make_least_distance(unknowns, PLANES), make_rescue(make_near(NEAR_PAIRS)), np.zeros(pieces), np.zeros(bodies),
        np.zeros(dofs), np.zeros(dofs), np.zeros((trees, 7)), np.zeros(dofs), np.zeros((bodies, 7)),
    )  # fmt: skip
    return Machine(
        poses, poses.copy(), make_driven_state(scene), room, make_global_depths(NEAR_PAIRS),
        make_boxes(scene, places.base), np.zeros(trees), np.zeros((trees, 3)), np.zeros((8, 3)), np.zeros((8, 3)),
        make_simulated_state(scene, poses), poses.copy(), poses.copy(), scene.initial_velocity.copy(), np.zeros((trees, 3)),
        make_axes(), make_scratch(),
    )  # fmt: skip


@outlined
def place_recording(scene: Scene, m: Machine, roots: Floats, angles: Floats) -> None:
    """Forward kinematics of all trees the recording moves; their pieces and boxes as recorded."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        pose_tree(scene, m.room.origins, tree, roots, angles, m.recorded)
        place_tree(scene, tree, m.recorded, m.room.places.base)
        update_boxes(scene, m.room.places.base, m.boxes, tree)


@outlined
def measure_recorded(scene: Scene, m: Machine) -> float:
    """Overlaps of the recorded poses: fills `near` and `depths`; returns the deepest [m] of driven bodies with fixed and
    other driven ones.
    """
    near = m.room.near
    find_near(scene, m.room.places.base, m.boxes, m.still, 0.0, near, m.room.places.found, m.axes, m.scratch)
    global_depths(scene.pieces, near, m.depths)
    deepest = 0.0
    for k in range(near.count[0]):
        if scene.trees.role[near.tree_b[k]] != SIMULATED:
            deepest = max(deepest, -near.separation[k])
    return deepest


@outlined
def shift_driven(scene: Scene, m: Machine, roots: Floats) -> None:
    """Corrected poses: the recorded ones, driven trees translated by their offset (none: bit for bit the same)."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            for k in range(7):
                m.corrected[body, k] = m.recorded[body, k]
            if scene.trees.role[tree] == DRIVEN:
                for k in range(3):
                    m.corrected[body, k] += m.driven.offset[tree, k]
    if m.room.joints.any[0] == 1:
        pose_avatars(scene, m.room.origins, roots, m.room.chains.angles, m.driven.offset, m.corrected)


@kernel
def want_velocities(scene: Scene, m: Machine, dt: float) -> None:
    """Velocities of driven bodies at which they want to move, whatever holds them back."""
    p, bodies = m.room.places, scene.bodies
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
            held = p.goal[tree, i] - m.driven.offset[tree, i]
            m.velocity[body, i] = (c1[i] - c0[i] + held) / dt
            m.velocity[body, 3 + i] = turn[i] / dt


@kernel
def place_simulated(scene: Scene, m: Machine, tree: int, poses: Floats) -> None:
    """Pieces and boxes of a simulated tree at its row of `poses` (B, 7)."""
    p = m.room.places
    place_tree(scene, tree, poses, p.base)
    place_at(scene, p.base, m.still_offset, tree, p.frames)
    place_at(scene, p.base, m.still_offset, tree, p.moved)
    update_boxes(scene, p.base, m.boxes, tree)


@kernel
def _meets_driven(scene: Scene, m: Machine, tree: int) -> bool:
    """Whether a simulated tree overlaps a driven one as that ended the last frame."""
    near = m.room.near
    near.count[0] = 0
    for other in range(len(scene.trees.role)):
        if scene.trees.role[other] == DRIVEN:
            update_boxes(scene, m.room.places.frames, m.boxes, other)
            near_pairs_of_trees(scene, m.room.places.frames, m.boxes, other, tree, 0.0, near, m.axes, m.scratch)
    for k in range(near.count[0]):  # noqa: SIM110 - a kernel cannot take a generator
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


@outlined
def simulate_bodies(scene: Scene, m: Machine, dt: float, knobs: Knobs) -> tuple[int, int]:
    """Move the simulated bodies through the frame; what hits a driven tree changes its offset's speed.

    Returns the impacts and the flags of `simulate`.
    """
    if len(m.simulated.free) == 0 or dt <= 0.0:
        return 0, 0
    want_velocities(scene, m, dt)
    for tree in range(len(m.impulse)):
        for i in range(3):
            m.impulse[tree, i] = 0.0
    p = m.room.places
    impacts, flags = simulate(
        scene.pieces, m.simulated, m.start, m.corrected, m.velocity, m.impulse, p.moved, dt, knobs.max_impacts, knobs.gap,
        m.scratch,
    )  # fmt: skip
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            for i in range(3):
                m.driven.speed[tree, i] += m.impulse[tree, i] / scene.trees.mass[tree]
        elif scene.trees.role[tree] == SIMULATED:
            body = scene.trees.body_start[tree]
            for k in range(7):
                m.recorded[body, k] = m.corrected[body, k]
            place_simulated(scene, m, tree, m.corrected)
    return impacts, flags


@outlined
def yield_to_simulated(scene: Scene, m: Machine, roots: Floats, knobs: Knobs) -> int:
    """Where a simulated body ended inside a driven one, the driven one gives way. Returns the rounds this took."""
    p, near = m.room.places, m.room.near
    find_near(scene, p.frames, m.boxes, m.still, 0.0, near, p.found, m.axes, m.scratch)
    for k in range(near.count[0]):
        if near.separation[k] < 0.0 and scene.trees.role[near.tree_b[k]] == SIMULATED:
            rounds = give_way(scene, m.driven, m.room, m.boxes, knobs.gap, knobs.rounds, m.axes, m.scratch)
            shift_driven(scene, m, roots)
            return rounds
    return 0


@outlined
def find_contacts(scene: Scene, m: Machine, gap: float, block: Block, frame: int) -> float:
    """Contacts of the final poses, written to `block`; returns the deepest overlap that is left [m]."""
    places, near = m.room.places, m.room.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, places.frames, m.boxes, tree)
    room = CONTACT_GAPS * gap
    find_near(scene, places.frames, m.boxes, m.still, room, near, places.found, m.axes, m.scratch)
    deepest = write_contacts(
        scene, places.frames, near, m.driven.offset, m.points_a, m.points_b, block, frame, m.scratch
    )
    if len(m.simulated.free) > 0:
        block.contact_end[frame + 1] = write_touches(
            m.simulated, m.corrected, block.contact_bodies, block.contact_values, block.contact_end[frame + 1]
        )
    return deepest


@kernel
def measure_correction(scene: Scene, m: Machine, lengths: Floats) -> None:
    """Largest distance and angle of a driven body from where it was recorded, into `lengths`."""
    far, turn = 0.0, 0.0
    for body in range(len(scene.bodies.role)):
        if scene.bodies.role[body] != DRIVEN:
            continue
        square, cosine = 0.0, 0.0
        for k in range(3):
            square += (m.corrected[body, k] - m.recorded[body, k]) ** 2
        for k in range(3, 7):
            cosine += (m.corrected[body, k] - m.recorded[body, k]) ** 2
        far = max(far, np.sqrt(square))
        turn = max(turn, 4.0 * np.arcsin(min(1.0, 0.5 * np.sqrt(cosine))))
    lengths[CORRECTION], lengths[TURN] = far, turn


@kernel
def step(
    scene: Scene, m: Machine, roots: Floats, angles: Floats, dt: float, knobs: Knobs, block: Block, frame: int
) -> None:
    """One frame: from the recorded roots (T, 7) and angles (Q,) to its row of `block`.

    `dt` [s] is the time since the frame before it; the first frame's does not matter.
    """
    lengths, numbers, clock = block.lengths[frame], block.numbers[frame], block.cycles[frame]
    first = m.driven.started[0] == 0
    t0 = cycles()
    for body in range(len(m.start)):
        if scene.trees.moving[scene.bodies.tree[body]] == 1:
            for k in range(7):
                m.start[body, k] = m.corrected[body, k]
    place_recording(scene, m, roots, angles)
    t1 = cycles()
    lengths[RECORDED] = measure_recorded(scene, m)
    t2 = cycles()
    if not first:
        predict_simulated(scene, m, dt)
    done = update_driven(
        scene, m.driven, m.room, m.boxes, roots, angles, m.recorded, dt, knobs.gap, knobs.rounds, m.axes, m.scratch
    )
    shift_driven(scene, m, roots)
    t3 = cycles()
    impacts, flags = 0, 0
    if not first and len(m.simulated.free) > 0:
        impacts, flags = simulate_bodies(scene, m, dt, knobs)
        yield_to_simulated(scene, m, roots, knobs)
    t4 = cycles()
    write_depths(block, frame, m.depths, done.method)
    lengths[RESIDUAL] = find_contacts(scene, m, knobs.gap, block, frame)
    measure_correction(scene, m, lengths)
    t5 = cycles()
    for k in range(len(block.moving)):
        for i in range(7):
            block.recorded[frame, k, i] = m.recorded[block.moving[k], i]
            block.corrected[frame, k, i] = m.corrected[block.moving[k], i]
    for k in range(len(angles)):
        block.angles[frame, k] = m.room.chains.angles[k] if m.room.joints.held[k] == 1 else angles[k]
    numbers[ITERATIONS], numbers[IMPACTS], numbers[FALLBACKS], numbers[FLAGS] = (
        done.rounds,
        impacts,
        done.rescues,
        flags,
    )
    if not done.converged:
        numbers[FLAGS] |= FLAG_NOT_CONVERGED
    if first and lengths[RECORDED] > 0.0:
        numbers[FLAGS] |= FLAG_STARTED_INSIDE
    clock[KINEMATICS], clock[RECORDED_DEPTH], clock[OVERLAP] = t1 - t0, t2 - t1, t3 - t2
    clock[IMPULSES], clock[CONTACTS], clock[WHOLE] = t4 - t3, t5 - t4, t5 - t0
    counts = block.counts[frame]
    counts[KINEMATICS], counts[RECORDED_DEPTH], counts[OVERLAP] = len(block.moving), m.depths.count[0], done.rounds
    counts[IMPULSES], counts[WHOLE] = impacts, 1
    counts[CONTACTS] = block.contact_end[frame + 1] - block.contact_end[frame]


@kernel
def run_block(
    scene: Scene,
    m: Machine,
    roots: Floats,
    angles: Floats,
    dts: Floats,
    drifts: Floats,
    knobs: Knobs,
    hasty: bool,
    block: Block,
) -> int:
    """Step through frames.

    Parameters
    ----------
    scene, m, knobs
        The scene, the machine, which is brought up to date, and the configuration.
    roots, angles, dts, drifts
        (N, T, 7), (N, Q), (N,) and (N, T, 3): the recording, the times between frames [s], and where trees are to step
        aside.
    hasty
        Stop at the first frame in which a tree is wedged.
    block
        Takes the results.

    Returns
    -------
    int
        How many frames were done before `block` had no more room: at least one.
    """
    m.room.places.hasty[0] = 1 if hasty else 0
    block.contact_end[0] = block.depth_end[0] = 0
    for frame in range(len(dts)):
        if not has_room(block, frame):
            return frame
        for tree in range(drifts.shape[1]):
            for i in range(3):
                m.driven.drift[tree, i] = drifts[frame, tree, i]
        step(scene, m, roots[frame], angles[frame], dts[frame], knobs, block, frame)
        if hasty and block.numbers[frame, FALLBACKS] > 0:
            return frame
    return len(dts)
