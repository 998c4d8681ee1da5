"""A new convex shape takes five files: a copy of the package with a cone reads, measures, collides and draws it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import geomphys
from tests.cli.press import SCENE, write_log
from tests.house.cone import ADDED, package_with_cone

URDF = """<robot name="hat"><link name="hat"><visual><geometry><cone radius="0.1" length="0.2"/></geometry></visual>
<collision><origin xyz="0 0 1"/><geometry><cone radius="0.1" length="0.2"/></geometry></collision></link></robot>"""

HAT = """
[[object]]
name = "hat"
class = "simulated"
cone = [0.1, 0.2]
position = [0.3, 0, 0.101]
density = 1000
"""

DEFINED = """
import sys
from pathlib import Path
import numpy as np
from geomphys.errors import MeshError, SceneError
from geomphys.output.urdf_description import urdf_for_viewers, urdf_of_objects
from geomphys.scene.body_geometry import GeometryLoader
from geomphys.scene.mass import of_mesh
from geomphys.scene.primitives import PrimitiveShape
from geomphys.scene.scene_file import load_scene_file
from geomphys.scene.urdf_file import read_urdf

scene, urdf = map(Path, sys.argv[1:])
table = load_scene_file(scene).object[2]
assert table.primitive == PrimitiveShape("cone", (0.1, 0.2))
[(shape, pose)] = read_urdf(urdf).links[0].collisions
assert shape == table.primitive and pose[2, 3] == 1.0
body = GeometryLoader(seed=0).body_geometry([(shape, np.eye(4))], "auto", "hat")
close = of_mesh(*body.triangles, 1.0)
assert abs(body.mass.mass / close.mass - 1.0) < 1e-3
assert np.allclose(body.mass.com, close.com, atol=1e-5) and np.allclose(body.mass.inertia, close.inertia, rtol=2e-3)
colour = (1, 2, 3, 255)
for text in (urdf_of_objects("objects", [table], None, {"hat": colour}), urdf_for_viewers(urdf, {}, colour)):
    assert text.count("<cylinder") == 8 and "<cone" not in text
for wrong in ('length="0"', 'size="1"'):
    urdf.write_text(urdf.read_text().replace('length="0.2"', wrong))
    try:
        read_urdf(urdf)
    except Exception as error:
        assert "cone" in str(error), error
    else:
        raise AssertionError(wrong)
"""

COLLIDES = """
import numpy as np
from geomphys.collision.query import outline, query
from geomphys.scene.pieces import Box, Cone, Cylinder, Hull, PosedShape, Sphere, build_pieces
from geomphys.scene.tessellation import surface_of_revolution
from scipy.spatial.transform import Rotation

rng = np.random.default_rng(1)
cone, rim = Cone(0.1, 0.1), surface_of_revolution(np.array([0.0, 0.1, 0.0]), np.array([-0.1, -0.1, 0.1]), 360)[0]
hull = Hull(rim)
for other in (Box((0.1, 0.05, 0.08)), Sphere(0.07), Cylinder(0.05, 0.1), Hull(rng.normal(size=(12, 3)) * 0.1), cone):
    for _ in range(20):
        a, b = np.eye(4), np.eye(4)
        a[:3, :3], b[:3, :3] = Rotation.random(2, rng).as_matrix()
        b[:3, 3] = rng.normal(size=3) * 0.1
        twin = hull if other is cone else other
        found, close = query(cone, a, other, b), query(hull, a, twin, b)
        assert abs(found.separation - close.separation) < 1e-5, (other, found.separation, close.separation)
pieces = build_pieces([PosedShape(cone, np.eye(4), 0)])
assert np.allclose([outline(pieces, 0).min(axis=0), outline(pieces, 0).max(axis=0)], [[-0.1] * 3, [0.1] * 3], atol=1e-3)
"""

STANDS = """
import sys
from pathlib import Path
import numpy as np
import geomphys

folder = Path(sys.argv[1])
index = geomphys.load_world(folder / "scene.toml").body_names.index("hat")
results = list(geomphys.replay(folder / "log.mcap", folder / "scene.toml"))
hat, contacts = results[-1].corrected[index], results[-1].contacts
assert abs(hat[2] - 0.1) < 1e-4 and np.linalg.norm(hat[:2] - [0.3, 0.0]) < 1e-4 and abs(hat[6]) > 1.0 - 1e-6, hat
assert ((contacts.body_a == index) | (contacts.body_b == index)).sum() >= 3
"""


def run(code: str, package: Path, *arguments: Path) -> None:
    """Run code with a package in front of all others."""
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(package.parent)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return package_with_cone(Path(geomphys.__file__).parent, tmp_path_factory.mktemp("cone"))


def test_a_cone_is_five_files(package: Path, tmp_path: Path) -> None:
    assert len(ADDED) <= 5
    (tmp_path / "scene.toml").write_text(SCENE + HAT)
    (tmp_path / "hat.urdf").write_text(URDF)
    run(DEFINED, package, tmp_path / "scene.toml", tmp_path / "hat.urdf")


@pytest.mark.slow
def test_the_cone_collides_as_a_fine_hull_does(package: Path) -> None:
    run(COLLIDES, package)


@pytest.mark.slow
def test_the_cone_stands_on_a_floor(package: Path, tmp_path: Path) -> None:
    write_log(tmp_path / "log.mcap", frames=60)
    (tmp_path / "scene.toml").write_text(SCENE + HAT)
    run(STANDS, package, tmp_path)
