"""A substep of driven and simulated bodies stopped inside: one stage of it is called, and what it changed is looked at."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from geomphys.engine.coupled_contacts import find_coupled_contacts, find_inequalities
from geomphys.engine.coupled_groups import activate_group, label_groups
from geomphys.engine.coupled_motion import begin_poses
from geomphys.engine.coupled_step import predict_end_poses
from geomphys.engine.coupled_unknowns import load_unknowns
from geomphys.engine.state import ReplayData, make_replay_data
from geomphys.engine.step import pose_recording
from geomphys.jit.packed_records import pack
from geomphys.scene import arrays as s
from geomphys.scene.pieces import Box, Sphere
from geomphys.simulated.driven_paths import fit_paths
from geomphys.simulated.update import begin_frame
from tests.simulated.scenes import Thing, make_scene

GAP, STEP = 2e-6, 1.0 / 240.0
RADIUS, HALF = 0.05, 0.02  # m: of a ball, and half the height of a plate


class Substep:
    """The group of the driven trees and simulated bodies of a scene, at the beginning of a substep.

    `roots` (T, 7) and `angles` (Q,) are recorded at its end; at its beginning everything is at rest where the scene has it.
    """

    def __init__(self, scene: s.Scene, dt: float = STEP) -> None:
        self.made, self.dt = scene, dt
        self.data: ReplayData = make_replay_data(scene)
        self.scene, self.packed = pack(scene), pack(self.data)
        self.roots, self.angles = scene.trees.rest.copy(), np.zeros(len(scene.dofs.lower))

    def begin(self) -> Substep:
        """Recorded and simulated paths, pairs, and the group of all."""
        m = self.data
        m.start[:] = m.corrected
        pose_recording(self.scene, self.packed, self.roots, self.angles)
        load_unknowns(self.scene, self.packed, self.roots, self.angles, self.dt)
        predict_end_poses(self.scene, self.packed, self.roots, self.angles, self.dt)
        fit_paths(self.packed.simulated, m.recorded, self.dt)
        begin_frame(self.packed.simulated, self.dt, GAP, False)
        assert label_groups(self.scene, self.packed)
        activate_group(self.scene, self.packed, -1)
        return self

    def find_contacts(self, t: float = 0.0, margin: float = 4e-3) -> Substep:
        """Contacts and limits of a step from time `t` to the end."""
        h = self.dt - t
        begin_poses(self.scene, self.packed, self.roots, self.angles, t, h, self.dt)
        find_coupled_contacts(self.scene, self.packed, t, h, margin)
        find_inequalities(self.scene, self.packed, t, h, margin)
        return self

    def call(self, stage: Callable[..., Any], *arguments: Any) -> Any:
        """Call a stage that takes the scene and the machine."""
        return stage(self.scene, self.packed, *arguments)

    @property
    def contacts(self) -> Any:
        """`CONTACT` of each contact."""
        sim = self.data.simulated
        return sim.contacts[: int(sim.counts["contacts"])]

    def velocity(self, body: int) -> np.ndarray:
        return np.asarray(self.data.simulated.motion["velocity"][body])

    def unknown(self, tree: int, axis: int = 2) -> Any:
        """`UNKNOWN` of the offset of a root along a world axis."""
        return self.data.coupled.unknowns[3 * tree + axis]


def ball_over_plate(
    clearance: float, speed: float = 0.0, mass: float = 0.5, across: float = 0.0, **ball: Any
) -> Substep:
    """A driven plate (tree 0, of 0.4 kg by its coupling) and a ball (tree 1) that comes down on its middle."""
    things = [
        Thing(shape=Box((0.2, 0.2, HALF)), role=s.DRIVEN),
        Thing(
            shape=Sphere(RADIUS), at=(0, 0, HALF + RADIUS + clearance), v=(across, 0, -speed), mass=mass, **ball
        ),
    ]  # fmt: skip
    return Substep(make_scene(things)).begin()
