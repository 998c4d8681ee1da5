"""The pipeline: one compiled step a frame, and the replay of a whole log. The only module that knows every stage."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

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
    contacts_of,
    has_room,
    make_block,
    metrics_of,
    penetrations_of,
    poses_of,
    write_contacts,
    write_depths,
)
from geomphys.collision.detect import Axes, find_near, make_axes, make_near
from geomphys.collision.global_depth import GlobalDepths, global_depths, make_global_depths
from geomphys.collision.penetration import Scratch, make_scratch
from geomphys.collision.sweep import Boxes, make_boxes, update_boxes
from geomphys.config import Config
from geomphys.driven.escape import make_rescue
from geomphys.driven.least_distance import make_least_distance
from geomphys.driven.overlap import make_places
from geomphys.driven.chains import make_chain_room
from geomphys.driven.posture import make_joints, pose_avatars
from geomphys.driven.steps import is_recorded
from geomphys.driven.update import DrivenRoom, DrivenState, make_driven_state, update_driven
from geomphys.errors import GeomphysError
from geomphys.kernel import kernel
from geomphys.packed import pack
from geomphys.load import load_world
from geomphys.provenance import provenance_of
from geomphys.recording.frames import FrameSource
from geomphys.results import FLAG_NOT_CONVERGED, FLAG_STARTED_INSIDE, Frame, FrameResult
from geomphys.sinks.base import Sink
from geomphys.timing import STAGES, cycles, ns_per_cycle
from geomphys.world.kinematics import joint_origins, place_tree, pose_tree
from geomphys.world.scene import DRIVEN, SIMULATED, Scene, World

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


class Machine(NamedTuple):
    """State and scratch of a replay: what changes from frame to frame. Made by `make_machine`."""

    recorded: Floats  # (B, 7) poses as recorded
    corrected: Floats  # (B, 7)
    driven: DrivenState
    room: DrivenRoom
    depths: GlobalDepths
    boxes: Boxes
    still: Floats  # (T,) zeros: no tree moves while its overlaps are measured
    points_a: Floats  # (8, 3) of a contact manifold
    points_b: Floats  # (8, 3)
    axes: Axes
    scratch: Scratch


def make_machine(scene: Scene) -> Machine:
    """Everything a replay of `scene` needs, at rest."""
    trees, bodies, pieces = len(scene.trees.role), len(scene.bodies.role), len(scene.pieces.kind)
    dofs, origins = len(scene.dofs.lower), joint_origins(scene)
    near, places = make_near(NEAR_PAIRS), make_places(scene, NEAR_PAIRS)
    poses = np.zeros((bodies, 7))
    for tree in range(trees):
        pose_tree(scene, origins, tree, scene.trees.rest, np.zeros(dofs), poses)
        for frames in (places.base, places.frames, places.moved):
            place_tree(scene, tree, poses, frames)
    unknowns = 3 * trees + dofs
    room = DrivenRoom(
        origins, make_joints(scene, poses), np.zeros(bodies, np.int64), places, make_chain_room(scene, unknowns, MET), near,
        make_least_distance(unknowns, PLANES), make_rescue(make_near(NEAR_PAIRS)), np.zeros(pieces), np.zeros(bodies),
        np.zeros(dofs), np.zeros(dofs), np.zeros((trees, 7)), np.zeros(dofs), np.zeros((bodies, 7)),
    )  # fmt: skip
    return Machine(
        poses, poses.copy(), make_driven_state(scene), room, make_global_depths(NEAR_PAIRS),
        make_boxes(scene, places.base), np.zeros(trees), np.zeros((8, 3)), np.zeros((8, 3)),
        make_axes(), make_scratch(),
    )  # fmt: skip


@kernel
def place_recording(scene: Scene, m: Machine, roots: Floats, angles: Floats) -> None:
    """Forward kinematics of all trees the recording moves; their pieces and boxes as recorded."""
    for tree in range(len(scene.trees.role)):
        if not is_recorded(scene, tree):
            continue
        pose_tree(scene, m.room.origins, tree, roots, angles, m.recorded)
        place_tree(scene, tree, m.recorded, m.room.places.base)
        update_boxes(scene, m.room.places.base, m.boxes, tree)


@kernel
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


@kernel
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
def find_contacts(scene: Scene, m: Machine, gap: float, block: Block, frame: int) -> float:
    """Contacts of the final poses, written to `block`; returns the deepest overlap that is left [m]."""
    places, near = m.room.places, m.room.near
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN:
            update_boxes(scene, places.frames, m.boxes, tree)
    room = CONTACT_GAPS * gap
    find_near(scene, places.frames, m.boxes, m.still, room, near, places.found, m.axes, m.scratch)
    return write_contacts(
        scene, places.frames, near, m.driven.offset, m.points_a, m.points_b, block, frame, m.scratch
    )


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
    place_recording(scene, m, roots, angles)
    t1 = cycles()
    lengths[RECORDED] = measure_recorded(scene, m)
    t2 = cycles()
    done = update_driven(
        scene, m.driven, m.room, m.boxes, roots, angles, m.recorded, dt, knobs.gap, knobs.rounds, m.axes, m.scratch
    )
    shift_driven(scene, m, roots)
    t3 = cycles()
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
        block.angles[frame, k] = m.room.chains.angles[k] if m.room.joints.yields[k] == 1 else angles[k]
    numbers[ITERATIONS], numbers[IMPACTS], numbers[FALLBACKS], numbers[FLAGS] = done.rounds, 0, done.rescues, 0
    if not done.converged:
        numbers[FLAGS] |= FLAG_NOT_CONVERGED
    if first and lengths[RECORDED] > 0.0:
        numbers[FLAGS] |= FLAG_STARTED_INSIDE
    clock[KINEMATICS], clock[RECORDED_DEPTH], clock[OVERLAP] = t1 - t0, t2 - t1, t3 - t2
    clock[IMPULSES], clock[CONTACTS], clock[WHOLE] = t4 - t3, t5 - t4, t5 - t0
    counts = block.counts[frame]
    counts[KINEMATICS], counts[RECORDED_DEPTH], counts[OVERLAP] = len(block.moving), m.depths.count[0], done.rounds
    counts[IMPULSES], counts[WHOLE] = 0, 1
    counts[CONTACTS] = block.contact_end[frame + 1] - block.contact_end[frame]


@kernel
def run_block(scene: Scene, m: Machine, roots: Floats, angles: Floats, dts: Floats, knobs: Knobs, block: Block) -> int:
    """Step through frames, roots (N, T, 7), angles (N, Q), times between them dts (N,) [s]; returns how many were done
    before `block` had no more room (at least one).
    """
    block.contact_end[0] = block.depth_end[0] = 0
    for frame in range(len(dts)):
        if not has_room(block, frame):
            return frame
        step(scene, m, roots[frame], angles[frame], dts[frame], knobs, block, frame)
    return len(dts)


def moving_bodies(scene: Scene) -> Ints:
    """Bodies of trees that move."""
    return np.flatnonzero(scene.trees.moving[scene.bodies.tree]).astype(np.int64)


class Pipeline:
    """A scene ready to run: takes frames, gives results, remembers what lies between."""

    def __init__(self, world: World, config: Config) -> None:
        self.world = world
        self.machine = make_machine(world.scene)
        self.knobs = Knobs(config.gap, config.max_iterations, config.max_impacts)
        self.block = make_block(moving_bodies(world.scene), self.machine.recorded.copy(), len(world.scene.dofs.lower))
        self._packed = pack(world.scene), pack(self.machine), pack(self.block)
        self._last_ns: int | None = None

    def run(self, frames: Sequence[Frame]) -> Iterator[tuple[Frame, int]]:
        """Step through `frames`; yields each with its row of `block`, valid until the next is asked for."""
        times = [self._last_ns if self._last_ns is not None else frames[0].time_ns, *(f.time_ns for f in frames)]
        dts = np.diff(np.array(times, dtype=np.int64)) * 1e-9
        roots = np.stack([f.roots for f in frames])
        angles = np.stack([f.angles for f in frames])
        done = 0
        while done < len(frames):
            scene, machine, block = self._packed
            count = run_block(scene, machine, roots[done:], angles[done:], dts[done:], self.knobs, block)
            if count == 0 or self.machine.room.near.lost[0]:
                raise GeomphysError(
                    f"frame {frames[done].index}: more than {NEAR_PAIRS} pairs of convex pieces are near each other at "
                    "once; decompose the meshes into fewer pieces"
                )
            for row in range(count):
                yield frames[done + row], row
            done += count
        self._last_ns = frames[-1].time_ns

    def result(self, frame: Frame, row: int, decode_ns: int, encode_ns: int) -> FrameResult:
        """The result of a frame whose step is in `row` of the block."""
        block = self.block
        scale = ns_per_cycle()
        stages = [("decode", decode_ns, 1), ("step", int(block.cycles[row, WHOLE] * scale), 1)]
        stages += [
            (name, int(block.cycles[row, k] * scale), int(block.counts[row, k])) for k, name in enumerate(STAGES)
        ]
        return FrameResult(
            frame=frame,
            recorded=poses_of(block, block.recorded[row]),
            corrected=poses_of(block, block.corrected[row]),
            angles=block.angles[row].copy(),
            contacts=contacts_of(block, row),
            penetrations=penetrations_of(block, row),
            metrics=metrics_of(block, row, frame.held, frame.flags),
            timing=(*stages, ("encode", encode_ns, 1)),
        )


def replay(
    log: Path | str,
    scene: Path | str | World,
    *,
    config: Config | None = None,
    sinks: Sequence[Sink] = (),
    progress: Callable[[int, int | None], None] | None = None,
) -> Iterator[FrameResult]:
    """Replay a log in a scene; yields one result a frame.

    Parameters
    ----------
    log
        An MCAP file or a ROS 2 bag directory.
    scene
        A scene file or the world it was loaded into.
    config
        All parameters; None: the defaults.
    sinks
        Opened before the first frame, given every frame, closed after the last; closed as incomplete if the replay ends
        early (an error, or the caller stops iterating).
    progress
        Called after each frame with the number of frames done and, if known, of all.

    Yields
    ------
    FrameResult
        In order of time. The stage `encode` of a frame is what the sinks took for the frame before it.

    Raises
    ------
    InputError
        The log, the scene or a model is wrong.
    OutputError
        A sink cannot write.
    """
    config = config or Config()
    world = scene if isinstance(scene, World) else load_world(Path(scene), mode=config.mode, seed=config.seed)
    opened: list[Sink] = []
    complete = False
    try:
        with FrameSource(Path(log), world, config) as source:
            provenance = provenance_of(Path(log), world, config) if sinks else None
            for sink in sinks:
                assert provenance is not None
                sink.open(world, config, provenance)
                opened.append(sink)
            yield from _frames(source, Pipeline(world, config), sinks, progress)
        complete = True
    finally:
        for sink in opened:
            sink.close(complete)


def _frames(
    source: FrameSource, pipeline: Pipeline, sinks: Sequence[Sink], progress: Callable[[int, int | None], None] | None
) -> Iterator[FrameResult]:
    frames, done, encode_ns = iter(source), 0, 0
    while True:
        start = time.perf_counter_ns()
        chunk = [frame for _, frame in zip(range(len(pipeline.block.angles)), frames, strict=False)]
        decode_ns = (time.perf_counter_ns() - start) // max(len(chunk), 1)
        if not chunk:
            return
        for frame, row in pipeline.run(chunk):
            result = pipeline.result(frame, row, decode_ns, encode_ns)
            start = time.perf_counter_ns()
            for sink in sinks:
                sink.write(result)
            encode_ns = time.perf_counter_ns() - start
            done += 1
            if progress is not None:
                progress(done, source.expected_frames)
            yield result
