"""Screw holes are filled and nothing else is; simpler meshes keep near the mesh."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from geomphys.scene.coverage import Surface
from geomphys.scene.meshes import Mesh
from geomphys.scene.screw_holes import hole_radius, screw_holes, simplified, without_screw_holes
from geomphys.scene.tessellation import sphere_triangles
from tests.scene.models import cube, ell
from tests.scene.test_convexity import cup, revolved


def washer(bore: float, height: float = 0.005) -> Mesh:
    """A disc of 15 mm radius with a bore."""
    return revolved([(bore, 0), (0.015, 0), (0.015, height), (bore, height)])


def polygon_area(radius: float, corners: int = 48) -> float:
    """Area of the regular polygon that `revolved` makes of a circle."""
    return 0.5 * corners * radius**2 * np.sin(2 * np.pi / corners)


def fork(gap: float) -> Mesh:
    """Two walls of 20 mm by 20 mm on a foot, with a gap between them, as wide all along."""
    x = np.array([-0.006 - gap, -gap / 2, gap / 2, 0.006 + gap])
    outline = [
        (x[0], 0),
        (x[3], 0),
        (x[3], 0.02),
        (x[2], 0.02),
        (x[2], 0.005),
        (x[1], 0.005),
        (x[1], 0.02),
        (x[0], 0.02),
    ]
    corners = np.array([[px, y, pz] for y in (0.0, 0.02) for px, pz in outline])
    cap = [(0, 1, 4), (0, 4, 5), (0, 5, 6), (0, 6, 7), (1, 2, 3), (1, 3, 4)]
    sides = [f for k in range(8) for f in ((k, k + 8, (k + 1) % 8), ((k + 1) % 8, k + 8, (k + 1) % 8 + 8))]
    faces = np.array([*cap, *((a + 8, c + 8, b + 8) for a, b, c in cap), *sides])
    mesh = Mesh("fork", corners, faces)
    return mesh if mesh.signed_volume > 0 else Mesh("fork", corners, faces[:, ::-1].copy())


def test_a_through_hole_becomes_solid() -> None:
    mesh = washer(0.0012)
    (points,) = screw_holes(mesh, 0.0016)
    assert len(points) == 96
    assert np.hypot(points[:, 0], points[:, 1]).max() == pytest.approx(0.0012)
    filled = without_screw_holes(mesh, 0.0016)
    assert filled.is_watertight
    assert filled.signed_volume == pytest.approx(0.005 * polygon_area(0.015), rel=1e-6)


def test_a_blind_hole_becomes_solid() -> None:
    mesh = cup(0.0012, 0.01)
    assert mesh.signed_volume < without_screw_holes(mesh, 0.0016).signed_volume
    assert without_screw_holes(mesh, 0.0016).signed_volume == pytest.approx(0.06 * polygon_area(0.02), rel=1e-6)


def test_wider_holes_stay() -> None:
    for mesh in (washer(0.0018), cup(0.0018), washer(0.01), cup(0.015)):
        assert screw_holes(mesh, 0.0016) == []
        assert without_screw_holes(mesh, 0.0016) is mesh
    assert len(screw_holes(washer(0.0018), 0.0019)) == 1


def test_room_between_walls_and_corners_stay() -> None:
    for gap in (0.001, 0.002, 0.003):
        assert fork(gap).is_watertight
        assert screw_holes(fork(gap), 0.0016) == []
    corners, faces = ell()
    for scale in (0.01, 0.1, 1.0):
        assert screw_holes(Mesh("ell", scale * corners, faces), 0.0016) == []
    assert screw_holes(Mesh("cube", *cube(0.001)), 0.0016) == []


def test_which_holes_are_filled() -> None:
    assert hole_radius(1e-3) == pytest.approx(1.6e-3)
    assert hole_radius(0.5e-3) == pytest.approx(0.8e-3)
    assert hole_radius(1.3e-3) == pytest.approx(1.6e-3)
    assert hole_radius(5e-3) == pytest.approx(5e-3)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-4, 1e-3])
def test_a_simpler_mesh_keeps_near_the_mesh(tolerance: float) -> None:
    corners, faces = sphere_triangles(0.02, 96)
    stretched = corners * [1.0, 0.7, 1.4] + [0.3, 0.0, -0.1]
    mesh = Mesh("egg", stretched, faces)
    simple = simplified(mesh, tolerance)
    assert simple.is_watertight
    assert len(simple.faces) < (0.95 if tolerance < 1e-4 else 0.7) * len(mesh.faces)
    random = np.random.default_rng(3)
    for here, there in ((mesh, simple), (simple, mesh)):
        weights = random.dirichlet([1.0, 1.0, 1.0], 3000)
        triangles = here.vertices[here.faces[random.integers(0, len(here.faces), 3000)]]
        points = np.vstack([here.vertices, np.einsum("nk,nkj->nj", weights, triangles)])
        assert Surface(there.vertices, there.faces).distance(points).max() <= tolerance
    again = simplified(mesh, tolerance)
    assert np.array_equal(again.vertices, simple.vertices)
    assert np.array_equal(again.faces, simple.faces)


def test_a_box_of_many_triangles_is_a_box_again() -> None:
    grid = np.linspace(0.0, 0.05, 12)
    corners, faces = [], []
    for axis, side in product(range(3), (0, 1)):
        first = len(corners)
        for a, b in product(grid, grid):
            corners.append(np.roll([0.05 * side, a, b], axis))
        for i, j in product(range(11), range(11)):
            k = first + 12 * i + j
            quad = (k, k + 12, k + 13, k + 1) if side else (k, k + 1, k + 13, k + 12)
            faces += [(quad[0], quad[1], quad[2]), (quad[0], quad[2], quad[3])]
    from geomphys.scene.meshes import merge_vertices

    simple = simplified(merge_vertices("box", np.array(corners), np.array(faces)), 1e-6)
    assert simple.signed_volume == pytest.approx(0.05**3)
    assert len(simple.faces) == 12
