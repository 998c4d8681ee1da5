"""State and scratch of a replay: everything that changes from frame to frame, made once."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, make_axes, make_near
from geomphys.collision.global_depth import GlobalDepths, make_global_depths
from geomphys.collision.penetration import Scratch, make_scratch
from geomphys.collision.sweep import Boxes, make_boxes
from geomphys.driven.ccd import make_ccd_room
from geomphys.driven.chain_room import make_chain_room
from geomphys.driven.escape import make_rescue
from geomphys.driven.hold import make_carried, make_wanted
from geomphys.driven.least_distance import make_least_distance
from geomphys.driven.places import make_places
from geomphys.driven.posture import make_joints
from geomphys.driven.state import DrivenRoom, DrivenState, make_driven_state
from geomphys.driven.steps import make_stir
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import joint_origins, place_tree, pose_tree
from geomphys.simulated.allocation import make_simulated_state
from geomphys.simulated.state import SimulatedState

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR_PAIRS = 1 << 14  # most pairs of pieces that can be near at once
PLANES = 512  # most planes of a least-distance problem
MET = 2048  # most pairs that chains yield to at once


class Knobs(NamedTuple):
    """What the step needs of the configuration."""

    gap: float
    rounds: int
    max_impacts: int


class State(NamedTuple):
    """What frames leave behind for the next ones, but for remembered directions, which only save time."""

    driven: DrivenState
    simulated: SimulatedState
    recorded: Floats
    corrected: Floats
    velocity: Floats
    boxes: Boxes
    base: Floats
    frames: Floats
    moved: Floats
    course: Floats


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
    still: Floats  # (T, 2) zeros: no tree moves while its overlaps are measured
    still_offset: Floats  # (T, 3) zeros
    points_a: Floats  # (8, 3) of a contact manifold
    points_b: Floats  # (8, 3)
    simulated: SimulatedState
    start: Floats  # (B, 7) poses at the frame's start
    predicted: Floats  # (B, 7) poses of simulated bodies at the frame's end, by their velocity
    velocity: Floats  # (B, 6) m/s of the centre of mass and rad/s, world
    impulse: Floats  # (T, 3) N s that simulated bodies gave to driven trees
    coupling: Floats  # (T, 6) offset [m] of driven trees before their turn, and its speed [m/s] after a free one
    course: Floats  # (T, 13) of recorded roots, as `note_courses` fills it
    roots: Floats  # (T, 7) recorded root poses within a frame
    angles: Floats  # (Q,) recorded angles within a frame
    posture: Floats  # (Q,) angles at the frame's start
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
            self.course,
        )  # fmt: skip


def make_machine(scene: Scene, seed: int = 0) -> Machine:
    """Everything a replay of `scene` needs, at rest; `seed` is that of the order in which chains are dealt with."""
    trees, bodies = len(scene.trees.role), len(scene.bodies.role)
    dofs, origins = len(scene.dofs.lower), joint_origins(scene)
    near, places, packed = make_near(NEAR_PAIRS), make_places(scene, NEAR_PAIRS), pack(scene)
    poses = np.zeros((bodies, 7))
    for tree in range(trees):
        pose_tree(packed, origins, tree, scene.trees.rest, np.zeros(dofs), poses)
        for frames in (places.base, places.frames, places.moved):
            place_tree(packed, tree, poses, frames)
    joints = make_joints(scene, poses)
    unknowns = max(3, 3 * int(np.sum(scene.trees.role == DRIVEN)) + int(joints.held.sum()))
    room = DrivenRoom(
        origins, joints, np.zeros(bodies, np.int64), places, make_chain_room(scene, unknowns, MET),
        make_ccd_room(scene, joints), near, make_least_distance(unknowns, PLANES),
        make_rescue(make_near(NEAR_PAIRS)), make_stir(scene), np.zeros(dofs), np.zeros(dofs),
        np.zeros((trees, 7)), np.zeros(dofs), np.zeros((bodies, 7)),
        np.zeros((trees, 3)), np.ones(1), np.array([seed]), make_wanted(trees, dofs, bodies), make_carried(trees),
    )  # fmt: skip
    return Machine(
        poses, poses.copy(), make_driven_state(scene), room, make_global_depths(NEAR_PAIRS),
        make_boxes(scene, places.base), np.zeros((trees, 2)), np.zeros((trees, 3)), np.zeros((8, 3)), np.zeros((8, 3)),
        make_simulated_state(scene, poses), poses.copy(), poses.copy(), scene.initial_velocity.copy(), np.zeros((trees, 3)),
        np.zeros((trees, 6)), np.zeros((trees, 13)),
        np.zeros((trees, 7)), np.zeros(dofs), np.zeros(dofs), make_axes(), make_scratch(),
    )  # fmt: skip
