"""Housings with shafts are cut where the shafts stand on them, not into a dozen pieces by CoACD for three seconds."""

from __future__ import annotations

from pathlib import Path

import manifold3d
import numpy as np
import pytest
from scipy.spatial import ConvexHull

from geomphys.scene import coacd_process, decomposition
from geomphys.scene.coverage import piece_protrusion, uncovered_distance
from geomphys.scene.decomposition import decompose
from geomphys.scene.face_cuts import cut_along_faces
from geomphys.scene.meshes import Mesh
from tests.bugs.test_screw_holes_take_minutes import bracket, mesh_of
from tests.scene.models import cube

Solid = manifold3d.Manifold


def motor() -> Mesh:
    """A housing, 20 mm by 34 mm by 26 mm, with a shaft of many triangles on either side; turned, on no axis."""
    solid = Solid.cube((0.02, 0.034, 0.026), True)
    shaft = Solid.cylinder(0.008, 0.003, 0.003, 400)
    solid = solid + shaft.translate((0, 0.009, 0.0125)) + shaft.translate((0, 0.009, -0.0155))
    return mesh_of("motor", solid.rotate((20, 30, 40)))


def test_a_motor_is_its_housing_and_two_shafts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decomposition, "user_cache_folder", lambda name: tmp_path)
    monkeypatch.setattr(coacd_process, "_run_until_exit", lambda *_: pytest.fail("CoACD was started"))
    mesh = motor()
    pieces = decompose(mesh)
    volumes = sorted(ConvexHull(points).volume for points in pieces.hulls)
    disc = np.pi * 0.003**2
    assert volumes == pytest.approx([0.0025 * disc, 0.0075 * disc, 0.02 * 0.034 * 0.026], rel=0.01)
    assert pieces.uncovered_m == uncovered_distance(mesh.vertices, mesh.faces, pieces.hulls) == 0.0
    assert piece_protrusion(mesh.vertices, mesh.faces, pieces.hulls) <= 0.5 * pieces.threshold * mesh.size
    monkeypatch.setattr(decomposition, "user_cache_folder", lambda name: tmp_path / "again")
    again = decompose(mesh)
    assert not again.cached
    assert all(np.array_equal(a, b) for a, b in zip(pieces.hulls, again.hulls, strict=True))


def test_what_needs_many_cuts_or_none_is_left_to_coacd() -> None:
    assert cut_along_faces(bracket(), 1e-3) is None
    corners, faces = cube()
    assert cut_along_faces(Mesh("sheet", corners * [1.0, 1.0, 1e-12], faces), 1e-3) is None
    assert cut_along_faces(Mesh("cube", corners, faces), 1e-3) is None
