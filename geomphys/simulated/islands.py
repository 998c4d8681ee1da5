"""Islands: bodies that may touch, directly or through others. Marks those whose motion has changed at a moment, and their pairs.

An island is simulated on its own, so that nothing depends on what else is in the scene. An impact changes, of its island, the
two bodies that touch, and all that are connected to them through contact points.
"""

from __future__ import annotations

from geomphys.jit.kernel import kernel, noinline
from geomphys.simulated.contact_points import NEAR
from geomphys.simulated.state import AWAKE, Simulation, concerns_changed, has_changed, is_disabled, is_simulated
from geomphys.simulated.time_of_impact import is_apart, measure_pair


@kernel
def root_of(sim: Simulation, body: int) -> int:
    """The least body known to be of the island of a body, while islands are labelled."""
    while sim.bodies[body].island != body:
        body = sim.bodies[body].island
    return body


@noinline
def label_islands(sim: Simulation) -> None:
    """Give bodies that may touch, directly or through others, the same label, and list the bodies and pairs of each island."""
    for s in range(len(sim.free)):
        sim.bodies[sim.free[s]].island = sim.free[s]
    for k in range(sim.counts.pairs):
        if is_simulated(sim, sim.pairs[k].body[1]):
            x, y = root_of(sim, sim.pairs[k].body[0]), root_of(sim, sim.pairs[k].body[1])
            sim.bodies[max(x, y)].island = min(x, y)
    for s in range(len(sim.free)):
        body = sim.free[s]
        label = root_of(sim, body)
        sim.bodies[body].island = label  # labels are those of earlier bodies
        island = sim.islands[label]
        if label == body:
            island.mass = 0.0
            island.first_body = island.end_body = island.first_pair = island.end_pair = 0
        island.mass += sim.motion[body].mass
        island.end_body += 1
    for k in range(sim.counts.pairs):
        sim.islands[sim.bodies[sim.pairs[k].body[0]].island].end_pair += 1
    list_islands(sim)


@kernel
def list_islands(sim: Simulation) -> None:
    """Fill `members` and `island_pairs`; `end_body` and `end_pair` hold the numbers of an island's bodies and pairs."""
    bodies, pairs = 0, 0
    for s in range(len(sim.free)):
        if is_label(sim, sim.free[s]):
            island = sim.islands[sim.free[s]]
            of_it, between = island.end_body, island.end_pair
            island.first_body = island.end_body = bodies
            island.first_pair = island.end_pair = pairs
            bodies, pairs = bodies + of_it, pairs + between
    for s in range(len(sim.free)):
        island = sim.islands[sim.bodies[sim.free[s]].island]
        sim.members[island.end_body] = sim.free[s]
        island.end_body += 1
    for k in range(sim.counts.pairs):
        island = sim.islands[sim.bodies[sim.pairs[k].body[0]].island]
        sim.island_pairs[island.end_pair] = k
        island.end_pair += 1


@kernel
def is_label(sim: Simulation, body: int) -> bool:
    """Whether a simulated body labels an island."""
    return bool(sim.bodies[body].island == body)


@kernel
def unmark(sim: Simulation) -> None:
    """Mark no body as changed."""
    for s in range(sim.counts.changed):
        sim.bodies[sim.changed[s]].changed = 0
    sim.counts.changed = sim.counts.concerned = 0


@kernel
def mark(sim: Simulation, body: int) -> None:
    """Mark a body as changed; bodies in ascending order."""
    sim.bodies[body].changed = 1
    sim.changed[sim.counts.changed] = body
    sim.counts.changed += 1


@kernel
def list_if_concerned(sim: Simulation, pair: int) -> None:
    """List a pair if it concerns a changed body."""
    if concerns_changed(sim, pair):
        sim.concerned[sim.counts.concerned] = pair
        sim.counts.concerned += 1


@kernel
def list_concerned(sim: Simulation, island: int) -> None:
    """List the pairs of an island that concern changed bodies."""
    for i in range(sim.islands[island].first_pair, sim.islands[island].end_pair):
        list_if_concerned(sim, sim.island_pairs[i])


@noinline
def mark_island(sim: Simulation, island: int) -> None:
    """Mark as changed the bodies of an island that are AWAKE, and no others."""
    unmark(sim)
    for i in range(sim.islands[island].first_body, sim.islands[island].end_body):
        if sim.bodies[sim.members[i]].activation == AWAKE:
            mark(sim, sim.members[i])
    list_concerned(sim, island)


@noinline
def mark_activation(sim: Simulation, activation: int) -> None:
    """Mark as changed the bodies of all islands that are of an `activation`, and no others."""
    unmark(sim)
    for s in range(len(sim.free)):
        if sim.bodies[sim.free[s]].activation == activation:
            mark(sim, sim.free[s])
    for k in range(sim.counts.pairs):
        list_if_concerned(sim, k)


@kernel
def are_connected(sim: Simulation, pair: int, t: float) -> bool:
    """Whether the bodies of a pair have contact points with each other, or will have when they are measured at `t`."""
    if is_disabled(sim, pair):
        return False
    if sim.pairs[pair].point_count > 0:
        return True
    if is_apart(sim, pair, t, NEAR):
        return False
    if sim.pairs[pair].measured_at != t:
        measure_pair(sim, pair, t)
    return sim.pairs[pair].distance <= NEAR


@noinline
def mark_connected(sim: Simulation, pair: int, t: float) -> None:
    """Mark as changed the bodies, and no others, that the impact of a pair at time `t` of the step concerns."""
    unmark(sim)
    for side in range(2):
        body = sim.pairs[pair].body[side]
        if is_simulated(sim, body):
            sim.bodies[body].changed = 1
    label = sim.bodies[sim.pairs[pair].body[0]].island
    island, grows = sim.islands[label], True
    while grows:
        grows = False
        for i in range(island.first_pair, island.end_pair):
            k = sim.island_pairs[i]
            a, b = sim.pairs[k].body[0], sim.pairs[k].body[1]
            if is_simulated(sim, b) and has_changed(sim, a) != has_changed(sim, b) and are_connected(sim, k, t):
                for body in (a, b):
                    sim.bodies[body].changed = 1 if sim.bodies[body].activation == AWAKE else 0
                grows = grows or has_changed(sim, a) == has_changed(sim, b)
    for i in range(island.first_body, island.end_body):
        if has_changed(sim, sim.members[i]):
            mark(sim, sim.members[i])
    list_concerned(sim, label)
