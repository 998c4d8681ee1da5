"""Penetration depths beside coal and FCL: the same pairs, the same sign, one judge."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.bench.depths import PairLoop, Pairs, compare_depths, random_pairs, shape_of
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, PosedShape, Shape, Sphere, build_pieces


def pairs_of(*shapes: Shape, positions: list[tuple[float, float, float]]) -> Pairs:
    frames = np.array([[1.0, 0, 0, 0, 1, 0, 0, 0, 1, *position] for position in positions])
    return Pairs("made", build_pieces([PosedShape(s, np.eye(4), k) for k, s in enumerate(shapes)]), frames)


def test_balls_of_known_depth() -> None:
    pairs = pairs_of(Sphere(0.03), Sphere(0.02), positions=[(0.04, 0.0, 0.0), (0.0, 0.0, 0.0)])
    found = PairLoop(pairs).all(pairs.frames)[0]
    np.testing.assert_allclose(found["normal"], [1.0, 0.0, 0.0], atol=1e-15)
    assert found["distance"] == pytest.approx(-0.01, abs=1e-15)


def test_random_pairs_overlap_and_are_the_same_each_time() -> None:
    sets, again = random_pairs(3, (8, 30)), random_pairs(3, (8, 30))
    for pairs, other in zip(sets, again, strict=True):
        assert np.array_equal(pairs.frames, other.frames)
        assert np.all(PairLoop(pairs).all(pairs.frames)["distance"] < 0.0)


def test_coal_agrees_and_fcl_is_judged_by_the_same_measure() -> None:
    pytest.importorskip("coal")
    for pairs in random_pairs(0, (8, 30)):
        ours, singly, coal, fcl = compare_depths(pairs, 1, with_peers=True).engines
        assert (ours.ratio, ours.deviation.max, singly.deviation.max) == (1.0, 0.0, 0.0)
        assert coal.engine.startswith("coal")
        assert coal.deviation.p95 < 1e-6
        assert max(ours.residual_m.max, coal.residual_m.p95) < 1e-8
        assert coal.missed == ours.missed == 0
        assert fcl.residual_m.median < 1e-6  # far too long ways, but out


def test_every_kind_of_shape_reaches_the_peers() -> None:
    pytest.importorskip("coal")
    corners = np.array([[x, y, z] for x in (-0.02, 0.02) for y in (-0.01, 0.01) for z in (-0.01, 0.01)])
    shapes = [Sphere(0.01), Capsule(0.01, 0.02), Box((0.02, 0.01, 0.01)), Cylinder(0.01, 0.02), Hull(corners)]
    ground = Box((0.5, 0.5, 0.05))
    low = {Sphere: 0.01, Capsule: 0.03, Box: 0.01, Cylinder: 0.02, Hull: 0.01}  # how far each reaches down
    for shape in shapes:
        pairs = pairs_of(shape, ground, positions=[(0.0, 0.0, 0.05 + low[type(shape)] - 0.002), (0.0, 0.0, 0.0)])
        ours, _, coal, fcl = compare_depths(pairs, 1, with_peers=True).engines
        assert PairLoop(pairs).all(pairs.frames)["distance"][0] == pytest.approx(-0.002, rel=1e-9)
        assert coal.deviation.max < 1e-3
        assert (ours.missed, coal.missed, fcl.missed) == (0, 0, 0)
        assert type(shape_of(pairs.pieces, 0)) is type(shape)
