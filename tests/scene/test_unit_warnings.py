"""Lengths that are probably not metres."""

from __future__ import annotations

from pathlib import Path

import pytest

from geomphys.load import load_world
from tests.scene.models import cube, stl, urdf

MESH = '<link name="{0}"><{1}><geometry><mesh filename="cube.stl"{2}/></geometry></{1}></link>'


def warnings(folder: Path, text: str) -> tuple[str, ...]:
    stl(folder / "cube.stl", *cube())
    (folder / "scene.toml").write_text(text)
    return load_world(folder / "scene.toml").findings.warnings


def thing(shape: str, kind: str = "fixed") -> str:
    return f'[[object]]\nname = "thing"\nclass = "{kind}"\n{shape}\n'


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            thing('mesh = "cube.stl"\nscale = 90.0'),
            "thing' is 90 m long; .* cube.stl is in millimetres, say scale = 0.09",
        ),
        (thing('mesh = "cube.stl"\nscale = 0.0001'), "thing' is 0.1 mm long; .*check scale .scale = 0.0001 is applied"),
        (thing("box = [500.0, 300.0, 20.0]"), "500 m long; .*if its box is in millimetres, divide it by 1000"),
        (thing("sphere = 40.0", "simulated"), "80 m long; .*if its sphere is in millimetres"),
        (thing("box = [0.0003, 0.0003, 0.0001]"), "0.3 mm long"),
    ],
)
def test_an_object_in_another_unit_is_told(tmp_path: Path, text: str, says: str) -> None:
    import re

    (line,) = warnings(tmp_path, text)
    assert re.search(says, line), line
    assert "metres" in line


@pytest.mark.parametrize(
    "text",
    [
        thing("box = [20.0, 20.0, 0.1]"),  # a floor
        thing("box = [0.01, 5.0, 2.5]"),
        thing('mesh = "cube.stl"'),
        thing('mesh = "cube.stl"\nscale = 0.001', "simulated"),
    ],
)
def test_what_may_well_be_metres_is_not_told(tmp_path: Path, text: str) -> None:
    assert warnings(tmp_path, text) == ()


def test_a_scale_of_one_says_that_a_mesh_is_in_metres(tmp_path: Path) -> None:
    vertices, faces = cube()
    stl(tmp_path / "hall.stl", 20.0 * vertices, faces)
    (line,) = warnings(tmp_path, thing('mesh = "hall.stl"'))
    assert line.endswith("say scale = 0.001, and if in metres scale = 1")
    assert warnings(tmp_path, thing('mesh = "hall.stl"\nscale = 1')) == ()


@pytest.mark.parametrize("kind", ["visual", "collision"])
def test_links_of_a_model_are_told_together(tmp_path: Path, kind: str) -> None:
    ball = '<link name="c"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>'
    joints = "".join(
        f'<joint name="j{c}" type="fixed"><parent link="c"/><child link="{c}"/></joint>' for c in ("a", "b")
    )
    urdf(
        tmp_path / "hand.urdf",
        MESH.format("a", kind, ' scale="80 80 80"'),
        MESH.format("b", kind, ' scale="60 60 60"'),
        ball,
        joints,
    )
    (line,) = warnings(tmp_path, '[[avatar]]\nname = "hand"\nurdf = "hand.urdf"\n')
    assert "hand.urdf: 2 links are more than 5 m long, 'a' 80 m; lengths are in metres" in line
    assert 'scale="0.001 0.001 0.001"' in line
