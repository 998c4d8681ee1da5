"""What happens between two corrected frames: bodies on straight ways from one to the next, checked at 1 kHz."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import find_near
from geomphys.collision.sweep import update_boxes
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.jit.kernel import kernel
from geomphys.jit.packed_records import pack
from geomphys.numerics.vec3 import add_scaled, slerp, sub
from geomphys.scene.arrays import SIMULATED, Scene
from geomphys.scene.kinematics import orientation_of, pose_pieces_of_tree, position_of, set_pose
from geomphys.scene.world import World

Floats = NDArray[np.float64]

RATE = 1000.0  # Hz
SHARE = 0.2  # of the mean thickness of two pieces: what is no deeper cannot be on its way through
MAX_SAMPLES = 100  # between two frames


@kernel
def deepest_at(scene: Scene, data: ReplayData, before: Floats, after: Floats, share: float) -> float:
    """Largest depth over mean thickness of a driven piece and one of another tree that is not simulated, at poses (B, 7) a
    share of the way from `before` to `after`.
    """
    pieces = data.workspace.piece_frames
    for tree in range(len(scene.trees.role)):
        if scene.trees.moving[tree] == 0:
            continue
        for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
            p, q = position_of(before, body), slerp(orientation_of(before, body), orientation_of(after, body), share)
            set_pose(data.corrected, body, add_scaled(p, sub(position_of(after, body), p), share), q)
        pose_pieces_of_tree(scene, tree, data.corrected, pieces.frames)
        update_boxes(scene, pieces.frames, data.detection.boxes, tree)
    near, worst = data.workspace.near, 0.0
    find_near(scene, pieces.frames, data.still, 0.0, math.inf, near, data.detection)
    for k in range(near.counts.filled):
        a, b = near.tree_a[k], near.tree_b[k]
        if a != b and scene.trees.role[a] != SIMULATED and scene.trees.role[b] != SIMULATED:
            mean = 0.5 * (scene.pieces.thickness[near.a[k]] + scene.pieces.thickness[near.b[k]])
            worst = max(worst, -near.separation[k] / mean)
    return worst


class Passage:
    """Takes corrected frames in order and tells of each whether something was passed into on the way to it."""

    def __init__(self, world: World) -> None:
        self._scene, self._machine = pack(world.scene), pack(make_replay_data(world.scene))
        self._before: tuple[int, Floats] | None = None

    def add(self, time_ns: int, poses: Floats) -> bool:
        """Whether on the way to `poses` (B, 7) a pair is deeper than `SHARE`, but not in the frames at its ends."""
        before, self._before = self._before, (time_ns, poses)
        if before is None or np.array_equal(before[1], poses):
            return False
        samples = min(math.ceil(1e-9 * (time_ns - before[0]) * RATE), MAX_SAMPLES)
        ends = max(self._depth(before[1], poses, share) for share in (0.0, 1.0))
        return ends <= SHARE and any(self._depth(before[1], poses, k / samples) > SHARE for k in range(1, samples))

    def _depth(self, before: Floats, after: Floats, share: float) -> float:
        return float(deepest_at(self._scene, self._machine, before, after, share))
