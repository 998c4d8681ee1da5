"""The simulated loop stopped inside a frame: one stage is called, and what it changed is looked at by name."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from geomphys.simulated.frame import begin
from geomphys.simulated.islands import mark_activation
from geomphys.simulated.motion import move_bases
from geomphys.simulated.pairs import find_pairs
from geomphys.simulated.sleeping import wake
from geomphys.simulated.state import AWAKE, Records
from geomphys.simulated.substeps import build_contacts
from geomphys.simulated.update import MIN_RESTITUTION_THRESHOLD, STEP, TOUCH
from tests.simulated.scenes import Player


class Stage:
    """A player's scene at the beginning of a step of `dt` [s]: pairs are found, contact points laid out, all awake.

    `sim` is what kernels of the loop are handed first. `bodies` and `motion` have a record for each body, `pairs` and
    `contacts` for each pair that may meet and each contact point, of the types in `geomphys.simulated.state`; a field is a
    view, so that writing to it changes the state.
    """

    def __init__(self, player: Player, dt: float = STEP) -> None:
        self.player, self.dt = player, dt
        self.sim = player.packed
        player.end[:] = player.poses
        weight = float(np.linalg.norm(player.scene.gravity))
        frame = player.simulation.frame
        frame["dt"], frame["gap"], frame["touch"] = dt, player.gap, TOUCH * player.gap
        frame["weight"], frame["restitution_threshold"] = weight, max(MIN_RESTITUTION_THRESHOLD, 2.0 * weight * STEP)
        begin(self.sim, False)
        find_pairs(self.sim, dt)
        self.any_awake = wake(self.sim, True)
        mark_activation(self.sim, AWAKE)
        move_bases(self.sim, 0.0)
        self.build_contacts()

    def build_contacts(self) -> float:
        """Contact points of changed bodies; returns the least clearance [m]."""
        return float(build_contacts(self.sim, 0.0))

    def mark(self, *bodies: int) -> None:
        """Mark bodies, in ascending order, and no others as changed."""
        sim = self.player.simulation
        sim.bodies["changed"] = 0
        sim.bodies["changed"][list(bodies)] = 1
        sim.changed[: len(bodies)] = bodies
        concerned = np.flatnonzero(np.isin(self.pairs["body"], bodies).any(axis=1))
        sim.concerned[: len(concerned)] = concerned
        sim.counts["changed"], sim.counts["concerned"] = len(bodies), len(concerned)

    def call(self, stage: Callable[..., object], *arguments: object) -> object:
        """Call a stage with this state."""
        return stage(self.sim, *arguments)

    @property
    def bodies(self) -> Records:
        """(B,) `BODY`: how bodies stand in the frame."""
        return self.player.simulation.bodies

    @property
    def motion(self) -> Records:
        """(B,) `MOTION`."""
        return self.player.simulation.motion

    @property
    def pairs(self) -> Records:
        """`PAIR` of each pair that may meet."""
        return self.player.simulation.pairs[: self.player.simulation.counts["pairs"]]

    @property
    def contacts(self) -> Records:
        """`CONTACT` of each contact point."""
        return self.player.simulation.contacts[: self.player.simulation.counts["contacts"]]

    def pair(self, a: int, b: int) -> int:
        """Number of the first pair of two bodies."""
        return int(np.flatnonzero((np.sort(self.pairs["body"], axis=1) == sorted((a, b))).all(axis=1))[0])
