"""What two scenes differ in, said in words."""

from __future__ import annotations

import pytest

from geomphys.analysis.diff.scene_words import scene_differences

SCENE = """
[scene]
name = "press"
gravity = [0.0, 0.0, -9.81]

[[object]]
name = "table"
class = "fixed"
box = [1.0, 1.0, 0.1]
position = [0.0, 0.0, -0.05]

[[avatar]]
name = "hand"
urdf = "hand.urdf"
coupling = { stiffness = 1000.0, damping = 40.0 }

[[avatar.chain]]
name = "index"
base = "palm"
tip = "index_distal"

[[material_pair]]
materials = ["rubber", "wood"]
friction = 0.9
"""


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("-0.05]", "-0.04]", "object table: position is [0, 0, -0.05] in a, [0, 0, -0.04] in b, 10 mm apart"),
        ("1.0, 0.1]", "1.0, 0.2]", "object table: box is [1, 1, 0.1] in a, [1, 1, 0.2] in b, 100 mm apart"),
        ("1000.0", "500.0", "avatar hand: coupling: stiffness is 1000 in a, 500 in b"),
        ("index_distal", "index_tip", 'avatar hand: chain index: tip is "index_distal" in a, "index_tip" in b'),
        ("friction = 0.9", "friction = 0.8", "material pair rubber/wood: friction is 0.9 in a, 0.8 in b"),
        ('class = "fixed"', 'class = "fixed"\nscale = 2', "object table: scale is 2 in b and not given in the other"),
        ('name = "press"\n', "", 'scene: name is "press" in a and not given in the other'),
        ("[[object]]", '[[object]]\nname = "lamp"\n[[object]]', "object lamp: only in b"),
        ('"hand.urdf"', '"../elsewhere/hand.urdf"', "the scene files differ in comments or their order only"),
        ("[scene]", "# a comment\n[scene]", "the scene files differ in comments or their order only"),
        ("[scene]", "[scene", "the scene files differ, and one of them is no TOML"),
    ],
)
def test_every_kind_of_change_is_said(old: str, new: str, said: str) -> None:
    assert old in SCENE
    changed = SCENE.replace(old, new, 1)
    assert scene_differences({"a.toml": SCENE.encode()}, {"b.toml": changed.encode()}) == (said,)


def test_files_are_compared_by_their_names_and_bytes() -> None:
    a = {
        "s.toml": b"",
        "hand.urdf": b"1",
        "meshes/0a/palm.obj": b"1",
        "meshes/0b/tip.obj": b"1",
        "attachments.json": b"1",
    }
    b = {
        "s.toml": b"",
        "hand.urdf": b"2",
        "meshes/1a/palm.obj": b"2",
        "meshes/0b/tip.obj": b"1",
        "attachments.json": b"2",
    }
    said = "hand.urdf, palm.obj: not the same file in both"
    assert scene_differences(a, b) == (said,)
    del b["meshes/0b/tip.obj"]
    assert scene_differences(a, b) == (said, "tip.obj: only in a")
    assert scene_differences(a, a) == ()


def test_an_output_without_a_scene_file_is_said() -> None:
    assert scene_differences({"s.toml": b""}, {}) == ("b has no scene file attached",)
