"""What holds for separations of all kinds of pieces, whatever the formula: certificates, symmetry, invariance."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Shape, Sphere
from tests.collision.engines import coal_place, coal_shape
from tests.collision.pairs import Pair, check_certificate, pose, random_hull, random_turn, searched_depth

KINDS = (Sphere, Capsule, Box, Cylinder, Hull)
PAIRS = [(a, b) for k, a in enumerate(KINDS) for b in KINDS[k:]]
CURVED = 2e-6
"""Share of the size that points on a cylinder may be off its surface: the root of what its distance may be off."""


def some(kind: type, rng: np.random.Generator) -> Shape:
    if kind is Sphere:
        return Sphere(rng.uniform(0.1, 0.6))
    if kind is Capsule:
        return Capsule(rng.uniform(0.05, 0.4), rng.uniform(0.1, 0.8))
    if kind is Box:
        return Box(tuple(rng.uniform(0.05, 0.8, 3)))
    if kind is Cylinder:
        return Cylinder(rng.uniform(0.05, 0.6), rng.uniform(0.05, 0.8))
    return random_hull(rng, int(rng.integers(4, 40)), rng.uniform(0.1, 0.8, 3))


def some_pair(kinds: tuple[type, type], rng: np.random.Generator, spread: float) -> Pair:
    a, b = some(kinds[0], rng), some(kinds[1], rng)
    at_a, at_b = pose(rng.normal(size=3), random_turn(rng)), pose(turn=random_turn(rng))
    if rng.random() < 0.3:
        at_b[:3, :3] = at_a[:3, :3]
    at_b[:3, 3] = at_a[:3, 3] + rng.normal(size=3) * spread
    return Pair(a, at_a, b, at_b)


def coal_distance(pair: Pair) -> float:
    request, result = coal.DistanceRequest(True, True), coal.DistanceResult()
    places = [coal_place(t) for t in pair.poses]
    shapes = [coal_shape(pair.pieces, k) for k in range(2)]
    return float(coal.distance(shapes[0], places[0], shapes[1], places[1], request, result))


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_overlaps_are_certified_and_no_search_finds_a_shorter_way_out(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(KINDS.index(kinds[0]) * 10 + KINDS.index(kinds[1]))
    curved = Cylinder in kinds and Sphere not in kinds
    seen = 0
    while seen < 12:
        pair = some_pair(kinds, rng, float(rng.choice([0.02, 0.2, 0.5])))
        answer = pair.answer()
        check_certificate(pair, answer, on_surface=CURVED if curved else 1e-9)
        if answer.s < 0.0:
            seen += 1
            assert -answer.s <= searched_depth(pair) * (1 + (1e-6 if curved else 1e-11)) + 1e-12


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_distances_are_certified_and_agree_with_coal(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(KINDS.index(kinds[0]) * 10 + KINDS.index(kinds[1]))
    seen = 0
    while seen < 25:
        pair = some_pair(kinds, rng, 1.5)
        answer = pair.answer()
        if answer.s > 1e-3:
            seen += 1
            check_certificate(pair, answer, on_surface=CURVED if Cylinder in kinds else 1e-9)
            # both points lie on the surfaces, so the distance is no shorter; the certificate says it is no longer
            assert answer.s == pytest.approx(coal_distance(pair), rel=3e-5, abs=1e-6)


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_the_other_way_round_is_the_same_with_its_sign(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(5)
    for _ in range(20):
        pair = some_pair(kinds, rng, 0.5)
        one, other = pair.answer(), pair.answer(first=1)
        assert one.s == other.s
        assert np.array_equal(one.n, -other.n)
        assert np.allclose(one.a, other.b, rtol=0, atol=1e-15 * pair.size)
        assert np.allclose(one.b, other.a, rtol=0, atol=1e-15 * pair.size)


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_a_motion_of_both_changes_nothing(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(6)
    tight = 1e-6 if Cylinder in kinds else 1e-11
    for _ in range(20):
        pair = some_pair(kinds, rng, 0.5)
        move = pose(rng.normal(size=3), random_turn(rng))
        moved = Pair(pair.shapes[0], move @ pair.poses[0], pair.shapes[1], move @ pair.poses[1])
        assert moved.answer().s == pytest.approx(pair.answer().s, rel=tight, abs=1e-13)


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_an_earlier_normal_saves_time_only(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        pair = some_pair(kinds, rng, 0.6)
        cold = pair.answer()
        for axis in (cold.n, rng.normal(size=3), -cold.n):
            unit = axis / np.linalg.norm(axis)
            warm = pair.answer(axis=(float(unit[0]), float(unit[1]), float(unit[2])))
            assert warm.s == cold.s
            assert np.array_equal(warm.n, cold.n)


@pytest.mark.parametrize("kinds", PAIRS, ids=lambda k: f"{k[0].__name__}-{k[1].__name__}")
def test_beyond_the_limit_a_bound_is_enough(kinds: tuple[type, type]) -> None:
    rng = np.random.default_rng(8)
    seen = 0
    while seen < 20:
        pair = some_pair(kinds, rng, 1.5)
        exact = pair.answer()
        if exact.s <= 1e-3:
            continue
        seen += 1
        n = (float(exact.n[0]), float(exact.n[1]), float(exact.n[2]))
        for limit in (0.0, 0.5 * exact.s, 0.999 * exact.s):
            for axis in ((0.0, 0.0, 0.0), n):
                bound = pair.answer(limit=limit, axis=axis)
                assert limit < bound.s <= exact.s * (1 + 1e-9)
                assert -pair.overlap(bound.n) >= bound.s - 1e-14 * pair.size
        below = pair.answer(limit=1.001 * exact.s, axis=n)
        assert below.s == exact.s


def test_depth_goes_to_distance_without_a_step() -> None:
    """Moving B along the normal by d changes the separation by d, through the touch."""
    rng = np.random.default_rng(9)
    for kinds in PAIRS:
        pair = some_pair(kinds, rng, 0.2)
        answer = pair.answer()
        for off in (-1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6, 1e-3):
            at_b = pair.poses[1].copy()
            at_b[:3, 3] += (answer.s - off) * answer.n
            there = Pair(pair.shapes[0], pair.poses[0], pair.shapes[1], at_b).answer()
            assert there.s == pytest.approx(off, abs=1e-7 * max(-answer.s, 0.0) + 1e-12), (kinds, off)
