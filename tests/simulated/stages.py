"""The simulated loop stopped inside a frame: one stage is called, and what it changed is looked at by name.

Only this module knows how the tables of the loop are laid out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from geomphys.simulated import state as columns
from geomphys.simulated.frame import begin, mark_all
from geomphys.simulated.header import header_of
from geomphys.simulated.motion import move_bases
from geomphys.simulated.pairs import find_pairs
from geomphys.simulated.sleeping import wake
from geomphys.simulated.update import LEAST_THRESHOLD, STEP, TOUCH, lay_rows
from tests.simulated.scenes import Player

Table = Mapping[str, np.ndarray]


class Stage:
    """A player's scene at the beginning of a step of `dt` [s]: pairs are found, contact points laid out, all awake.

    `sim` is what kernels of the loop are handed first. `bodies` and `motion` have a row for each body, `pairs` and `rows`
    for each pair that may meet and each contact point; a column is a view, so that writing to it changes the state.
    """

    def __init__(self, player: Player, dt: float = STEP) -> None:
        self.player, self.dt = player, dt
        self._start, self._end = player.poses.copy(), player.poses.copy()
        self.sim = header_of(
            player.scene.pieces, player.state, self._start, self._end, player.velocity, player.driven_impulse,
            player.frames, dt, player.gap, player.scratch,
        )  # fmt: skip
        weight = float(np.linalg.norm(player.scene.gravity))
        constants = player.state.header.view(np.float64)
        constants[columns.AT_WEIGHT] = weight
        constants[columns.AT_TOUCH] = TOUCH * player.gap
        constants[columns.AT_THRESHOLD] = max(LEAST_THRESHOLD, 2.0 * weight * STEP)
        begin(self.sim, False)
        find_pairs(self.sim, 0.0, dt)
        self.any_awake = wake(self.sim, True)
        mark_all(self.sim)
        move_bases(self.sim, 0.0)
        self.lay_rows()

    def lay_rows(self) -> float:
        """Contact points of changed bodies; returns the least clearance [m]."""
        return float(lay_rows(self.sim, 0.0))

    def call(self, stage: Callable[..., object], *arguments: object) -> object:
        """Call a stage with this state."""
        return stage(self.sim, *arguments)

    @property
    def bodies(self) -> Table:
        """How bodies stand in the frame: 0 or 1, `island` a label."""
        kinds = self.player.state.kinds
        return {
            "changed": kinds[:, columns.CHANGED],
            "awake": kinds[:, columns.AWAKE],
            "island": kinds[:, columns.ISLAND],
            "fresh": kinds[:, columns.FRESH],
            "touched": kinds[:, columns.TOUCHED],
        }

    @property
    def motion(self) -> Table:
        """Position of the centre of mass [m], velocities [m/s, rad/s], acceleration [m/s²], momentum [kg m²/s], s at rest."""
        motion = self.player.state.motion
        return {
            "position": motion[:, columns.POINT : columns.POINT + 3],
            "velocity": motion[:, columns.SPEED : columns.SPEED + 3],
            "acceleration": motion[:, columns.PULL : columns.PULL + 3],
            "angular_velocity": motion[:, columns.SPIN : columns.SPIN + 3],
            "angular_momentum": motion[:, columns.MOMENTUM : columns.MOMENTUM + 3],
            "mass": motion[:, columns.MASS],
            "quiet_time": motion[:, columns.QUIET],
        }

    @property
    def pairs(self) -> Table:
        """Both bodies of each pair, and how many contact points it has."""
        state = self.player.state
        pairs = state.pairs[: state.counts[columns.N_PAIRS]]
        return {"body": pairs[:, columns.BODY_A : columns.BODY_B + 1], "point_count": pairs[:, columns.POINTS]}

    @property
    def rows(self) -> Table:
        """Both bodies of each contact point, and the distance of the surfaces there [m]."""
        state = self.player.state
        count = state.counts[columns.N_ROWS]
        bodies = state.row_of[:count, columns.ROW_A : columns.ROW_B + 1]
        return {"body": bodies, "clearance": state.rows[:count, columns.CLEARANCE]}

    def pair(self, a: int, b: int) -> int:
        """Number of the first pair of two bodies."""
        return int(np.flatnonzero((np.sort(self.pairs["body"], axis=1) == sorted((a, b))).all(axis=1))[0])
