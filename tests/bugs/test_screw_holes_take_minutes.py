"""A bracket with screw holes was cut into a hundred pieces for a minute, a smooth finger of many triangles nearly as long."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geomphys.scene import coacd_process, decomposition
from geomphys.scene.coverage import piece_protrusion
from geomphys.scene.decomposition import decompose
from geomphys.scene.meshes import Mesh, merge_vertices

Solid = manifold3d.Manifold


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of the test's own."""
    monkeypatch.setattr(decomposition, "user_cache_folder", lambda name: tmp_path)


def mesh_of(name: str, solid: manifold3d.Manifold) -> Mesh:
    made = solid.to_mesh64()
    return merge_vertices(name, np.array(made.vert_properties)[:, :3], np.array(made.tri_verts).astype(np.int64))


def bracket() -> Mesh:
    """A U of 3 mm walls, 36 mm by 30 mm by 40 mm, with eight holes for M2.5 and M3 screws."""
    solid = Solid.cube((0.036, 0.03, 0.04), True) - Solid.cube((0.03, 0.05, 0.034), True).translate((0, 0, 0.006))
    for x in (-0.01, 0.01):
        for y in (-0.008, 0.008):
            solid = solid - Solid.cylinder(0.02, 0.00125, 0.00125, 24, True).translate((x, y, -0.018))
    for z in (0.0, 0.012):
        solid = solid - Solid.cylinder(0.06, 0.0015, 0.0015, 24, True).rotate((0, 90, 0)).translate((0, 0, z))
    return mesh_of("bracket", solid)


def test_a_bracket_is_its_walls() -> None:
    mesh = bracket()
    pieces = decompose(mesh)
    assert pieces.method == "coacd"
    assert len(pieces.hulls) <= 6
    assert pieces.uncovered_m == 0.0
    concavity = 0.5 * pieces.threshold * mesh.size
    assert piece_protrusion(mesh.vertices, mesh.faces, pieces.hulls) <= 1.6 * concavity
    assert sum(ConvexHull(h).volume for h in pieces.hulls) < 1.1 * mesh.signed_volume
    middle = np.array([0.0, 0.0, 0.004])  # between the walls
    assert not any(_holds(corners, middle) for corners in pieces.hulls)


def _holds(corners: np.ndarray, point: np.ndarray) -> bool:
    planes = ConvexHull(corners).equations
    return bool(np.all(planes[:, :3] @ point + planes[:, 3] <= 0))


def test_a_finger_with_screw_holes_is_its_hull(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: pytest.fail("CoACD was started"))
    ball = Solid.sphere(0.011, 128)
    finger = Solid.batch_hull([ball, ball.translate((0, 0, 0.02))]).trim_by_plane((0, 1, 0), -0.006)
    for z in (0.0, 0.02):
        finger = finger - Solid.cylinder(0.012, 0.0012, 0.0012, 32, True).rotate((90, 0, 0)).translate((0, -0.004, z))
    pieces = decompose(mesh_of("finger", finger))
    assert (pieces.method, len(pieces.hulls)) == ("hull", 1)
