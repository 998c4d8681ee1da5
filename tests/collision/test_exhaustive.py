"""Trying every direction and growing a polytope find the same depth."""

from __future__ import annotations

import numpy as np

from geomphys.collision.epa import expand
from geomphys.collision.exhaustive import exhaustive
from geomphys.collision.gjk import OVERLAP, Goal, closest
from geomphys.collision.scratch import Scratch
from geomphys.collision.support import core_of, position_of, rotation_of, shapes_of
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import norm, rot_transposed_mul, rotate_back, sub
from geomphys.scene.arrays import Floats, Pieces
from geomphys.scene.pieces import Box, Capsule, Shape
from tests.collision.pairs import SCRATCH, Pair, pose, random_hull, random_turn


@kernel
def both_depths(pieces: Pieces, frames: Floats, scratch: Scratch) -> tuple[bool, float, float, float]:
    """Whether the cores of the first two pieces overlap; their depth both ways, and the cosine between the normals."""
    shapes = shapes_of(pieces, frames)
    a, b = core_of(shapes, 0), core_of(shapes, 1)
    rot = rot_transposed_mul(rotation_of(shapes, 0), rotation_of(shapes, 1))
    t = rotate_back(rotation_of(shapes, 0), sub(position_of(shapes, 1), position_of(shapes, 0)))
    size = pieces.reach[0] + pieces.reach[1] + norm(t)
    scratch.simplex.count = 0
    state, _, _, _ = closest(a, b, rot, t, size, Goal(np.inf, 0.0, 1.0), (0.1, 0.2, 0.3), scratch.simplex)
    if state != OVERLAP:
        return False, 0.0, 0.0, 0.0
    exact, grown, n, _ = expand(a, b, rot, t, size, 1e-15 * size, scratch.simplex, scratch)
    tried, m, _ = exhaustive(a, b, rot, t, size, scratch)
    return exact, grown, tried, n[0] * m[0] + n[1] * m[1] + n[2] * m[2]


def test_twins() -> None:
    rng = np.random.default_rng(0)

    def some(first: bool) -> Shape:
        kind = rng.integers(3 if first else 2)
        if kind == 0:
            return Box(tuple(rng.uniform(0.1, 1.0, 3)))
        if kind == 1:
            return random_hull(rng, int(rng.integers(4, 40)), rng.uniform(0.2, 0.8, 3))
        return Capsule(0.01, rng.uniform(0.1, 1.0))

    seen = 0
    for _ in range(150):
        pair = Pair(
            some(True), pose(rng.normal(size=3) * 0.2, random_turn(rng)), some(False), pose(turn=random_turn(rng))
        )
        overlap, grown, tried, cosine = both_depths(pair.packed, pair.frames, SCRATCH)
        if overlap:
            seen += 1
            assert abs(grown - tried) < 1e-12
            assert cosine > 1.0 - 1e-9
    assert seen > 80
