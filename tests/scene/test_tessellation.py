"""Triangles of primitives: closed, wound outwards, corners on the surface."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.scene.meshes import Mesh
from geomphys.scene.tessellation import (
    box_triangles,
    capsule_triangles,
    cylinder_triangles,
    merge_surfaces,
    sphere_triangles,
    triangulate_faces,
)

SHAPES = {
    "box": box_triangles((0.1, 0.2, 0.3)),
    "sphere": sphere_triangles(0.4, 24),
    "cylinder": cylinder_triangles(0.2, 0.5, 24),
    "capsule": capsule_triangles(0.2, 0.5, 24),
}


@pytest.mark.parametrize("name", SHAPES)
def test_closed_convex_and_wound_outwards(name: str) -> None:
    mesh = Mesh(name, *SHAPES[name])
    assert mesh.is_watertight
    assert mesh.has_consistent_winding
    assert mesh.signed_volume > 0
    assert mesh.is_convex


def test_corners_lie_on_the_surface() -> None:
    np.testing.assert_allclose(np.linalg.norm(SHAPES["sphere"][0], axis=1), 0.4, rtol=1e-14)
    x, y, z = SHAPES["cylinder"][0].T
    assert np.all(np.isclose(np.hypot(x, y), 0.2) | np.isclose(np.abs(z), 0.25))
    x, y, z = SHAPES["capsule"][0].T
    axial = np.clip(z, -0.25, 0.25)
    np.testing.assert_allclose(np.sqrt(x * x + y * y + (z - axial) ** 2), 0.2, rtol=1e-14)


def test_joined_surfaces_keep_their_triangles() -> None:
    vertices, faces = merge_surfaces([SHAPES["box"], SHAPES["sphere"]])
    assert len(vertices) == 8 + len(SHAPES["sphere"][0])
    assert np.array_equal(vertices[faces[12:]], SHAPES["sphere"][0][SHAPES["sphere"][1]])
    assert merge_surfaces([])[1].shape == (0, 3)


def test_faces_are_cut_into_fans() -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    loops = np.array([9, 9, 9, 0, 1, 2, 3, 3, 2, 0])  # the rows of another solid come first
    assert triangulate_faces(square, loops, np.array([3, 7, 10]))[1].tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 0]]
