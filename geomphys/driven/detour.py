"""Ways round an edge: trees that would come to be on the other side of something stop at the edge in a step.

Each move of the overlap loop leads through nothing, but several of them may lead round an edge, so that the straight way
from where the tree was to where it ends leads through what it went round. Seen from frame to frame, that is passing
through. The tree then stays where the way turns, and goes on from there in the next step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from geomphys.collision.detect import Axes, Near, pair_separation
from geomphys.collision.penetration import Scratch
from geomphys.driven.escape import DEEPER, concerns
from geomphys.driven.places import Places, place_at, row_of
from geomphys.jit.kernel import kernel, outlined
from geomphys.numerics.vec3 import Vec, add_scaled, dot, norm, sub
from geomphys.scene.arrays import DRIVEN, Scene

Ints = NDArray[np.int64]

DETOUR = 2e-4  # m: moves of which one is shorter lead round nothing
CUT = 0.2  # of the mean thickness of two pieces: what a straight way may cut of a corner
PITCH = 0.3  # of it, between places on the way that are looked at
MOST_PLACES = 64


@kernel
def _against(p: Places, tree_a: int, tree_b: int) -> tuple[Vec, Vec]:
    """Where a is against b at the way's start and at its end, from where it is now. [m]"""
    now = sub(row_of(p.current, tree_a), row_of(p.current, tree_b))
    start = sub(row_of(p.start, tree_a), row_of(p.start, tree_b))
    end = sub(row_of(p.trial, tree_a), row_of(p.trial, tree_b))
    return sub(start, now), sub(end, now)


@kernel
def _cuts(scene: Scene, p: Places, near: Near, k: int, axes: Axes, scratch: Scratch) -> bool:
    """Whether the pieces of pair k are deep in each other somewhere on the straight way from `start` to `trial`."""
    a, b = near.a[k], near.b[k]
    start, end = _against(p, near.tree_a[k], near.tree_b[k])
    n = (near.normal[k, 0], near.normal[k, 1], near.normal[k, 2])
    mean = 0.5 * (scene.pieces.thickness[a] + scene.pieces.thickness[b])
    if near.separation[k] + min(dot(n, start), dot(n, end)) >= -CUT * mean:
        return False  # on the same side of a plane
    way, found = sub(end, start), False
    places = int(min(math.ceil(norm(way) / (PITCH * max(mean, 1e-5))), MOST_PLACES))
    for i in range(3):
        p.moved[b, 9 + i] = p.frames[b, 9 + i]
    allowed = CUT * mean
    for place in range(places):
        at = add_scaled(start, way, place / places)
        for i in range(3):
            p.moved[a, 9 + i] = p.frames[a, 9 + i] + at[i]
        s, _, _, _ = pair_separation(scene.pieces, p.moved, a, b, 0.0, axes, scratch)
        if place == 0:
            allowed = max(allowed, -DEEPER * s)  # the turn of this step may have brought them there
        found = found or s < -allowed
    return found


@outlined
def goes_through(scene: Scene, p: Places, near: Near, ignored: Ints, axes: Axes, scratch: Scratch) -> bool:
    """Whether the straight way of some tree from `p.start` to `p.trial` leads through something.

    `near` are the pairs near `p.current`, in between; those of `ignored` (B,) bodies do not count.
    """
    found = False
    for k in range(near.filled[0]):
        found = found or (concerns(scene, near, ignored, k) and _cuts(scene, p, near, k, axes, scratch))
    for tree in range(len(p.trial)):
        if scene.trees.role[tree] == DRIVEN:
            place_at(scene, p.base, p.trial, tree, p.moved)
    return found
