"""State and scratch of a replay: everything that changes from frame to frame, made once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import MOTION_BOUND, Detection, make_axes, make_near
from geomphys.collision.global_depth import GlobalDepths, make_global_depths
from geomphys.collision.penetration import make_scratch
from geomphys.collision.sweep import make_boxes
from geomphys.driven.contacts_kept import RECORDED_ON
from geomphys.driven.links import Links, make_links
from geomphys.driven.paper.state import PaperWorkspace
from geomphys.driven.state import (
    DrivenState,
    DrivenWorkspace,
    make_driven_state,
    make_driven_workspace,
    make_piece_frames,
)
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.engine.coupled_state import Coupled, make_coupled
from geomphys.engine.fingertips import Fingertips, make_fingertips
from geomphys.jit.packed_records import pack
from geomphys.scene.arrays import DRIVEN, FIXED, SIMULATED, Scene
from geomphys.scene.kinematics import joint_origins, pose_pieces_of_tree, pose_tree
from geomphys.simulated.allocation import make_simulation
from geomphys.simulated.state import Records, Simulation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEAR_PAIRS = 1 << 14  # most pairs of pieces that can be near at once


RECORDED_PATH = np.dtype(
    [
        ("position", np.float64, 3),  # m
        ("velocity", np.float64, 3),  # m/s, mean over the frame
        ("change", np.float64, 3),  # m/s²: change of that since the frame before
        ("acceleration", np.float64, 3),  # m/s², extrapolated to the middle of the frame
        ("duration", np.float64),  # s, of the frame
    ]
)
"""Motion of the recorded root of a driven tree through the last frame."""


class Method(NamedTuple):
    """How driven bodies are corrected: one of the fields is None."""

    exact: float | None  # m; clearance of the exact method
    paper: PaperWorkspace | None  # of the published method


class StepParameters(NamedTuple):
    """The part of the configuration that the step reads."""

    gap: float
    max_impacts: int
    method: Method


class ReplayData(NamedTuple):
    """State and workspace of a replay, which change from frame to frame. Made by `make_replay_data`."""

    recorded: Floats  # (B, 7) poses as recorded
    corrected: Floats  # (B, 7)
    driven: DrivenState
    workspace: DrivenWorkspace
    depths: GlobalDepths
    detection: Detection
    still: Records  # (T,) MOTION_BOUND, zero: overlaps are measured without a margin for motion
    touching: Records  # (T,) MOTION_BOUND, zero, but of fixed trees how near recorded contacts are to them
    without_simulated: Records  # (T,) MOTION_BOUND, zero, but -inf of simulated trees: nothing is near them
    simulated: Simulation
    start: Floats  # (B, 7) poses at the frame's start
    velocity: Floats  # (B, 6) m/s of the centre of mass and rad/s, world, of simulated bodies
    coupled: Coupled
    recorded_path: Records  # (T,) RECORDED_PATH
    roots: Floats  # (T, 7) recorded root poses within a frame
    angles: Floats  # (Q,) recorded angles within a frame
    posture: Floats  # (Q,) angles at the frame's start
    fingertips: Fingertips
    tip_detection: Detection  # for the measures of contacts: caches directions separately from those of the solver


def _touching(scene: Scene) -> Records:
    """The bounds for `ReplayData.touching`: zero where no tree that follows the recording has joints."""
    touching, jointed = np.zeros(len(scene.trees.role), MOTION_BOUND), np.diff(scene.trees.dof_start) > 0
    if (jointed & (scene.trees.role == DRIVEN)).any():
        touching["world"][scene.trees.role == FIXED] = RECORDED_ON
    return touching


def make_replay_data(
    scene: Scene,
    iterations: int = 30,
    is_thumb: Ints | None = None,
    weights: Weights = WEIGHTS,
    links: Links | None = None,
) -> ReplayData:
    """State and workspace for a replay of `scene`, at rest.

    `iterations` bounds those of a search for a posture; `is_thumb` (B,) marks the links of thumbs; `weights` are those of
    the objective; `links` are those of `make_links`, if they are known already.
    """
    trees, bodies = len(scene.trees.role), len(scene.bodies.role)
    dofs, origins = len(scene.dofs.lower), joint_origins(scene)
    near, piece_frames, packed = make_near(NEAR_PAIRS), make_piece_frames(scene), pack(scene)
    poses = np.zeros((bodies, 7))
    for tree in range(trees):
        pose_tree(packed, origins, tree, scene.trees.rest, np.zeros(dofs), poses)
        pose_pieces_of_tree(packed, tree, poses, piece_frames.base)
    for frames in (piece_frames.frames, piece_frames.before, piece_frames.iterate, piece_frames.moved):
        frames[:] = piece_frames.base
    boxes, scratch, found = make_boxes(scene, piece_frames.base), make_scratch(), np.zeros(trees, np.int64)
    detection = Detection(boxes, make_axes(), scratch, found)
    links = make_links(scene, weights) if links is None else links
    workspace = make_driven_workspace(scene, poses, links, piece_frames, near, detection, iterations, weights)
    corrected, start = poses.copy(), poses.copy()
    velocity = scene.initial_velocity.copy()
    without_simulated = np.zeros(trees, MOTION_BOUND)
    without_simulated["world"][scene.trees.role == SIMULATED] = -np.inf
    return ReplayData(
        recorded=poses,
        corrected=corrected,
        driven=make_driven_state(scene, poses),
        workspace=workspace,
        depths=make_global_depths(NEAR_PAIRS),
        detection=detection,
        still=np.zeros(trees, MOTION_BOUND),
        touching=_touching(scene),
        without_simulated=without_simulated,
        simulated=make_simulation(
            scene, poses, start=start, end=corrected, reported=velocity, frames=piece_frames.moved,
            scratch=scratch,
        ),
        start=start,
        velocity=velocity,
        coupled=make_coupled(scene, poses, workspace.links),
        recorded_path=np.zeros(trees, RECORDED_PATH),
        roots=np.zeros((trees, 7)),
        angles=np.zeros(dofs),
        posture=np.zeros(dofs),
        fingertips=make_fingertips(scene, workspace.links, is_thumb),
        tip_detection=Detection(boxes, make_axes(1 << 10), scratch, found),
    )  # fmt: skip
