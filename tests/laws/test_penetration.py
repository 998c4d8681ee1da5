"""Depths of polytopes against the convex hull of the Minkowski difference, on random and on degenerate pairs."""

from __future__ import annotations

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.scene.pieces import Box, Cylinder, Hull, Shape
from tests.collision.pairs import (
    Pair,
    check_certificate,
    minkowski_depth,
    pose,
    random_hull,
    random_turn,
    searched_depth,
)

SEEDS = range(int(os.environ.get("GEOMPHYS_PENETRATION_SEEDS", "12")))
"""Blocks of 100 pairs; 200 seeds take some minutes."""

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
OCTAHEDRON = np.vstack([np.eye(3), -np.eye(3)])
TETRAHEDRON = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
RING = np.arange(24) * np.pi / 12
PRISM = np.array([[np.cos(t), np.sin(t), z] for t in RING for z in (-0.5, 0.5)])
RIGHT_TURNS = [
    Rotation.identity(),
    Rotation.from_euler("x", 45, degrees=True),
    Rotation.from_euler("z", 45, degrees=True),
    Rotation.from_euler("xyz", [90, 0, 90], degrees=True),
    Rotation.from_euler("xz", [45, 45], degrees=True),
]


def check(pair: Pair) -> None:
    """The answer is certified, and as deep as the Minkowski difference; or both say that there is no overlap."""
    answer, depth = pair.answer(), minkowski_depth(pair)
    check_certificate(pair, answer)
    if answer.s < 0.0:
        assert abs(-answer.s - max(depth, 0.0)) <= 1e-9 * max(depth, 0.0) + 1e-11 * pair.size
    else:
        assert depth <= 1e-11 * pair.size


def any_polytope(rng: np.random.Generator) -> Shape:
    kind = rng.integers(7)
    if kind == 0:
        return Box(tuple(10 ** rng.uniform(-1, 0, 3)))
    if kind == 1:
        return Box(tuple(10 ** rng.uniform(-3, 0, 3)))
    count = int(rng.choice([4, 5, 8, 12, 20, 40, 60]))
    plate_or_needle = {2: np.array([1.0, 1.0, 1e-4]), 3: np.array([1.0, 1e-3, 1e-3])}
    return random_hull(rng, count, plate_or_needle.get(int(kind), 1.0) * 10 ** rng.uniform(-1.5, 0))


@pytest.mark.parametrize("seed", SEEDS)
def test_random_pairs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(100):
        a, b = any_polytope(rng), any_polytope(rng)
        if rng.random() < 0.1:
            b = a
        at_a, at_b = pose(rng.normal(size=3), random_turn(rng)), pose(turn=random_turn(rng))
        reach = Pair(a, at_a, b, at_b).pieces.reach.sum()
        case = rng.integers(4)
        if case == 0:
            at_b[:3, :3] = at_a[:3, :3]
        at_b[:3, 3] = at_a[:3, 3] + rng.normal(size=3) * rng.choice([0.05, 0.3, 1.0]) * 0.5 * reach
        if case == 1:
            at_b = at_a.copy()
        check(Pair(a, at_a, b, at_b))


def lattice_polytope(rng: np.random.Generator) -> Shape:
    size = 10 ** rng.uniform(-3, 1)
    plates = [(1.0, 1.0, 1e-4), (1.0, 1e-4, 1e-4), (1.0, 0.5, 0.25)]
    kind = rng.integers(8)
    if kind < 3:
        x, y, z = plates[kind]
        return Box((x * size, y * size, z * size))
    if kind == 3:
        x, y, z = rng.integers(1, 4, 3) * 0.25
        return Box((float(x), float(y), float(z)))
    if kind == 4:
        return Hull(CUBE * rng.integers(1, 4, 3) * 0.25)
    return Hull([OCTAHEDRON, TETRAHEDRON, PRISM][kind - 5] * 0.5)


