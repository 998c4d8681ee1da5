"""Laws of the narrow phase for any two shapes at any poses; and two other engines' answers."""

from __future__ import annotations

import coal
import fcl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from geomphys.collision.detect import APPROXIMATE
from geomphys.collision.penetration import Scratch, separate, separation
from geomphys.collision.support import Shapes
from geomphys.jit.kernel import kernel
from geomphys.numerics.vec3 import Vec
from geomphys.scene.arrays import Floats, Pieces
from geomphys.scene.pieces import Box, Capsule, Cylinder, Hull, Shape, Sphere
from tests.collision.engines import coal_place, coal_shape
from tests.collision.pairs import SCRATCH, Array, Pair, check_certificate, pose

length = st.floats(0.01, 1.0)
unit = st.floats(-1.0, 1.0)
turn = st.tuples(unit, unit, unit).map(lambda v: Rotation.from_rotvec(np.pi * np.array(v)))
place = st.builds(lambda x, y, z, t: pose((x, y, z), t), unit, unit, unit, turn)
hull = st.integers(0, 10_000).map(lambda seed: Hull(np.random.default_rng(seed).normal(size=(12, 3)) * 0.3))
shape = st.one_of(
    st.builds(Sphere, length),
    st.builds(Capsule, length, length),
    st.builds(Cylinder, length, length),
    st.builds(lambda x, y, z: Box((x, y, z)), length, length, length),
    hull,
)
PRECISE = 2e-6  # of the size: what a pair with a cylinder may miss
bounded = settings(max_examples=60, deadline=None, derandomize=True)


@kernel
def approximate(pieces: Pieces, frames: Floats, start: Vec, scratch: Scratch) -> float:
    """A bound of the separation of the first two pieces, searched from a direction."""
    scratch.simplex.count = 0
    return separate(Shapes(pieces, frames), 0, 1, np.inf, start, APPROXIMATE, scratch.simplex, scratch)[0]


axis = st.one_of(st.just(np.zeros(3)), st.tuples(unit, unit, unit).map(np.array))


@bounded
@given(shape, place, shape, place, axis)
def test_an_approximate_separation_is_a_bound_with_the_right_sign(
    a: Shape, at_a: Array, b: Shape, at_b: Array, start: Array
) -> None:
    """Whatever direction it is started at."""
    pair, length = Pair(a, at_a, b, at_b), float(np.linalg.norm(start))
    exact, n = pair.answer().s, start / length if length > 0.1 else np.zeros(3)
    s = approximate(pair.packed, pair.frames, tuple(n.tolist()), SCRATCH)
    slack = PRECISE * pair.size
    assert s <= exact + slack if exact >= 0.0 else s <= slack
    assert s >= APPROXIMATE * exact - slack or exact < 0.0


@kernel
def twice(
    pieces: Pieces, frames: Floats, later: Floats, scratch: Scratch
) -> tuple[tuple[float, Vec, Vec, Vec], tuple[float, Vec, Vec, Vec]]:
    """Separation of two pieces at `later`, from the simplex that their search at `frames` has left, and without one."""
    scratch.simplex.count = 0
    separate(Shapes(pieces, frames), 0, 1, np.inf, (0.0, 0.0, 0.0), 1.0, scratch.simplex, scratch)
    found = separate(Shapes(pieces, later), 0, 1, np.inf, (0.0, 0.0, 0.0), 1.0, scratch.simplex, scratch)
    return found, separation(pieces, later, 0, 1, np.inf, (0.0, 0.0, 0.0), scratch)


@bounded
@given(shape, place, shape, place, st.sampled_from([0.0, 1e-4, 1e-2, 1.0]), place)
def test_a_search_from_the_last_simplex_finds_the_same(
    a: Shape, at_a: Array, b: Shape, at_b: Array, far: float, other: Array
) -> None:
    """However far the pieces have moved since."""
    turned = Rotation.from_rotvec(far * Rotation.from_matrix(other[:3, :3]).as_rotvec())
    later = Pair(a, at_a, b, at_b @ pose(tuple(far * other[:3, 3]), turned))
    pair = Pair(a, at_a, b, at_b)
    (s, n, pa, pb), (cold, *_) = twice(pair.packed, pair.frames, later.frames, SCRATCH)
    assert s == pytest.approx(cold, abs=PRECISE * later.size)
    assert np.allclose(np.array(pa) - pb, s * np.array(n), atol=1e-12 + PRECISE * later.size)


def moved(by: Array, at: Array) -> Array:
    return by @ at


@bounded
@given(shape, place, shape, place)
def test_either_way_round_is_the_same(a: Shape, at_a: Array, b: Shape, at_b: Array) -> None:
    pair = Pair(a, at_a, b, at_b)
    one, other = pair.answer(), pair.answer(first=1)
    assert one.s == pytest.approx(other.s, abs=PRECISE * pair.size)
    check_certificate(pair, one, on_surface=1e-6)


