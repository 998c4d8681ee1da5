"""Meshes of several closed shells, apart, touching in a corner, an edge or a face, one within another, inside out."""

from __future__ import annotations

import numpy as np
import pytest

from geomphys.errors import MeshError
from geomphys.scene.decomposition import decompose
from geomphys.scene.meshes import Mesh, merge_vertices, oriented_outwards, require_closed
from geomphys.scene.shells import shell_labels
from tests.scene.models import cube, ell


def together(*parts: tuple[np.ndarray, np.ndarray]) -> Mesh:
    """One mesh of several, equal vertices merged."""
    starts = np.cumsum([0, *(len(v) for v, _ in parts)])
    vertices = np.concatenate([v for v, _ in parts])
    return merge_vertices("thing", vertices, np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=False)]))


def at(shift: tuple[float, float, float], half: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    corners, faces = cube(half)
    return corners + shift, faces


def inside_out(part: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return part[0], part[1][:, ::-1]


TOUCHING = {
    "a corner": (1.0, 1.0, 1.0),
    "an edge": (1.0, 1.0, 0.0),
    "a face": (1.0, 0.0, 0.0),
    "half a face": (1.0, 0.5, 0.0),
    "nothing": (3.0, 0.0, 0.0),
}


@pytest.mark.parametrize("shift", TOUCHING.values(), ids=TOUCHING.keys())
def test_two_cubes_come_apart_however_they_touch(shift: tuple[float, float, float]) -> None:
    mesh = together(at((0, 0, 0)), at(shift))
    assert mesh.is_closed
    require_closed(mesh)
    shells = mesh.shells()
    assert len(shells) == 2
    for shell in shells:
        assert shell.is_watertight
        assert shell.is_convex
        assert shell.signed_volume == pytest.approx(1.0)
    assert np.allclose(shells[1].vertices.mean(axis=0), shift)


def test_the_faces_of_a_row_of_cubes_go_to_their_own_cube() -> None:
    mesh = together(*(at((k, 0, 0)) for k in range(4)))
    assert [len(shell.faces) for shell in mesh.shells()] == [12] * 4
    assert decompose(mesh).method == "hull"  # as a whole it is a convex beam


def test_four_cubes_about_one_edge() -> None:
    mesh = together(at((0, 0, 0)), at((1, 0, 0)), at((0, 1, 0)), at((1, 1, 0)))
    assert sorted(round(float(s.signed_volume), 9) for s in mesh.shells()) == [1.0] * 4


def test_touching_shells_become_their_pieces() -> None:
    mesh = together(at((0, 0, 0)), at((1, 1, 0)), at((1, 0, 0)))
    pieces = decompose(mesh)
    assert pieces.method == "parts"
    assert [len(hull) for hull in pieces.hulls] == [8, 8, 8]


def test_a_shell_that_touches_itself_stays_one() -> None:
    """Two hooks whose ends meet."""
    corners, faces = ell()
    turned = corners * [-1, -1, 1]
    mesh = together((corners, faces), (turned + np.array([0.3, 0.3, 0.0]), faces))  # two hooks that meet
    assert mesh.is_closed
    assert sum(shell.signed_volume for shell in mesh.shells()) == pytest.approx(0.006)


def test_open_meshes_and_sheets_stay_refused() -> None:
    corners, faces = ell()
    assert shell_labels(corners, faces[1:]) is None
    opened = together((corners, faces), at((5, 0, 0)))
    holed = Mesh("holed", opened.vertices, opened.faces[1:])
    both = np.concatenate([faces[4:], faces[4:, ::-1]])  # an open shell with two sides
    for mesh in (holed, Mesh("sheet", corners, both)):
        assert not mesh.is_closed
        with pytest.raises(MeshError, match="neither watertight nor convex"):
            require_closed(mesh)


def test_three_sheets_at_an_edge_are_no_solid() -> None:
    vertices = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-1, 1, 0], [-1, -1, 0]], dtype=float)
    assert shell_labels(vertices, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])) is None


def test_a_shell_inside_out_beside_another_is_turned() -> None:
    mesh = together(at((0, 0, 0)), inside_out(at((3, 0, 0), half=0.4)))
    assert oriented_outwards(mesh).signed_volume == pytest.approx(1.0 + 0.8**3)
    pieces = decompose(mesh)
    assert pieces.method == "parts"
    assert len(pieces.hulls) == 2


def test_a_cavity_stays_one() -> None:
    mesh = together(at((0, 0, 0)), inside_out(at((0, 0, 0), half=0.4)))
    assert oriented_outwards(mesh).signed_volume == pytest.approx(1.0 - 0.8**3)
    turned = Mesh("turned", mesh.vertices, mesh.faces[:, ::-1])
    assert oriented_outwards(turned).signed_volume == pytest.approx(1.0 - 0.8**3)


def test_triangles_that_are_there_twice_count_once() -> None:
    mesh = together(at((0, 0, 0)), at((0, 0, 0)))
    assert len(mesh.faces) == 12
    assert mesh.is_watertight
    assert mesh.signed_volume == pytest.approx(1.0)
