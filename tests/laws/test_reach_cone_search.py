"""Signed angles and projections of reach cones against brute-force searches over the sphere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from geomphys.driven.reach_cones import signed_angle

LIMITS = settings(max_examples=150, deadline=None, derandomize=True)


def unit(v):
    v = np.asarray(v, float)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def angle_between(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), np.sum(a * b, axis=-1))


def star(centre, azimuths, polar):
    """A polygon that is seen whole from its centre: simple, counter-clockwise, convex or not, of any size."""
    c = unit(centre)
    x = unit(np.cross(c, [0.3, -0.5, 0.81] if abs(c @ unit([0.3, -0.5, 0.81])) < 0.9 else [1.0, 0, 0]))
    y = np.cross(c, x)
    ring = np.cos(azimuths)[:, None] * x + np.sin(azimuths)[:, None] * y
    return np.ascontiguousarray(np.cos(polar)[:, None] * c + np.sin(polar)[:, None] * ring)


def on_side(a, b, t):
    """Points of a great-circle arc at shares t."""
    length = angle_between(a, b)
    t = np.atleast_1d(t)[:, None]
    return (np.sin((1 - t) * length) * a + np.sin(t * length) * b) / np.sin(length)


def searched(corners, d):
    """Distance [rad] and place of the nearest boundary point: dense samples of every side, refined at the best."""
    best = np.inf, None
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        t = np.linspace(0, 1, 201)
        k = int(np.argmin(angle_between(on_side(a, b, t), d)))
        low, high = t[max(k - 1, 0)], t[min(k + 1, 200)]
        fine = minimize_scalar(
            lambda t, a=a, b=b: angle_between(on_side(a, b, t)[0], d),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-12},
        )
        for share in (fine.x, low, high):
            point = on_side(a, b, share)[0]
            best = min(best, (float(angle_between(point, d)), tuple(point)))
    return best[0], np.array(best[1])


def is_inside(corners, centre, d):
    """By counting the sides that the way from the centre crosses."""
    way, crossings = np.cross(centre, d), 0
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        n = np.cross(a, b)
        p = np.cross(way, n)
        for q in (p, -p):
            on_way = np.cross(centre, q) @ way > 0 and np.cross(q, d) @ way > 0
            crossings += bool(on_way and np.cross(a, q) @ n > 0 and np.cross(q, b) @ n > 0)
    return crossings % 2 == 0


def sharpest(corners):
    """The smallest angle [rad] between neighbouring sides."""
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    u, v = (unit(p - np.sum(p * corners, axis=1, keepdims=True) * corners) for p in (before, after))
    return float(np.min(angle_between(u, v)))


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1).map(unit)


@st.composite
def cones(draw, widest=2.9):
    count = draw(st.integers(3, 9))
    jitter = np.array(draw(st.lists(st.floats(-0.3, 0.3), min_size=count, max_size=count)))
    polar = np.array(draw(st.lists(st.floats(0.15, widest), min_size=count, max_size=count)))
    azimuths = 2 * np.pi * (np.arange(count) + jitter) / count
    assume(np.all(np.diff(azimuths, append=azimuths[0] + 2 * np.pi) < 3.1))  # else the centre is not inside
    centre = draw(directions)
    corners = star(centre, azimuths, polar)
    assume(np.all(angle_between(corners, np.roll(corners, -1, axis=0)) < 3.1))
    return centre, corners


@LIMITS
@given(cones(), directions)
def test_equals_the_search(cone, d):
    centre, corners = cone
    away, _ = searched(corners, d)
    g, nearest, inward = signed_angle(corners, 0, len(corners), tuple(d))
    assert abs(g) == pytest.approx(away, abs=1e-7)
    assert float(angle_between(np.array(nearest), d)) == pytest.approx(abs(g), abs=1e-12)
    if away > 1e-6 and angle_between(centre, -d) > 1e-3 and angle_between(centre, d) > 1e-3:
        assert (g >= 0) == is_inside(corners, centre, d)
    assert np.linalg.norm(inward) == pytest.approx(1, abs=1e-12)
    assert np.dot(inward, d) == pytest.approx(0, abs=1e-7)


@LIMITS
@given(cones(), directions)
def test_the_angle_grows_as_fast_as_one_goes_along_inward(cone, d):
    _, corners = cone
    g, _, inward = signed_angle(corners, 0, len(corners), tuple(d))
    h = 1e-6
    ahead, back = (
        signed_angle(corners, 0, len(corners), tuple(np.cos(h) * d + s * np.sin(h) * np.array(inward)))[0]
        for s in (1, -1)
    )
    assume(abs(g) > 1e-4)
    assert (g - back) / h == pytest.approx(1, abs=1e-4) or (ahead - g) / h == pytest.approx(1, abs=1e-4)
    if g < 0:
        assert (ahead - g) / h == pytest.approx(1, abs=1e-4)


@LIMITS
@given(cones(), directions)
def test_the_boundary_direction_is_the_nearest_one(cone, d):
    _, corners = cone
    g, nearest, _ = signed_angle(corners, 0, len(corners), tuple(d))
    assume(g < 0)
    assert float(angle_between(np.array(nearest), d)) == pytest.approx(searched(corners, d)[0], abs=1e-7)
    assert signed_angle(corners, 0, len(corners), nearest)[0] > -1e-7


def test_a_whole_sphere_of_directions():
    """Half the sphere minus a notch, the poles, and the directions opposite."""
    turn = np.arange(8) * np.pi / 4
    polar = np.where(np.arange(8) == 3, 0.4, np.pi / 2)
    corners = star([0, 0, 1.0], turn, polar)
    for d in unit(np.random.default_rng(1).normal(size=(200, 3))):
        g = signed_angle(corners, 0, 8, tuple(d))[0]
        assert (g > 0) == is_inside(corners, np.array([0, 0, 1.0]), d)
    assert signed_angle(corners, 0, 8, (0.0, 0.0, 1.0))[0] > 0.2
    assert signed_angle(corners, 0, 8, (0.0, 0.0, -1.0))[0] == pytest.approx(-np.pi / 2, abs=1e-12)


def test_an_octant_in_closed_form():
    corners = np.eye(3)
    middle = unit([1.0, 1, 1])
    assert signed_angle(corners, 0, 3, tuple(middle))[0] == pytest.approx(np.arcsin(1 / np.sqrt(3)), abs=1e-15)
    g, nearest, inward = signed_angle(corners, 0, 3, tuple(unit([1.0, 1, -1])))
    assert g == pytest.approx(-np.arcsin(1 / np.sqrt(3)), abs=1e-15)
    assert nearest == pytest.approx(unit([1.0, 1, 0]), abs=1e-15)
    assert inward[2] > 0
    assert signed_angle(corners, 0, 3, (-1.0, 0.0, 0.0))[0] == pytest.approx(-np.pi / 2, abs=1e-15)


def test_on_the_boundary():
    corners = np.eye(3)
    for d, inward in (((1.0, 0.0, 0.0), (0, 1, 1)), (tuple(unit([1.0, 1, 0])), (0, 0, 1))):
        g, nearest, way = signed_angle(corners, 0, 3, d)
        assert g == pytest.approx(0, abs=1e-15)
        assert nearest == pytest.approx(d, abs=1e-15)
        assert way == pytest.approx(unit(inward), abs=1e-12)