@pytest.mark.parametrize("seed", SEEDS)
def test_degenerate_pairs(seed: int) -> None:
    """Coplanar faces, parallel edges, corners that meet, common centres, 1 mm against 10 m, plates and needles."""
    rng = np.random.default_rng(1000 + seed)
    for _ in range(100):
        a, b = lattice_polytope(rng), lattice_polytope(rng)
        common = RIGHT_TURNS[rng.integers(5)] if rng.random() < 0.5 else random_turn(rng)
        turns = [common * RIGHT_TURNS[rng.integers(5)] for _ in range(2)]
        pair = Pair(a, pose(turn=turns[0]), b, pose(common.apply(rng.integers(-4, 5, 3) * 0.25), turns[1]))
        case = rng.integers(4)
        at_b = pair.poses[1]
        if case == 0:
            at_b[:3, 3] *= pair.pieces.reach.min()
        elif case == 1:
            on_b = pair.corners(1)[rng.integers(8 if isinstance(b, Box) else 4)] - at_b[:3, 3]
            on_a = pair.corners(0)
            at_b[:3, 3] = (on_a[rng.integers(4)] if rng.random() < 0.5 else on_a[:3].mean(axis=0)) - on_b
        elif case == 2:
            at_b[:3, 3] = 0.0
        check(Pair(a, pair.poses[0], b, at_b))


def test_stacked_cubes_touch_within_rounding() -> None:
    for turn in RIGHT_TURNS:
        for shape in (Box((1.0, 1.0, 1.0)), Hull(CUBE)):
            pair = Pair(shape, pose(turn=turn), shape, pose(turn.apply([0.0, 0.0, 2.0]), turn))
            answer = pair.answer()
            assert abs(answer.s) < 1e-14
            assert np.allclose(answer.n, -turn.as_matrix()[:, 2], atol=1e-12)


@pytest.mark.parametrize("kind", ["box", "hull"])
def test_same_shape_at_same_place(kind: str) -> None:
    """The way out of itself is as long as the shape is wide in its thinnest direction."""
    half = (0.3, 0.2, 0.05)
    shape: Shape = Box(half) if kind == "box" else Hull(CUBE * half)
    answer = Pair(shape, pose(), shape, pose()).answer()
    assert answer.s == pytest.approx(-0.1, rel=1e-14)
    assert abs(answer.n[2]) == pytest.approx(1.0, rel=1e-14)


@pytest.mark.parametrize("tilt", [0.0, 1e-5, 3.14159265e-5, 1e-4])
def test_cylinders_about_one_axis_meet_where_the_normal_says(tilt: float) -> None:
    """Every way out at right angles to the axis is as short; the polytope may run out of room before it is round."""
    shape = Cylinder(1.0, 1.0)
    over = Rotation.from_matrix([[-1.0, 0.0, tilt], [0.0, 1.0, 0.0], [-tilt, 0.0, -1.0]])
    pair = Pair(shape, pose(), shape, pose((0.0, 0.0, 0.0), over))
    check_certificate(pair, pair.answer(), on_surface=1e-5)


@pytest.mark.parametrize("height", [0.0, 0.1, -0.21, 0.27, -0.295])
@pytest.mark.parametrize("distance", [0.02, 0.06, 0.099, 0.13])
def test_a_corner_beside_a_cylinder_is_as_deep_as_it_is_near_to_the_axis(distance: float, height: float) -> None:
    """To rounding, as long as it is farther from the ends than it is deep: there another way out may be shorter."""
    rng, radius, half_height = np.random.default_rng(3), 0.1, 0.3
    base = [(distance + 0.5, height + y, z) for y in (-0.3, 0.3) for z in (-0.3, 0.3)]
    spike = Hull(np.array([(distance, 0.0, height), *((x, z, y) for x, y, z in base)]))
    for _ in range(10):
        at = pose(rng.normal(size=3), random_turn(rng))
        for pair in (
            Pair(Cylinder(radius, half_height), at, spike, at),
            Pair(spike, at, Cylinder(radius, half_height), at),
        ):
            answer = pair.answer()
            check_certificate(pair, answer, on_surface=2e-6)
            if abs(height) + max(radius - distance, 0.0) < half_height:
                assert answer.s == pytest.approx(distance - radius, abs=1e-15 * pair.size)
            elif answer.s < 0.0:
                assert -answer.s <= searched_depth(pair) * (1.0 + 1e-6)


def test_a_cylinder_at_the_edge_of_a_cube_leaves_it_by_the_end_where_that_is_nearer() -> None:
    """Its side is 20 mm deep in the cube, its end 10 mm."""
    lying = Rotation.from_euler("y", 90, degrees=True)
    answer = Pair(Cylinder(0.1, 0.3), pose((1.29, 0.0, 1.08), lying), Hull(CUBE), pose()).answer()
    assert answer.s == pytest.approx(-0.01, abs=1e-9)
    assert answer.n == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)
