"""Copies of a mesh, moved: found in whatever order they list corners and triangles, and cut once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from geomphys.scene import decomposition
from geomphys.scene.congruence import translation_between
from geomphys.scene.decomposition import decompose
from geomphys.scene.meshes import Mesh
from tests.scene.models import ell

OFFSET = np.array([0.3, -0.02, 1.1])


def moved(mesh: Mesh, rotation: NDArray[np.float64], seed: int = 3) -> Mesh:
    """The mesh rotated and moved by `OFFSET`, its corners and triangles in another order."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(mesh.vertices))
    rank = np.argsort(order)
    faces = np.roll(rank[mesh.faces], 1, axis=1)[rng.permutation(len(mesh.faces))]
    return Mesh("moved", (mesh.vertices @ rotation.T + OFFSET)[order], faces)


def test_a_copy_that_was_moved_is_found_with_its_offset() -> None:
    mesh = Mesh("ell", *ell())
    np.testing.assert_allclose(translation_between(mesh, moved(mesh, np.eye(3))), OFFSET, atol=1e-12)


@pytest.mark.parametrize("change", ["rotated", "mirrored", "larger"])
def test_what_is_no_moved_copy_is_not_taken_for_one(change: str) -> None:
    mesh = Mesh("ell", *ell())
    matrix = {"rotated": np.diag([-1.0, -1.0, 1.0]), "mirrored": np.diag([-1.0, 1.0, 1.0]), "larger": 1.001 * np.eye(3)}
    assert translation_between(mesh, moved(mesh, matrix[change])) is None


def test_a_mesh_of_two_copies_is_cut_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decomposition, "user_cache_folder", lambda name: tmp_path)
    cuts, cut = [], decomposition.convex_parts
    monkeypatch.setattr(decomposition, "convex_parts", lambda *a, **k: (cuts.append(a), cut(*a, **k))[1])
    corners, faces = ell()
    two = Mesh("two", np.vstack([corners, corners + OFFSET]), np.vstack([faces, np.asarray(faces) + len(corners)]))
    hulls = decompose(two).hulls
    assert len(cuts) == 1
    half = len(hulls) // 2
    for first, second in zip(hulls[:half], hulls[half:], strict=True):
        np.testing.assert_allclose(second, first + OFFSET, atol=1e-12)
