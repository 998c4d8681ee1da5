"""What the driven loop carries from frame to frame, and its room."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Near
from geomphys.driven.ccd import CcdRoom
from geomphys.driven.chain_room import ChainRoom
from geomphys.driven.escape import Rescue
from geomphys.driven.hold import Carried, Lag, Wanted, make_lag
from geomphys.driven.least_distance import LeastDistance
from geomphys.driven.places import Places
from geomphys.driven.posture import Joints, PostureState
from geomphys.driven.steps import Stir
from geomphys.scene.arrays import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class DrivenState(NamedTuple):
    """What the driven loop carries from frame to frame."""

    started: Ints  # (1,) 0 before the first frame
    steps: Ints  # (1,) made so far: chains are dealt with in an order drawn anew for each
    offset: Floats  # (T, 3) m, of each tree from its recorded pose
    speed: Floats  # (T, 3) m/s, of the offset
    roots: Floats  # (T, 7) recorded root poses of the last step, but for the turn of trees that are behind
    angles: Floats  # (Q,) angles of the last step, likewise
    frames: Floats  # (P, 12) pieces at the end of the last step
    posture: PostureState
    drift: Floats  # (T, 3) direction in which a tree is to step aside, its length the pace; 0: none
    lag: Lag


class DrivenRoom(NamedTuple):
    """Fixed facts and scratch of the driven loop."""

    origins: Floats  # (B, 7) joint origins
    joints: Joints
    nothing: Ints  # (B,) zeros: no body is ignored
    places: Places
    chains: ChainRoom
    ccd: CcdRoom
    near: Near
    problem: LeastDistance
    rescue: Rescue
    stir: Stir
    before: Floats  # (Q,) angles at the end of the last step
    after: Floats  # (Q,) angles the coupling asks for
    roots: Floats  # (T, 7) recorded root poses of a step
    angles: Floats  # (Q,)
    poses: Floats  # (B, 7) recorded poses of a step
    ahead: Floats  # (T, 3) where trees would be that are to slow down
    share: Floats  # (1,) of the frame that the step is
    seed: Ints  # (1,) of the order in which chains are dealt with
    wanted: Wanted
    carried: Carried


def make_driven_state(scene: Scene) -> DrivenState:
    """The state before the first frame."""
    trees, pieces, dofs = len(scene.trees.role), len(scene.pieces.kind), len(scene.dofs.lower)
    return DrivenState(
        np.zeros(1, np.int64), np.zeros(1, np.int64), np.zeros((trees, 3)), np.zeros((trees, 3)), np.zeros((trees, 7)),
        np.zeros(dofs), np.zeros((pieces, 12)), PostureState(np.zeros(dofs), np.zeros(dofs)), np.zeros((trees, 3)),
        make_lag(trees, dofs),
    )  # fmt: skip