@bounded
@given(shape, place, shape, place)
def test_moving_out_by_the_depth_parts_them_and_by_less_does_not(a: Shape, at_a: Array, b: Shape, at_b: Array) -> None:
    pair = Pair(a, at_a, b, at_b)
    found = pair.answer()
    if found.s >= -1e-4:
        return
    slack = 3 * PRECISE * pair.size
    for share, free in ((1.0, True), (1.2, True), (0.5, False)):
        out = at_a.copy()
        out[:3, 3] -= share * found.s * found.n
        left = Pair(a, out, b, at_b).answer().s
        if free:
            assert left >= -slack
        else:
            assert left == pytest.approx(0.5 * found.s, abs=slack), "depth falls one to one on the shortest way out"


@bounded
@given(shape, place, shape, place, st.tuples(unit, unit, unit))
def test_depth_changes_by_no_more_than_the_motion(a: Shape, at_a: Array, b: Shape, at_b: Array, by: tuple) -> None:
    pair, there = Pair(a, at_a, b, at_b), at_a.copy()
    there[:3, 3] += by
    change = Pair(a, there, b, at_b).answer().s - pair.answer().s
    assert abs(change) <= np.linalg.norm(by) + PRECISE * pair.size


@bounded
@given(shape, place, shape, place, place)
def test_moving_both_alike_changes_nothing(a: Shape, at_a: Array, b: Shape, at_b: Array, by: Array) -> None:
    here, there = Pair(a, at_a, b, at_b), Pair(a, moved(by, at_a), b, moved(by, at_b))
    one, other = here.answer(), there.answer()
    assert one.s == pytest.approx(other.s, abs=PRECISE * here.size)
    if one.s < -1e-3:  # of several ways out as short another may be found, but it is one
        n = by[:3, :3].T @ other.n
        assert -float(here.overlap(n)) == pytest.approx(one.s, abs=1e-5 * here.size)


@bounded
@given(shape, place, shape, place, st.floats(0.0, 0.5))
def test_a_larger_shape_is_no_farther_away(a: Shape, at_a: Array, b: Shape, at_b: Array, more: float) -> None:
    if isinstance(b, Sphere):
        larger: Shape = Sphere(b.radius + more)
    elif isinstance(b, Hull):
        larger = Hull(b.vertices * (1 + more) - more * b.vertices.mean(axis=0))
    elif isinstance(b, Box):
        larger = Box(tuple(h + more for h in b.half_extents))
    else:
        larger = type(b)(b.radius + more, b.half_height + more)
    pair = Pair(a, at_a, b, at_b)
    assert Pair(a, at_a, larger, at_b).answer().s <= pair.answer().s + PRECISE * pair.size


@bounded
@given(shape, place, shape, place)
def test_coal_finds_no_shorter_way_and_the_same_distance(a: Shape, at_a: Array, b: Shape, at_b: Array) -> None:
    pair = Pair(a, at_a, b, at_b)
    found = pair.answer().s
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    shapes = [coal_shape(pair.pieces, k) for k in range(2)]
    theirs = coal.distance(shapes[0], coal_place(at_a), shapes[1], coal_place(at_b), request, result)
    if found > 0:
        assert found == pytest.approx(theirs, abs=1e-5 * pair.size)
    elif np.linalg.norm(result.normal) > 0.9:
        # their depth of round shapes is off by half a percent; but out along their normal is one way out
        assert -found <= pair.overlap(-np.array(result.normal)) + PRECISE * pair.size


def of_fcl(shape: Shape) -> fcl.CollisionGeometry:
    if isinstance(shape, Sphere):
        return fcl.Sphere(shape.radius)
    if isinstance(shape, Capsule):
        return fcl.Capsule(shape.radius, 2 * shape.half_height)
    assert isinstance(shape, Box)
    return fcl.Box(*(2 * h for h in shape.half_extents))


simple = st.one_of(
    st.builds(Sphere, length), st.builds(lambda x, y, z: Box((x, y, z)), length, length, length)
)  # fmt: skip


@bounded
@given(simple, place, simple, place)
def test_fcl_says_whether_they_meet(a: Shape, at_a: Array, b: Shape, at_b: Array) -> None:
    pair = Pair(a, at_a, b, at_b)
    found = pair.answer().s
    bodies = [fcl.CollisionObject(of_fcl(s), fcl.Transform(t[:3, :3], t[:3, 3])) for s, t in ((a, at_a), (b, at_b))]
    meets = fcl.collide(*bodies, fcl.CollisionRequest(), fcl.CollisionResult()) > 0
    if abs(found) > 1e-5 * pair.size:
        assert meets == (found < 0)
