"""State of the driven loop from frame to frame, and its workspace."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import MOTION_BOUND, Detection, Near, Records, make_near
from geomphys.driven.links import Links
from geomphys.driven.postures import Posture, make_posture
from geomphys.driven.qp import Quadratic, make_quadratic
from geomphys.driven.weights import WEIGHTS, Weights
from geomphys.jit.packed_records import Record
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.scene.kinematics import joint_origins

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROWS = 1024  # most rows of a quadratic problem
SPOTS = 512  # contact spots cached in a search

# rows of near pairs (DrivenWorkspace.row_state)
NO_ROW, REQUESTED, HAS_ROW = 0, 1, 2

# whether there was a frame before this one, and whether some frame ended free of overlap (PROGRESS, start)
NOT_STARTED, STARTED_FREE, NEVER_FREE = 0, 1, 2

# how a tree may move (SearchWorkspace.mobility): translation alone, or general motion: rotation and joints too
LOCKED, TRANSLATION, GENERAL_MOTION = 0, 1, 2

# the coupled solve prescribes the posture (DrivenState.prescription), or did before and the shape still differs by that
PRESCRIBED, WAS_PRESCRIBED = 1, 2

PROGRESS = np.dtype(
    [
        ("start", np.int64),  # NOT_STARTED, STARTED_FREE or NEVER_FREE
        ("updates", np.int64),  # updates of the driven loop so far
        ("dt", np.float64),  # s, of the last step; 0 in the first
    ]
)
"""Progress of the driven loop over the frames."""

SEARCH_COUNTS = np.dtype(
    [
        ("touches", np.int64),  # rows of `touches` that are filled
        ("touch_pairs", np.int64),  # and of `touch_pairs`
        ("witness", np.int64),  # the listed pair by which a posture was last found not to be free, to be tried first
        ("reference_body", np.int64),  # the nearest body that the recording moves; -1: none
        ("next_spot", np.int64),  # row of `spots` to fill next
        ("overlap_a", np.int64),  # pieces of the pair that overlapped most at the goals when some were last not free
        ("overlap_b", np.int64),
        ("blocking_a", np.int64),  # pieces by which a position of a depenetration search was last not clear; -1: none
        ("blocking_b", np.int64),
    ]
)
"""Counts of the tables of a search."""


TRAVEL = np.dtype(
    [
        ("translation", np.float64, 3),  # m, displacement of the centre
        ("rotation", np.float64),  # m, bound of the motion of any point by rotation
        ("angle", np.float64),  # rad, of its rotation
    ]
)
"""Motion of a piece between two postures."""

SPOT = np.dtype(
    [
        ("a", np.int64),  # pieces; -1: none
        ("b", np.int64),
        ("normal", np.float64, 3),  # world
        ("point_a", np.float64, 3),  # m, in the frames of the links
        ("point_b", np.float64, 3),
    ]
)
"""A spot where a pair touched in an earlier pass of a search."""

TOUCH = np.dtype(
    [
        ("tip", np.int64),  # link at the end of a chain
        ("body", np.int64),  # what it touches in the recording
        ("gap", np.float64),  # m, how far apart they were recorded
        ("normal", np.float64, 3),  # there, out of the body
        ("goal", np.float64),  # m, gap at the end of the step up to which there is no penalty
    ]
)
"""A recorded contact."""


LINK_OFFSET = np.dtype(
    [
        ("translation", np.float64, 3),  # m, of the link's centre, world
        ("rotation", np.float64, 3),  # rad, rotation vector, world
        ("velocity", np.float64, 3),  # m/s: rate of `translation`
        ("angular_velocity", np.float64, 3),  # rad/s: rate of `rotation`
        ("last_translation", np.float64, 3),  # `translation` at the end of the last step
        ("last_rotation", np.float64, 3),
        ("contact_velocity", np.float64, 3),  # m/s: what of `velocity` contacts have set
        ("contact_angular_velocity", np.float64, 3),  # rad/s
        ("last_velocity", np.float64, 3),  # m/s, at which `translation` changed in the last step
        ("last_angular_velocity", np.float64, 3),  # rad/s, at which `rotation` did
        ("recorded_velocity", np.float64, 3),  # m/s, of the link's centre in the last step
        ("recorded_angular_velocity", np.float64, 3),  # rad/s, of the link in the last step
    ]
)
"""Offset of a link from its recorded pose, and its rates."""

RECORDED_MOTION = np.dtype(
    [
        ("centre", np.float64, 3),  # m, of the link as recorded, world
        ("path", np.float64, 3),  # m, by which it moved in the step
        ("rotation", np.float64, 3),  # rad, rotation vector of the link in the step
    ]
)
"""Recorded motion of a link in a step."""

TREMOR = np.dtype(
    [
        ("translation", np.float64, 3),  # m, of the pivot's filtered from its recorded pose, world
        ("rotation", np.float64, 3),  # rad, rotation vector, world
        ("velocity", np.float64, 3),  # m/s, of the filtered pose against what is gripped
        ("angular_velocity", np.float64, 3),  # rad/s
    ]
)
"""Filter of the recorded pose of a tree that grips something: see `tremor`."""

COMPOSITE_INERTIA = np.dtype(
    [
        ("mass", np.float64),
        ("first_moment", np.float64, 3),  # about the pivot, as the others
        ("xx", np.float64),
        ("yy", np.float64),
        ("zz", np.float64),
        ("xy", np.float64),
        ("xz", np.float64),
        ("yz", np.float64),
    ]
)
"""Inertia of a link and all below it: weights [1], lengths [m]."""

LINK_SURFACE = np.dtype(
    [
        ("centre", np.float64, 3),  # m, world
        ("rotated_moments", np.float64, 9),  # m², R S of the link's rotation R and its second moments S, row by row
    ]
)
"""Surface of a link in a posture."""

JOINT_TWIST = np.dtype(
    [
        ("column", np.int64),  # of its degree of freedom; -1: none
        ("velocity", np.float64, 3),  # m, at the pivot, per unit of the degree of freedom
        ("angular_velocity", np.float64, 3),
    ]
)
"""Motion that the joint above a body gives in a posture."""


class DrivenState(NamedTuple):
    """State of the driven loop from frame to frame."""

    progress: Record  # PROGRESS
    offset: Floats  # (T, 3) m, of each tree's root from its recorded position
    offset_velocity: Floats  # (T, 3) m/s, of the pivot's offset; impulses change it
    last_offset_velocity: Floats  # (T, 3) m/s, the same at the end of the last step
    last: Posture  # everything at the end of the last step, corrected
    recorded: Posture  # the recording of the last step
    link_offsets: Records  # (B,) LINK_OFFSET
    tremor: Records  # (T,) TREMOR
    general_motion: Ints  # (T,) 1: the offsets are more than a translation of the tree
    mean_tip: Floats  # (B, 3) m, mean recorded centre of each fingertip of a rigid tree, in the frame of its palm
    has_gripped: Ints  # (T,) 1: a rigid tree that has closed on something since its offset was last a translation
    used_low: Floats  # (Q,) the least angle recorded so far
    used_high: Floats  # (Q,) and the largest
    prescription: Ints  # (T,) PRESCRIBED: its posture in this step, obstacles apart, is that below; WAS_PRESCRIBED; 0
    prescribed_posture: Posture
    method: Ints  # (T,) by which each tree was freed in the frame so far, as in results.METHODS


class PieceFrames(NamedTuple):
    """Frames of all pieces."""

    base: Floats  # (P, 12) world_from_piece as recorded
    frames: Floats  # (P, 12) current
    before: Floats  # (P, 12) at the start of the step
    iterate: Floats  # (P, 12) at the iterate of a search
    moved: Floats  # (P, 12) scratch
    motion_bounds: Records  # (T,) MOTION_BOUND: motion of the pieces of each tree that near pairs must cover


class SearchWorkspace(NamedTuple):
    """Workspace of the search for a posture."""

    before: Posture  # at the start of the step, all trees
    iterate: Posture  # the iterate
    trial: Posture  # the iterate after the step being tried
    best: Posture  # the best free iterate
    start: Posture  # a free start
    goal: Posture  # goal by the coupling
    filtered: Posture  # the recording without the tremor of grips; angles unused
    weight: Floats  # (B,) of each link in the objective: more where its target is far from where it was recorded
    target: Floats  # (B, 7) target of each link: of its centre, its orientation
    cached_target: Floats  # (B, 7) `target`, saved while another is tried
    recorded: Records  # (B,) RECORDED_MOTION
    anchor: Floats  # (B, 3) m, where each link's centre would be with the offset of the last frame
    deviation_limit: Floats  # (T,) m: how far the links of a tree may move from there
    translation_limit: Floats  # (T,) m: by how much the offset of a rigid tree may change in the step
    mobility: Ints  # (T,) how it may move: LOCKED, TRANSLATION or GENERAL_MOTION
    cached_mobility: Ints  # (T,) `mobility`, saved while another is tried
    group: Ints  # (T,) number of the group that is solved together; -1: none
    first: Ints  # (T,) first column of a tree
    column: Ints  # (Q,) of a joint, -1: none
    extrapolated: Floats  # (Q,) angles of the last step plus the recorded change
    preferred: Floats  # (Q,) angles of the goal, on the branch of the last ones
    low: Floats  # (Q,) limits, widened to recorded and last values
    high: Floats  # (Q,)
    used_low: Floats  # (Q,) range in which a joint was used
    used_high: Floats  # (Q,)
    inertia: Records  # (B,) COMPOSITE_INERTIA
    surface: Records  # (B,) LINK_SURFACE, at the posture of the objective, of links with a weight
    twist: Records  # (B,) JOINT_TWIST, there
    force: Floats  # (B, 6) composite force and torque about the pivot
    motion: Records  # (P,) TRAVEL of each piece from the iterate to the trial
    travel: Records  # (P,) TRAVEL of each piece since the start of the step
    from_goal: Records  # (P,) TRAVEL from the goal
    covered: Floats  # (T,) m: motion of the pieces of a tree that the listed pairs cover
    depth: Floats  # (T,) m, recorded depth of a tree
    blocked: Ints  # (T,) 1: the goal is not free, or cannot be reached
    spots: Records  # (n,) SPOT
    counts: Record  # SEARCH_COUNTS
    touches: Records  # (k,) TOUCH
    touch_pairs: Ints  # (n,) near pairs of tips with what they touch
    cone_angle: Floats  # (C,) rad: of a limb in its reach cone at `cone_reference`; below 0: the least it may have
    cone_reference: Floats  # (Q,) rad: recorded angles
    closing: Floats  # (T,) m: how far the penalty may move tips of a tree in the step
    grip: Floats  # (T,) how firmly a tree grips something, 0 to 1: see `tremor`
    grips: Ints  # (T,) 1: a rigid tree that closes on something
    stopped: Floats  # (T,) share to which the joints of a tree stop together: it grips, or has gripped, something
    unit: Floats  # (Q,) ones
    iterations: int  # bound on the iterations of a search
    ignored: Ints  # (T,) 1: trees that others need not avoid


class DrivenWorkspace(NamedTuple):
    """Constant data and workspace of the driven loop."""

    origins: Floats  # (B, 7) joint origins
    links: Links
    piece_frames: PieceFrames
    near: Near
    at_trial: Near  # those of the near pairs that were measured at the trial: its rows are those of `near`
    listed: Near  # pairs with the trees being solved at their goals: see `reachability`
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
        offset_velocity=np.zeros((trees, 3)),
        last_offset_velocity=np.zeros((trees, 3)),
        last=make_posture(scene, poses),
        recorded=make_posture(scene, poses),
        link_offsets=np.zeros(bodies, LINK_OFFSET),
        tremor=np.zeros(trees, TREMOR),
        general_motion=np.zeros(trees, np.int64),
        mean_tip=np.zeros((bodies, 3)),
        has_gripped=np.zeros(trees, np.int64),
        used_low=np.full(dofs, np.inf),
        used_high=np.full(dofs, -np.inf),
        prescription=np.zeros(trees, np.int64),
        prescribed_posture=make_posture(scene, poses),
        method=np.zeros(trees, np.int64),
    )


def make_piece_frames(scene: Scene) -> PieceFrames:
    """Arrays for the frames of all pieces."""
    trees, pieces = len(scene.trees.role), len(scene.pieces.kind)
    return PieceFrames(
        base=np.zeros((pieces, 12)),
        frames=np.zeros((pieces, 12)),
        before=np.zeros((pieces, 12)),
        iterate=np.zeros((pieces, 12)),
        moved=np.zeros((pieces, 12)),
        motion_bounds=np.zeros(trees, MOTION_BOUND),
    )


def make_search_workspace(scene: Scene, poses: Floats, links: Links, pairs: int, iterations: int) -> SearchWorkspace:
    """Workspace of a search of up to `iterations` iterations in a scene with up to `pairs` near pairs."""
    trees, bodies = len(scene.trees.role), len(scene.bodies.role)
    dofs, pieces = len(scene.dofs.lower), len(scene.pieces.kind)
    contacts = max(int((scene.bodies.role == DRIVEN).sum()) * bodies, 1)  # capacity for every tip and body
    return SearchWorkspace(
        before=make_posture(scene, poses),
        iterate=make_posture(scene, poses),
        trial=make_posture(scene, poses),
        best=make_posture(scene, poses),
        start=make_posture(scene, poses),
        goal=make_posture(scene, poses),
        filtered=make_posture(scene, poses),
        weight=links.weight.copy(),
        target=np.zeros((bodies, 7)),
        cached_target=np.zeros((bodies, 7)),
        recorded=np.zeros(bodies, RECORDED_MOTION),
        anchor=np.zeros((bodies, 3)),
        deviation_limit=np.zeros(trees),
        translation_limit=np.zeros(trees),
        mobility=np.zeros(trees, np.int64),
        cached_mobility=np.zeros(trees, np.int64),
        group=np.zeros(trees, np.int64),
        first=np.zeros(trees, np.int64),
        column=np.full(dofs, -1),
        extrapolated=np.zeros(dofs),
        preferred=np.zeros(dofs),
        low=np.zeros(dofs),
        high=np.zeros(dofs),
        used_low=np.zeros(dofs),
        used_high=np.zeros(dofs),
        inertia=np.zeros(bodies, COMPOSITE_INERTIA),
        surface=np.zeros(bodies, LINK_SURFACE),
        twist=np.zeros(bodies, JOINT_TWIST),
        force=np.zeros((bodies, 6)),
        motion=np.zeros(pieces, TRAVEL),
        travel=np.zeros(pieces, TRAVEL),
        from_goal=np.zeros(pieces, TRAVEL),
        covered=np.zeros(trees),
        depth=np.zeros(trees),
        blocked=np.zeros(trees, np.int64),
        spots=np.full(SPOTS, -1, SPOT),
        counts=np.zeros((), SEARCH_COUNTS),
        touches=np.zeros(contacts, TOUCH),
        touch_pairs=np.zeros(pairs, np.int64),
        cone_angle=np.zeros(len(scene.cones.limb)),
        cone_reference=np.zeros(dofs),
        closing=np.zeros(trees),
        grip=np.zeros(trees),
        grips=np.zeros(trees, np.int64),
        stopped=np.zeros(trees),
        unit=np.ones(dofs),
        iterations=iterations,
        ignored=np.zeros(trees, np.int64),
    )


def make_driven_workspace(
    scene: Scene,
    poses: Floats,
    links: Links,
    piece_frames: PieceFrames,
    near: Near,
    detection: Detection,
    iterations: int,
    weights: Weights = WEIGHTS,
) -> DrivenWorkspace:
    """Workspace for a scene, on arrays shared with the other loops."""
    unknowns = 6 * int((scene.trees.role == DRIVEN).sum()) + int(
        sum(
            scene.trees.dof_start[t + 1] - scene.trees.dof_start[t]
            for t in range(len(scene.trees.role))
            if scene.trees.role[t] == DRIVEN
        )
    )
    at_trial = make_near(len(near.a))
    at_trial.exact[:] = 0
    return DrivenWorkspace(
        origins=joint_origins(scene),
        links=links,
        piece_frames=piece_frames,
        near=near,
        at_trial=at_trial,
        listed=make_near(len(near.a)),
        row_state=np.zeros(len(near.a), np.int64),
        work=make_search_workspace(scene, poses, links, len(near.a), iterations),
        problem=make_quadratic(max(unknowns, 1), ROWS),
        detection=detection,
        weights=weights,
    )
