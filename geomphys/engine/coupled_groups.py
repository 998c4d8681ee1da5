"""Groups of driven trees and simulated islands that may touch: each is solved independently of the others."""

from __future__ import annotations

from geomphys.engine.coupled_state import Coupled
from geomphys.engine.state import ReplayData
from geomphys.jit.kernel import kernel, noinline
from geomphys.scene.arrays import DRIVEN, Scene
from geomphys.simulated.state import AWAKE, COUPLED, IN_OTHER_GROUP, Simulation

NEAR_TREES = 0.02  # m: driven trees that come no nearer are not solved together


@kernel
def may_press(data: ReplayData, k: int) -> bool:
    """Whether pair k of the simulated loop is of an awake body and a driven link."""
    sim = data.simulated
    a, b = sim.pairs[k].body[0], sim.pairs[k].body[1]
    return bool(sim.bodies[b].role == DRIVEN and sim.bodies[a].activation == AWAKE)


@kernel
def island_tree(sim: Simulation, body: int) -> int:
    """Tree of the body that an island is labelled by."""
    return int(sim.bodies[sim.bodies[body].island].tree)


@kernel
def merge_labels(c: Coupled, a: int, b: int) -> bool:
    """Merge the labels of two trees; whether they differed."""
    x, y = c.trees[a].group, c.trees[b].group
    if x == y:
        return False
    c.trees[a].group = c.trees[b].group = min(x, y)
    return True


@kernel
def are_near(scene: Scene, sim: Simulation, tree: int, other: int) -> bool:
    """Whether links of two trees may come nearer than `NEAR_TREES` in this substep."""
    for a in range(scene.trees.body_start[tree], scene.trees.body_start[tree + 1]):
        for b in range(scene.trees.body_start[other], scene.trees.body_start[other + 1]):
            x, y, near = sim.body_boxes[a], sim.body_boxes[b], True
            for i in range(3):
                near = near and x.low[i] <= y.high[i] + NEAR_TREES and y.low[i] <= x.high[i] + NEAR_TREES
            if near:
                return True
    return False


@noinline
def label_groups(scene: Scene, data: ReplayData) -> bool:
    """Label driven trees and islands that may touch, directly or through others, to be solved together; whether there are any.

    A group has steps, margins and sweeps of its own, so that it does not depend on other groups. Its bodies count as not
    awake for the simulated loop.
    """
    sim, c, some = data.simulated, data.coupled, False
    for tree in range(len(c.trees)):
        c.trees[tree].group = -1
    for k in range(sim.counts.pairs):
        if may_press(data, k):
            a, b = island_tree(sim, sim.pairs[k].body[0]), sim.bodies[sim.pairs[k].body[1]].tree
            c.trees[a].group, c.trees[b].group, some = a, b, True
    changed = some
    while changed:
        changed = False
        for k in range(sim.counts.pairs):
            if may_press(data, k):
                a, b = island_tree(sim, sim.pairs[k].body[0]), sim.bodies[sim.pairs[k].body[1]].tree
                changed = merge_labels(c, a, b) or changed
        for tree in range(len(c.trees)):
            for other in range(tree):
                apart_yet = (
                    c.trees[tree].group != c.trees[other].group and min(c.trees[tree].group, c.trees[other].group) >= 0
                )
                driven = scene.trees.role[tree] == DRIVEN and scene.trees.role[other] == DRIVEN
                if driven and apart_yet and are_near(scene, sim, tree, other):
                    changed = merge_labels(c, tree, other) or changed
    for s in range(len(sim.free)):
        body = sim.bodies[sim.free[s]]
        if some and body.activation == AWAKE and c.trees[island_tree(sim, sim.free[s])].group >= 0:
            body.activation = IN_OTHER_GROUP
    for k in range(sim.counts.pairs):
        if sim.bodies[sim.pairs[k].body[0]].activation != IN_OTHER_GROUP:
            sim.pairs[k].touching = 0
    return some


@kernel
def activate_group(scene: Scene, data: ReplayData, group: int) -> None:
    """Let the trees and bodies of a group take part in the solve, and no others; group -1: those of all groups."""
    sim, c = data.simulated, data.coupled
    for tree in range(len(c.trees)):
        label = c.trees[tree].group
        on = scene.trees.role[tree] == DRIVEN and label >= 0 and (group < 0 or label == group)
        c.trees[tree].solved = 1 if on else 0
    for s in range(len(sim.free)):
        body = sim.bodies[sim.free[s]]
        if body.activation in (COUPLED, IN_OTHER_GROUP):
            own = group < 0 or c.trees[island_tree(sim, sim.free[s])].group == group
            body.activation = COUPLED if own else IN_OTHER_GROUP
