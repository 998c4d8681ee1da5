"""Containment: a driven body that becomes non-finite is put back to its last good state, within the frame.

Inputs are bounded and checked where they are read, so this is for overflow at the limits of floating point, or a fault of the
program. Simulated bodies are put back by their own loop (`geomphys.simulated.frame.finish`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.sweep import update_boxes
from geomphys.driven.targets import clear_link_offset, find_recorded_motion, store_tree_offsets
from geomphys.driven.tremor import clear_tremor
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.results import FLAG_QUARANTINED
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import pose_pieces_of_tree

Floats = NDArray[np.float64]

FARTHEST = 1e15  # m, m/s, rad/s: beyond, a square may overflow


@kernel
def _is_good(value: float) -> bool:
    """Whether a number is finite and can be squared; false for NaN."""
    return abs(value) < FARTHEST


@kernel
def _is_sound(scene: Scene, data: ReplayData, tree: int) -> bool:
    """Whether the whole state of a driven tree is finite."""
    for i in range(3):
        if not (_is_good(data.driven.offset[tree, i]) and _is_good(data.driven.offset_velocity[tree, i])):
            return False
    for body in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        for k in range(7):
            if not _is_good(data.corrected[body, k]):
                return False
        offset = data.driven.link_offsets[body]
        for i in range(3):
            if not (_is_good(offset.translation[i]) and _is_good(offset.velocity[i])):
                return False
            if not (_is_good(offset.rotation[i]) and _is_good(offset.angular_velocity[i])):
                return False
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):  # noqa: SIM110 - no generators in kernels
        if not _is_good(data.driven.last.angles[q]):
            return False
    return True


@kernel
def keep_posture(data: ReplayData) -> None:
    """Save the angles of the end of the last frame, which `contain_driven` restores."""
    for q in range(len(data.posture)):
        angle = data.driven.last.angles[q]
        if _is_good(angle):
            data.posture[q] = angle


@noinline
def _put_back(scene: Scene, data: ReplayData, tree: int, roots: Floats, angles: Floats, first: bool) -> None:
    """Restore a tree to its pose at the frame's start, at rest; in the first frame to its recorded pose."""
    p, state = data.workspace.piece_frames, data.driven
    root, last = scene.trees.body_start[tree], scene.trees.body_start[tree + 1]
    for k in range(7):
        state.last.roots[tree, k] = roots[tree, k] if first else data.start[root, k]
        state.recorded.roots[tree, k] = roots[tree, k]
    for q in range(scene.trees.dof_start[tree], scene.trees.dof_start[tree + 1]):
        state.last.angles[q] = angles[q] if first else data.posture[q]
        state.recorded.angles[q] = angles[q]
    for body in range(root, last):
        for k in range(7):
            data.corrected[body, k] = data.recorded[body, k] if first else data.start[body, k]
            state.last.poses[body, k], state.recorded.poses[body, k] = data.corrected[body, k], data.recorded[body, k]
        clear_link_offset(state, body)
    for i in range(3):
        state.offset[tree, i] = state.offset_velocity[tree, i] = state.last_offset_velocity[tree, i] = 0.0
    clear_tremor(state, tree)
    state.progress.dt = 0.0  # at rest: contacts give its offsets no rate
    find_recorded_motion(scene, state, data.workspace, tree, data.recorded)
    store_tree_offsets(scene, state, data.workspace, tree, data.recorded, not first)
    pose_pieces_of_tree(scene, tree, data.corrected, p.frames)
    pose_pieces_of_tree(scene, tree, data.corrected, p.moved)
    update_boxes(scene, p.frames, data.detection.boxes, tree)


@noinline
def contain_driven(scene: Scene, data: ReplayData, roots: Floats, angles: Floats, first: bool) -> int:
    """Put every driven tree that is not finite back to its last good state.

    Parameters
    ----------
    scene, m
        The scene and the data of the replay, whose `start` and `posture` hold the last good state.
    roots, angles
        (T, 7) and (Q,): the recording up to which the driven loop has gone.
    first
        Whether this is the first frame.

    Returns
    -------
    int
        `FLAG_QUARANTINED` if there was one, else 0.
    """
    flags = 0
    for tree in range(len(scene.trees.role)):
        if scene.trees.role[tree] == DRIVEN and not _is_sound(scene, data, tree):
            _put_back(scene, data, tree, roots, angles, first)
            flags = FLAG_QUARANTINED
    if flags != 0:  # cached directions may derive from values that are not finite
        for k in range(len(data.detection.axes.rows)):
            data.detection.axes.rows[k].pair = -1
    return flags
