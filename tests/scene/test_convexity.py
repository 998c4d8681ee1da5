"""When the hull of a mesh stands for it: dents of known depth, screw holes, and hollows that must stay."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene.convexity import is_nearly_convex
from geomphys.scene.meshes import Mesh
from geomphys.scene.tessellation import merge_surfaces, sphere_triangles, surface_of_revolution
from tests.scene.models import cube


def lathed(profile: list[tuple[float, float]]) -> Mesh:
    """A profile (radius, height) from pole to pole turned about z."""
    radius, height = np.array(profile).T
    return Mesh("lathed", *surface_of_revolution(radius, height, 48))


def revolved(profile: list[tuple[float, float]], segments: int = 48) -> Mesh:
    """A closed profile (radius, height), counter-clockwise seen with z up and r to the right, turned about z."""
    angles = np.arange(segments) * (2 * np.pi / segments)
    points = np.array(profile)
    count = len(points)
    corners = np.array([[r * np.cos(a), r * np.sin(a), z] for a in angles for r, z in points])
    faces = []
    for s in range(segments):
        here, after = count * s, count * ((s + 1) % segments)
        for k in range(count):
            j = (k + 1) % count
            faces += [(here + k, after + j, here + j), (here + k, after + k, after + j)]
    ring = Mesh("ring", corners, np.array(faces)[:, ::-1].copy())
    return ring if ring.signed_volume > 0 else Mesh("ring", corners, np.array(faces))


def dented_ball(depth: float) -> Mesh:
    """A ball of 0.1 m radius with its cap within 20 degrees of the pole pressed in to this depth below its rim."""
    polar = np.radians(np.concatenate([np.linspace(180, 20, 41), np.linspace(20, 0, 9)[1:]]))
    rim, level = 0.1 * np.sin(np.radians(20)), 0.1 * np.cos(np.radians(20))
    radius, height = 0.1 * np.sin(polar), 0.1 * np.cos(polar)
    bowl = polar < np.radians(19.9)
    height[bowl] = level - depth * (1 - (radius[bowl] / rim) ** 2)
    return Mesh("ball", *surface_of_revolution(radius, height, 64))


@pytest.mark.parametrize("depth", [0.005, 0.01, 0.015])
def test_a_dent_counts_by_its_depth(depth: float) -> None:
    mesh = dented_ball(depth)
    assert mesh.is_watertight
    assert mesh.signed_volume == pytest.approx(4 / 3 * np.pi * 1e-3, rel=0.03)
    volume = 0.5 * np.pi * (0.1 * np.sin(np.radians(20))) ** 2 * depth  # of a paraboloid
    assert 0.3 * np.cbrt(0.75 * volume / np.pi) < 0.9 * depth  # so the depth decides
    assert is_nearly_convex(mesh, 1.03 * depth)
    assert not is_nearly_convex(mesh, 0.97 * depth)


def test_a_wide_shallow_dish_counts_by_its_volume() -> None:
    dish = lathed([(0, 0), (0.1, 0), (0.1, 0.02), (0.09, 0.02), (0.09, 0.018), (0, 0.018)])
    volume = np.pi * 0.09**2 * 0.002
    limit = 0.3 * np.cbrt(0.75 * volume / np.pi)
    assert limit > 0.002
    assert is_nearly_convex(dish, 1.01 * limit)
    assert not is_nearly_convex(dish, 0.99 * limit)


def cup(bore: float, depth: float = 0.05) -> Mesh:
    """A solid cylinder of 20 mm radius and 60 mm height with a blind bore from the top."""
    return lathed([(0, 0), (0.02, 0), (0.02, 0.06), (bore, 0.06), (bore, 0.06 - depth), (0, 0.06 - depth)])


def test_a_screw_hole_narrower_than_the_concavity_is_filled_and_a_cup_is_not() -> None:
    assert is_nearly_convex(cup(0.001, 0.01), 0.0012)
    assert is_nearly_convex(cup(0.001, 0.01), 0.0011)
    assert not is_nearly_convex(cup(0.001, 0.01), 0.00097)
    assert not is_nearly_convex(cup(0.015), 0.005)
    assert not is_nearly_convex(cup(0.015, 0.004), 0.003)


def test_a_ring_keeps_its_hole() -> None:
    ring = revolved([(0.01, 0), (0.015, 0), (0.015, 0.005), (0.01, 0.005)])
    assert not is_nearly_convex(ring, 0.003)
    assert not is_nearly_convex(ring, 0.0095)
    assert is_nearly_convex(ring, 0.0101)


def test_a_void_behind_a_narrow_neck_is_no_screw_hole() -> None:
    bottle = lathed(
        [(0, 0), (0.02, 0), (0.02, 0.06), (5e-4, 0.06), (5e-4, 0.04), (4e-3, 0.04), (4e-3, 0.03), (0, 0.03)]
    )
    assert not is_nearly_convex(bottle, 0.002)
    assert not is_nearly_convex(bottle, 0.0035)
    corners, faces = sphere_triangles(0.004, 24)
    box = cube(0.04)
    hollow = Mesh("hollow", *merge_surfaces([box, (corners, faces[:, ::-1].copy())]))
    assert not is_nearly_convex(hollow, 0.003)
    assert is_nearly_convex(hollow, 0.0042)
