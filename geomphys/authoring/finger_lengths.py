"""Finds the fingers of an avatar, or the limbs of a body, whose lengths a calibration may seek."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from geomphys.authoring.contact_gaps import Finger
from geomphys.keypoints.bone_scale import BASE, branch_names
from geomphys.recording.point_measures import branch_title
from geomphys.scene.world import World


def find_fingers(world: World, tree: int, links: Collection[str]) -> tuple[Finger, ...]:
    """Fingers of a tree: those that have one of `links`, or all if none is named."""
    rows = slice(*world.scene.trees.body_start[tree : tree + 2])
    names = [name.split("/", 1)[1] for name in world.body_names[rows]]
    branches = branch_names(
        np.maximum(world.scene.bodies.parent[rows] - rows.start, -1), world.scene.bodies.dof[rows], names
    )
    requested = {branches[names.index(link)] for link in links if link in names} or set(branches)
    found = []
    for branch in dict.fromkeys(branches):
        bodies = [k for k, own in enumerate(branches) if own == branch]
        if branch != BASE and branch in requested:
            found.append(Finger(branch_title(branch), bodies[0], frozenset(bodies)))
    return tuple(found)


def link_factors(world: World, tree: int, factors: dict[Finger, float]) -> dict[str, float]:
    """Link -> factor of its lengths."""
    first = int(world.scene.trees.body_start[tree])
    return {
        world.body_names[first + body].split("/", 1)[1]: factor
        for finger, factor in factors.items()
        for body in sorted(finger.bodies)
    }
