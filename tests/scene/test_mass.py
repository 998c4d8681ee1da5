"""Masses and inertias: primitives against their tessellations, meshes against closed forms, laws of the tensor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geomphys.numerics.transforms import rotation_from_quaternion
from geomphys.scene import mass
from geomphys.scene.mass import MassProperties
from geomphys.scene.tessellation import (
    box_triangles,
    capsule_triangles,
    cylinder_triangles,
    sphere_triangles,
)


def pose(vector: list[float], position: list[float]) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    matrix[:3, 3] = position
    return matrix


def close(a: MassProperties, b: MassProperties, rtol: float) -> None:
    assert a.mass == pytest.approx(b.mass, rel=rtol)
    np.testing.assert_allclose(a.com, b.com, atol=rtol)
    np.testing.assert_allclose(a.inertia, b.inertia, atol=rtol * np.abs(b.inertia).max())


def test_a_box_mesh_has_the_mass_of_the_box() -> None:
    size = (0.1, 0.2, 0.5)
    close(mass.of_mesh(*box_triangles(size), 700.0), mass.of_box(size, 700.0), 1e-14)
    assert mass.of_box(size, 700.0).mass == pytest.approx(7.0)
    assert mass.of_box(size, 700.0).inertia[2, 2] == pytest.approx(7.0 / 12 * (0.01 + 0.04))


@pytest.mark.parametrize(
    ("exact", "tessellated"),
    [
        (mass.of_sphere(0.3, 900.0), lambda n: sphere_triangles(0.3, n)),
        (mass.of_cylinder(0.2, 0.7, 900.0), lambda n: cylinder_triangles(0.2, 0.7, n)),
        (mass.of_capsule(0.2, 0.7, 900.0), lambda n: capsule_triangles(0.2, 0.7, n)),
    ],
    ids=["sphere", "cylinder", "capsule"],
)
def test_tessellations_approach_the_closed_forms(exact: MassProperties, tessellated) -> None:
    coarse, fine = (mass.of_mesh(*tessellated(n), 900.0) for n in (64, 128))
    assert exact.mass > fine.mass > coarse.mass  # corners lie on the surface: the tessellation is inside
    # the error falls with the square of the segments: extrapolation comes close to the closed form
    for of in (lambda p: p.mass, lambda p: p.inertia[0, 0], lambda p: p.inertia[2, 2]):
        limit = (4 * of(fine) - of(coarse)) / 3
        assert limit == pytest.approx(of(exact), rel=1e-5)
    np.testing.assert_allclose(fine.com, 0.0, atol=1e-14)


def test_textbook_moments() -> None:
    ball, rod = mass.of_sphere(0.5, 10.0), mass.of_cylinder(0.1, 2.0, 5.0)
    assert ball.mass == pytest.approx(10.0 * 4 / 3 * math.pi * 0.125)
    assert ball.inertia[1, 1] == pytest.approx(0.4 * ball.mass * 0.25)
    assert rod.inertia[2, 2] == pytest.approx(0.5 * rod.mass * 0.01)
    assert rod.inertia[0, 0] == pytest.approx(rod.mass * (3 * 0.01 + 4.0) / 12)


def test_a_capsule_without_a_tube_is_a_ball() -> None:
    close(mass.of_capsule(0.25, 1e-9, 1000.0), mass.of_sphere(0.25, 1000.0), 1e-7)


def test_a_tetrahedron() -> None:
    """Corners 0, a, b, c on the axes: m = ρ abc / 6, centre at a quarter, I_xx = m (b² + c²) / 10 about the origin."""
    a, b, c = 0.3, 0.5, 0.7
    corners = np.array([[0, 0, 0], [a, 0, 0], [0, b, 0], [0, 0, c]], dtype=float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    solid = mass.of_mesh(corners, faces, 100.0)
    m = 100.0 * a * b * c / 6
    assert solid.mass == pytest.approx(m, rel=1e-14)
    np.testing.assert_allclose(solid.com, np.array([a, b, c]) / 4, rtol=1e-14)
    about_origin = m * (b * b + c * c) / 10 - m * (b * b + c * c) / 16
    assert solid.inertia[0, 0] == pytest.approx(about_origin, rel=1e-13)
    assert solid.inertia[0, 1] == pytest.approx(-m * a * b / 20 + m * a * b / 16, rel=1e-12)


def test_triangles_wound_inwards_give_the_same_solid() -> None:
    corners, faces = box_triangles((0.1, 0.2, 0.5))
    close(mass.of_mesh(corners, faces[:, ::-1], 3.0), mass.of_mesh(corners, faces, 3.0), 1e-14)


def test_far_from_the_origin_nothing_is_lost() -> None:
    corners, faces = box_triangles((0.1, 0.2, 0.5))
    far = mass.of_mesh(corners + np.array([300.0, -200.0, 100.0]), faces, 1000.0)
    np.testing.assert_allclose(far.inertia, mass.of_box((0.1, 0.2, 0.5), 1000.0).inertia, atol=1e-9)
    np.testing.assert_allclose(far.com, [300.0, -200.0, 100.0], rtol=1e-13)


def test_halves_make_the_whole() -> None:
    left = mass.of_box((0.2, 0.3, 0.4), 800.0).transformed(pose([0, 0, 0], [-0.1, 0, 0]))
    right = mass.of_box((0.2, 0.3, 0.4), 800.0).transformed(pose([math.pi, 0, 0], [0.1, 0, 0]))
    close(mass.combined([left, right]), mass.of_box((0.4, 0.3, 0.4), 800.0), 1e-14)


def test_a_moved_solid_is_the_moved_mesh() -> None:
    corners, faces = box_triangles((0.1, 0.2, 0.5))
    matrix = pose([0.3, -1.0, 0.5], [1.0, 2.0, 3.0])
    transformed = mass.of_box((0.1, 0.2, 0.5), 500.0).transformed(matrix)
    close(transformed, mass.of_mesh(corners @ matrix[:3, :3].T + matrix[:3, 3], faces, 500.0), 1e-12)


def test_principal_axes_rebuild_the_tensor() -> None:
    solid = mass.of_box((0.1, 0.2, 0.5), 500.0).transformed(pose([0.3, -1.0, 0.5], [0, 0, 0]))
    moments, q = solid.principal()
    axes = rotation_from_quaternion(q)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, solid.inertia, atol=1e-13)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.all(np.diff(moments) >= 0)
    assert moments[0] + moments[1] >= moments[2]


@pytest.mark.parametrize(
    "solid", [mass.of_sphere(0.1, 5.0), mass.of_box((1, 2, 3), 5.0), mass.of_mesh(*box_triangles((3, 2, 1)), 5.0)]
)
def test_axes_of_the_frame_are_kept_where_they_are_principal(solid: MassProperties) -> None:
    moments, q = solid.principal()
    assert q.tolist() == [0.0, 0.0, 0.0, 1.0]
    assert moments.tolist() == np.diag(solid.inertia).tolist()


def test_a_stated_mass_scales_the_inertia() -> None:
    solid = mass.of_box((0.1, 0.2, 0.5), 500.0).with_mass(2.0)
    close(solid, mass.of_box((0.1, 0.2, 0.5), 2.0 / 0.01), 1e-14)


def test_nothing_weighs_nothing() -> None:
    assert mass.combined([]).mass == 0.0
    moments, q = mass.combined([]).principal()
    assert moments.tolist() == [0, 0, 0]
    assert q.tolist() == [0, 0, 0, 1]
