"""The `squeeze` of driven trees: links press simulated bodies as if they were recorded deeper in them."""

from __future__ import annotations

import math

from geomphys.engine.coupled_state import Coupled
from geomphys.engine.coupled_unknowns import solves
from geomphys.jit.kernel import kernel
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.simulated.state import Simulation


@kernel
def nearest_clearance(sim: Simulation, a: int, b: int) -> float:
    """Clearance of the nearest contact of two bodies [m]; inf: they have none."""
    nearest = math.inf
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.a == a and r.b == b:
            nearest = min(nearest, r.clearance)
    return nearest


@kernel
def points_within(sim: Simulation, a: int, b: int, clearance: float) -> int:
    """Number of contacts of two bodies that are no farther apart than a clearance [m]."""
    count = 0
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        if r.a == a and r.b == b and r.clearance <= clearance:
            count += 1
    return count


@kernel
def add_squeeze(scene: Scene, sim: Simulation, c: Coupled, h: float) -> None:
    """Let driven links press what they touch by K times `squeeze` more, with their joints, or the root of a tree without any.

    As if they were recorded that much deeper: a link that is a clearance short of touching is drawn by K times what `squeeze`
    is more than that, which counts where another link of its tree is pressed. The force of a link is distributed over its
    nearest points.
    """
    for k in range(sim.counts.contacts):
        r = sim.contacts[k]
        tree = sim.bodies[r.b].tree
        if sim.bodies[r.b].role != DRIVEN or scene.trees.squeeze[tree] == 0.0:
            continue
        reach = max(sim.frame.touch, nearest_clearance(sim, r.a, r.b))
        short = reach if reach > sim.frame.touch else 0.0
        if r.clearance > reach or short >= scene.trees.squeeze[tree] or math.isinf(scene.trees.stiffness[tree]):
            continue
        deeper = scene.trees.squeeze[tree] - short
        force = scene.trees.stiffness[tree] * deeper / points_within(sim, r.a, r.b, reach)
        joints = False
        for e in range(r.first_effect, r.end_effect):
            joints = joints or c.effects[e].unknown >= 3 * len(scene.trees.role)
        for e in range(r.first_effect, r.end_effect):
            effect = c.effects[e]
            if joints == (effect.unknown >= 3 * len(scene.trees.role)):
                x = c.unknowns[effect.unknown]
                x.new_rate -= effect.jacobian[0] * x.inverse_mass * h * force


@kernel
def largest_squeeze(scene: Scene, c: Coupled) -> float:
    """Largest `squeeze` of the driven trees of the group [m]."""
    largest = 0.0
    for tree in range(len(scene.trees.role)):
        if solves(scene, c, tree) and math.isfinite(scene.trees.stiffness[tree]):
            largest = max(largest, scene.trees.squeeze[tree])
    return largest
