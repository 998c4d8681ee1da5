"""A body in primitives: they hold its pieces, fit tightly, and are the same whatever rounding says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from lxml import etree
from trimesh.transformations import euler_matrix

from geomphys.load import load_world
from geomphys.output.primitive_fit import PlacedPrimitive, fitted_primitive, primitives_of_body
from geomphys.output.urdf_description import descriptions, visual_of
from geomphys.scene.arrays import CAPSULE, HULL


def read_back(shape: PlacedPrimitive) -> tuple[str, list[float], np.ndarray]:
    """Tag, lengths and pose of a primitive, read from its element of a URDF, by another library's Euler angles."""
    visual = visual_of(shape)
    (element,), origin = visual.find("geometry"), visual.find("origin")
    lengths = [float(word) for text in element.attrib.values() for word in text.split()]
    matrix = euler_matrix(*map(float, origin.get("rpy").split()), axes="sxyz")
    matrix[:3, 3] = [float(word) for word in origin.get("xyz").split()]
    return element.tag, lengths, matrix


@pytest.mark.parametrize("turned", [(0.0, 0.0, 0.0), (0.3, -0.7, 1.9), (0.0, np.pi / 2, 0.4)])
@pytest.mark.parametrize(
    ("mesh", "tag", "excess"),
    [
        (trimesh.creation.box((0.1, 0.2, 0.4)), "box", 1.001),
        (trimesh.creation.cylinder(0.01, 0.1, sections=64), "cylinder", 1.01),
        (trimesh.creation.capsule(0.1, 0.01), None, 1.2),
        (trimesh.creation.icosahedron(), None, 2.5),
    ],
)
def test_the_fit_holds_all_points_and_not_much_more(
    mesh: trimesh.Trimesh, tag: str | None, excess: float, turned: tuple[float, float, float]
) -> None:
    matrix = euler_matrix(*turned)
    matrix[:3, 3] = 0.3, -0.2, 0.1
    points = mesh.copy().apply_transform(matrix).vertices
    shape = fitted_primitive(points)
    found, lengths, pose = read_back(shape)
    assert np.linalg.det(shape.body_from_shape[:3, :3]) == pytest.approx(1.0)
    local = trimesh.transform_points(points, np.linalg.inv(pose))
    if found == "box":
        beyond, volume = np.abs(local) - np.array(lengths) / 2, np.prod(lengths)
    else:
        radius, length = lengths
        beyond = np.array([np.hypot(*local[:, :2].T) - radius, np.abs(local[:, 2]) - length / 2])
        volume = np.pi * radius**2 * length
    assert beyond.max() < 5e-6
    if tag == "box" or not any(turned):
        assert tag in (None, found)
        assert volume <= excess * mesh.convex_hull.volume


def test_noise_of_rounding_changes_no_character() -> None:
    rng = np.random.default_rng(0)
    for mesh in (trimesh.creation.box((0.1, 0.1, 0.1)), trimesh.creation.cylinder(0.01, 0.1, sections=12)):
        points = mesh.apply_transform(euler_matrix(0.3, -0.7, 1.9)).vertices
        texts = {
            etree.tostring(visual_of(fitted_primitive(points + 1e-14 * rng.normal(size=points.shape))))
            for _ in range(20)
        }
        assert len(texts) == 1


def test_a_body_is_shown_by_its_pieces(root: Path) -> None:
    world = load_world(root / "assets/scenes/hand_mug.toml")
    pieces = world.scene.pieces
    for body in range(len(world.body_names)):
        start, stop = world.scene.bodies.piece_start[body : body + 2]
        shapes = primitives_of_body(world, body)
        assert len(shapes) == (stop - start) + 2 * np.count_nonzero(pieces.kind[start:stop] == CAPSULE)
    assert HULL in pieces.kind
    for text in descriptions(world).values():
        assert "mesh" not in text
        assert str(root) not in text
