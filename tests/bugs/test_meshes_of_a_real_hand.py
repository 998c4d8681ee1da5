"""Meshes with holes were told one at a time, a cup of two shells that touch was refused, millimetres were not noticed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from geomphys.errors import MeshError
from geomphys.load import load_world
from tests.scene.models import ball, cube, ell, joint, link, stl, urdf
from tests.zoo import through_all

MESH = '<geometry><mesh filename="{}"/></geometry>'


def hand(folder: Path, how: str = "auto") -> Path:
    corners, faces = ell()
    for name in ("one", "two"):
        stl(folder / f"{name}.stl", corners, faces[1:])
    stl(folder / "good.stl", corners, faces)
    urdf(
        folder / "hand.urdf",
        *(
            link(name, MESH.format(f"{mesh}.stl"))
            for name, mesh in (("a", "one"), ("b", "two"), ("c", "good"), ("d", "two"))
        ),
        *(joint(f"j{name}", "a", name) for name in "bcd"),
    )
    (folder / "scene.toml").write_text(f'[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\ndecomposition = "{how}"\n')
    return folder / "scene.toml"


def test_all_meshes_with_holes_are_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(MeshError) as caught:
        load_world(hand(tmp_path))
    message = str(caught.value)
    assert "hand.urdf: 3 of 4 collision meshes are neither watertight nor convex" in message
    assert "one.stl (a); two.stl (b, d)" in message
    assert 'decomposition = "hull"' in message
    assert "good.stl" not in message
    load_world(hand(tmp_path, "hull"))


def test_all_missing_meshes_are_told_at_once(tmp_path: Path) -> None:
    scene = hand(tmp_path)
    for name in ("one", "two"):
        (tmp_path / f"{name}.stl").unlink()
    with pytest.raises(
        MeshError, match=r"3 of 4 collision meshes are not there: .*one\.stl \(a\); .*two\.stl \(b, d\)"
    ):
        load_world(scene)


def test_init_writes_the_hull_for_them(tmp_path: Path) -> None:
    hand(tmp_path)
    assert 'decomposition = "hull"' in through_all(tmp_path / "hand.urdf", tmp_path).scene


def test_a_cup_of_two_shells_that_touch_is_replayed(tmp_path: Path) -> None:
    """Two L's back to back, as a modeller joins a cup and its handle: trimesh calls their union no volume."""
    import trimesh

    corners, faces = ell()
    both = np.concatenate([corners, corners * [-1, -1, 1]])  # they share the edge at the origin
    path = stl(tmp_path / "cup.stl", both, np.concatenate([faces, faces + len(corners)]))
    assert not trimesh.load(path).is_volume
    model = urdf(
        tmp_path / "hand.urdf",
        link("palm", MESH.format("cup.stl")),
        ball("tip"),
        joint("j", "palm", "tip", xyz="0 0 0.5"),
    )
    outcome = through_all(model, tmp_path)
    assert 'decomposition = "hull"' not in outcome.scene
    world = load_world(tmp_path / "made.toml")
    assert world.scene.bodies.mass[0] == pytest.approx(1000.0 * 0.006, rel=1e-5)
    assert outcome.audit["same_world"]


def test_a_mesh_in_millimetres_is_told_with_the_remedy(tmp_path: Path) -> None:
    stl(tmp_path / "mug.stl", *cube(45.0))
    (tmp_path / "scene.toml").write_text('[[object]]\nname = "mug"\nclass = "fixed"\nmesh = "mug.stl"\n')
    (line,) = load_world(tmp_path / "scene.toml").findings.warnings
    assert "'mug' is 90 m long" in line
    assert "millimetres, say scale = 0.001" in line
