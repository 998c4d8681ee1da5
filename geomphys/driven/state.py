"""State of the driven loop from frame to frame, and its workspace."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Detection, Near, make_near
from geomphys.driven.links import Links, make_links
from geomphys.driven.postures import Posture, make_posture
from geomphys.driven.qp import Quadratic, make_quadratic
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.jit.packed_records import Record
from geomphys.scene.arrays import DRIVEN, Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

PAIRS = 1 << 14  # most pairs of pieces that can be near at once
ROWS = 1024  # most rows of a quadratic problem
SPOTS = 512  # contact spots remembered in a search
REFERENCE_BODIES = 3  # bodies with which a tree may be taken along

# rows of near pairs (DrivenWorkspace.row_state)
NO_ROW, REQUESTED, HAS_ROW = 0, 1, 2

# whether there was a frame before this one, and whether some frame ended free of overlap (PROGRESS, start)
NOT_STARTED, STARTED_FREE, NEVER_FREE = 0, 1, 2

# how a tree may yield (SearchWorkspace.kind)
LOCKED, RIGID, ARTICULATED = 0, 1, 2


# where a tree goes is given (DrivenState.given), or was given before and its shape is still off by that
GIVEN, WAS_GIVEN = 1, 2


PROGRESS = np.dtype(
    [
        ("start", np.int64),  # NOT_STARTED, STARTED_FREE or NEVER_FREE
        ("updates", np.int64),  # of the driven loop so far
    ]
)
"""How far the driven loop has come."""

SEARCH_COUNTS = np.dtype(
    [
        ("touches", np.int64),  # rows of `touch` that are filled
        ("next_spot", np.int64),  # row of `spot` that is filled next
    ]
)
"""Of the tables of a search."""


class DrivenState(NamedTuple):
    """State of the driven loop from frame to frame."""

    progress: Record  # PROGRESS
    offset: Floats  # (T, 3) m, of each tree's root from its recorded position
    speed: Floats  # (T, 3) m/s, of the pivot's offset; impulses change it
    last_speed: Floats  # (T, 3) m/s, what it was at the end of the last step
    last: Posture  # everything at the end of the last step, corrected
    recorded: Posture  # the recording of the last step
    shift: Floats  # (B, 6) offset of each link: of its centre [m] and its rotation [rad, rotation vector in the world]
    rate: Floats  # (B, 6) and their rates
    deformed: Ints  # (T,) 1: the offsets are more than a translation of the tree
    used_low: Floats  # (Q,) the least angle recorded so far
    used_high: Floats  # (Q,) and the largest
    joint_offset: Floats  # (Q,) corrected less recorded angles
    joint_step: Floats  # (Q,) their last change
    given: Ints  # (T,) GIVEN: where it goes in this step, but for what is in its way, is `prescribed`; WAS_GIVEN; 0
    prescribed: Posture


class PieceFrames(NamedTuple):
    """Frames of all pieces."""

    base: Floats  # (P, 12) world_from_piece as recorded
    frames: Floats  # (P, 12) as they are
    moved: Floats  # (P, 12) scratch
    reach: Floats  # (T, 2) m: how far the pieces of each tree may move before the near pairs are used, and by bending


class SearchWorkspace(NamedTuple):
    """Scratch of the search for a posture."""

    before: Posture  # where the step begins, of trees that do not yield too
    now: Posture  # the iterate
    trial: Posture  # where it would go
    best: Posture  # the best free iterate
    start: Posture  # a free start
    goal: Posture  # what the coupling asks for
    target: Floats  # (B, 7) where each link is to go: its centre, its orientation
    cached_target: Floats  # (B, 7) `target`, saved while another is tried
    anchor: Floats  # (B, 3) m, where each link's centre would be with the offset of the last frame
    deviation_limit: Floats  # (T,) m: how far the links of a tree may get from there
    shift_limit: Floats  # (T,) m: by how much the offset of a rigid tree may change in the step
    kind: Ints  # (T,) how it may yield: LOCKED, RIGID, ARTICULATED
    cached_kind: Ints  # (T,) `kind`, saved while another is tried
    group: Ints  # (T,) the trees that are solved together have one number; -1: none
    first: Ints  # (T,) first column of a tree
    column: Ints  # (Q,) of a joint, -1: none
    extrapolated: Floats  # (Q,) angles of the last step and what was recorded since
    expected: Floats  # (Q,) the same, with offsets going on: where joints would go by themselves
    low: Floats  # (Q,) limits, widened to what was recorded and to where joints were
    high: Floats  # (Q,)
    used_low: Floats  # (Q,) range in which a joint is natural
    used_high: Floats  # (Q,)
    inertia: Floats  # (B, 10) composite mass, first moment, second moments about the pivot
    force: Floats  # (B, 6) composite force and torque about the pivot
    motion: Floats  # (P,) m, how far each piece goes from the iterate to the trial
    drift: Floats  # (P,) m, how far pieces that the recording moves have gone since the step began
    travel: Floats  # (P, 4) m, how far each piece goes since then: its centre, and any point by rotation at most
    from_goal: Floats  # (P, 4) the same from the goal
    covered: Floats  # (T,) m: how far pieces of a tree may go for which pairs are listed
    depth: Floats  # (T,) m, how deep a tree was recorded in something
    hit: Ints  # (T,) 1: what the coupling asks for is not free, or cannot be reached
    spot: Ints  # (n, 2) pieces of spots where pairs touched in passes before
    spot_at: Floats  # (n, 9) normal in the world, points in the links' frames
    counts: Record  # SEARCH_COUNTS
    touch: Ints  # (k, 2) tip link and body that touch in the recording
    touch_gap: Floats  # (k,) m, how far apart they were recorded
    touch_goal: Floats  # (k,) m, how far apart they may be at the end of the step without being drawn together
    closing: Floats  # (T,) m: how far tips of a tree are drawn to what they touch in the step
    unit: Floats  # (Q,) ones
    passes: int  # bound on the passes of a search
    reference_bodies: Ints  # (n,) bodies that move by the recording and are near
    ignored: Ints  # (T,) 1: trees that no other need avoid


class DrivenWorkspace(NamedTuple):
    """Fixed facts and scratch of the driven loop."""

    origins: Floats  # (B, 7) joint origins
    links: Links
    piece_frames: PieceFrames
    near: Near
    listed: Near  # as the trees that yield are at their goals: see `reachability`
    row_state: Ints  # (n,) of the near pairs: NO_ROW, REQUESTED or HAS_ROW
    work: SearchWorkspace
    problem: Quadratic
    detection: Detection
    weights: Weights


def make_driven_state(scene: Scene, poses: Floats) -> DrivenState:
    """The state before the first frame; `poses` (B, 7) are those at rest."""
    trees, bodies, dofs = len(scene.trees.role), len(scene.bodies.role), len(scene.dofs.lower)
    return DrivenState(
        progress=np.zeros((), PROGRESS),
        offset=np.zeros((trees, 3)),
        speed=np.zeros((trees, 3)),
        last_speed=np.zeros((trees, 3)),
        last=make_posture(scene, poses),
        recorded=make_posture(scene, poses),
        shift=np.zeros((bodies, 6)),
        rate=np.zeros((bodies, 6)),
        deformed=np.zeros(trees, np.int64),
        used_low=np.full(dofs, np.inf),
        used_high=np.full(dofs, -np.inf),
        joint_offset=np.zeros(dofs),
        joint_step=np.zeros(dofs),
        given=np.zeros(trees, np.int64),
        prescribed=make_posture(scene, poses),
    )


def make_piece_frames(scene: Scene) -> PieceFrames:
    """Arrays for the frames of all pieces."""
    trees, pieces = len(scene.trees.role), len(scene.pieces.kind)
    return PieceFrames(
        base=np.zeros((pieces, 12)),
        frames=np.zeros((pieces, 12)),
        moved=np.zeros((pieces, 12)),
        reach=np.zeros((trees, 2)),
    )


def make_search_workspace(scene: Scene, poses: Floats, passes: int) -> SearchWorkspace:
    """Workspace of a search of up to `passes` passes in a scene."""
    trees, bodies = len(scene.trees.role), len(scene.bodies.role)
    dofs, pieces = len(scene.dofs.lower), len(scene.pieces.kind)
    contacts = max(int((scene.bodies.role == DRIVEN).sum()) * bodies, 1)  # one of every tip and body fits
    return SearchWorkspace(
        before=make_posture(scene, poses),
        now=make_posture(scene, poses),
        trial=make_posture(scene, poses),
        best=make_posture(scene, poses),
        start=make_posture(scene, poses),
        goal=make_posture(scene, poses),
        target=np.zeros((bodies, 7)),
        cached_target=np.zeros((bodies, 7)),
        anchor=np.zeros((bodies, 3)),
        deviation_limit=np.zeros(trees),
        shift_limit=np.zeros(trees),
        kind=np.zeros(trees, np.int64),
        cached_kind=np.zeros(trees, np.int64),
        group=np.zeros(trees, np.int64),
        first=np.zeros(trees, np.int64),
        column=np.full(dofs, -1),
        extrapolated=np.zeros(dofs),
        expected=np.zeros(dofs),
        low=np.zeros(dofs),
        high=np.zeros(dofs),
        used_low=np.zeros(dofs),
        used_high=np.zeros(dofs),
        inertia=np.zeros((bodies, 10)),
        force=np.zeros((bodies, 6)),
        motion=np.zeros(pieces),
        drift=np.zeros(pieces),
        travel=np.zeros((pieces, 4)),
        from_goal=np.zeros((pieces, 4)),
        covered=np.zeros(trees),
        depth=np.zeros(trees),
        hit=np.zeros(trees, np.int64),
        spot=np.full((SPOTS, 2), -1),
        spot_at=np.zeros((SPOTS, 9)),
        counts=np.zeros((), SEARCH_COUNTS),
        touch=np.zeros((contacts, 2), np.int64),
        touch_gap=np.zeros(contacts),
        touch_goal=np.zeros(contacts),
        closing=np.zeros(trees),
        unit=np.ones(dofs),
        passes=passes,
        reference_bodies=np.full(REFERENCE_BODIES, -1),
        ignored=np.zeros(trees, np.int64),
    )


def make_driven_workspace(
    scene: Scene,
    poses: Floats,
    origins: Floats,
    piece_frames: PieceFrames,
    near: Near,
    detection: Detection,
    passes: int,
    weights: Weights = WEIGHTS,
) -> DrivenWorkspace:
    """Workspace for a scene, on arrays that the machine shares with the other loops."""
    unknowns = 6 * int((scene.trees.role == DRIVEN).sum()) + int(
        sum(
            scene.trees.dof_start[t + 1] - scene.trees.dof_start[t]
            for t in range(len(scene.trees.role))
            if scene.trees.role[t] == DRIVEN
        )
    )
    return DrivenWorkspace(
        origins=origins,
        links=make_links(scene, weights.base),
        piece_frames=piece_frames,
        near=near,
        listed=make_near(len(near.a)),
        row_state=np.zeros(len(near.a), np.int64),
        work=make_search_workspace(scene, poses, passes),
        problem=make_quadratic(max(unknowns, 1), ROWS),
        detection=detection,
        weights=weights,
    )
